"""Machines that are slow, and those whose position walks off: a tank and a free motor, simulated here."""

from math import pi, sin, sqrt

import numpy as np
import pytest

from fieldmodels.diagnosis import diagnose
from fieldmodels.effects import actuator, force, sensor
from fieldmodels.machine import Force, Machine, number
from fieldmodels.model import Signal
from fieldmodels.recording import Recording


class Tank(Machine):
    """A tank with an outlet, filled through a valve."""

    inputs = (Signal("valve", "1"),)
    states = (Signal("level", "m"),)
    outputs = (Signal("level", "m", noise=0.002),)
    filling = number("m/s", 0.02, 1e-4, 1.0)
    outlet = number("m^0.5/s", 0.008, 1e-5, 1.0)
    effects = actuator("valve") + sensor("level")

    def derivative(self, state, input, p):
        """Torricelli's law."""
        return (p.filling * input.valve - p.outlet * sqrt(max(state.level, 1e-9)),)


class Motor(Machine):
    """A motor that turns freely, with an encoder."""

    inputs = (Signal("current", "A"),)
    states = (Signal("angle", "rad"), Signal("speed", "rad/s"))
    outputs = (Signal("angle", "rad", noise=5e-4),)
    inertia = number("kg m^2", 0.02, 1e-4, 1.0)
    damping = number("N m s/rad", 0.05, 1e-4, 1.0)
    forces = (Force("speed", "angle", "N m", "inertia"),)
    effects = actuator("current") + force("speed") + sensor("angle")

    def derivative(self, state, input, p):
        """Newton's law."""
        return state.speed, (0.5 * input.current - p.damping * state.speed) / p.inertia


class Bound(Motor):
    """The same on a weak spring."""

    def derivative(self, state, input, p):
        """Newton's law."""
        return state.speed, (0.5 * input.current - p.damping * state.speed - 1e-6 * state.angle) / p.inertia


def held(rng: np.random.Generator, count: int, span: tuple[int, int], low: float, high: float) -> np.ndarray:
    """Random levels, each held for some samples."""
    found: list[float] = []
    while len(found) < count:
        found += [float(rng.uniform(low, high))] * int(rng.integers(*span))
    return np.array(found[:count])


def filled(seed: int, late: int) -> Recording:
    """A tank whose valve acts so many seconds late, in a row a second."""
    rng, count, fine = np.random.default_rng(seed), 2500, 20
    valve, level = held(rng, count, (60, 240), 0.15, 0.85), 0.8
    valve[:30] = valve[0]
    shown = np.empty(count)
    for i in range(count):
        shown[i] = level
        for _ in range(fine):
            level += (0.02 * valve[max(i - late, 0)] - 0.0085 * sqrt(level)) / fine
    return Recording(
        np.arange(count) * 1.0, {"valve": valve, "level": shown + 0.002 * rng.standard_normal(count)}
    )


def turned(seed: int, teeth: int) -> Recording:
    """A motor that cogs so many times a turn; its encoder has 4096 lines."""
    rng, count, step, fine = np.random.default_rng(seed), 4000, 0.005, 20
    current, angle, speed, h = held(rng, count, (40, 160), -3.0, 3.0), 0.0, 0.0, step / fine
    shown = np.empty(count)
    for i in range(count):
        shown[i] = angle
        for _ in range(fine):
            speed += h * (0.5 * current[i] - 0.05 * speed - 0.15 * sin(teeth * angle)) / 0.02
            angle += h * speed
    line = 2 * pi / 4096
    return Recording(np.arange(count) * step, {"current": current, "angle": np.round(shown / line) * line})


def test_a_delay_of_a_slow_machine_is_told_however_long_it_is():
    causes = diagnose(Tank(), [filled(1, 14), filled(2, 14)], [filled(3, 14)]).causes
    assert [cause.effect for cause in causes] in (["actuator_delay"], ["sensor_delay"])
    assert causes[0].parameters["delay"].value == pytest.approx(14.0, abs=0.2)


def test_a_motor_that_turns_often_is_told_to_cog():
    teeth = 8
    causes = diagnose(Motor(), [turned(4, teeth), turned(5, teeth)], [turned(6, teeth)]).causes
    assert {cause.effect for cause in causes} == {"cogging", "sensor_quantisation"}
    [cogging] = (cause for cause in causes if cause.effect == "cogging")
    assert cogging.parameters["period"].value == pytest.approx(2 * pi / teeth, rel=1e-3)
    assert cogging.parameters["sine"].value == pytest.approx(-0.15, rel=0.02)


def test_windows_follow_the_speed_of_what_its_place_does_not_hold():
    """The motor's speed settles within 0.4 s; it has gone far after several of these."""
    record = turned(4, 0)
    free, bound = (machine.scaled_to([record]).horizons[1] for machine in (Motor(), Bound()))
    assert 0.2 < free < 0.8
    assert bound > 2.0 * free


def test_a_force_that_swings_once_in_a_slow_record_is_sought():
    fast = turned(7, 0)
    slow = Recording(200.0 * fast.time, fast.signals)  # 4000 s, a row a second
    frequency = Motor().scaled_to([slow]).effect("periodic_force").parameters[-1]
    assert frequency.lower < 1.0 / 4000.0
