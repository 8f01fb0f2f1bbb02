"""Oracle of the test rig: ``mass dv/dt = force - damping v - stiffness x``, and docs/models.md."""

from __future__ import annotations

from collections.abc import Mapping

from exam.oracles import Values, filled, one_axis
from fieldmodels.arrays import FloatArray

NEUTRAL: Values = {
    **one_axis.neutral("force"),
    "asymmetric_damping": {"coefficient": 0.0},
    "payload": {"mass": 0.0},
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
    mass = base["mass"] + given["payload"]["mass"]
    on = {name: given[name] for name in effects if name != "payload"}

    def force(x: float, v: float, drive: float) -> float:
        return drive - base["damping"] * v - base["stiffness"] * x

    return one_axis.shown(one_axis.episode(force, mass, on, commands[:, 0], step, "velocity"), start)
