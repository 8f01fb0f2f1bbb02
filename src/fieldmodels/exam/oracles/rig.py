"""Oracle of the test rig: ``mass dv/dt = force - damping v - stiffness x``, and docs/models.md."""

from __future__ import annotations

from collections.abc import Mapping

from fieldmodels.arrays import FloatArray
from fieldmodels.exam.oracles import Values, filled, one_axis

NEUTRAL: Values = {**one_axis.neutral("force"), "payload": {"mass": 0.0}}


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
        force="force",
        inertia=base["mass"] + given["payload"]["mass"],
        damping=base["damping"],
        stiffness=base["stiffness"],
        velocity_bias=given["sensor_bias"]["bias"],
        given=given,
    )
    return one_axis.simulate(axis, commands[:, 0], step, start)
