"""How near an aircraft may fly to a radar: Tables 4.1 and 4.2 as distances over the ground."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.machines.uav_route.detection import probability_of_detection
from fieldmodels.machines.uav_route.parameters import World
from fieldmodels.machines.uav_route.signature import signature_of

NOSE = math.radians(30.0)
"""Half-angle of the cone about the nose in which Table 4.1's signature is low [rad]."""
TAIL = math.radians(20.0)
"""The same about the tail [rad]."""
STEEP = math.radians(1.0)
"""Within this angle Table 4.1 goes from low to high [rad]."""


@dataclass(frozen=True)
class Limits:
    """Distances over the ground beyond which no radar's probability exceeds the threshold [km].

    Attributes:
        side: Level, at any azimuth.
        banked_side: In a turn, at any azimuth.
        nose: Level or in a turn, the radar within ``NOSE`` of the nose.
        tail: Level or in a turn, the radar within ``TAIL`` of the tail.
    """

    side: float
    banked_side: float
    nose: float
    tail: float


@lru_cache(maxsize=64)
def limits_of(world: World) -> Limits:
    """Find the distances for a world by bisection on the worst azimuth of each mode."""
    bank = world.aircraft.bank
    every = np.radians(np.linspace(0.0, 180.0, 721))
    nose, tail = np.linspace(0.0, NOSE, 121), np.linspace(math.pi - TAIL, math.pi, 81)
    return Limits(
        side=_safe_beyond(world, every, (0.0,)),
        banked_side=_safe_beyond(world, every, (0.0, -bank, bank)),
        nose=_safe_beyond(world, nose, (0.0, -bank, bank)),
        tail=_safe_beyond(world, tail, (0.0, -bank, bank)),
    )


@lru_cache(maxsize=64)
def banked_limits(world: World, *, kinder: bool = False) -> tuple[FloatArray, FloatArray]:
    """Azimuths from nose to tail [rad], and beyond which distance [km] a bank to any side is not detected.

    With ``kinder`` it is the distance of the side to which a bank shows less.
    """
    azimuths = np.radians(np.linspace(0.0, 180.0, 361))
    coarse = np.arange(0.0, world.detection.reach + 8.0, 4.0)[:, None]

    def seen(distance: FloatArray) -> NDArray[np.bool_]:
        at, azimuth = np.broadcast_arrays(distance, azimuths)
        banks = (-world.aircraft.bank, world.aircraft.bank)
        chances = [probability_seen(world, at, azimuth, b) for b in banks]
        worst = np.min(chances, axis=0) if kinder else np.max(chances, axis=0)
        return np.asarray(worst > world.detection.threshold)

    low = np.where(seen(coarse), coarse, -4.0).max(axis=0)
    high = low + 4.0
    for _ in range(30):
        middle = 0.5 * (low + high)
        low, high = np.where(seen(middle), middle, low), np.where(seen(middle), high, middle)
    return azimuths, high


@lru_cache(maxsize=64)
def steepest(world: World, nose: bool) -> tuple[FloatArray, FloatArray]:
    """Distances over the ground, and how far the radar may be from nose or tail there, rounded up [rad]."""
    radius = np.arange(1.0, limits_of(world).side + 1.0)
    cone = NOSE if nose else TAIL
    offsets = np.linspace(0.0, STEEP, 201)
    azimuth = cone + offsets if nose else math.pi - cone - offsets
    seen = probability_seen(world, radius[:, None] + 0.0 * azimuth, azimuth + 0.0 * radius[:, None])
    last = np.maximum((seen <= world.detection.threshold).sum(axis=1), 1) - 1
    return radius, cone + offsets[last] + offsets[1]


def probability_seen(
    world: World, distance: FloatArray, azimuth: FloatArray, bank: float | FloatArray = 0.0
) -> FloatArray:
    """Probability of detection from a distance over the ground [km] at a level azimuth [rad], with a bank."""
    height = world.aircraft.altitude
    ahead, level = distance * np.cos(azimuth), distance * np.sin(azimuth)
    right = level * np.cos(bank) + height * np.sin(bank)
    belly = height * np.cos(bank) - level * np.sin(bank)
    flat = np.hypot(ahead, right)
    slant = np.hypot(distance, height)
    seen = probability_of_detection(
        signature_of(np.arctan2(right, ahead), np.arctan2(-belly, flat)), slant, world.detection.interpolation
    )
    return np.where(slant <= world.detection.reach, seen, 0.0)


def _safe_beyond(world: World, azimuths: FloatArray, banks: tuple[float, ...]) -> float:
    """Distance over the ground beyond which none of these attitudes is detected [km]."""

    def seen(distance: float) -> bool:
        worst = max(
            probability_seen(world, np.full(len(azimuths), distance), azimuths, b).max() for b in banks
        )
        return bool(worst > world.detection.threshold)

    coarse = np.arange(0.0, world.detection.reach + 2.0, 1.0)
    last = max((i for i, distance in enumerate(coarse) if seen(float(distance))), default=-1)
    if last < 0:
        return 0.0
    low, high = float(coarse[last]), float(coarse[last]) + 1.0
    for _ in range(50):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if seen(middle) else (low, middle)
    return high
