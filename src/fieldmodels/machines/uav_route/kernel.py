"""The kernels of a batch of flights: legs flown under the radars' scans, arrival and score, in one call."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled, inlined
from fieldmodels.machines.uav_route.aircraft import Attitude, Leg, Phase, heading_of, leg_of, turn_into
from fieldmodels.machines.uav_route.layouts import distance_around, draw_layout
from fieldmodels.machines.uav_route.lock_loss import timers_after
from fieldmodels.machines.uav_route.observation import distance_to_goal, radial, write
from fieldmodels.machines.uav_route.parameters import ABOVE, AROUND, RADARS, STOCHASTIC, TWO_QUADRANT
from fieldmodels.machines.uav_route.radar import certain, chance
from fieldmodels.machines.uav_route.state import ARRIVED, DAMAGED, ENGAGE, FLYING, LATE, LAUNCH, LOSE
from fieldmodels.streams import GAMMA, mixed, uniform


@inlined
def begin(flight: Any, p: Any) -> None:
    """Begin a flight's next episode."""
    flight.episode += 1
    if p.drawn:
        key = mixed(flight.key + np.uint64(flight.episode) * GAMMA)
        draw_layout(key, p.radars, p.side_on, p.banked, flight.start, flight.goal, flight.radars)
    else:
        flight.start[0], flight.start[1] = p.start_north, p.start_east
        flight.goal[0], flight.goal[1] = p.goal_north, p.goal_east
        for r in range(p.radars):
            flight.radars[r, 0], flight.radars[r, 1] = p.sites[r, 0], p.sites[r, 1]
    put_at_start(flight)


@inlined
def put_at_start(flight: Any) -> None:
    """Put a flight at its start, with nothing flown and no radar that knows of it."""
    flight.over, flight.legs, flight.scans, flight.losses = FLYING, 0, 0, 0
    flight.place[0], flight.place[1] = flight.start[0], flight.start[1]
    north, east = flight.goal[0] - flight.start[0], flight.goal[1] - flight.start[1]
    distance = max(math.sqrt(north * north + east * east), 1e-9)
    flight.course[0], flight.course[1] = north / distance, east / distance
    for r in range(RADARS):
        flight.probability[r], flight.detected[r], flight.unbroken[r] = 0.0, 0, 0.0
        for timer in range(3):
            flight.timers[r, timer] = 0.0
    flight.time, flight.path, flight.time_over, flight.longest, flight.largest = 0.0, 0.0, 0.0, 0.0, 0.0


@inlined
def scan(flight: Any, north: float, east: float, attitude: Attitude, plant: Any, p: Any) -> None:
    """Let every radar compute its probability of detection, and detect above the threshold."""
    for r in range(p.radars):
        to_north, to_east = flight.radars[r, 0] - north, flight.radars[r, 1] - east
        likely = chance(to_north, to_east, attitude, plant, p)
        flight.probability[r] = likely
        flight.largest = max(flight.largest, likely)
        flight.detected[r] = 1 if certain(likely, p) else 0


@inlined
def draw_scans(flight: Any, p: Any) -> None:
    """Draw the result of each radar's scan; the numbers depend on the scan's time alone."""
    key = mixed(mixed(flight.key + np.uint64(flight.episode) * GAMMA) + GAMMA)
    for r in range(p.radars):
        number = uniform(key, RADARS * flight.scans + r)
        likely = flight.probability[r]
        seen = number >= likely if p.draw == ABOVE else number < likely
        flight.detected[r] = 1 if seen and likely > 0.0 else 0
    flight.scans += 1


@inlined
def run_timers(flight: Any, time: float, p: Any) -> bool:
    """Let all timers run for a time [s] in which nothing changes; returns whether a missile hits."""
    hit, over = False, False
    for r in range(p.radars):
        detected = flight.detected[r] == 1
        lose, engage, launch, lost, damaged = timers_after(
            flight.timers[r, LOSE], flight.timers[r, ENGAGE], flight.timers[r, LAUNCH], detected, time, p
        )
        flight.timers[r, LOSE], flight.timers[r, ENGAGE], flight.timers[r, LAUNCH] = lose, engage, launch
        flight.losses += 1 if lost else 0
        flight.unbroken[r] = flight.unbroken[r] + time if detected else 0.0
        flight.longest = max(flight.longest, flight.unbroken[r])
        hit = hit or damaged
        over = over or detected
    flight.time_over += time if over else 0.0
    flight.time += time
    return hit


@inlined
def fly_phase(flight: Any, duration: float, phase: Phase, plant: Any, p: Any) -> bool:
    """Fly with one velocity and attitude for a time [s]; returns whether it ends in a hit.

    Detection above the threshold is tested in the middle of steps; drawn scans come at their own times, and
    what a scan has found holds until the next one.
    """
    x, y = flight.place[0], flight.place[1]
    north, east = phase.north, phase.east
    flown, hit = 0.0, False
    pieces = max(1, math.ceil(duration / p.step - 1e-9))
    interval = p.scan_interval * plant.scan_interval.factor
    while flown < duration and not hit:
        time = duration / pieces
        if p.detection == STOCHASTIC:
            due = flight.scans * interval - flight.time
            if due <= 1e-9:
                scan(flight, x + flown * north, y + flown * east, phase.attitude, plant, p)
                draw_scans(flight, p)
                due = flight.scans * interval - flight.time
            time = min(max(due, 1e-9), duration - flown)
        else:
            middle = flown + 0.5 * time
            scan(flight, x + middle * north, y + middle * east, phase.attitude, plant, p)
        hit = run_timers(flight, time, p)
        flown = flown + time if flown + time < duration - 1e-9 else duration
    flight.place[0], flight.place[1] = x + flown * north, y + flown * east
    flight.path += flown * math.sqrt(north * north + east * east)
    return hit


