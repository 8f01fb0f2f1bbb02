"""A one-axis test rig on a spring: the model for a user's own linear bench."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from fieldmodels.effects import actuator, force, sensor
from fieldmodels.effects.stock import LARGE
from fieldmodels.machine import Force, number
from fieldmodels.machines.one_axis.model import OneAxis
from fieldmodels.machines.one_axis.scales import Scales
from fieldmodels.model import Effect, Parameter, Signal

PAYLOAD = Effect(
    "payload",
    "The axis carries an additional load.",
    "force",
    (Parameter("mass", "kg", 0.0, 0.0, LARGE, 0.1, starts=(0.2,)),),
    "M + m",
)


class Rig(OneAxis):
    """Mass, viscous damper and spring; a force in, a position (and perhaps a velocity) out.

        mass dv/dt = force - damping v - stiffness x

    Nominal values are an ordinary table-top bench; a diagnosis refits them, whatever the bench.
    """

    inputs = (Signal("force", "N"),)
    outputs = (Signal("position", "m", noise=2e-4), Signal("velocity", "m/s", noise=5e-3, optional=True))
    states = (Signal("position", "m"), Signal("velocity", "m/s"))
    mass = number("kg", 2.0, 1e-6, 1e6)
    damping = number("N s/m", 4.0, 0.0, 1e8)
    stiffness = number("N/m", 80.0, 0.0, 1e10)
    forces = (Force("velocity", "position", "N", "inertia", name="force"),)
    effects = (
        *force("velocity", ("coulomb_friction", "stribeck_friction", "hysteresis", "cogging")),
        *force("velocity", ("asymmetric_damping", "quadratic_drag", "cubic_stiffness")),
        *sensor("position", ("backlash",), prefix=""),
        PAYLOAD,
        *force("velocity", ("constant_force", "periodic_force")),
        *actuator("force", without=("bias", "play", "parameter_step")),
        *sensor("velocity", ("bias",)),
        *sensor("velocity", ("lag",), prefix="velocity_"),
        *sensor("position", ("drift", "gain", "delay", "quantisation")),
        *actuator("force", ("parameter_step",), prefix=""),
    )
    horizons = (0.2, 0.5, 1.0)
    rotary = False
    damped = True
    nominal_scales = Scales(
        base=(2.0, 4.0, 80.0), force=3.0, high_forces=(8.0, 6.0, 4.0, 2.0), rate=800.0, position=0.05,
        velocity=0.2, duration=30.0, step=0.01, position_noise=2e-4, velocity_noise=5e-3, frequencies=(1.0,),
    )  # fmt: skip

    def inertia(self, p: Any) -> Any:
        """Moved mass [kg]; a payload adds to it."""
        return p.mass + p.payload_mass

    def derivative(self, state: Any, input: Any, p: Any) -> Any:
        """Rates of position and velocity."""
        left = input.force - p.damping * state.velocity - p.stiffness * state.position
        return state.velocity, left * (
            1.0 / (p.mass + p.payload_mass)
        )  # the quotient is taken once for all steps

    def pace(self, p: Any) -> Any:
        """Its natural frequency, and the rate of its damping [1/s]."""
        mass = p.mass + p.payload_mass
        return math.sqrt(p.stiffness / mass) + p.damping / mass

    def suited(self, effect: Effect) -> Effect:
        """A payload is sought from a tenth of the mass on."""
        return replace(effect, parameters=(light(effect.parameters[0], 0.1 * self.scales.base[0]),))


def light(mass: Parameter, size: float) -> Parameter:
    """A payload's mass that is sought from a size on."""
    return replace(mass, scale=0.5 * size, starts=(size,))
