"""A driven pendulum: the model for a user's own rotary bench."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from fieldmodels.effects import actuator, force, sensor
from fieldmodels.effects.stock import LARGE
from fieldmodels.elementary import sine
from fieldmodels.machine import Force, number
from fieldmodels.machines.one_axis.model import OneAxis
from fieldmodels.machines.one_axis.scales import Scales
from fieldmodels.machines.rig import light
from fieldmodels.model import Effect, Parameter, Signal
from fieldmodels.recording.units import STANDARD_GRAVITY

DFKI = "identified on the DFKI simple pendulum bench"
PAYLOAD = Effect(
    "payload",
    "The axis carries an additional load.",
    "force",
    (
        Parameter("mass", "kg", 0.0, 0.0, LARGE, 3e-3, starts=(6e-3,)),
        Parameter("length", "m", 0.5, 1e-3, 1e2, 0.05, starts=(0.5,)),
    ),
    "M + m l^2, G + m g l",
)
SHAFT = (
    *force("velocity", ("coulomb_friction", "stribeck_friction", "hysteresis", "cogging")),
    *force("velocity", ("quadratic_drag", "cubic_stiffness")),
    *sensor("angle", ("backlash",), prefix=""),
)
"""Stock effects of a shaft."""
PERIPHERY = (
    *sensor("angle", ("bias", "drift", "gain", "delay", "quantisation")),
    *sensor("velocity", ("lag",), prefix="velocity_"),
)  # fmt: skip
"""Stock effects of its sensor."""


class Pendulum(OneAxis):
    """Inertia under gravity without friction; a torque in, an angle (and perhaps a velocity) out.

        inertia dv/dt = torque - gravity_moment sin(angle)

    The angle is zero where the pendulum hangs at rest. ``gravity_moment`` is mass times distance of
    the centre of mass from the axis times the acceleration of gravity.
    """

    inputs = (Signal("torque", "N m"),)
    outputs = (
        Signal("angle", "rad", noise=2e-3, angle=True),
        Signal("velocity", "rad/s", noise=5e-2, optional=True),
    )
    states = (Signal("angle", "rad"), Signal("velocity", "rad/s"))
    inertia = number("kg m^2", 0.0626, 1e-9, 1e6, scale=0.006, source=DFKI)
    gravity_moment = number("N m", 1.0, 0.0, 1e8, source=DFKI)
    forces = (Force("velocity", "angle", "N m", "loaded", name="torque"),)
    effects = (
        *force("velocity", ("viscous_friction",)),
        *SHAFT,
        PAYLOAD,
        *force("velocity", ("constant_force", "periodic_force")),
        *actuator("torque", without=("bias", "play", "parameter_step")),
        *PERIPHERY,
        *actuator("torque", ("parameter_step",), prefix=""),
    )
    horizons = (0.15, 0.3, 0.6)
    rotary = True
    damped = False
    nominal_scales = Scales(
        base=(0.0626, 1.0), force=0.5, high_forces=(1.5, 1.2, 0.8, 0.4), rate=150.0, position=0.8,
        velocity=2.0, duration=30.0, step=0.01, position_noise=2e-3, velocity_noise=5e-2, frequencies=(1.0,),
    )  # fmt: skip

    def loaded(self, p: Any) -> Any:
        """Inertia [kg m^2]; a payload is a point mass at some distance from the axis."""
        return p.inertia + p.payload_mass * p.payload_length**2

    def derivative(self, state: Any, input: Any, p: Any) -> Any:
        """Rates of angle and velocity."""
        gravity = p.gravity_moment + p.payload_mass * p.payload_length * STANDARD_GRAVITY
        inertia = p.inertia + p.payload_mass * p.payload_length**2
        return state.velocity, (input.torque - gravity * sine(state.angle)) * (1.0 / inertia)

    def pace(self, p: Any) -> Any:
        """The frequency of its small swings [rad/s]."""
        gravity = p.gravity_moment + p.payload_mass * p.payload_length * STANDARD_GRAVITY
        return math.sqrt(abs(gravity) / (p.inertia + p.payload_mass * p.payload_length**2))

    def suited(self, effect: Effect) -> Effect:
        """A payload is sought from a tenth of the inertia on."""
        mass, length = effect.parameters
        return replace(effect, parameters=(light(mass, 0.1 * self.scales.base[0]), length))
