"""Faults that no library lists, hidden in a rig by a simulator of its own in plain Python."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fieldgym.bench import as_env
from fieldmodels.diagnosis import DiagnosisOptions, diagnose
from fieldmodels.diagnosis.outcome import Diagnosis
from fieldmodels.diagnosis.report import write_results
from fieldmodels.recording import Recording
from fieldmodels.registry import get_model

MASS, DAMPING, STIFFNESS = 2.3, 5.1, 93.0
STEP, FINE, SAMPLES = 0.01, 10, 3000
NOISE = {"position": 2e-4, "velocity": 5e-3}
GEAR, HUM = 0.021, 0.37
"""Periods of an eccentric gear [m] and of an aliased hum [s]."""
Push = Callable[[float, float, float, float], float]
Sensor = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


def command(seed: int) -> np.ndarray:
    """Twelve sines up to 4 Hz, or steps to levels between -8 and 8 N."""
    rng, time = np.random.default_rng(seed), np.arange(SAMPLES) * STEP
    if seed % 2:
        switches = rng.integers(20, 120, size=200).cumsum()
        return rng.uniform(-8, 8, 201)[np.searchsorted(switches, np.arange(SAMPLES))]
    waves = [
        np.sin(2 * np.pi * f * time + p)
        for f, p in zip(np.geomspace(0.1, 4, 12), rng.uniform(0, 6.28, 12), strict=True)
    ]
    return 4.0 * np.sum(waves, axis=0) / np.std(np.sum(waves, axis=0))


def rig(
    seed: int,
    push: Push | None = None,
    shown: Sensor | None = None,
    damping: Callable[[float], float] = lambda t: DAMPING,
    late: Callable[[np.random.Generator], np.ndarray] | None = None,
) -> Recording:
    """A log of the rig under a command, with a force and a position sensor of one's own.

    Args:
        seed: Of command and noise.
        push: Force f(t, x, v, u) [N].
        shown: Position that is shown, of true position, velocity and command.
        damping: Over time.
        late: By how many samples each sample of the command acts too late.
    """
    u, h = command(seed), STEP / FINE
    delays = late(np.random.default_rng([seed, 2])) if late else np.zeros(SAMPLES, dtype=np.int64)
    acting = u[np.maximum(np.arange(SAMPLES) - delays, 0)]
    x = v = 0.0
    states = np.empty((SAMPLES, 2))
    for i in range(SAMPLES):
        states[i] = x, v
        for k in range(FINE):
            t = i * STEP + k * h

            def rate(t: float, x: float, v: float, f: float = float(acting[i])) -> float:
                extra = push(t, x, v, f) if push else 0.0
                return (f + extra - damping(t) * v - STIFFNESS * x) / MASS

            a = rate(t, x, v)
            b = rate(t + h / 2, x + h / 2 * v, v + h / 2 * a)
            x, v = (
                x + h * v + h * h / 2 * b,
                v + h * rate(t + h / 2, x + h / 2 * v + h * h / 8 * a, v + h / 2 * b),
            )
    position, velocity = states.T
    rng = np.random.default_rng([seed, 1])
    seen = {"position": shown(position, velocity, u) if shown else position, "velocity": velocity}
    noisy = {name: values + NOISE[name] * rng.standard_normal(SAMPLES) for name, values in seen.items()}
    return Recording(time=np.arange(SAMPLES) * STEP, signals={"force": u, **noisy}, source=f"seed {seed}")


HIDDEN = {
    "a bump of force at one place": (
        {"push": lambda t, x, v, u: -0.16 * math.exp(-(((x - 0.03) / 0.015) ** 2))}, "force", "position",
    ),
    "a command that adds its square": ({"push": lambda t, x, v, u: 0.0016 * u * u}, "force", "force"),
    "a sensor that lags by the direction": (
        {"shown": lambda x, v, u: x - 4e-4 * np.tanh(v / 0.005)}, "sensor", "velocity",
    ),
    "a sensor that feels the command": ({"shown": lambda x, v, u: x + 1.2e-4 * u}, "sensor", "force"),
    "an eccentric gear before the sensor": (
        {"shown": lambda x, v, u: x + 3e-4 * np.sin(2 * np.pi * x / GEAR)}, "sensor", "position",
    ),
    "hum in a sensor": (
        {"shown": lambda x, v, u: x + 3e-4 * np.sin(2 * np.pi * np.arange(SAMPLES) * STEP / HUM)},
        "sensor", "time",
    ),
    "an actuator that fades": ({"push": lambda t, x, v, u: -0.006 * t * u}, "force", "force times time"),
    "damping that grows": ({"damping": lambda t: DAMPING * (1 + 0.007 * t)}, "parameter", "time"),
}  # fmt: skip
"""A fault, the place of its curve, and the variable that it depends on."""


@cache
def found(kind: str, seed: int) -> Diagnosis:
    fault = HIDDEN[kind][0]
    return diagnose(get_model("rig"), [rig(seed, **fault)], [rig(seed + 500, **fault)])


@pytest.mark.matrix(
    keep=(
        "3-a bump of force at one place",
        "3-an eccentric gear before the sensor",
        "3-an actuator that fades",
        "3-damping that grows",
    )
)
@pytest.mark.parametrize("kind", list(HIDDEN))
@pytest.mark.parametrize("seed", [3, pytest.param(4, marks=pytest.mark.nightly)])
def test_what_no_list_contains_is_unknown_and_its_curve_regains_what_was_lost(kind: str, seed: int):
    result = found(kind, seed)
    assert result.verdict == "unknown", result.summary()
    assert not result.causes
    _, place, over = HIDDEN[kind]
    seen = [(c.place, c.over.removeprefix("size of ")) for c in result.curves]
    assert (place, over) in seen, [c.direction for c in result.curves]
    position = result.gain["position"]
    lost = position.rmse_before - NOISE["position"]
    assert position.rmse_after == position.rmse_before  # nothing is named
    assert position.rmse_before - position.rmse_with_curves > 0.7 * lost


def test_damping_of_one_direction_is_half_of_it_both_ways_and_half_by_direction():
    fault = {"push": lambda t, x, v, u: -0.3 * max(v, 0.0)}
    result = diagnose(get_model("rig"), [rig(3, **fault)], [rig(503, **fault)])
    assert [c.effect for c in result.causes] == ["asymmetric_damping"]
    found = result.causes[0].parameters["coefficient"]
    assert abs(found.value - 0.15) < 3.0 * found.std
    assert found.std < 0.03


@pytest.mark.parametrize(
    ("kind", "period", "unit"),
    [("an eccentric gear before the sensor", GEAR, "m"), ("hum in a sensor", HUM, "s")],
)
def test_a_wave_is_stated_by_its_period_and_runs(tmp_path: Path, kind: str, period: float, unit: str):
    result = found(kind, 3)
    words, number, said = result.curves[0].formula.rsplit(" ", 2)
    assert (words, said) == ("repeats every", unit)
    assert float(number) == pytest.approx(period, rel=0.005)
    assert np.ptp(result.curves[0].curve[:, 1]) == pytest.approx(6e-4, rel=0.15)
    assert not result.not_runnable
    env = as_env("rig", reality=write_results(result, tmp_path, drawn={})["extended.yaml"])
    [effect] = [e for e in env.unwrapped._task.machine.effects if e.name.startswith("sensor_on_position")]
    if unit == "m":  # the time that a curve over the time runs on is the log's own
        values = [p.nominal for p in effect.parameters if p.name.startswith("value_")]
        assert len(values) > 8  # of one cycle, after which it begins anew
        assert env.unwrapped._task.machine.index(f"{effect.name}.period")


TRUE = {
    "a bump of force at one place": lambda x: -0.16 * np.exp(-(((x - 0.03) / 0.015) ** 2)),
    "a command that adds its square": lambda u: 0.0016 * u**2,
    "a sensor that lags by the direction": lambda v: -4e-4 * np.tanh(v / 0.005),
    "a sensor that feels the command": lambda u: 1.2e-4 * u,
    "damping that grows": lambda t: DAMPING * 0.007 * t,
}
"""What was hidden, as a function of the curve's variable."""