@inlined
def length_to_capture(flight: Any, north: float, east: float, length: float, capture: float) -> float:
    """How far along a leg [km] the goal's capture circle is entered; more than its length if it is not."""
    to_north, to_east = flight.goal[0] - flight.place[0], flight.goal[1] - flight.place[1]
    along = to_north * north + to_east * east
    across = to_east * north - to_north * east
    inside = capture * capture - across * across
    if inside < 0.0:
        return 2.0 * length + 1.0
    enter: float = along - math.sqrt(inside)
    if enter < 0.0:
        return 0.0 if to_north * to_north + to_east * to_east <= capture * capture else 2.0 * length + 1.0
    return enter


class Begun(NamedTuple):
    """A leg as it begins."""

    north: float  # cosine of its course
    east: float  # sine of its course
    turn: float  # into it [rad]
    leg: Leg
    way: float  # to its end, or to where the goal's capture circle is entered [km]
    banked: float  # time of its turning phase [s]
    arrives: bool  # whether it ends at the goal


@inlined
def begin_leg(flight: Any, course: float, length: float, plant: Any, p: Any) -> Begun:
    """Begin a leg of a course [rad] and a length [km]; the first one begins without a turn."""
    north, east = math.cos(course), math.sin(course)
    to_north, to_east = flight.place[0] + length * north, flight.place[1] + length * east
    turn = 0.0
    if flight.legs > 0:
        turn = turn_into(flight.course[0], flight.course[1], north, east, to_north, to_east, p)
    flight.course[0], flight.course[1] = north, east
    if p.arctangent == TWO_QUADRANT:
        course = heading_of(north, east, True)
        north, east = math.cos(course), math.sin(course)
    leg = leg_of(north, east, turn, plant, p)
    entered = length_to_capture(flight, north, east, length, p.capture)
    way = min(length, entered)
    return Begun(north, east, turn, leg, way, min(leg.banked, way / leg.turning.speed), entered <= length)


@inlined
def end_leg(flight: Any, hit: bool, arrives: bool, p: Any) -> None:
    """End a leg, and the flight if it is over."""
    flight.legs += 1
    if hit:
        flight.over = DAMAGED
    elif arrives:
        flight.over = ARRIVED
    elif flight.legs >= p.max_legs:
        flight.over = LATE


@inlined
def fly(flight: Any, course: float, length: float, plant: Any, p: Any) -> None:
    """Fly one leg of a course [rad] and a length [km]."""
    begun = begin_leg(flight, course, length, plant, p)
    leg, way, hit = begun.leg, begun.way, False
    if begun.banked > 0.0:
        hit = fly_phase(flight, begun.banked, leg.turning, plant, p)
        way = max(way - leg.turning.speed * begun.banked, 0.0)
    if not hit and way > 1e-9:
        hit = fly_phase(flight, way / leg.level.speed, leg.level, plant, p)
    end_leg(flight, hit, begun.arrives, p)


@inlined
def way_left(flight: Any, p: Any) -> float:
    """Distance to the goal by which progress is measured [km]."""
    if p.progress != AROUND:
        return distance_to_goal(flight)
    circle = math.sqrt(max(p.side_on**2 - p.altitude**2, 0.0))
    return distance_around(flight.place, flight.goal, flight.radars[: p.radars], circle)


@inlined
def score(flight: Any, way: float, path: float, detected: float, p: Any) -> float:
    """What a leg was worth that began with a way left [km] and a path behind it [km]."""
    value: float = -p.length_cost * (flight.path - path) + p.progress_reward * (way - way_left(flight, p))
    if flight.over == ARRIVED:
        value += p.arrival_reward
    elif flight.over == DAMAGED:
        value -= p.damage_cost
    elif flight.over == LATE:
        value -= p.late_cost
    if detected > 0.0:
        value -= p.detection_cost * detected + p.sighting_cost
    return value


@compiled
def start_all(flights: NDArray[Any], which: NDArray[np.int64], rules: NDArray[Any]) -> None:
    """Begin the next episode of some flights."""
    for b in which:
        begin(flights[b], rules[b])


@compiled
def advance_all(
    flights: NDArray[Any],
    actions: FloatArray,
    flying: bool,
    relative: bool,
    restarting: bool,
    plants: NDArray[Any],
    rules: NDArray[Any],
    observed: NDArray[np.float32],
    numbers: FloatArray,
    places: FloatArray,
    reward: FloatArray,
    over: NDArray[np.int64],
) -> bool:
    """Take every flight through one leg, or with ``flying`` off only observe; see ``Flights.advance``.

    Returns:
        False if an action is not a finite number; then nothing has happened.
    """
    order = np.zeros((2, RADARS))
    if flying:
        for b in range(len(flights)):
            if not (math.isfinite(actions[b, 0]) and math.isfinite(actions[b, 1])):
                return False
    for b in range(len(flights)):
        flight, plant, p = flights[b], plants[b], rules[b]
        gain = 0.0
        if flying and restarting and flight.over != FLYING:
            begin(flight, p)
        elif flying and flight.over == FLYING:
            course = actions[b, 0]
            if relative:
                cosine, sine = radial(flight, plant, p.radars)
                course += math.atan2(sine, cosine)
            way, path, seen = way_left(flight, p), flight.path, flight.time_over
            fly(flight, course, min(max(actions[b, 1], p.least_leg), p.longest_leg), plant, p)
            gain = score(flight, way, path, flight.time_over - seen, p)
        reward[b] = gain
        over[b] = flight.over
        write(flight, plant, b, p, order, observed, numbers, places)
    return True
