"""What is said of a verdict, word by word as an engineer would write it, for verdicts of every shape."""

import json
import math
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

sys.path.insert(0, str(Path(__file__).parent))

from verdicts import SHAPES, cause, curve, gain, verdict

from fieldagents import findings
from fieldmodels.diagnosis import diagnose
from fieldmodels.diagnosis.answer import how_sure, in_words
from fieldmodels.diagnosis.outcome import TOO_FEW
from fieldmodels.diagnosis.phrases import a, the
from fieldmodels.diagnosis.report import report_section
from fieldmodels.diagnosis.result import Share
from fieldmodels.effects import actuators, changes, forces, sensors
from fieldmodels.html import plain
from fieldmodels.registry import get_model, model_names
from fieldmodels.synthesis import synthesise

HEADLINES = {
    "one": "The simulation lacks an actuator delay.",
    "two": "The simulation lacks an actuator delay and Coulomb friction.",
    "three": "The simulation lacks an actuator delay, an elastic stop and Coulomb friction.",
    "a tie": "The simulation lacks either Coulomb friction or Stribeck friction.",
    "a tie with a curve": (
        "The simulation lacks either a sensor gain or an unlisted dependence of the position sensor on the "
        "position."
    ),
    "a tie with a force's curve": (
        "The simulation lacks either Coulomb friction or an unlisted force that depends on the velocity."
    ),
    "a tie with a value's curve": (
        "The simulation lacks either an actuator delay or an unlisted dependence of the actuator delay on "
        "the size of the rate of change of the velocity."
    ),
    "a tie with chance": (
        "The simulation lacks either an actuator delay or random changes of the actuator delay."
    ),
    "a tie and a name": (
        "The simulation lacks either Coulomb friction or Stribeck friction, and a constant force."
    ),
    "a name and a curve": "The simulation lacks an actuator delay, and something else.",
    "a curve": (
        "The simulation lacks something that no listed effect explains: it depends on the velocity and acts "
        "on the damping."
    ),
    "two curves": (
        "The simulation lacks 2 things that no listed effect explains: one depends on the velocity (by its "
        "sign alone), one on the position (only near the ends of its range)."
    ),
    "an unconfirmed curve": "The simulation may lack something that no listed effect explains.",
    "a name and an unconfirmed curve": "The simulation lacks an actuator delay. ",
    "a curve and an unconfirmed one": (
        "The simulation lacks something that no listed effect explains: it depends on the velocity and acts "
        "on the damping. With that curve"
    ),
    "a sensor's curve": (
        "The simulation lacks something that no listed effect explains: it depends on the position (repeats "
        "every 0.1 m) and acts on the position sensor."
    ),
    "nothing": "The simulation explains these data; nothing significant is missing.",
    "a sensor that wanders": (
        "The simulation explains these data, but the zero of the position sensor wanders by 0.00200 m (RMS) "
        "within a record."
    ),
    "a sign": "Check the columns first: the sign of force seems to be reversed (declare it as force=-force).",
    "unrelated": "There is no relation between command and response.",
}
CERTAINTIES = {
    "two": "It is practically certain that the simulation lacks an actuator delay and Coulomb friction.",
    "two, less certain": (
        "It is practically certain that the simulation lacks an actuator delay, and very likely that it "
        "lacks Coulomb friction."
    ),
    "a tie": (
        "It is practically certain that the simulation lacks either Coulomb friction or Stribeck friction. "
        "These data cannot tell the alternatives apart."
    ),
    "nothing": (
        "What depends on one measured signal would have shown from these sizes on: a missing force of "
        "0.031 N, an error of 0.0002 m in the position sensor and a change of 0.2 N s/m in the damping. What "
        "depends on nothing measured, on several signals at once, or acts seldom may add up to 0.0009 m to "
        "the predicted position and 0.03 m/s to the predicted velocity, white noise aside."
    ),
    "doubted": (
        "It is practically certain that the simulation lacks an actuator delay. Caution: these data hardly "
        "determine the mass and the damping; excite the machine more. Caution: the fit ended with the mass "
        "at the largest value allowed, 2.00 kg; the verdict and the extended simulation depend on that bound"
        ". A gyro bias may be missing, too, but these data cannot tell it from nothing."
    ),
    "an unconfirmed curve": (
        "Possible, but not confirmed by the test data: what depends on the velocity and acts on the damping."
    ),
    "a name and an unconfirmed curve": (
        "It is practically certain that the simulation lacks an actuator delay. A gyro bias may be missing, "
        "too, but these data cannot tell it from nothing. Possible, but not confirmed by the test data: what "
        "depends on the velocity and acts on the damping."
    ),
    "a curve and an unconfirmed one": (
        "Possible, but not confirmed by the test data: what depends on the position (only near the ends of "
        "its range)."
    ),
}
SUMMARIES = {
    "an unconfirmed curve": (
        "Something may be missing that no listed effect explains, and what it depends on is not certain. "
        "Nothing is named."
    ),
    "a name and an unconfirmed curve": "Missing: an actuator delay.",
    "a curve and an unconfirmed one": (
        "Something is missing that no listed effect explains: it depends on the velocity and acts on the "
        "damping. Nothing is named."
    ),
}


