"""The wheeled robot: its drives integrated eight times finer than a diagnosis predicts them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.exam.benchmarks.base import Benchmark, Outside
from fieldmodels.machines.pose_reaching.recording import record_drive
from fieldmodels.model import EffectValues
from fieldmodels.recording import Recording

DURATION = 120.0
RADIUS = 0.1
"""Of the wheel whose eccentricity makes the drive surge [m]."""


class PoseReaching(Benchmark):
    """Two minutes at 20 Hz by random commands, with measured wheels."""

    name = "pose_reaching"
    outside = MappingProxyType(
        {
            "weak_left": "The drive turns less to the left than to the right.",
            "understeer": "The robot turns the less, the faster it goes.",
            "surging_drive": "The drive surges once a turn of an eccentric wheel.",
            "compass": "A compass whose error depends on the heading (hard iron).",
        }
    )
    constants = MappingProxyType({"parameter_step.time": 0.45 * DURATION})

    def record(
        self,
        reality: EffectValues,
        seed: int,
        *,
        noise: bool = True,
        coloured: float = 0.0,
        outside: Outside | None = None,
    ) -> Recording:
        """See ``Benchmark.record``."""
        applied = _drive(outside) if outside and outside.name != "compass" else None
        drive = record_drive(
            DURATION, np.random.default_rng(seed), reality, noise=float(noise), coloured=coloured,
            applied=applied,
        )  # fmt: skip
        if outside and outside.name == "compass":
            heading = drive["heading"] + outside.size * np.sin(drive["heading"])
            return replace(drive, signals={**drive.signals, "heading": heading})
        return drive


def _drive(outside: Outside) -> Callable[[FloatArray, float], FloatArray]:
    """What a faulty drive makes of speed and turn rate."""

    def applied(commands: FloatArray, step: float) -> FloatArray:
        speed, rate = commands.T
        if outside.name == "weak_left":
            return np.column_stack([speed, np.where(rate > 0, 1.0 - min(outside.size, 0.9), 1.0) * rate])
        if outside.name == "understeer":
            return np.column_stack([speed, rate / (1.0 + outside.size * speed**2)])
        assert outside.name == "surging_drive"
        angle = np.cumsum(speed) * step / RADIUS
        return np.column_stack([speed * (1.0 + outside.size * np.sin(angle)), rate])

    return applied
