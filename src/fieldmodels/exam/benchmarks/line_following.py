"""The walking robot: the walks of the task, in coordinates of the floor."""

from __future__ import annotations

import math
from functools import cache
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.exam.benchmarks.base import Benchmark, Outside
from fieldmodels.exam.benchmarks.noise import wandering
from fieldmodels.machines.line_following.parameters import Noise
from fieldmodels.machines.line_following.recording import LAW, record_walk
from fieldmodels.machines.line_following.tracks import Track, straight
from fieldmodels.machines.line_following.walks import Scene, Walks
from fieldmodels.model import EffectValues
from fieldmodels.recording import Recording

STRIDES = 1000
NOISE = Noise(bias=0.0)
CORRELATION = 6.0
"""Correlation time of noise that wanders [s]: five strides."""


class LineFollowing(Benchmark):
    """A straight line of 1000 strides with random turns; yaw and slip stay random without noise too."""

    name = "line_following"
    outside = MappingProxyType(
        {
            "weak_left": "The robot turns less to the left than to the right.",
            "sideways_drift": "The robot slides sideways in its turns.",
            "bent_sensor": "A sensor whose scale grows towards its edges.",
            "smeared_sensor": "A sensor that still holds a share of its last reading.",
        }
    )

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
        white = math.sqrt(1.0 - coloured) if noise else 0.0
        levels = Noise(sensor=white * NOISE.sensor, yaw=NOISE.yaw, lateral=NOISE.lateral, bias=0.0)
        walk = record_walk(
            dict(reality),
            STRIDES,
            scene=Scene(_line(), noise=levels),
            law=LAW,
            noise=white,
            robot=_robot(outside) if outside else Walks,
            rng=np.random.default_rng(seed),
        )
        whole = {output.name: output.noise for output in self.model.outputs} | {"line": NOISE.sensor}
        return wandering(walk, whole, coloured, CORRELATION, seed)


@cache
def _line() -> Track:
    """A straight line that is long enough."""
    return straight(0.7 * STRIDES + 10.0)


class Faulty(Walks):
    """A robot whose fault is in no list.

    Attributes:
        weak: Share by which turns to the left are smaller.
        drift: Sideways slip for each turn [m/rad].
        bent: Cubic part of the sensor [1/m^2].
        smeared: Share of the last reading in each.
    """

    weak: ClassVar[float] = 0.0
    drift: ClassVar[float] = 0.0
    bent: ClassVar[float] = 0.0
    smeared: ClassVar[float] = 0.0

    def advance(self, commands: Any) -> None:
        """See ``Walks.advance``; what was commanded is what is remembered."""
        one = self.walks[0]
        asked = float(np.asarray(commands)[0])
        done = asked * (1.0 - self.weak) if asked > 0 else asked
        last = float(one["lines"][0, 0])
        one["x"] -= self.drift * done * np.sin(one["heading"])
        one["y"] += self.drift * done * np.cos(one["heading"])
        super().advance(np.array([done]))
        one["commands"][0] = asked
        place = float(one["lines"][0, 0])
        one["lines"][0, 0] = self.smeared * last + (1.0 - self.smeared) * (place + self.bent * place**3)


FIELDS = {
    "weak_left": "weak", "sideways_drift": "drift", "bent_sensor": "bent", "smeared_sensor": "smeared",
}  # fmt: skip
UNITS: dict[str, FloatArray | float] = {"weak": 0.2, "drift": 0.4, "bent": 20.0, "smeared": 0.3}


def _robot(outside: Outside) -> type[Walks]:
    """A robot with a fault, of ``size`` times a middling one."""
    field = FIELDS[outside.name]
    share = outside.size * UNITS[field]
    return type("Faulty", (Faulty,), {field: min(share, 0.95) if field in ("weak", "smeared") else share})