@pytest.mark.parametrize("shape", SUMMARIES)
def test_a_curve_that_the_test_data_contradict_is_possible_and_no_more(shape):
    diagnosis = SHAPES[shape]
    assert diagnosis.summary() == f"{SUMMARIES[shape]} {diagnosis.of_possible}"
    *_, last = diagnosis.to_json()["curves"]
    assert last["confirmed"] is False
    report = " ".join(plain(report_section(diagnosis, {}, "")))
    assert "but predicts the test data no better" in report


def test_of_several_stages_curves_the_one_that_is_found_is_stated():
    """Whichever comes first."""
    found = SHAPES["a curve and an unconfirmed one"]
    turned = replace(found, curves=found.curves[::-1])
    assert turned.unknown == found.unknown == found.curves[0]
    assert turned.summary().startswith(SUMMARIES["a curve and an unconfirmed one"])


@pytest.mark.every("shape", HEADLINES)
def test_the_answer_begins_with_what_is_wrong(shape):
    assert in_words(SHAPES[shape])[0].startswith(HEADLINES[shape])


@pytest.mark.parametrize(
    ("shape", "added"),
    [
        ("a curve", "With that curve, the error"),
        ("two curves", "With these curves, the error"),
        ("an uncertain curve", "With the curve that helps most, the error"),
    ],
)
def test_it_says_with_how_many_curves_the_error_falls(shape, added):
    assert added in " ".join(in_words(replace(SHAPES[shape], curve_effects={"x": {}})))


@pytest.mark.every("shape", CERTAINTIES)
def test_it_says_how_sure_that_is(shape):
    assert how_sure(SHAPES[shape]) == CERTAINTIES[shape]


def test_what_depends_on_a_recent_mean_may_be_stored():
    stored = verdict([], [curve("force", "", "memory of force over 0.5 s")])
    assert any("may be stored" in line for line in in_words(stored))
    assert not any("may be stored" in line for line in in_words(SHAPES["two curves"]))


def test_data_that_show_nothing_of_any_size_are_said_to():
    """Curves were tried, and none would have been found however large."""
    quiet = SHAPES["nothing"]
    blind = replace(quiet, seen=tuple(replace(one, size=math.inf, errors={}) for one in quiet.seen))
    assert TOO_FEW in how_sure(blind)
    assert TOO_FEW in blind.summary()
    assert TOO_FEW not in how_sure(quiet) + quiet.summary() + how_sure(replace(quiet, seen=()))


def test_a_place_of_which_nothing_would_have_shown_is_said():
    quiet = SHAPES["nothing"]
    force, sensor, damping = quiet.seen
    blind = replace(quiet, seen=(force, replace(sensor, size=math.inf, errors={}), damping))
    said = "An error in the position sensor would not have shown, whatever its size."
    assert said in blind.summary()
    assert "would not have shown" not in quiet.summary()


def test_where_two_stages_say_the_same_the_larger_size_is_said():
    """A wheel's error is one between command and wheel in one stage, and one on the ground in another."""
    quiet = SHAPES["nothing"]
    force, *others = quiet.seen
    for size in (0.4, math.inf):
        other = replace(force, size=size, errors={"position": 1.0} if size < 1.0 else {})
        twice = replace(quiet, seen=(force, *others, other))
        assert "0.031 N" not in twice.summary() + how_sure(twice)
        assert twice.to_json()["seen"][0]["size"] == 0.031


def test_what_anything_may_add_is_said_where_nothing_is_found():
    quiet = SHAPES["nothing"]
    assert quiet.to_json()["unseen"] == {"position": 9e-4, "velocity": 0.03}
    assert "may add up to 0.008 m to the predicted position" in SHAPES["nothing but noise"].summary()
    assert "9.00 · 10⁻⁴ m" in report_section(quiet, {}, "")
    named = replace(SHAPES["one"], gain=quiet.gain)
    assert named.unseen == named.to_json()["unseen"] == {}
    assert "may add" not in named.summary() + how_sure(named)


def test_of_many_outputs_those_are_said_first_of_which_it_is_most():
    quiet = SHAPES["nothing"]
    assert "velocity" in quiet.of_unseen(1)
    assert "position" not in quiet.of_unseen(1)


COUNTED = r"delay|gain|bias|lag|stop|force|curve|dead zone|spring|payload|slope|drift"


