"""The flying aircraft: integrated in 40 pieces a sample, with complex positions."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.exam.benchmarks.base import Benchmark, Outside
from fieldmodels.exam.benchmarks.noise import wandering
from fieldmodels.machines.uav_route.recording import record_flight
from fieldmodels.model import EffectValues
from fieldmodels.recording import Recording

DURATION, EPISODES = 2000.0, 4
CORRELATION = 20.0
"""Correlation time of noise that wanders [s]: ten samples."""


class UavRoute(Benchmark):
    """Four flights of 2000 s at 0.5 Hz from one random waypoint to the next, under a radar."""

    name = "uav_route"
    outside = MappingProxyType(
        {
            "fading_radar": "The radar's range swings slowly, as with the weather.",
            "late_position": "The tracker shows where the aircraft was some time ago.",
            "position_scale": "The tracker's map is too large.",
            "position_swing": "The tracker's position swings slowly.",
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
        fading = outside if outside and outside.name == "fading_radar" else None
        flight = record_flight(
            dict(reality),
            DURATION,
            episodes=EPISODES,
            noise=math.sqrt(1.0 - coloured) * noise,
            faded=_fading(fading.size) if fading else None,
            rng=np.random.default_rng(seed),
        )
        whole = {o.name: o.noise for o in self.model.outputs if o.name in ("north", "east")}
        flight = wandering(flight, whole, coloured, CORRELATION, seed)
        if outside and not fading:
            places = {name: _measured(outside, flight, name) for name in ("north", "east")}
            return replace(flight, signals={**flight.signals, **places})
        return flight


def _fading(size: float) -> Callable[[complex, float], float]:
    """Factor of the radar's ranges, which swings once in 900 s."""
    return lambda _place, time: math.exp(min(size, 2.0) * math.sin(2 * math.pi * time / 900.0))


def _measured(outside: Outside, flight: Recording, name: str) -> FloatArray:
    """A coordinate as a faulty tracker shows it [m]."""
    place = flight[name]
    if outside.name == "late_position":
        return np.concatenate(
            [
                np.interp(flight.time[a:b] - outside.size, flight.time[a:b], place[a:b])
                for a, b in flight.bounds
            ]
        )
    if outside.name == "position_scale":
        return (1.0 + outside.size) * place
    assert outside.name == "position_swing"
    return place + outside.size * np.sin(2 * np.pi * flight.time / 700.0)
