"""Test data that go further than the training data: a cart, simulated here by itself."""

import numpy as np
import pytest

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis import diagnose
from fieldmodels.diagnosis.shapes import along_a_line, is_table, tables, window_tables
from fieldmodels.drivers.curved import FreeCurve
from fieldmodels.effects import actuator, force, sensor
from fieldmodels.machine import Force, Machine, number
from fieldmodels.model import Signal
from fieldmodels.recording import Recording

MASS, DAMPER, SPRING = 2.0, 6.0, 120.0
STEP, COUNT, SUBSTEPS, FURTHER = 0.01, 3000, 5, 1.3


class Cart(Machine):
    """A mass on a spring and a damper."""

    inputs = (Signal("push", "N"),)
    states = (Signal("place", "m"), Signal("speed", "m/s"))
    outputs = (Signal("place", "m", noise=1e-4), Signal("speed", "m/s", noise=2e-3))
    mass = number("kg", 1.8, 0.1, 50.0)
    damper = number("N s/m", 5.0, 0.0, 1e3)
    spring = number("N/m", 100.0, 1.0, 1e4)
    forces = (Force("speed", "place", unit="N", inertia="mass"),)
    effects = actuator("push") + force("speed") + sensor("place")
    hold = "held"

    def derivative(self, state, input, p):
        """Newton's law."""
        return state.speed, (input.push - p.damper * state.speed - p.spring * state.place) / p.mass


def rounded_hinge(speed: float) -> float:
    """A damper that brakes at any speed one way, and pushes the other way: a hyperbola, in no list."""
    return -2.0 * (np.hypot(1.0, speed / 0.2) - 1.0)


def record(seed: int, times: float) -> Recording:
    """Runge and Kutta's rule, with commands so many times as large."""
    rng, time = np.random.default_rng(seed), np.arange(COUNT) * STEP
    frequencies, phases = np.exp(rng.uniform(np.log(0.1), np.log(3.0), 9)), rng.uniform(0.0, 6.28, 9)
    push = np.sin(2.0 * np.pi * np.outer(time, frequencies) + phases).sum(axis=1)
    push *= 7.0 * times / np.std(push)
    state, rows, h = np.zeros(2), np.empty((COUNT, 2)), STEP / SUBSTEPS

    def rate(y: FloatArray, u: float) -> FloatArray:
        pushed = u + rounded_hinge(y[1]) - DAMPER * y[1] - SPRING * y[0]
        return np.array([y[1], pushed / MASS])

    for n, u in enumerate(push.tolist()):
        rows[n] = state
        for _ in range(SUBSTEPS):
            a = rate(state, u)
            b = rate(state + h / 2 * a, u)
            c = rate(state + h / 2 * b, u)
            state = state + h / 6 * (a + 2 * b + 2 * c + rate(state + h * c, u))
    place, speed = rows.T
    shown = {
        "place": place + 1e-4 * rng.standard_normal(COUNT),
        "speed": speed + 2e-3 * rng.standard_normal(COUNT),
    }
    return Recording(time, {"push": push, **shown}, source=f"seed {seed}")


@pytest.mark.nightly
def test_a_curve_predicts_what_goes_further_than_it_was_fitted_to():
    logs = record(1, 1.0), record(101, FURTHER)
    fastest = [np.abs(log["speed"]).max() for log in logs]
    assert fastest[1] > 1.04 * fastest[0]
    found = diagnose(Cart(), logs[:1], logs[1:])
    assert [(c.place, c.over, c.found) for c in found.curves[:1]] == [("force", "speed", True)]
    gain = found.gain["speed"]
    assert gain.rmse_with_curves < 0.12 * gain.rmse_before  # 0.08; of a curve that is constant beyond 0.27


def test_a_table_goes_on_along_a_line_and_not_for_ever():
    """Columns that are lines go on as these lines, for a quarter of the way between the outer knots."""
    knots = np.array([-1.0, -0.5, 0.5, 3.0])
    lines = np.column_stack([2.0 * knots + 1.0, -knots])
    further, values = along_a_line(knots, lines)
    curve = FreeCurve("force", "", "speed", further, values)
    ends, coefficients = np.array([-2.0, 4.0]), np.array([1.0, 0.5])
    np.testing.assert_allclose(further, [-2.0, *knots, 4.0])
    np.testing.assert_allclose(curve.at(ends, coefficients), 1.5 * ends + 1.0)
    np.testing.assert_allclose(curve.at(10.0 * ends, coefficients), 1.5 * ends + 1.0)


def test_neither_time_nor_a_value_of_the_machine_goes_on():
    """A mass that falls with the speed must not fall below zero."""
    rng = np.random.default_rng(3)
    speed = {"speed": ("m/s", rng.normal(0.5, 1.0, (60, 8)))}
    time = {"time": ("s", np.linspace(0.0, 30.0, 480).reshape(60, 8))}
    assert [is_table(c) for c in tables(speed)] == [True, False]  # what bends at the ends goes on itself
    assert not any(map(is_table, (*tables(time), *window_tables(speed))))
    assert all(c.knots[-1] <= 30.0 for c in tables(time))
    [bends] = [c for c in tables(speed) if c.formula == "ends"]
    assert bends.knots[-1] > speed["speed"][1].max() + 0.2 * np.ptp(speed["speed"][1])
