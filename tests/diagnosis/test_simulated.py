"""Faults that are seen by far, where what explains most to first order need not be what explains them."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from fieldmodels.diagnosis import diagnose, extension, simulated
from fieldmodels.diagnosis.curves import _solved
from fieldmodels.diagnosis.options import DEFAULT
from fieldmodels.diagnosis.simulated import that_keep_their_promise
from fieldmodels.diagnosis.verdict import Judgement
from fieldmodels.effects import actuator, friction, sensor
from fieldmodels.machine import Machine, number
from fieldmodels.model import ModelError, Signal
from fieldmodels.recording import Recording

STEP, SAMPLES, NOISE = 2.0, 3000, 0.05


class Bath(Machine):
    """A bath that a heater warms."""

    inputs = (Signal("power", "W"),)
    states = outputs = (Signal("temperature", "K", noise=NOISE),)
    capacity = number("J/K", 4000.0, 100.0, 1e6)
    loss = number("W/K", 5.0, 0.1, 100.0)
    effects = actuator("power") + friction("temperature", ("constant_force",)) + sensor("temperature")

    def derivative(self, state, input, p):
        return (input.power - p.loss * state.temperature) / p.capacity


def bath(seed: int, heater: float = 0.0, thermometer: float = 0.0, radiation: float = 0.0) -> Recording:
    """A log of the bath, each power held for one to three minutes, by the exact solution of short steps.

    Args:
        seed: Of powers and noise.
        heater: Share of its power that it loses in a second.
        thermometer: Share that it shows too little after a second.
        radiation: Loss that grows with the square [W/K2].
    """
    rng = np.random.default_rng(seed)
    power = np.repeat(rng.choice([0.0, 100.0, 200.0, 300.0, 400.0, 500.0], 100), rng.integers(20, 90, 100))
    time, true, now = np.arange(SAMPLES) * STEP, np.empty(SAMPLES), 20.0
    for i in range(SAMPLES):
        true[i] = now
        for part in range(4):
            given = power[i] * (1.0 - heater * (time[i] + part * STEP / 4.0))
            loss = 5.5 + radiation * now
            now = given / loss + (now - given / loss) * math.exp(-loss / 4300.0 * STEP / 4.0)
    shown = true * (1.0 - thermometer * time) + NOISE * rng.standard_normal(SAMPLES)
    signals = {"power": power[:SAMPLES], "temperature": shown}
    return Recording(time=time, signals=signals, source=f"bath {seed}")


@pytest.mark.matrix(keep=("thermometer",))
@pytest.mark.parametrize("fault", [{"heater": 2e-5}, {"thermometer": 2e-5}], ids=["heater", "thermometer"])
def test_what_fades_by_an_eighth_is_regained(fault: dict[str, float]):
    """Which of the two fades cannot be told: a bath follows its heater slowly."""
    result = diagnose(Bath(), [bath(1, **fault)], [bath(2, **fault)])
    [curve] = result.curves
    assert curve.over in ("power times time", "temperature times time")
    assert result.gain["temperature"].rmse_before > 3.0 * NOISE
    assert result.gain["temperature"].rmse_with_curves < 1.05 * NOISE


def test_radiation_is_a_square():
    result = diagnose(Bath(), [bath(1, radiation=0.01)], [bath(2, radiation=0.01)])
    assert not result.causes
    assert [(c.over, c.formula) for c in result.curves] == [("temperature", "square")]
    assert not result.above_noise  # with the curve, which extended.yaml has


def test_a_curve_is_solved_for_beside_a_mass_that_is_known_a_million_times_better():
    rng = np.random.default_rng(1)
    columns = rng.normal(size=(40, 10, 2)) * [1e6, 1.0]
    residual = columns @ [2e-6, 3.0]
    step, _ = _solved(SimpleNamespace(active=np.ones(2, dtype=bool), jacobian=columns, residual=residual))
    assert step == pytest.approx([2e-6, 3.0], rel=1e-6)


@pytest.mark.parametrize(("gain", "first"), [(80.0, "seems best"), (20.0, "is best")])
def test_a_curve_that_does_not_keep_its_promise_gives_way(monkeypatch, gain: float, first: str):
    """Of a promise of 100 nats three quarters must be kept for no other curve to be tried."""

    def curve(name: str, total: float) -> SimpleNamespace:
        return SimpleNamespace(name=name, total=total, coefficients=np.zeros(1), candidate=None)

    found, others = curve("seems best", 100.0), [curve("is best", 90.0), curve("is worse", 80.0)]
    cost = {"seems best": 150.0 - gain, "is best": 60.0, "is worse": 140.0}

    def extended(_candidates, _kept, curves, *_whitener) -> SimpleNamespace:
        now = cost[curves[0].name]
        return SimpleNamespace(fit=SimpleNamespace(cost=now), gain=150.0 - now)

    for module in (simulated, extension):
        monkeypatch.setattr(module, "extend", extended)
    monkeypatch.setattr(simulated, "covariance_whitener", lambda *_: None)
    options = SimpleNamespace(price=1.0, most_curves=2)
    kept = SimpleNamespace(fit=SimpleNamespace(cost=150.0), size=0)
    tried = SimpleNamespace(judge=lambda _kept: others, rivals=lambda *_: [])
    candidates = SimpleNamespace(problem=None, options=options)
    judged = SimpleNamespace(kept=kept, tried=tried)
    assert [one.name for one in that_keep_their_promise(candidates, judged, (found,))] == [first]


def test_kinds_of_friction_are_chosen_like_those_of_other_effects():
    assert [e.kind for e in friction("speed", ("constant_force",))] == ["constant_force"]
    assert [e.kind for e in friction("speed", "constant_force")] == ["constant_force"]
    assert "constant_force" not in [e.kind for e in friction("speed", without=("constant_force",))]
    with pytest.raises(ModelError, match="no stock effect 'constant'"):
        friction("speed", ("constant",))


@pytest.mark.parametrize(("worse", "stays"), [(0.009, False), (0.011, True)])
def test_a_curve_without_which_the_test_data_are_predicted_worse_stays(
    monkeypatch, worse: float, stays: bool
):
    """Training data that call for neither do not decide; names alone may be worse by a hundredth at most."""
    whole = SimpleNamespace(fit=None, predict=lambda _testing: "whole")
    instead = {
        "extend": whole, "covariance_whitener": None, "predict": "names", "_price": 0.0, "unexplained": True,
        "_parts": [],
    }  # fmt: skip
    for name, value in instead.items():
        monkeypatch.setattr(simulated, name, lambda *_given, value=value: value)
    compared = {("names", "whole"): worse}
    monkeypatch.setattr(simulated, "compared", lambda one, other: compared[one, other])
    kept = SimpleNamespace(effects=("a_name",), fit=SimpleNamespace(parameters=None))
    candidates = SimpleNamespace(problem=None, options=DEFAULT)
    judged = Judgement(kept, None, None, curves=("a curve",))
    assert bool(simulated.without_imitators(candidates, None, judged, None).curves) == stays
