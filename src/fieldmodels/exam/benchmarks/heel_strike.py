"""The walking leg: the walkers of the task, with exact strike times and a process torque."""

from __future__ import annotations

import math
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.exam.benchmarks.base import Benchmark, Outside
from fieldmodels.exam.benchmarks.noise import wandering
from fieldmodels.machines.heel_strike.model import HeelStrikeModel
from fieldmodels.machines.heel_strike.parameters import Leg, Noise
from fieldmodels.machines.heel_strike.recording import record_walk
from fieldmodels.model import EffectValues, Model
from fieldmodels.reality import Reality
from fieldmodels.recording import Recording

DURATION = 120.0
LEG = Leg(step=0.01)
NOISE = Noise(process=0.15, floor=0.001)
TEETH = 25.0
"""Periods of the cogging per radian, times 2 pi."""


class HeelStrike(Benchmark):
    """Two minutes at 100 Hz on an even floor; the torque on the hinge stays random without noise too."""

    name = "heel_strike"
    outside = MappingProxyType(
        {
            "cogging": "A motor's cogging: a torque that changes several times over the leg's swing.",
            "gyro_bend": "A gyro whose scale grows with the square of the rate.",
            "gyro_clip": "A gyro that cannot show more than a certain rate.",
            "gyro_swing": "A gyro whose bias swings slowly, as with the sun on its case.",
        }
    )
    constants = MappingProxyType({"periodic_force.frequency": 1.37, "parameter_step.time": 0.5 * DURATION})

    @property
    def model(self) -> Model:
        """The leg, sampled at 100 Hz."""
        return HeelStrikeModel(LEG)

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
        white = replace(NOISE, gyro=math.sqrt(1.0 - coloured) * NOISE.gyro)
        levels = white if noise else Noise(gyro=0.0, collision=0.0, process=NOISE.process, floor=0.0)
        cogging = (outside.size, TEETH) if outside and outside.name == "cogging" else (0.0, 1.0)
        rng = np.random.default_rng(seed)
        walk = record_walk(DURATION, rng, levels, Reality(effects=reality), LEG, cogging)
        walk = wandering(walk, {"gyro": NOISE.gyro}, coloured, 0.5, seed)
        if outside and outside.name != "cogging":
            measured = _faulty(outside, walk["gyro"], walk.time)
            return replace(walk, signals={**walk.signals, "gyro": measured})
        return walk


def _faulty(outside: Outside, gyro: FloatArray, time: FloatArray) -> FloatArray:
    """What a faulty gyro shows [rad/s]."""
    if outside.name == "gyro_bend":
        return gyro + outside.size * gyro**3
    if outside.name == "gyro_clip":
        limit = 1.0 / outside.size
        return np.clip(gyro, -limit, limit)
    assert outside.name == "gyro_swing"
    return gyro + outside.size * np.sin(2 * np.pi * time / 45.0)
