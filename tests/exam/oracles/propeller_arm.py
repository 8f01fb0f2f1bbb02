"""Oracle of the propeller arm: ``inertia dv/dt = thrust - damping v - gravity_moment sin(angle)``."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from exam.oracles import Values, filled, one_axis
from fieldmodels.arrays import FloatArray

NEUTRAL: Values = {**one_axis.neutral("torque"), "thrust_curve": {"exponent": 1.0}}


def simulate(
    base: Mapping[str, float],
    effects: Values,
    commands: FloatArray,
    step: float,
    start: Mapping[str, float] | None = None,
) -> FloatArray:
    """Drive one episode; see ``Simulate`` and ``one_axis``."""
    given = filled(effects, NEUTRAL)
    command = commands[:, 0]
    thrust = np.sign(command) * np.abs(command) ** given["thrust_curve"]["exponent"]
    on = {name: given[name] for name in effects if name != "thrust_curve"}

    def force(x: float, v: float, drive: float) -> float:
        return drive - base["damping"] * v - base["gravity_moment"] * math.sin(x)

    return one_axis.shown(one_axis.episode(force, base["inertia"], on, thrust, step), start)
