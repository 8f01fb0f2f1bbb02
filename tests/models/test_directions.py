"""What acts in each direction of motion of an own machine, against an adaptive integration."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fieldmodels.effects import actuator, change, force
from fieldmodels.machine import Force, Machine, number
from fieldmodels.model import Signal
from fieldmodels.recording import Recording, Windows

STEP, SAMPLES = 0.01, 300
PUSH = 0.8
"""Constant force in one direction [N m]."""


class Geared(Machine):
    """A motor that turns a load by a soft shaft."""

    inputs = (Signal("torque", "N m"),)
    states = (
        Signal("motor", "rad"), Signal("motor_speed", "rad/s"),
        Signal("load", "rad"), Signal("load_speed", "rad/s"),
    )  # fmt: skip
    outputs = (Signal("motor", "rad", noise=1e-4), Signal("load", "rad", noise=1e-4))
    shaft = number("N m/rad", 20.0, 1.0, 100.0)
    damping = number("N m s/rad", 0.5, 0.0, 10.0)
    rotor = number("kg m^2", 0.1, 0.01, 1.0)
    beam = number("kg m^2", 0.3, 0.01, 3.0)
    forces = (
        Force("motor_speed", "motor", unit="N m", inertia="rotor", name="torque"),
        Force("load_speed", "load", unit="N m", inertia="beam", name="torque"),
    )
    effects = (
        actuator("torque", ("lag",))
        + force("motor_speed", ("coulomb_friction",))
        + force("load_speed", ("coulomb_friction",), prefix="load_")
        + change("shaft")
    )

    def derivative(self, state, input, p):
        twist = p.shaft * (state.motor - state.load)
        return (
            state.motor_speed, (input.torque - twist - p.damping * state.motor_speed) / p.rotor,
            state.load_speed, (twist - p.damping * state.load_speed) / p.beam,
        )  # fmt: skip


class Stepped(Geared):
    """The same with an integration of its own: many small steps of Euler's."""

    substeps = 64
    derivative = None

    def step(self, state, input, p, dt):
        twist = p.shaft * (state.motor - state.load)
        motor_speed = (
            state.motor_speed + dt * (input.torque - twist - p.damping * state.motor_speed) / p.rotor
        )
        load_speed = state.load_speed + dt * (twist - p.damping * state.load_speed) / p.beam
        return state.motor + dt * motor_speed, motor_speed, state.load + dt * load_speed, load_speed


def simulated(machine: Machine, effects: dict[str, float], direction: int, hold: str) -> np.ndarray:
    """Both angles from rest under a torque, with a constant force in one direction."""
    time = STEP * np.arange(SAMPLES)
    log = Recording(time, {"torque": np.sin(3.0 * time), "motor": 0.0 * time, "load": 0.0 * time}, "test")
    vector = machine.nominal.copy()
    for name, value in effects.items():
        vector[machine.index(name)] = value
    whole = Windows(
        log, np.array([0]), np.array([SAMPLES]), np.zeros((1, 4)), np.ones((1, SAMPLES, 2), dtype=np.bool_)
    )
    pushed = whole.with_disturbance(PUSH * np.outer(np.ones(SAMPLES), machine.pushes[direction].weights))
    return machine.held_as(hold).simulate(vector[None], pushed)[0, 0]


def integrated(direction: int, drag: float, shaft_later: float) -> np.ndarray:
    """The same by SciPy: friction by a steep slope, a shaft that changes at 1.5 s."""

    def rates(t: float, y: np.ndarray) -> list[float]:
        shaft = 20.0 * (shaft_later if t >= 1.5 else 1.0)
        twist = shaft * (y[0] - y[2])
        torques = [math.sin(3.0 * t) - twist, twist]
        torques[direction] += PUSH
        torques[1] -= drag * math.tanh(y[3] / 1e-4)
        return [y[1], (torques[0] - 0.5 * y[1]) / 0.1, y[3], (torques[1] - 0.5 * y[3]) / 0.3]

    time = STEP * np.arange(SAMPLES)
    found = solve_ivp(
        rates, (0.0, time[-1]), np.zeros(4), "LSODA", time, rtol=1e-9, atol=1e-11, max_step=0.02
    )
    return found.y[[0, 2]].T


@pytest.mark.matrix(
    keep=(
        "alone-1",
        "beside friction-0",
        "beside a change-0",
    )
)
@pytest.mark.parametrize("direction", [0, 1])
@pytest.mark.parametrize(
    ("effects", "drag", "later"),
    [
        ({}, 0.0, 1.0),
        ({"load_coulomb_friction.torque": 0.2}, 0.2, 1.0),
        ({"shaft_step.change": 20.0}, 0.0, 2.0),
    ],
    ids=["alone", "beside friction", "beside a change"],
)
def test_a_force_acts_in_its_own_direction(effects, drag, later, direction):
    shown = simulated(Geared(), {"shaft_step.time": 1.5, **effects}, direction, "interpolated")
    np.testing.assert_allclose(shown, integrated(direction, drag, later), atol=5e-4)


@pytest.mark.matrix(keep=("1",))
@pytest.mark.parametrize("direction", [0, 1])
def test_a_force_acts_in_its_own_direction_of_a_machine_that_steps_by_itself(direction):
    np.testing.assert_allclose(
        simulated(Stepped(), {}, direction, "interpolated"), integrated(direction, 0.0, 1.0), atol=5e-3
    )


def test_directions_are_named_after_what_they_move():
    assert [(p.name, p.unit, p.weights) for p in Geared().pushes] == [
        ("force on motor_speed", "N m", (1.0, 0.0)),
        ("force on load_speed", "N m", (0.0, 1.0)),
    ]
