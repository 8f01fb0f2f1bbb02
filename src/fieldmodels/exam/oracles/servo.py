"""Oracle of the servo: ``inertia dv/dt = set_point - position - damping v + offset``, and docs/models.md."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.exam.oracles import Values, filled, one_axis

SHARED = one_axis.neutral("torque")
ABSENT = {
    *("backlash", "cubic_stiffness", "constant_force", "actuator_asymmetry", "actuator_dead_zone"),
    *("sensor_bias", "sensor_gain", "parameter_step"),
}
"""What other axes have, and a servo has not."""
NEUTRAL: Values = {
    **{effect: values for effect, values in SHARED.items() if effect not in ABSENT},
    "gravity": {"sine": 0.0, "cosine": 0.0},
    "dead_band": {"width": 0.0},
    "torque_limit": {"limit": math.inf},
}


@dataclass(frozen=True)
class Joint(one_axis.Axis):
    """An axis driven by what a controller makes of its set-point.

    Attributes:
        derivative_gain: What the controller gives against a velocity.
        offset: A constant torque.
    """

    derivative_gain: float = 0.0
    offset: float = 0.0

    def push(self, x: float, v: float, time: float, actuator: float) -> float:
        """All forces but dry friction and hysteresis."""
        width, limit = self.given["dead_band"]["width"], self.given["torque_limit"]["limit"]
        error = actuator - x
        motor = error - min(max(error, -width), width) - self.derivative_gain * v
        pull = self.given["gravity"]
        constant = self.offset + pull["sine"] * math.sin(x) + pull["cosine"] * math.cos(x)
        return super().push(x, v, time, float(np.clip(motor, -limit, limit))) + constant


def simulate(
    base: Mapping[str, float],
    effects: Values,
    commands: FloatArray,
    step: float,
    start: Mapping[str, float] | None = None,
) -> FloatArray:
    """Drive one episode; see ``Simulate`` and ``one_axis.simulate``."""
    joint = Joint(
        force="torque",
        inertia=base["inertia"],
        derivative_gain=base["damping"],
        offset=base["offset"],
        given={**SHARED, **filled(effects, NEUTRAL)},
    )
    return one_axis.simulate(joint, commands[:, 0], step, start)
