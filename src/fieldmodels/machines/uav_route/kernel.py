"""The kernels of a batch of flights: legs flown under the radars' scans, arrival and score, in one call."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray, IntArray
from fieldmodels.compiled import allocation_free, compiled
from fieldmodels.compiled import allocation_free_inlined as inlined
from fieldmodels.machines.uav_route.aircraft import Leg, Phase, heading_of, leg_of, turn_into
from fieldmodels.machines.uav_route.layouts import distance_around, draw_layout
from fieldmodels.machines.uav_route.lock_loss import timers_after
from fieldmodels.machines.uav_route.observation import distance_to_goal, radial, write
from fieldmodels.machines.uav_route.parameters import ABOVE, AROUND, RADARS, STOCHASTIC, TWO_QUADRANT
from fieldmodels.machines.uav_route.passing import (
    PASS,
    likely_at,
    look,
    may_hit,
    rises_and_falls,
    run_harmless,
)
from fieldmodels.machines.uav_route.radar import certain
from fieldmodels.machines.uav_route.state import ARRIVED, DAMAGED, ENGAGE, FLYING, LATE, LAUNCH, LOSE
from fieldmodels.streams import GAMMA, mixed, uniform

STEPS = 512
"""How many steps past radars are taken at once."""


class Room(NamedTuple):
    """Room for a kernel to work in."""

    order: FloatArray  # of the radars by their distance, shape (2, RADARS)
    times: FloatArray  # of scans [s], shape (STEPS,)
    found: NDArray[Any]  # by each radar, shape (RADARS,), dtype PASS


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
    put_at_start(flight, p)


@inlined
def put_at_start(flight: Any, p: Any) -> None:
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
    flight.way = way_left(flight, p)


@allocation_free
def scan(flight: Any, flown: float, phase: Phase, plant: Any, p: Any) -> None:
    """Let every radar compute its probability of detection a time [s] from here, and tell who detects."""
    for r in range(p.radars):
        likely = likely_at(flight, r, flown, phase, plant, p)
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
def scan_by_scan(flight: Any, duration: float, phase: Phase, plant: Any, p: Any) -> tuple[float, bool]:
    """Scan every step of a phase; returns the time flown [s] and whether it ends in a hit.

    Detection above the threshold is tested in the middle of steps; drawn scans come at their own times, and
    what a scan has found holds until the next one.
    """
    flown, hit = 0.0, False
    pieces = max(1, math.ceil(duration / p.step - 1e-9))
    interval = p.scan_interval * plant.scan_interval.factor
    while flown < duration and not hit:
        time = duration / pieces
        if p.detection == STOCHASTIC:
            due = flight.scans * interval - flight.time
            if due <= 1e-9:
                scan(flight, flown, phase, plant, p)
                draw_scans(flight, p)
                due = flight.scans * interval - flight.time
            time = min(max(due, 1e-9), duration - flown)
        else:
            scan(flight, flown + 0.5 * time, phase, plant, p)
        hit = run_timers(flight, time, p)
        flown = flown + time if flown + time < duration - 1e-9 else duration
    return flown, hit


@inlined
def run_past(
    flight: Any, count: int, step: float, phase: Phase, plant: Any, p: Any, room: Room
) -> tuple[int, bool]:  # fmt: skip
    """Let all timers run for so many steps [s] past radars.

    Returns:
        How many were taken; whether a missile hits.
    """
    times, found = room.times, room.found
    harmless, first, end = True, count, 0
    for r in range(p.radars):
        look(flight, r, times, count, step, phase, plant, p, found[r])
        harmless = harmless and not may_hit(flight, r, found[r], count, step, p)
        if found[r].end > found[r].first:
            first, end = min(first, found[r].first), max(end, found[r].end)
    done, hit = 0, False
    if harmless:
        for r in range(p.radars):
            run_harmless(flight, r, found[r], count, step, p)
        for k in range(first, end):
            seen = p.radars == 1
            for r in range(p.radars):
                seen = seen or found[r].first <= k < found[r].end
            flight.time_over += step if seen else 0.0
        for _ in range(count):
            flight.time += step
        done = count
    while done < count and not hit:
        for r in range(p.radars):
            flight.detected[r] = 1 if found[r].first <= done < found[r].end else 0
        hit = run_timers(flight, step, p)
        done += 1
    for r in range(p.radars):
        one = found[r]
        last = one.last if done == count else likely_at(flight, r, times[done - 1], phase, plant, p)
        flight.probability[r], flight.detected[r] = last, 1 if one.first < done <= one.end else 0
        flight.largest = max(flight.largest, one.largest if one.closest < done else last)
    return done, hit


@inlined
def fly_past(
    flight: Any, duration: float, phase: Phase, plant: Any, p: Any, room: Room
) -> tuple[float, bool]:
    """As ``scan_by_scan`` without drawn scans, as many steps at once as there is room for their times."""
    times = room.times
    left = max(1, math.ceil(duration / p.step - 1e-9))
    step = duration / left
    flown, hit = 0.0, False
    while flown < duration and not hit:
        begun, count = flown, max(min(left - 2, len(times)), 0)
        for k in range(count):  # surely whole steps
            times[k] = flown + 0.5 * step
            flown += step
        left -= count
        while count < len(times) and flown + step < duration - 1e-9:
            times[count] = flown + 0.5 * step
            flown, count = flown + step, count + 1
        if count < len(times) and not flown + step < duration - 1e-9:
            times[count] = flown + 0.5 * step
            flown, count = duration, count + 1
        done, hit = run_past(flight, count, step, phase, plant, p, room)
        if done < count:
            flown = begun
            for _ in range(done):
                flown += step
    return flown, hit


@allocation_free
def fly_phase(flight: Any, duration: float, phase: Phase, plant: Any, p: Any, room: Room) -> bool:
    """Fly with one velocity and attitude for a time [s]; returns whether it ends in a hit."""
    if p.detection == STOCHASTIC or not rises_and_falls(plant):
        flown, hit = scan_by_scan(flight, duration, phase, plant, p)
    else:
        flown, hit = fly_past(flight, duration, phase, plant, p, room)
    north, east = phase.north, phase.east
    flight.place[0] += flown * north
    flight.place[1] += flown * east
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
def fly(flight: Any, course: float, length: float, plant: Any, p: Any, room: Room) -> None:
    """Fly one leg of a course [rad] and a length [km]."""
    begun = begin_leg(flight, course, length, plant, p)
    leg, way, hit = begun.leg, begun.way, False
    if begun.banked > 0.0:
        hit = fly_phase(flight, begun.banked, leg.turning, plant, p, room)
        way = max(way - leg.turning.speed * begun.banked, 0.0)
    if not hit and way > 1e-9:
        hit = fly_phase(flight, way / leg.level.speed, leg.level, plant, p, room)
    end_leg(flight, hit, begun.arrives, p)


@allocation_free
def way_left(flight: Any, p: Any) -> float:
    """Distance to the goal by which progress is measured [km]."""
    if p.progress != AROUND:
        return distance_to_goal(flight)
    circle = math.sqrt(max(p.side_on**2 - p.altitude**2, 0.0))
    return distance_around(flight.place, flight.goal, flight.radars[: p.radars], circle)


@inlined
def score(flight: Any, path: float, detected: float, p: Any) -> float:
    """What a leg was worth that began with a path behind it [km]."""
    way, flight.way = flight.way, way_left(flight, p)
    value: float = -p.length_cost * (flight.path - path) + p.progress_reward * (way - flight.way)
    if flight.over == ARRIVED:
        value += p.arrival_reward
    elif flight.over == DAMAGED:
        value -= p.damage_cost
    elif flight.over == LATE:
        value -= p.late_cost
    if detected > 0.0:
        value -= p.detection_cost * detected + p.sighting_cost
    return value


@allocation_free
def advance_rows(
    rows: IntArray,
    flights: NDArray[Any],
    actions: FloatArray,
    flying: bool,
    relative: bool,
    restarting: bool,
    plants: NDArray[Any],
    rules: NDArray[Any],
    observed: NDArray[np.float32],
    numbers: FloatArray,
    known: FloatArray,
    reward: FloatArray,
    over: IntArray,
    room: Room,
) -> None:
    """As ``advance_all``, with room to work in."""
    for b in rows:
        flight, plant, p = flights[b], plants[b], rules[b]
        gain = 0.0
        if flying and restarting and flight.over != FLYING:
            begin(flight, p)
        elif flying and flight.over == FLYING:
            course = actions[b, 0]
            if relative:
                cosine, sine = radial(flight, plant, p.radars)
                course += math.atan2(sine, cosine)
            path, seen = flight.path, flight.time_over
            fly(flight, course, min(max(actions[b, 1], p.least_leg), p.longest_leg), plant, p, room)
            gain = score(flight, path, flight.time_over - seen, p)
        reward[b] = gain
        over[b] = flight.over
        write(flight, plant, b, p, room.order, observed, numbers, known)


@compiled
def advance_all(
    rows: IntArray,
    flights: NDArray[Any],
    actions: FloatArray,
    flying: bool,
    relative: bool,
    restarting: bool,
    plants: NDArray[Any],
    rules: NDArray[Any],
    observed: NDArray[np.float32],
    numbers: FloatArray,
    known: FloatArray,
    reward: FloatArray,
    over: IntArray,
) -> None:
    """Take some flights through one leg, or with ``flying`` off only observe; see ``Flights.advance``."""
    room = Room(np.zeros((2, RADARS)), np.empty(STEPS), np.empty(RADARS, PASS))
    advance_rows(
        rows, flights, actions, flying, relative, restarting, plants, rules,
        observed, numbers, known, reward, over, room,
    )  # fmt: skip
