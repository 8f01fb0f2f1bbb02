"""Oracle of the servo: ``inertia dv/dt = set_point - position - damping v + offset``, and docs/models.md."""

from __future__ import annotations

import math
from collections.abc import Mapping

from exam.oracles import Values, filled, one_axis
from fieldmodels.arrays import FloatArray

SHARED = one_axis.neutral("torque")
ABSENT = {
    *("backlash", "cubic_stiffness", "constant_force", "actuator_asymmetry", "actuator_dead_zone"),
    *("sensor_bias", "sensor_gain", "velocity_lag", "parameter_step"),
}
"""What other axes have, and a servo has not."""
NEUTRAL: Values = {
    **{effect: values for effect, values in SHARED.items() if effect not in ABSENT},
    "gravity": {"sine": 0.0, "cosine": 0.0},
    "dead_band": {"width": 0.0},
    "torque_limit": {"limit": math.inf},
}


def simulate(
    base: Mapping[str, float],
    effects: Values,
    commands: FloatArray,
    step: float,
    start: Mapping[str, float] | None = None,
) -> FloatArray:
    """Drive one episode; see ``Simulate`` and ``one_axis``."""
    given = filled(effects, NEUTRAL)
    width, limit = given["dead_band"]["width"], given["torque_limit"]["limit"]
    sine, cosine = given["gravity"]["sine"], given["gravity"]["cosine"]

    def force(x: float, v: float, set_point: float) -> float:
        error = set_point - x
        motor = error - min(max(error, -width), width) - base["damping"] * v
        constant = base["offset"] + sine * math.sin(x) + cosine * math.cos(x)
        return min(max(motor, -limit), limit) + constant

    on = {name: given[name] for name in effects if name in SHARED}
    return one_axis.shown(one_axis.episode(force, base["inertia"], on, commands[:, 0], step), start)