@pytest.mark.parametrize("kind", list(TRUE))
def test_a_curve_runs_as_what_was_hidden_sign_and_size(kind: str):
    """Up to a constant, and for a force a spring or a gain, which the base takes up."""
    _, place, over = HIDDEN[kind]
    [curve] = [c for c in found(kind, 3).curves if (c.place, c.over) == (place, over)]
    at, value, error = curve.curve.T
    absorbed = np.stack([np.ones_like(at), at] if place == "force" else [np.ones_like(at)], axis=1)
    weight = 1.0 / np.maximum(error, 0.1 * np.median(error))[:, None]
    left = [
        y - absorbed @ np.linalg.lstsq(weight * absorbed, weight[:, 0] * y, rcond=None)[0]
        for y in (value, TRUE[kind](at))
    ]
    slope = np.sum(weight[:, 0] ** 2 * left[0] * left[1]) / np.sum((weight[:, 0] * left[1]) ** 2)
    assert slope == pytest.approx(1.0, abs=0.4)


def test_a_curve_runs_on_in_a_free_run_and_in_an_environment(tmp_path: Path):
    kind = "a bump of force at one place"
    result, log = found(kind, 3), rig(888, **HIDDEN[kind][0])
    base = diagnose(get_model("rig"), [rig(3)], [rig(503)])
    errors = [float(np.std(d.simulate(log)["position"] - log["position"])) for d in (base, result)]
    assert errors[1] < 1.5 * NOISE["position"]
    assert errors[1] < 0.7 * errors[0]
    paths = write_results(result, tmp_path, drawn={})
    env = as_env("rig", reality=paths["extended.yaml"])
    assert "force_on_velocity_over_position" in {e.name for e in env.unwrapped._task.machine.effects}
    env.reset(seed=1)
    assert np.isfinite(env.step(np.ones(1, np.float32))[0]).all()


