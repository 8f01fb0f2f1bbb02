"""Starts of windows that no sensor sees are found: of machines that swing fast, and behind a spring."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import cont2discrete

from fieldmodels.diagnosis import diagnose
from fieldmodels.diagnosis.candidates import Candidates
from fieldmodels.diagnosis.cutting import split, start_vector
from fieldmodels.diagnosis.linearisation import Fit
from fieldmodels.diagnosis.problem import Problem
from fieldmodels.diagnosis.signs import mistaken_columns
from fieldmodels.effects import actuator, force, sensor
from fieldmodels.machine import Force, Machine, number
from fieldmodels.machines.servo import Servo
from fieldmodels.model import Signal
from fieldmodels.recording import Recording

NOISE = {"position": 5e-5, "load": 15.0, "motor": 1e-3, "motor_speed": 0.05}


class Cylinder(Machine):
    """A mass on oil that a valve moves; the oil's force is measured, the velocity is not."""

    inputs = (Signal("valve", "1"),)
    states = (
        Signal("position", "m", noise=5e-5),
        Signal("velocity", "m/s", noise=5e-2),
        Signal("load", "N", noise=15.0),
    )
    outputs = (Signal("position", "m", noise=5e-5), Signal("load", "N", noise=15.0))
    mass = number("kg", 100.0, 1.0, 1e4)
    damping = number("N s/m", 500.0, 0.0, 1e5)
    oil = number("N/m", 5e5, 1e3, 1e9)
    flow = number("m/s", 0.3, 1e-3, 10.0)
    leak = number("1/s", 5.0, 0.0, 1e3)
    forces = (Force("velocity", "position", unit="N", inertia="mass"),)
    horizons = 0.23, 0.47, 0.93
    effects = (
        actuator("valve", ("delay", "dead_zone"))
        + force("velocity", ("coulomb_friction",))
        + sensor("position", ("delay",))
    )

    def derivative(self, state: Any, input: Any, p: Any) -> Any:
        """Rates of position, velocity and load."""
        rate = (state.load - p.damping * state.velocity) / p.mass
        return state.velocity, rate, p.oil * (p.flow * input.valve - state.velocity) - p.leak * state.load


class TwoMass(Machine):
    """A motor drives a load through a springy shaft; only the motor has sensors."""

    inputs = (Signal("torque", "N m"),)
    states = (
        Signal("motor", "rad", noise=1e-3),
        Signal("motor_speed", "rad/s", noise=0.05),
        Signal("load", "rad", noise=0.05),
        Signal("load_speed", "rad/s", noise=1.0),
    )
    outputs = (Signal("motor", "rad", noise=1e-3), Signal("motor_speed", "rad/s", noise=0.05))
    motor_inertia = number("kg m2", 0.01, 1e-4, 1.0)
    damping = number("N m s/rad", 0.02, 0.0, 10.0)
    load_inertia = number("kg m2", 0.02, 1e-4, 10.0)
    spring = number("N m/rad", 20.0, 0.1, 1e4)
    forces = (Force("motor_speed", "motor", unit="N m", inertia="motor_inertia"),)
    effects = force("motor_speed", ("coulomb_friction",))

    def derivative(self, state: Any, input: Any, p: Any) -> Any:
        """Rates of both angles and speeds."""
        twist = p.spring * (state.motor - state.load)
        return (
            state.motor_speed,
            (input.torque - p.damping * state.motor_speed - twist) / p.motor_inertia,
            state.load_speed,
            twist / p.load_inertia,
        )


