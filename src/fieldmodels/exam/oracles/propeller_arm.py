"""Oracle of the propeller arm: ``inertia dv/dt = thrust - damping v - gravity_moment sin(angle)``."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.exam.oracles import Values, filled, one_axis

NEUTRAL: Values = {**one_axis.neutral("torque"), "thrust_curve": {"exponent": 1.0}}


def simulate(
    base: Mapping[str, float],
    effects: Values,
    commands: FloatArray,
    step: float,
    start: Mapping[str, float] | None = None,
) -> FloatArray:
    """Drive one episode; see ``Simulate`` and ``one_axis.simulate``."""
    given = filled(effects, NEUTRAL)
    axis = one_axis.Axis(
        force="torque",
        inertia=base["inertia"],
        damping=base["damping"],
        gravity=base["gravity_moment"],
        bias=given["sensor_bias"]["bias"],
        given=given,
    )
    command = commands[:, 0]
    thrust = np.sign(command) * np.abs(command) ** given["thrust_curve"]["exponent"]
    return one_axis.simulate(axis, thrust, step, start)
