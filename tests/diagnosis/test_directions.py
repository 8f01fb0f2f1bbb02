"""What no list contains, in one of several directions of an own machine: two tanks, one above the other."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fieldmodels.diagnosis import diagnose
from fieldmodels.effects import actuator, sensor
from fieldmodels.machine import Force, Machine, number
from fieldmodels.model import Signal
from fieldmodels.recording import Recording

SAMPLES, EULER, NOISE = 1500, 20, 0.02
"""Seconds, steps in each, and a gauge's noise [cm]."""
HOLE, LEAK = 9.0, 0.05
"""Height of a hole in a wall [cm], and what leaves there [cm^0.5/s]."""


class Tanks(Machine):
    """Water is pumped into the upper tank, runs into the lower one, and out."""

    inputs = (Signal("pump", "V"),)
    states = outputs = (Signal("upper", "cm", noise=NOISE), Signal("lower", "cm", noise=NOISE))
    flow = number("cm/s/V", 0.2, 0.01, 2.0)
    upper_outlet = number("cm^0.5/s", 0.2, 0.01, 2.0)
    lower_outlet = number("cm^0.5/s", 0.2, 0.01, 2.0)
    forces = (Force("upper"), Force("lower"))
    effects = actuator("pump") + sensor("upper") + sensor("lower", prefix="low_")

    def derivative(self, state, input, p):
        down = p.upper_outlet * math.sqrt(max(state.upper, 0.0))
        out = p.lower_outlet * math.sqrt(max(state.lower, 0.0))
        return p.flow * input.pump - down, down - out


def recorded(seed: int, leaking: str) -> Recording:
    """Levels while the pump steps; one tank has a hole in its wall."""
    rng = np.random.default_rng(seed)
    pump = np.repeat(rng.uniform(1.0, 6.0, 40), rng.integers(40, 120, 40))[:SAMPLES]
    upper = lower = 8.0
    levels = np.empty((SAMPLES, 2))
    for i, volts in enumerate(pump):
        levels[i] = upper, lower
        for _ in range(EULER):
            down, out = 0.22 * math.sqrt(upper), 0.21 * math.sqrt(lower)
            leak = LEAK * math.sqrt(max((upper if leaking == "upper" else lower) - HOLE, 0.0))
            upper += (0.17 * volts - down - (leak if leaking == "upper" else 0.0)) / EULER
            lower += (down - out - (leak if leaking == "lower" else 0.0)) / EULER
    shown = levels + NOISE * rng.standard_normal(levels.shape)
    signals = {"pump": pump, "upper": shown[:, 0], "lower": shown[:, 1]}
    return Recording(np.arange(SAMPLES, dtype=np.float64), signals, f"{leaking} tank leaks")


@pytest.mark.matrix(keep=("lower",))
@pytest.mark.parametrize("leaking", ["upper", "lower"])
def test_a_leak_is_found_in_the_tank_that_leaks(leaking: str):
    found = diagnose(Tanks(), [recorded(1, leaking)], [recorded(2, leaking)])
    assert found.verdict == "unknown", found.summary()
    curve = found.curves[0]
    assert (curve.place, curve.target, curve.over) == ("force", f"rate of {leaking}", leaking)
    at, rate, _ = curve.curve.T
    lost = np.interp(
        [HOLE, 12.0], at, rate
    )  # of what is lost below the hole the outlet's own number takes a share
    assert lost[1] - lost[0] == pytest.approx(-LEAK * math.sqrt(3.0), abs=0.4 * LEAK * math.sqrt(3.0))
    gain = found.gain[leaking]
    assert gain.rmse_with_curves < 0.2 * gain.rmse_before
    # The extended simulation runs from the first sample on, and leaks in the same tank.
    other = recorded(3, leaking)
    free = found.simulate(other)[leaking] - other[leaking]
    assert np.sqrt(np.mean(free**2)) < 0.1