@pytest.mark.every("shape", SHAPES)
def test_every_sentence_is_a_sentence(shape, capsys):
    """Capital, end, articles, agreement; on the terminal, in the report, in a notebook and in the JSON."""
    found = SHAPES[shape]
    lines = [
        *in_words(found),
        found.summary(),
        found.to_json()["summary"],
        *plain(report_section(found, {}, "")),
    ]
    findings.show(json.loads(json.dumps(found.to_json())), Console(width=300), in_words(found))
    assert in_words(found)[0] in capsys.readouterr().out
    said = " ".join([*in_words(found), found.summary()])
    for line in in_words(found):
        assert re.match(r"[A-Z]", line), line
        assert line.endswith("."), line
    for line in lines:
        assert "  " not in line, line
        assert " ," not in line, line
        assert ".." not in line.replace("...", ""), line
    assert not re.search(r"\b(a) [aeio]|\ban [bcdfgjklmnpqrstvwxyz]|\b(a|an|the) (a|an|the)\b", said), said
    for words in re.findall(rf"\b(?:lacks|either|or|and) ((?:\w+ )*?(?:{COUNTED}))\b", said):
        assert re.search(r"\b(a|an|the|unlisted|missing|another|changes)\b", words), (words, said)


def test_every_effect_of_every_machine_has_its_article():
    names = {e.name for m in model_names() for e in get_model(m).effects}
    for place, library in (("actuator", actuators), ("", forces), ("sensor", sensors), ("gain", changes)):
        names |= {f"{place}_{kind}".strip("_") for kind in library.LIBRARY}
    read = {name: a(name) for name in names}
    expected = {
        "actuator_rate_limit": "an actuator rate limit", "one_sided_spring": "a one-sided spring",
        "unequal_wheels": "unequal wheels", "elastic_stop": "an elastic stop", "hysteresis": "hysteresis",
        "radar_position": "an error of the radar position", "yaw_slip": "yaw slip", "wind": "wind",
        "gravity": "an error of the gravity", "stribeck_friction": "Stribeck friction",
        "actuator_asymmetry": "an actuator asymmetry", "stiffness_drift": "a stiffness drift",
        "sensor_eccentricity": "a sensor eccentricity", "cubic_stiffness": "cubic stiffness",
    }  # fmt: skip
    assert {name: read[name] for name in expected} == expected
    for name, text in read.items():
        assert re.fullmatch(r"(an? )?[A-Za-z][A-Za-z -]*", text), name
        if text.startswith("an "):
            assert text[3] in "aeiou", text
    assert [the(name) for name in ("x", "time", "left_wheel")] == ["x", "time", "the left wheel"]


@pytest.mark.parametrize(
    ("percent", "shown"),
    [(80.0, "position: 80.0 %"), (-3.0, "– (the others make up"), (float("nan"), "– (it ex")],
)
def test_a_cause_that_gains_nothing_by_itself_shows_no_zero(percent, shown, capsys):
    """Beside a headline of 80 %: a dash that says why."""
    one = cause("actuator_delay")
    one = type(one)(**{**vars(one), "gain": Share(percent, (percent, percent))})
    found = verdict([one], gain={"position": gain()})
    findings.show(json.loads(json.dumps(found.to_json())), Console(width=300), in_words(found))
    printed = capsys.readouterr().out
    assert shown in printed
    assert findings.GAIN in printed


@pytest.fixture(scope="module")
def two_together():
    """A dead zone and a sensor's delay, of which the first one alone would explain little."""
    hidden = {"sensor_delay": {"delay": 0.04}, "actuator_dead_zone": {"width": 1.0}}
    rig = get_model("rig")
    return rig, hidden, [
        synthesise(
            rig, hidden, "mixed", duration=30.0, step=0.01, amplitude=8.0, rng=np.random.default_rng(seed),
            noise=True,
        )
        for seed in (1, 2)
    ]  # fmt: skip


@pytest.mark.nightly
def test_what_is_known_to_a_percent_is_practically_certain(two_together):
    rig, hidden, (train, test) = two_together
    found = diagnose(rig, [train], [test])
    assert {c.effect for c in found.causes} == set(hidden)
    for one in found.causes:
        (value,) = one.parameters.values()
        assert value.std < 0.01 * value.value
        assert one.chance < 1e-6
        assert one.chance <= one.p_value
    assert "practically certain that the simulation lacks an actuator dead zone and a sensor delay" in (
        how_sure(found)
    )
    assert found.to_json()["causes"][0]["chance"] == pytest.approx(found.causes[0].chance, rel=1e-4)


def test_a_cause_gains_what_its_absence_costs(two_together):
    """Errors with and without each from the simulations themselves, over windows.

    Each window starts from the state that fits it best, and the rest is not refitted without the cause, so
    that shares agree to some percent. Over the causes before it the first one would gain less.
    """
    rig, _, (train, test) = two_together
    found = diagnose(rig, [train], [test])
    for one in found.causes:
        others = [c for c in found.causes if c is not one]
        rest = replace(found, causes=tuple(others)) if others else found
        errors = []
        for which in (found, rest):
            run = which.predict(test)
            errors.append(float(np.sqrt(np.nanmean((run[one.signal] - run[f"{one.signal}_predicted"]) ** 2))))
        assert one.gain.percent == pytest.approx(100 * (1 - errors[0] / errors[1]), abs=5.0)