class Crane(Machine):
    """In the coordinates of the hall; a sensor shows the angle at which the load hangs, none where it is."""

    inputs = (Signal("force", "N"),)
    states = (
        Signal("trolley", "m"),
        Signal("speed", "m/s"),
        Signal("load", "m"),
        Signal("load_speed", "m/s"),
    )
    outputs = (Signal("trolley", "m", noise=2e-4), Signal("angle", "rad", noise=1e-3))
    mass = number("kg", 10.0, 1.0, 100.0)
    cable = number("m", 0.8, 0.1, 5.0)
    damping = number("N s/m", 5.0, 0.0, 1e3)
    forces = (Force("speed", "trolley", unit="N", inertia="mass"),)
    effects = force("speed", ("coulomb_friction",))

    def derivative(self, state: Any, input: Any, p: Any) -> Any:
        """Rates of both places and speeds; 4 kg hang on the cable."""
        pull = 4.0 * 9.81 * math.tan(math.asin((state.load - state.trolley) / p.cable))
        speeding = (input.force - p.damping * state.speed + pull) / p.mass
        return state.speed, speeding, state.load_speed, -pull / 4.0

    def observe(self, state: Any, p: Any) -> Any:
        """The trolley's place and the angle."""
        return state.trolley, math.asin((state.load - state.trolley) / p.cable)


def record(
    names: tuple[str, ...],
    rates: list[list[float]],
    gain: list[float],
    seen: list[int],
    command: Callable[[Any, float], float],
    step: float,
    seed: int,
) -> Recording:
    """12 s under a command that is held from sample to sample, solved by the matrix exponential, with noise.

    Args:
        names: Command and outputs.
        rates: Matrix of the states' rates.
        gain: The command's part in them.
        seen: States that have a sensor.
        command: Of the state and a set point between -1 and 1.
        step: Sampling interval [s].
        seed: Of set points and noise.
    """
    rng = np.random.default_rng(seed)
    a, b = np.array(rates), np.array(gain)[:, None]
    ahead, push, *_ = cont2discrete((a, b, np.eye(len(a)), 0 * b), step)
    targets = np.repeat(rng.uniform(-1.0, 1.0, 15), round(0.8 / step))
    state, states, given = np.zeros(len(a)), [], []
    for target in targets:
        states.append(state)
        given.append(command(state, target))
        state = ahead @ state + push[:, 0] * given[-1]
    path = np.array(states)[:, seen]
    shown = {n: path[:, i] + NOISE[n] * rng.standard_normal(len(path)) for i, n in enumerate(names[1:])}
    return Recording(
        step * np.arange(len(path)), {names[0]: np.array(given), **shown}, source=f"record {seed}"
    )


def cylinder(seed: int) -> Recording:
    """A cylinder that follows set points by its valve; oil and mass swing at 10 Hz."""
    mass, damping, oil, flow = 131.0, 716.0, 5.7e5, 0.288
    rates = [[0, 1, 0], [0, -damping / mass, 1 / mass], [0, -oil, -4.0]]
    return record(
        ("valve", "position", "load"), rates, [0, 0, oil * flow], [0, 2],
        lambda x, r: float(np.clip(20.0 * (0.1 * r - x[0]), -1, 1)), 0.004, seed,
    )  # fmt: skip


def test_the_phase_of_a_fast_swing_is_found():
    """A fifth of a window is about a period of this swing: averages over it do not show the start's phase."""
    found = diagnose(Cylinder(), [cylinder(1)], [cylinder(2)])
    assert found.verdict == "consistent", found.summary()
    for name, sizes in found.above_noise.items():
        assert sizes < 1.2, (name, sizes)


@pytest.mark.nightly
def test_an_unseen_load_starts_where_the_motor_is():
    """Its angle may be radians, however small a noise its state declares; the refit ends at the truth."""
    motor, damping, load, spring = 0.0118, 0.05, 0.0208, 22.9
    rates = [
        [0, 1, 0, 0], [-spring / motor, -damping / motor, spring / motor, 0],
        [0, 0, 0, 1], [spring / load, 0, -spring / load, 0],
    ]  # fmt: skip
    train, test = (
        record(
            ("torque", "motor", "motor_speed"), rates, [0, 1 / motor, 0, 0], [0, 1],
            lambda x, r: float(np.clip(0.6 * (2.0 * r - x[0]) - 0.05 * x[1], -1, 1)), 0.002, seed,
        )
        for seed in (1, 2)
    )  # fmt: skip
    model = TwoMass().scaled_to([train, test])
    training, _ = split(model, [train], [test])
    base = fitted(training)
    assert base.parameters[:4] == pytest.approx((motor, damping, load, spring), rel=0.05)