def test_a_diagnosis_is_short_in_words_and_whole_as_a_table():
    result = found("a bump of force at one place", 3)
    assert len(repr(result)) < 400
    assert "unknown" in repr(result)
    table = result.to_dataframe()
    assert set(table.kind) == {"parameters", "curve"}
    assert table.set_index("parameter").value["mass"] == pytest.approx(MASS, rel=0.01)
    assert "<table" in result._repr_html_()
    prediction = result.predict(rig(888))
    assert {"window", "t", "position", "position_predicted"} <= set(prediction)
    labels = [axis.get_ylabel().replace("\n", " ") for axis in result.plot().axes]
    assert [label for label in labels if label != "error [m]"] == [
        "position [m]",
        "velocity [m/s]",
        "force [N]",
    ]


@pytest.mark.matrix(keep=("force",))
@pytest.mark.parametrize("signal", ["force", "position", "velocity"])
def test_a_reversed_sign_is_said_before_any_cause(signal: str):
    drag = {"push": lambda t, x, v, u: -0.6 * v * abs(v)}
    logs = [rig(seed, **drag) for seed in (3, 503)]
    turned = [replace(r, signals={**r.signals, signal: -r[signal]}) for r in logs]
    result = diagnose(get_model("rig"), turned[:1], turned[1:])
    assert result.verdict == "unknown"
    assert not result.causes
    assert not result.curves
    assert f"{signal}=-{signal}" in result.mistaken
    assert result.summary().startswith("First check the columns")


@pytest.mark.nightly
def test_a_sensor_that_was_dead_in_some_recordings_is_said_before_any_sign():
    logs = [rig(seed) for seed in (3, 4, 5)]
    dead = replace(logs[1], signals={**logs[1].signals, "position": np.zeros(SAMPLES)})
    result = diagnose(get_model("rig"), [logs[0], dead, logs[2]], [rig(503)])
    assert result.verdict == "unknown"
    assert not result.causes
    assert result.mistaken == (
        "position never changes in seed 4 (leave out what was recorded with a dead sensor)"
    )


