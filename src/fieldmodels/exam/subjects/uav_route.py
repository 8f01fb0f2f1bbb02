"""The flying aircraft: integrated in 200 pieces a sample, with complex positions."""

from __future__ import annotations

import math
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from fieldmodels.exam.subjects.base import Outside, Subject
from fieldmodels.exam.subjects.noise import wandering
from fieldmodels.model import EffectValues, FloatArray
from fieldmodels.recording import Recording
from fieldmodels.uav_route.recording import record_flight

DURATION = 4000.0
CORRELATION = 20.0
"""Correlation time of noise that wanders [s]: ten samples."""


class UavRoute(Subject):
    """Flights of 4000 s at 0.5 Hz from one random waypoint to the next."""

    name = "uav_route"
    outside = MappingProxyType(
        {
            "speed_by_place": "The aircraft is faster in the north than in the south.",
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
        """See ``Subject.record``."""
        by_place = outside if outside and outside.name == "speed_by_place" else None
        flight = record_flight(
            dict(reality),
            DURATION,
            noise=math.sqrt(1.0 - coloured) * noise,
            added=(lambda place: by_place.size * math.tanh(place.real / 50e3)) if by_place else None,
            rng=np.random.default_rng(seed),
        )
        whole = {o.name: o.noise for o in self.model.outputs if o.name in ("north", "east")}
        flight = wandering(flight, whole, coloured, CORRELATION, seed)
        if outside and by_place is None:
            places = {name: _shown(outside, flight.time, flight[name]) for name in ("north", "east")}
            return replace(flight, signals={**flight.signals, **places})
        return flight


def _shown(outside: Outside, time: FloatArray, place: FloatArray) -> FloatArray:
    """A coordinate as a faulty tracker shows it [m]."""
    if outside.name == "late_position":
        return np.interp(time - outside.size, time, place)
    if outside.name == "position_scale":
        return (1.0 + outside.size) * place
    assert outside.name == "position_swing"
    return place + outside.size * np.sin(2 * np.pi * time / 700.0)
