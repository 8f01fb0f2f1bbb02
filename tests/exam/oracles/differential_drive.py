"""Oracle of a differential drive that is commanded by its wheels' speeds (docs/pose_reaching.md)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from exam.oracles import Values, pose_reaching
from fieldmodels.arrays import FloatArray

NEUTRAL = pose_reaching.NEUTRAL


def simulate(
    base: Mapping[str, float],
    effects: Values,
    commands: FloatArray,
    step: float,
    start: Mapping[str, float] | None = None,
) -> FloatArray:
    """Drive one episode; see ``Simulate`` and ``pose_reaching.simulate``."""
    left, right = base["wheel_radius"] * commands.T
    motion = np.column_stack([0.5 * (left + right), (right - left) / base["track"]])
    return pose_reaching.simulate(base, effects, motion, step, start)
