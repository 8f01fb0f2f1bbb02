"""What is observed of a flight: in the frame of the nearest radar's bearing, from where it believes to be."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import allocation_free_inlined as inlined
from fieldmodels.machines.uav_route.state import ARRIVED, BOUND, DAMAGED, EACH, ENGAGE, LAUNCH, LOSE, OWN


@inlined
def within(value: float) -> float:
    """An observation within its bounds."""
    return min(max(value, -BOUND), BOUND)


@inlined
def distance_to_goal(flight: Any) -> float:
    """Distance to the goal [km]."""
    distance: float = math.hypot(flight.goal[0] - flight.place[0], flight.goal[1] - flight.place[1])
    return distance


@inlined
def measured_place(flight: Any, plant: Any) -> tuple[float, float]:
    """North and east at which the aircraft believes to be [km]."""
    return flight.place[0] + plant.sensor_bias.north, flight.place[1] + plant.sensor_bias.east


@inlined
def ratio(time: float, threshold: float) -> float:
    """A timer relative to its threshold, at most 1."""
    if threshold > 0.0:
        return min(time / threshold, 1.0)
    return 1.0 if time > 0.0 else 0.0


@inlined
def nearest_radar(flight: Any, north: float, east: float, count: int) -> int:
    """The radar next to a place."""
    best, least = 0, math.inf
    for r in range(count):
        square = (flight.radars[r, 0] - north) ** 2 + (flight.radars[r, 1] - east) ** 2
        if square < least:
            best, least = r, square
    return best


@inlined
def radial(flight: Any, plant: Any, count: int) -> tuple[float, float]:
    """Cosine and sine of the bearing of the nearest radar, from where the aircraft believes to be."""
    north, east = measured_place(flight, plant)
    r = nearest_radar(flight, north, east, count)
    to_north, to_east = flight.radars[r, 0] - north, flight.radars[r, 1] - east
    distance = math.sqrt(to_north * to_north + to_east * to_east)
    return (to_north / distance, to_east / distance) if distance > 0.0 else (1.0, 0.0)


@inlined
def observe(flight: Any, plant: Any, p: Any, observed: NDArray[np.float32], order: Any) -> None:
    """Write down what is observed of a flight, in the frame of the nearest radar's bearing; see ``EACH``."""
    north, east = measured_place(flight, plant)
    for r in range(p.radars):
        square = (flight.radars[r, 0] - north) ** 2 + (flight.radars[r, 1] - east) ** 2
        place = r
        while place > 0 and order[1, place - 1] > square:
            order[0, place], order[1, place] = order[0, place - 1], order[1, place - 1]
            place -= 1
        order[0, place], order[1, place] = r, square
    cosine, sine = radial(flight, plant, p.radars)
    to_north, to_east = flight.goal[0] - north, flight.goal[1] - east
    ahead, right = to_north * cosine + to_east * sine, to_east * cosine - to_north * sine
    distance = max(math.sqrt(ahead * ahead + right * right), 1.0)
    own = (  # in the order of OWN
        ahead / 100.0,
        right / 100.0,
        math.log(distance / 100.0),
        ahead / distance,
        right / distance,
        flight.course[0] * cosine + flight.course[1] * sine,
        flight.course[1] * cosine - flight.course[0] * sine,
        1.0 - flight.legs / p.max_legs,
    )
    for i in range(len(own)):
        observed[i] = within(own[i])
    for k in range(p.radars):
        r = int(order[0, k])
        row = observed[len(OWN) + k * len(EACH) :]
        to_north, to_east = flight.radars[r, 0] - north, flight.radars[r, 1] - east
        slant = math.sqrt(order[1, k] + p.altitude * p.altitude)
        reach = max(math.sqrt(order[1, k]), 1e-9)
        each = (  # in the order of EACH
            math.tanh((slant - p.side_on) / 5.0),
            math.tanh((slant - p.side_on) / 50.0),
            (slant - p.side_on) / 500.0,
            (to_north * cosine + to_east * sine) / reach,
            (to_east * cosine - to_north * sine) / reach,
            ratio(flight.timers[r, LOSE], p.lose),
            ratio(flight.timers[r, ENGAGE], p.engage),
            ratio(flight.timers[r, LAUNCH], p.target),
            float(flight.detected[r]),
        )
        for i in range(len(each)):
            row[i] = within(each[i])


@inlined
def write(
    flight: Any, plant: Any, b: int, p: Any, order: Any, observed: NDArray[np.float32],
    numbers: FloatArray, known: FloatArray,
) -> None:  # fmt: skip
    """Write down what is observed of flight ``b``, and its ``NUMBERS``."""
    observe(flight, plant, p, observed[b], order)
    values = (  # in the order of NUMBERS
        1.0 if flight.over == ARRIVED else 0.0,
        1.0 if flight.over == DAMAGED else 0.0,
        flight.time,
        flight.path,
        distance_to_goal(flight),
        flight.time_over,
        flight.longest,
        flight.largest,
        float(flight.losses),
        float(flight.legs),
    )
    for i in range(len(values)):
        numbers[i, b] = values[i]
    north, east = measured_place(flight, plant)
    r = nearest_radar(flight, north, east, p.radars)
    of_all = (  # in the order of KNOWN
        north,
        east,
        math.atan2(flight.course[1], flight.course[0]),
        math.atan2(flight.radars[r, 1] - east, flight.radars[r, 0] - north),
        flight.place[0],
        flight.place[1],
        flight.start[0],
        flight.start[1],
        flight.goal[0],
        flight.goal[1],
    )
    for i in range(len(of_all)):
        known[b, i] = of_all[i]
    for r in range(p.radars):
        row = known[b, len(of_all) + 6 * r :]
        row[0], row[1] = flight.radars[r, 0], flight.radars[r, 1]
        row[2], row[3], row[4] = flight.timers[r, LOSE], flight.timers[r, ENGAGE], flight.timers[r, LAUNCH]
        row[5] = flight.detected[r]