def test_no_sign_is_doubted_where_it_is_right():
    drag = {"push": lambda t, x, v, u: -0.6 * v * abs(v)}
    result = diagnose(get_model("rig"), [rig(3, **drag)], [rig(503, **drag)])
    assert result.mistaken == ""
    assert [c.effect for c in result.causes] == ["quadratic_drag"]


def test_what_consistent_data_would_have_shown_is_found_when_it_is_there():
    """A force of the place of twice the stated size is found; of a fifth of it is not."""
    result = diagnose(get_model("rig"), [rig(4)], [rig(504)])
    assert result.verdict == "consistent"
    [size] = [v.size for v in result.seen if v.place == "force"]
    wave = np.sqrt(2.0)  # root mean square of a sine over many periods
    for times, verdict in ((2.0, {"unknown", "named", "ambiguous"}), (0.2, {"consistent"})):
        push = {"push": lambda t, x, v, u, a=times * size * wave: a * math.sin(x / 0.012)}
        again = diagnose(get_model("rig"), [rig(4, **push)], [rig(504, **push)])
        assert again.verdict in verdict, (times, again.summary())


@pytest.mark.parametrize("seed", [3, pytest.param(4, marks=pytest.mark.nightly)])
@pytest.mark.parametrize("grows", [0.01, 0.0])
def test_a_gain_is_named_alone_only_if_it_holds_in_all_parts_of_the_data(grows: float, seed: int):
    """A position that is shown 3 % too large is a gain; if the faster the more, it is something else."""
    fault = {"shown": lambda x, v, u: (1.03 + grows * np.tanh(np.abs(v) / np.std(v) - 1.0)) * x}
    result = diagnose(get_model("rig"), [rig(seed, **fault)], [rig(seed + 500, **fault)])
    alone = [c.effect for c in result.causes if not c.alternatives]
    if grows:
        assert alone == []
        assert result.causes[0].alternatives == ("curve of size of velocity, in sensor gain.gain",)
    else:
        assert alone == ["sensor_gain"]
        [gain] = result.causes[0].parameters.values()
        assert abs(gain.value - 1.03) < 3.0 * gain.std