def swinging(seed: int) -> Recording:
    """30 s of a crane of 13 kg, a cable of 0.95 m and a damping of 9 N s/m, driven along a hall of 4 m."""
    rng, step, rows = np.random.default_rng(seed), 0.01, []
    state = np.array([1.0, 0.0, 1.0, 0.0])
    for target in np.repeat(rng.uniform(0.0, 4.0, 15), 200):
        trolley, speed, load, _ = state
        given = float(np.clip(60.0 * (target - trolley) - 40.0 * speed, -50.0, 50.0))
        rows.append((given, trolley, np.arcsin((load - trolley) / 0.95)))

        def rates(_: float, y: Any, given: float = given) -> list[float]:
            sine = (y[2] - y[0]) / 0.95
            tangent = sine / np.sqrt(1.0 - sine**2)
            return [y[1], (given - 9.0 * y[1] + 39.24 * tangent) / 13.0, y[3], -9.81 * tangent]

        state = solve_ivp(rates, (0.0, step), state, rtol=1e-8, atol=1e-10).y[:, -1]
    columns = np.array(rows).T
    columns[1:] += np.array([[2e-4], [1e-3]]) * rng.standard_normal((2, len(rows)))
    return Recording(
        step * np.arange(len(rows)), dict(zip(("force", "trolley", "angle"), columns, strict=True))
    )


@pytest.mark.nightly
def test_a_load_starts_where_its_angle_shows_it():
    """A refit whose loads all start at 0, out of reach of most trolleys, has no number for most windows."""
    train = swinging(1)
    model = Crane().scaled_to([train])
    training, _ = split(model, [train], [])
    assert fitted(training).parameters[:3] == pytest.approx((13.0, 0.95, 9.0), rel=0.03)


def candidates_of(problem: Problem) -> Candidates:
    """What fits the base to a problem."""
    whitener = np.diag(1 / problem.output_scale)
    start = start_vector(problem.model, {})
    return Candidates(problem, start, frozenset(), problem.folds, whitener)


def fitted(problem: Problem) -> Fit:
    """The base fitted to a problem."""
    return candidates_of(problem).base().fit


@pytest.mark.nightly
def test_a_slipping_encoder_does_not_lose_the_refit():
    """Jumps of six noises are fitted best, in averages, by a swing that no sample shows."""
    rng = np.random.default_rng(0)
    step, inertia, damping = 0.01, 0.0025, 0.055
    time = step * np.arange(3000)
    given = 0.45 * np.interp(time, np.arange(0.0, 34.0, 2.0), np.repeat(rng.uniform(-1, 1, 18), 2)[:17])
    a, b = np.array([[0, 1], [-1 / inertia, -damping / inertia]]), np.array([[0], [1 / inertia]])
    ahead, push, *_ = cont2discrete((a, b, np.eye(2), 0 * b), step)
    state, path = np.array([given[0], 0.0]), []
    for u in given:
        path.append(state[0])
        state = ahead @ state + push[:, 0] * u
    slips = 0.0064 * np.cumsum(np.bincount(rng.integers(0, 3000, 8), rng.choice([-1.0, 1.0], 8), 3000))
    shown = np.array(path) + slips + 1e-3 * rng.standard_normal(3000)
    train = Recording(time, {"set_point": given, "position": shown})
    model = Servo().scaled_to([train])
    training, _ = split(model, [train], [])
    candidates = candidates_of(training)
    base = candidates.base().fit
    assert not mistaken_columns(model, [train], candidates, base)
    assert 0.5 < base.parameters[1] / damping < 2.0
