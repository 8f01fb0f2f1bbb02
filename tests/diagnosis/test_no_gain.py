"""What does not predict test data better, and what ends at a bound, is said and not recommended."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from fieldmodels.diagnosis import diagnose, extension
from fieldmodels.diagnosis.answer import how_sure, in_words
from fieldmodels.diagnosis.extension import improving
from fieldmodels.diagnosis.statements import bounded
from fieldmodels.recording import Recording
from fieldmodels.registry import get_model

STEP, RIG = 0.01, get_model("rig")


def rig(seed, phase, count=3000, drag=2.0):
    """A mass on its guide under random forces, shaken once a second; semi-implicit Euler."""
    rng = np.random.default_rng(seed)
    force = np.repeat(rng.uniform(-4.0, 4.0, count // 30), 30)
    time = STEP * np.arange(count)
    place, speed, places = 0.0, 0.0, np.empty(count)
    for n in range(count):
        places[n] = place
        for part in range(20):
            shaken = (
                1.5 * np.sin(2 * np.pi * (time[n] + part * STEP / 20) + phase) if phase is not None else 0.0
            )
            speed += STEP / 20 * (force[n] + shaken - drag * speed - 20.0 * place) / 2.0
            place += STEP / 20 * speed
    columns = {"force": force, "position": places + 2e-4 * rng.normal(size=count)}
    return Recording(time, columns, source="rig")


@pytest.fixture(scope="module")
def another_phase():
    return diagnose(RIG, [rig(1, 0.0)], [rig(2, np.pi)])


def test_a_curve_that_the_test_data_contradict_is_said_and_left_out(another_phase):
    """A wave over time whose phase is another one in the test record."""
    assert another_phase.verdict == "unknown"
    assert another_phase.curves
    assert not any(curve.confirmed for curve in another_phase.curves)
    assert another_phase.curve_effects == {}
    left = [f"{curve.direction} (it predicts the test data no better)" for curve in another_phase.curves]
    assert list(another_phase.not_runnable) == left
    said = " ".join(in_words(another_phase))
    assert f"Not in extended.yaml: {'; '.join(left)}." in said
    assert "Simulate with" not in said
    assert said.startswith("The simulation may lack something that no listed effect explains. ")
    assert "Possible, but not confirmed by the test data: what depends on time" in said
    gain = another_phase.gain["position"]
    assert gain.rmse_with_curves == gain.rmse_after


@pytest.mark.parametrize(
    ("errors", "kept"),
    [
        ({2: (0.9, 0.9), 1: (0.8, 1.0)}, 2),
        ({2: (1.2, 1.2), 1: (0.9, 1.0)}, 1),
        ({2: (1.1, 1.0), 1: (1.0, 1.0)}, 0),
        ({2: (0.7, 1.2), 1: (9.0, 9.0)}, 2),  # a better mean of logarithms
        ({2: (0.7, 1.5), 1: (9.0, 9.0)}, 0),
        ({2: (0.9, np.nan), 1: (9.0, 9.0)}, 2),  # one that is not measured
        ({1: (0.9, 1.0)}, 1),  # the fit of both failed
    ],
)
def test_as_many_curves_are_added_as_predict_better(monkeypatch, errors, kept):
    def predicted(values):
        return SimpleNamespace(rmse=lambda: np.array(values))

    def extended(_problem, _kept, curves):
        if len(curves) not in errors:
            return None
        return SimpleNamespace(curves=curves, predict=lambda _: predicted(errors[len(curves)]))

    monkeypatch.setattr(extension, "extend", extended)
    found = improving(None, None, ("first", "second"), None, predicted((1.0, 1.0)))
    assert (len(found.curves) if found else 0) == kept


def test_what_ended_at_a_bound_is_said(another_phase):
    """A rig without damping, which a fit would have below none."""
    heavy = replace(RIG.parameters[0], upper=2.0)
    model = get_model("rig")
    fitted = SimpleNamespace(
        free=np.array([0, 1]), active=np.array([False, True]), parameters=np.array([2.0, 1.0, 3.0]),
        jacobian=np.array([[[2.0, 1.0], [0.0, 1.0]]]), residual=np.array([[2.1, -2.1]]),
    )  # fmt: skip
    narrow = SimpleNamespace(names=model.names, all_parameters=(heavy, *model.all_parameters[1:]))
    assert bounded(narrow, fitted) == ("the mass at the largest value allowed, 2.00 kg",)
    assert bounded(narrow, SimpleNamespace(**{**vars(fitted), "active": np.array([True, True])})) == ()
    less = np.array([[1.9, -1.9]])  # along (1, -1) / sqrt(2)
    assert bounded(narrow, SimpleNamespace(**{**vars(fitted), "residual": less / np.sqrt(2)})) == ()
    beyond = SimpleNamespace(**{**vars(fitted), "free": np.array([len(model.names) + 1, 1])})
    assert bounded(narrow, beyond) == ()  # a curve's
    said = replace(another_phase, bounded=("the mass at the largest value allowed, 2 kg",))
    for text in (said.summary(), how_sure(said), how_sure(replace(said, verdict="consistent"))):
        assert "ended with the mass at the largest value allowed, 2 kg" in text
    assert said.to_json()["bounded"] == ["the mass at the largest value allowed, 2 kg"]
    assert "ended" not in another_phase.summary()


@pytest.mark.nightly
def test_a_damping_below_none_is_said_to_have_ended_there():
    found = diagnose(RIG, [rig(3, None, drag=-0.3)], [rig(4, None, drag=-0.3)])
    assert found.bounded
    assert found.bounded[0].startswith("the damping at the smallest value allowed, 0 ")