def test_a_name_is_ambiguous_if_a_curve_in_its_place_does_as_well():
    """A gain that falls by two hundredths in mid-record is no parameter's step beside a gain."""
    fault = {"shown": lambda x, v, u: np.where(np.arange(SAMPLES) < SAMPLES // 2, 1.04, 1.02) * x}
    result = diagnose(get_model("rig"), [rig(3, **fault)], [rig(503, **fault)])
    assert "sensor_gain" in {c.effect for c in result.causes}
    assert all(c.alternatives for c in result.causes), result.summary()


def test_ripple_over_the_command_is_a_wave():
    ripple = {"push": lambda t, x, v, u: 0.25 * math.sin(2 * np.pi * u / 1.7)}
    result = diagnose(get_model("rig"), [rig(3, **ripple)], [rig(503, **ripple)])
    assert result.verdict == "unknown"
    words, number, unit = result.curves[0].formula.rsplit(" ", 2)
    assert (result.curves[0].over, words, unit) == ("force", "repeats every", "N")
    assert float(number) == pytest.approx(1.7, rel=0.05)


@pytest.mark.parametrize(("late", "by_chance"), [("from 1 to 5", True), ("always 3", False)])
def test_a_delay_that_varies_by_chance_is_told_from_one_that_is_steady(late: str, by_chance: bool):
    """A bus that is late by chance, and one that is late by as much on average."""
    fault = {
        "late": (lambda rng: rng.integers(1, 6, SAMPLES)) if by_chance else (lambda rng: np.full(SAMPLES, 3))
    }
    result = diagnose(get_model("rig"), [rig(3, **fault)], [rig(503, **fault)])
    [delay] = [c for c in result.causes if c.effect == "actuator_delay"]
    assert ("random changes of actuator delay" in delay.alternatives) == by_chance


JITTER = 0.003
"""Mean lateness of a position sensor's stamps [s]."""


def stamped(seed: int, jitter: bool, quantum: float = 0.0, walk: float = 0.0) -> Recording:
    """The rig, whose positions are late by random times, or always; rounded, or of a zero that walks."""

    def shown(x: np.ndarray, v: np.ndarray, _u: np.ndarray) -> np.ndarray:
        drawn = np.abs(np.random.default_rng([seed, 3]).standard_normal(SAMPLES))
        zero = walk * np.random.default_rng([seed, 4]).standard_normal(SAMPLES).cumsum()
        return x - v * JITTER * (drawn / drawn.mean() if jitter else 1.0) + zero

    log = rig(seed, shown=shown)
    if quantum:
        log.signals["position"][:] = quantum * np.round(log["position"] / quantum)
    return log


@pytest.mark.matrix(
    keep=(
        "jitter-steps",
        "steady-steps",
        "an encoder-steps",
    )
)
@pytest.mark.parametrize("seed", [3, 4], ids=["steps", "waves"])
@pytest.mark.parametrize(
    ("jitter", "quantum"), [(True, 0.0), (False, 0.0), (False, 2e-3)], ids=["jitter", "steady", "an encoder"]
)
def test_stamps_that_jitter_are_told_from_late_ones(seed: int, jitter: bool, quantum: float):
    """A coarse encoder is wrong by chance while it moves, and not at rest; that is no jitter."""
    logs = [[stamped(each, jitter, quantum)] for each in (seed, 500 + seed)]
    named = [c for c in diagnose(get_model("rig"), *logs).causes if c.effect == "sensor_delay"]
    assert len(named) == 1
    assert ("random changes of sensor delay" in named[0].alternatives) == jitter


@pytest.mark.matrix(keep=("True",))
@pytest.mark.parametrize("jitter", [True, False])
def test_jitter_shows_beside_a_zero_that_walks(jitter: bool):
    logs = [[stamped(seed, jitter, walk=1e-4)] for seed in (3, 503)]
    [named] = diagnose(get_model("rig"), *logs).causes
    assert named.effect == "sensor_delay"
    assert ("random changes of sensor delay" in named.alternatives) == jitter


def test_errors_of_the_simulation_alone_are_no_chance(monkeypatch):
    """Without noise what an integration errs goes with the motion, and with every sensitivity."""
    for name in NOISE:
        monkeypatch.setitem(NOISE, name, 0.0)
    late = {"late": lambda rng: np.full(SAMPLES, 3)}
    [cause] = diagnose(get_model("rig"), [rig(3, **late)], [rig(503, **late)]).causes
    assert (cause.effect, cause.alternatives) == ("actuator_delay", ())


@pytest.mark.matrix(
    keep=(
        "0.0-0.1-coulomb_friction-waves",
        "1.5-1.6-power 1.5 with sign-steps",
        "2.0-2.0-quadratic_drag-waves",
        "3.0-4.0-cube-steps",
    )
)
@pytest.mark.parametrize("seed", [3, 6], ids=["steps", "waves"])
@pytest.mark.parametrize(
    ("power", "size", "formula"),
    [
        (0.0, 0.1, "coulomb_friction"), (0.5, 0.1, "root with sign"), (1.5, 1.6, "power 1.5 with sign"),
        (2.0, 2.0, "quadratic_drag"), (3.0, 4.0, "cube"),
    ],
)  # fmt: skip
def test_a_drag_of_another_power_than_the_listed_ones_is_not_named(
    power: float, size: float, formula: str, seed: int
):
    """Each power has a listed one for a neighbour, which takes most of the error away."""
    drag = {"push": lambda t, x, v, u: -size * math.copysign(abs(v) ** power, v)}
    result = diagnose(get_model("rig"), [rig(seed, **drag)], [rig(seed + 500, **drag)])
    if power in (0.0, 2.0):
        assert [(c.effect, c.alternatives) for c in result.causes] == [(formula, ())]
    elif result.causes:
        assert power < 3.0
        assert [c.alternatives for c in result.causes] == [("curve of velocity",)]
    else:
        assert [(c.over, c.formula) for c in result.curves[:1]] == [("velocity", formula)]


def test_a_constant_force_is_named_alone():
    """A sign and a constant hold it, and are as likely: no rival, since they do the same and more."""
    push = {"push": lambda t, x, v, u: 0.3}
    result = diagnose(get_model("rig"), [rig(3, **push)], [rig(503, **push)])
    assert [(c.effect, c.alternatives) for c in result.causes] == [("constant_force", ())]


def test_thresholds_are_arguments():
    kind = "a bump of force at one place"
    strict = DiagnosisOptions(level=1e-9, curve_level=1e-9, least_share=10.0, least_gain=1e6, above=1e9)
    logs = [rig(seed, **HIDDEN[kind][0]) for seed in (3, 503)]
    assert diagnose(get_model("rig"), logs[:1], logs[1:], options=strict).verdict == "consistent"


@pytest.mark.parametrize("seed", [3, 4], ids=["steps", "waves"])
def test_commands_that_come_late_from_some_time_on_are_not_overlooked(seed: int):
    """By a sample, in the last two fifths: a delay of all of it helps there as much as it harms before."""
    fault = {"late": lambda _rng: (np.arange(SAMPLES) > 0.6 * SAMPLES).astype(np.int64)}
    result = diagnose(get_model("rig"), [rig(seed, **fault)], [rig(seed + 500, **fault)])
    assert result.verdict == "unknown", result.summary()
    assert result.curves[0].over == "change of force times time"


@pytest.mark.matrix(
    keep=(
        "damping-steps",
        "actuator-steps",
        "drag-steps",
    )
)
@pytest.mark.parametrize("seed", [3, 4], ids=["steps", "waves"])
@pytest.mark.parametrize(
    ("fault", "over"),
    [
        ({"damping": lambda t: DAMPING * (1.0 + 0.07 * t)}, "time, in damping"),
        ({"push": lambda t, x, v, u: -0.02 * t * u}, "force times time"),
        ({"push": lambda t, x, v, u: -15.0 * v**3}, "velocity"),
    ],
    ids=["damping", "actuator", "drag"],
)
def test_faults_far_above_the_noise_are_regained_to_it(fault: dict[str, Any], over: str, seed: int):
    """Damping that grows to three times its size, an actuator that loses three fifths, drag by the cube."""
    result = diagnose(get_model("rig"), [rig(seed, **fault)], [rig(seed + 500, **fault)])
    assert [c.direction for c in result.curves] == [over]
    values = result.curves[0].curve[:, 1]
    assert (values[-1] > values[0]) == (over == "time, in damping")  # it grows; the others take away
    gain = result.gain["position"]
    assert gain.rmse_before > 5.0 * NOISE["position"]
    assert gain.rmse_with_curves < 1.05 * NOISE["position"]


def test_cogging_repeats_many_times_along_the_way():
    """Teeth of 6 mm, thirty to fifty on a way of a few decimetres."""
    teeth = {"push": lambda t, x, v, u: 0.4 * math.sin(2.0 * math.pi * x / 0.006)}
    causes = diagnose(get_model("rig"), [rig(4, **teeth)], [rig(504, **teeth)]).causes
    assert [c.effect for c in causes] == ["cogging"]
    assert causes[0].parameters["period"].value == pytest.approx(0.006, rel=2e-3)


@pytest.mark.matrix(keep=("steps",))
@pytest.mark.parametrize("seed", [3, 4], ids=["steps", "waves"])
def test_friction_that_depends_on_the_place_is_friction_or_a_curve_of_it(seed: int):
    """How it varies cannot be run, so that it counts in no number that is stated."""

    def grip(_t: float, x: float, v: float, _u: float) -> float:
        return -0.3 * (1.0 + math.sin(x / 0.02)) * math.tanh(v / 0.003)

    result = diagnose(get_model("rig"), [rig(seed, push=grip)], [rig(seed + 500, push=grip)])
    assert [(c.effect, c.alternatives) for c in result.causes] == [
        ("coulomb_friction", ("curve of position, in coulomb friction.force",))
    ]
    assert [c.direction for c in result.curves] == ["position, in coulomb friction.force"]
    position = result.gain["position"]
    assert "cannot follow a variable in a run" in result.not_runnable[0]
    assert position.rmse_with_curves == position.rmse_after < position.rmse_before
