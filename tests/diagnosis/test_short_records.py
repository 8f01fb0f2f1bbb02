"""Records that are short, or cut into many pieces, of a machine that states no horizons."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fieldmodels.diagnosis import diagnose
from fieldmodels.machine import Force, Machine, number
from fieldmodels.model import Signal
from fieldmodels.recording import Recording, RecordingError

STEP, BASE = 0.05, 0.32


class Car(Machine):
    inputs = (Signal("speed", "m/s"), Signal("steer", "rad"))
    states = outputs = (
        Signal("x", "m", noise=0.02), Signal("y", "m", noise=0.02), Signal("heading", "rad", noise=0.005),
    )  # fmt: skip
    wheelbase = number("m", 0.3, 0.01, 10.0)

    def derivative(self, state, input, p):
        return (
            input.speed * math.cos(state.heading),
            input.speed * math.sin(state.heading),
            input.speed / p.wheelbase * math.tan(input.steer),
        )


def log(seed: int, samples: int) -> Recording:
    """A car on wide bends by small Euler steps: its place walks off, however fast it answers."""
    rng = np.random.default_rng(seed)
    held = np.minimum(rng.integers(40, 120, 99).cumsum().searchsorted(np.arange(samples)), 98)
    speed, steer = rng.uniform(0.3, 2.0, 99)[held], rng.uniform(-0.1, 0.1, 99)[held]
    pose, rows = np.zeros(3), np.empty((samples, 3))
    for i in range(samples):
        rows[i] = pose
        for _ in range(10):
            way = speed[i] * STEP / 10
            pose = pose + way * np.array([math.cos(pose[2]), math.sin(pose[2]), math.tan(steer[i]) / BASE])
    rows += rng.standard_normal(rows.shape) * (0.02, 0.02, 0.005)
    names = ("speed", "steer", "x", "y", "heading")
    return Recording(
        np.arange(samples) * STEP,
        dict(zip(names, (speed, steer, *rows.T), strict=True)),
        source=f"drive {seed}",
    )


def test_a_minute_of_a_car_is_not_refused():
    result = diagnose(Car(), [log(3, 1200)])
    assert sum(result.windows) >= 12  # as short as the heading allows, not as the place asks for
    assert result.parameters["wheelbase"].value == pytest.approx(BASE, rel=0.01)


def test_something_may_act_on_the_rate_of_every_state_that_is_no_declared_velocity():
    class Cart(Car):
        forces = (Force("heading"),)

    class Mass(Machine):
        inputs, outputs = (Signal("push", "N"),), (Signal("place", "m"),)
        states = (Signal("place", "m"), Signal("speed", "m/s"))
        forces = (Force("speed", position="place", unit="N"),)

        def derivative(self, state, input, p):
            return state.speed, input.push

    assert [push.name for push in Car().pushes] == ["rate of x", "rate of y", "rate of heading"]
    assert [push.name for push in Cart().pushes] == ["rate of heading", "rate of x", "rate of y"]
    assert [push.name for push in Mass().pushes] == [""]  # what a place does its speed says


def test_a_short_recording_among_many_is_left_out_with_a_line():
    result = diagnose(Car(), [*(log(seed, 120) for seed in range(20)), log(20, 8)])
    assert result.windows[0] >= 40
    assert [note for note in result.notes if "left out" in note] == [
        f"drive 20 is left out: shorter than a window of {result.horizon:g} s"
    ]


def test_what_a_diagnosis_needs_is_more_than_there_is():
    """Eight windows of 7.5 s hold eight samples more than 60 s."""

    class Stated(Car):
        horizons = (7.5,)

    with pytest.raises(RecordingError, match=r"only 7 windows of 7.5 s; .*at least 60.4 s of data in one"):
        diagnose(Stated(), [log(1, 1200)])


class Mass(Machine):
    inputs, outputs = (Signal("push", "N"),), (Signal("place", "m", noise=1e-3),)
    states = (Signal("place", "m"), Signal("speed", "m/s"))
    drag = number("1/s", 0.5, 0.0, 10.0)

    def derivative(self, state, input, p):
        return state.speed, input.push - p.drag * state.speed


def test_a_hidden_state_is_called_by_its_name_and_what_depends_on_it_runs():
    """A drag by the square of a speed that nobody measured, of a machine that declares no force."""
    rng, place, speed = np.random.default_rng(1), 0.0, 0.0
    rows = []
    for push in np.repeat(rng.uniform(-3.0, 3.0, 100), 20):
        rows.append((push, place + 1e-3 * rng.standard_normal()))
        for _ in range(10):
            speed += 0.002 * (push - 0.5 * speed - 0.8 * speed * abs(speed))
            place += 0.002 * speed
    columns = dict(zip(("push", "place"), np.transpose(rows), strict=True))
    result = diagnose(Mass(), [Recording(0.02 * np.arange(2000), columns)])
    [curve] = result.curves
    assert Mass().rates == {"speed": "place"}
    assert curve.over == "speed"
    assert result.curve_effects
    gain = result.gain["place"]
    assert gain.rmse_with_curves < 0.1 * gain.rmse_before
