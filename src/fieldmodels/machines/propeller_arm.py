"""An arm on a hinge that a propeller lifts: the model of a quarter of a drone."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.drivers.windows import Once
from fieldmodels.effects import actuator, force
from fieldmodels.elementary import sine
from fieldmodels.machine import Force, number
from fieldmodels.machines.one_axis.model import OneAxis
from fieldmodels.machines.one_axis.scales import Scales
from fieldmodels.machines.pendulum import PERIPHERY, SHAFT, Pendulum
from fieldmodels.model import Effect, Parameter, Signal
from fieldmodels.recording import Recording, Windows

KEPT = 16
"""Exponents whose thrust is kept: a fit asks for few, many times."""
BENCH = "identified on the quarter-drone bench"
EXPONENT = "thrust_curve.exponent"
THRUST_CURVE = Effect(
    name="thrust_curve",
    cause="Thrust grows with a power of the command (with the square, if the command sets a propeller's "
    "speed), not in proportion.",
    where="actuator",
    parameters=(Parameter("exponent", "1", 1.0, 0.2, 5.0, 0.1, starts=(0.6, 0.9, 1.1, 1.5, 2.0)),),
    equation="F = |u|^exponent sign(u)",
)


def _no_thrust_yet(_: Recording) -> dict[float, Recording]:
    return {}


class PropellerArm(OneAxis):
    """An inertia under gravity that a propeller turns about a hinge: motor command in, angle out.

        inertia dv/dt = command - damping v - gravity_moment sin(angle)

    A motion shows only ratios of moments; so all of them are in units of the thrust's moment at full
    command (1, or 100 %). The angle is zero where the arm hangs at rest. Nominally thrust is in proportion
    to the command.
    """

    inputs = (Signal("command", "1"),)
    outputs = Pendulum.outputs
    states = Pendulum.states
    inertia = number("s^2", 0.01, 1e-9, 1e6, source=BENCH)
    damping = number("s", 0.02, 0.0, 1e4, scale=0.005, source=BENCH)
    gravity_moment = number("1", 0.4, 0.0, 1e4, source=BENCH)
    forces = (Force("velocity", "angle", "1", "inertia", name="torque"),)
    effects = (
        *SHAFT,
        *force("velocity", ("constant_force", "periodic_force")),
        *actuator("command", without=("bias", "play", "parameter_step")),
        *PERIPHERY,
        *actuator("command", ("parameter_step",), prefix=""),
        THRUST_CURVE,
    )
    horizons = (0.5, 1.0, 2.0)
    rotary = True
    damped = True
    nominal_scales = Scales(
        base=(0.01, 0.02, 0.4), force=0.35, high_forces=(0.5, 0.45, 0.42, 0.4), rate=10.0,
        position=0.4, velocity=1.0,
        duration=100.0, step=0.01, position_noise=2e-4, velocity_noise=5e-2, frequencies=(1.0,),
    )  # fmt: skip

    def __init__(self, scales: Scales | None = None, driven_by_measured: bool = False) -> None:
        """Declare parameters and effects for an arm of these scales (default: nominal)."""
        super().__init__(scales, driven_by_measured)
        self.measured_inputs = ()  # thrust on a bench is not measured
        self._thrusts: Once[dict[float, Recording]] = Once(_no_thrust_yet)

    def derivative(self, state: Any, input: Any, p: Any) -> Any:
        """Rates of angle and velocity."""
        left = input.command - p.damping * state.velocity - p.gravity_moment * sine(state.angle)
        return state.velocity, left * (1.0 / p.inertia)

    def pace(self, p: Any) -> Any:
        """The frequency of its small swings, and the rate of its damping [1/s]."""
        return math.sqrt(abs(p.gravity_moment) / p.inertia) + p.damping / p.inertia

    def simulate(self, parameters: FloatArray, windows: Windows) -> FloatArray:
        """Simulate every window with the thrust that the command gives; see ``Model.simulate``."""
        parameters = np.atleast_2d(parameters)
        exponents = parameters[:, self.index(EXPONENT)]
        out = np.empty((len(parameters), len(windows), windows.samples, len(self.outputs)))
        for exponent in np.unique(exponents):
            rows = exponents == exponent
            out[rows] = super().simulate(parameters[rows], self._driven(parameters[rows][0], windows))
        return out

    def _driven(self, parameters: FloatArray, windows: Windows) -> Windows:
        """The windows with thrust in place of commands."""
        exponent = parameters[self.index(EXPONENT)]
        recording, name = windows.recording, self.inputs[0].name
        known = self._thrusts(recording)
        driven = known.get(exponent)
        if driven is None:
            if len(known) >= KEPT:
                known.clear()
            thrust = np.sign(recording[name]) * np.abs(recording[name]) ** exponent
            driven = known[exponent] = replace(recording, signals={**recording.signals, name: thrust})
        return replace(windows, recording=driven)
