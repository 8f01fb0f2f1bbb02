"""A joint under position control: the model for logs that hold set-points instead of torques."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Self

from fieldmodels.effects import actuator, force, sensor
from fieldmodels.effects.stock import LARGE, NO_LIMIT
from fieldmodels.elementary import sine
from fieldmodels.machine import Force, Machine, number
from fieldmodels.machines.one_axis.scales import Scales, measure_scales
from fieldmodels.model import Effect, Parameter, Signal
from fieldmodels.recording import Recording

LEG = "assumed: 0.02 kg m^2 under 20 N m/rad and 1.5 N m s/rad, as in a quadruped's leg"
GRAVITY = Effect(
    "gravity",
    "Gravity pulls on the joint, wherever it would hang.",
    "force",
    (
        Parameter("sine", "rad", 0.0, -LARGE, LARGE, 0.01, starts=(0.02,)),
        Parameter("cosine", "rad", 0.0, -LARGE, LARGE, 0.01, starts=(0.02,)),
    ),
    "G_s sin(x) + G_c cos(x)",
)
DEAD_BAND = Effect(
    "dead_band",
    "The controller lets small errors of position be.",
    "actuator",
    (Parameter("width", "rad", 0.0, 0.0, LARGE, 5e-3, starts=(5e-3, 0.02)),),
    "e = u - x is 0 up to a width, and less by it beyond",
)
TORQUE_LIMIT = Effect(
    "torque_limit",
    "The motor gives no more than a certain torque.",
    "actuator",
    (Parameter("limit", "rad", NO_LIMIT, 1e-9, NO_LIMIT, 0.02, starts=(0.05, 0.2, 0.5)),),
    "|e - damping v| <= limit",
)
USUAL = Scales(
    base=(1e-3, 0.075, 1.0), force=0.2, high_forces=(0.5, 0.4, 0.3, 0.2), rate=20.0, position=0.2,
    velocity=1.0, duration=30.0, step=0.01, position_noise=5e-4, velocity_noise=2e-2, frequencies=(1.0,),
)  # fmt: skip
"""Of a leg's joint: inertia, damping and stiffness by its proportional gain, where data cannot tell."""
LEAST = 1e-2
"""Of the inertia at which a fit starts: with less, errors of friction would have it vanish."""


class Servo(Machine):
    """An inertia that a PD controller leads to a set-point; a set-point in, a position out.

        inertia dv/dt = set_point - position - damping v + offset

    A motion shows only ratios of moments; so all of them are in units of the proportional gain: a friction
    of 0.03 rad holds the joint up to 0.03 rad away from its set-point. Times the gain [N m/rad] it is in N m,
    and ``inertia`` in kg m^2. ``damping`` is the derivative gain and viscous friction, which are one, and
    ``offset`` a constant torque and all biases, without which no joint is where it is told to be.

    Left out is a gain of the sensor: it equals one of the set-point.
    """

    inputs = (Signal("set_point", "rad"),)
    outputs = (Signal("position", "rad", noise=5e-4), Signal("velocity", "rad/s", noise=2e-2, optional=True))
    states = (Signal("position", "rad"), Signal("velocity", "rad/s"))
    inertia = number("s^2", 1e-3, 1e-10, 1e3, source=LEG)
    damping = number("s", 0.075, 0.0, 1e3, source=LEG)
    offset = number("rad", 0.0, -10.0, 10.0, scale=0.01)
    forces = (Force("velocity", "position", "rad", "inertia", name="torque"),)
    effects = (
        *force("velocity", ("coulomb_friction", "stribeck_friction", "hysteresis", "cogging")),
        *force("velocity", ("quadratic_drag", "periodic_force")),
        GRAVITY,
        DEAD_BAND,
        TORQUE_LIMIT,
        *actuator("set_point", ("gain", "lag", "rate_limit", "delay", "saturation")),
        *sensor("position", ("drift", "delay", "quantisation")),
    )

    def scaled_to(self, recordings: Sequence[Recording]) -> Self:
        """Start inertia and damping where an axis on a spring would have them; see ``Model.scaled_to``."""
        result = super().scaled_to(recordings)
        measured = measure_scales(
            recordings, self.inputs[0].name, "position", "velocity", False, True, USUAL, self.hold
        )
        inertia, damping, stiffness = measured.base
        own = {p.name: p for p in result.parameters}
        for name, size in (("inertia", inertia / stiffness), ("damping", damping / stiffness)):
            least = min(LEAST * size, own[name].nominal) if name == "inertia" else 0.0
            own[name] = replace(own[name], starts=(size,), scale=0.1 * size, lower=least)
        result.parameters = tuple(own.values())
        return result

    def derivative(self, state: Any, input: Any, p: Any) -> Any:
        """Rates of position and velocity."""
        error = input.set_point - state.position
        if p.dead_band_width > 0.0:
            error = math.copysign(max(abs(error) - p.dead_band_width, 0.0), error)
        torque = error - p.damping * state.velocity
        if abs(torque) > p.torque_limit_limit:
            torque = math.copysign(p.torque_limit_limit, torque)
        torque += p.offset + p.gravity_sine * sine(state.position)
        torque += p.gravity_cosine * sine(state.position + 0.5 * math.pi)
        return state.velocity, torque / p.inertia

    def pace(self, p: Any) -> Any:
        """Its natural frequency, and the rate of its damping [1/s]."""
        return math.sqrt(1.0 / p.inertia) + p.damping / p.inertia
