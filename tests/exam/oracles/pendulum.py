"""Oracle of the pendulum: ``inertia dv/dt = torque - gravity_moment sin(angle)``, and docs/models.md."""

from __future__ import annotations

import math
from collections.abc import Mapping

from exam.oracles import Values, filled, one_axis
from fieldmodels.arrays import FloatArray

NEUTRAL: Values = {
    **one_axis.neutral("torque"),
    "viscous_friction": {"coefficient": 0.0},
    "payload": {"mass": 0.0, "length": 0.5},
}
GRAVITY = 9.80665
"""Standard gravity [m/s^2] (CGPM 1901)."""


def simulate(
    base: Mapping[str, float],
    effects: Values,
    commands: FloatArray,
    step: float,
    start: Mapping[str, float] | None = None,
) -> FloatArray:
    """Drive one episode; see ``Simulate`` and ``one_axis``."""
    given = filled(effects, NEUTRAL)
    load = given["payload"]
    inertia = base["inertia"] + load["mass"] * load["length"] ** 2
    moment = base["gravity_moment"] + load["mass"] * GRAVITY * load["length"]
    on = {name: given[name] for name in effects if name != "payload"}

    def force(x: float, _v: float, drive: float) -> float:
        return drive - moment * math.sin(x)

    return one_axis.shown(one_axis.episode(force, inertia, on, commands[:, 0], step), start)
