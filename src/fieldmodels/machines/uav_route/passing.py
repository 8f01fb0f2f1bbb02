"""A straight flight past radars: which of its scans detect, without computing each.

Along a straight line a radar's probability of detection rises to the closest approach and falls after it: the
range shrinks, the elevation grows, and the azimuth leaves the nose's cone; then all that runs backwards. So
the scans that detect are one stretch, and bisection finds its ends. What is computed is computed as ``scan``
computes it, and timers take the same steps: results are equal to the bit.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import allocation_free
from fieldmodels.compiled import allocation_free_inlined as inlined
from fieldmodels.machines.uav_route.aircraft import Phase
from fieldmodels.machines.uav_route.lock_loss import timers_after
from fieldmodels.machines.uav_route.parameters import ELAPSED, IN_SAMPLES
from fieldmodels.machines.uav_route.radar import certain, chance
from fieldmodels.machines.uav_route.signature import NOSE
from fieldmodels.machines.uav_route.state import ENGAGE, LAUNCH, LOSE


@inlined
def rises_and_falls(plant: Any) -> bool:
    """Whether the nose points along the course, and its cone ends before the wings."""
    return bool(
        plant.wind.north == 0.0
        and plant.wind.east == 0.0
        and plant.nose_cone_width.factor * NOSE <= 0.5 * math.pi
    )


@allocation_free
def likely_at(flight: Any, r: int, flown: float, phase: Phase, plant: Any, p: Any) -> float:
    """Probability with which a radar detects an aircraft a time [s] after it was at its place."""
    north, east = flight.place[0] + flown * phase.north, flight.place[1] + flown * phase.east
    return chance(flight.radars[r, 0] - north, flight.radars[r, 1] - east, phase.attitude, plant, p)


PASS = np.dtype(
    [
        ("first", np.int64),  # number of the first scan that detects
        ("end", np.int64),  # of the one after the last that does; as ``first`` if none does
        ("closest", np.int64),  # of the one with the largest probability
        ("largest", np.float64),  # that probability
        ("last", np.float64),  # probability in the last scan of all
    ]
)
"""What the scans of a radar find."""


@allocation_free
def edge(
    flight: Any, r: int, times: FloatArray, inside: int, outside: int, phase: Phase, plant: Any, p: Any
) -> int:
    """The last scan that detects on the way from one that does to one that does not."""
    while abs(inside - outside) > 1:
        middle = (inside + outside) // 2
        if certain(likely_at(flight, r, times[middle], phase, plant, p), p):
            inside = middle
        else:
            outside = middle
    return inside


@allocation_free
def look(
    flight: Any, r: int, times: FloatArray, count: int, step: float, phase: Phase, plant: Any, p: Any,
    found: Any,
) -> None:  # fmt: skip
    """Find which of a radar's scans, at so many times [s] with a step between them, detect."""
    north = flight.radars[r, 0] - flight.place[0] + plant.radar_position.north
    east = flight.radars[r, 1] - flight.place[1] + plant.radar_position.east
    abeam = (north * phase.north + east * phase.east) / (phase.speed * phase.speed)
    found.last = likely_at(flight, r, times[count - 1], phase, plant, p)
    closest, largest = count - 1, found.last
    if abeam < times[count - 1]:
        closest = max(math.floor((abeam - times[0]) / step), -1)
        largest = likely_at(flight, r, times[closest], phase, plant, p) if closest >= 0 else -1.0
        if closest < count - 1:
            other = likely_at(flight, r, times[closest + 1], phase, plant, p)
            if other > largest:
                closest, largest = closest + 1, other
    found.closest, found.largest, found.first, found.end = closest, largest, 0, 0
    if certain(largest, p):
        found.end = count
        if closest > 0 and not certain(likely_at(flight, r, times[0], phase, plant, p), p):
            found.first = edge(flight, r, times, closest, 0, phase, plant, p)
        if not certain(found.last, p):
            found.end = edge(flight, r, times, closest, count - 1, phase, plant, p) + 1


@inlined
def may_hit(flight: Any, r: int, found: Any, count: int, step: float, p: Any) -> bool:
    """Whether a radar may launch its missile, or has, in so many steps of a time [s]."""
    longest = count if p.engaged == ELAPSED else found.end - found.first
    engage = flight.timers[r, ENGAGE] + longest * step
    return bool(p.timers == IN_SAMPLES or (engage > 0.0 and engage * (1.0 + 1e-9) >= p.engage))


@inlined
def run_harmless(flight: Any, r: int, found: Any, count: int, step: float, p: Any) -> None:
    """Let a radar's timers run for so many steps of a time [s], in which it launches no missile."""
    lose, engage, launch = flight.timers[r, LOSE], flight.timers[r, ENGAGE], flight.timers[r, LAUNCH]
    unbroken, k = flight.unbroken[r], 0
    while k < count:
        if k == found.first and found.end > k:
            while k < found.end:
                engage, unbroken, k = engage + step, unbroken + step, k + 1
            lose, flight.longest = 0.0, max(flight.longest, unbroken)
        elif engage == 0.0 and launch == 0.0:
            till = found.first if k < found.first else count
            while k < till:
                lose, k = lose + step, k + 1
            unbroken = 0.0
        else:
            lose, engage, launch, lost, _ = timers_after(lose, engage, launch, False, step, p)
            flight.losses += 1 if lost else 0
            unbroken, k = 0.0, k + 1
    flight.timers[r, LOSE], flight.timers[r, ENGAGE], flight.timers[r, LAUNCH] = lose, engage, launch
    flight.unbroken[r] = unbroken
