"""The kernels of several aircraft under the same radars: all fly at once, until the first leg ends."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled, inlined
from fieldmodels.machines.uav_route.aircraft import Phase, leg_of
from fieldmodels.machines.uav_route.kernel import (
    begin,
    begin_leg,
    draw_scans,
    end_leg,
    put_at_start,
    run_timers,
    scan,
    score,
)
from fieldmodels.machines.uav_route.layouts import draw_further
from fieldmodels.machines.uav_route.observation import radial, within, write
from fieldmodels.machines.uav_route.parameters import ONE, RADARS, STOCHASTIC
from fieldmodels.machines.uav_route.state import ENGAGE, FLYING
from fieldmodels.streams import GAMMA, mixed

UNDERWAY = np.dtype(
    [
        ("going", np.int64),  # 1 while a leg is flown
        ("north", np.float64),  # cosine of its course
        ("east", np.float64),  # sine of its course
        ("turn", np.float64),  # into it [rad]
        ("banked", np.float64),  # time left of its turning phase [s]
        ("way", np.float64),  # left to its end, or to the goal's capture circle [km]
        ("arrives", np.int64),  # whether it ends at the goal
        ("hit", np.int64),  # whether a missile has just hit
    ]
)
"""What an aircraft remembers of a leg that it has not finished."""

FREE = -1
"""A radar that follows no aircraft."""


@inlined
def phase_now(under: Any, plant: Any, p: Any) -> Phase:
    """How an aircraft flies at this moment."""
    leg = leg_of(under.north, under.east, under.turn, plant, p)
    return leg.turning if under.banked > 0.0 else leg.level


@inlined
def follow_one(flights: Any, legs: Any, tracked: Any, p: Any) -> None:
    """Let each free radar lock on the likeliest that it detects, and overlook all others."""
    for r in range(p.radars):
        likeliest = 0.0
        if tracked[r] == FREE:
            for a in range(len(flights)):
                found = legs[a].going == 1 and flights[a].detected[r] == 1
                if found and flights[a].probability[r] > likeliest:
                    likeliest, tracked[r] = flights[a].probability[r], a
        for a in range(len(flights)):
            if tracked[r] not in (FREE, a):
                flights[a].detected[r] = 0


@inlined
def let_go(flights: Any, tracked: Any, p: Any) -> None:
    """Free each radar whose lock is lost, or whose aircraft's flight is over."""
    for r in range(p.radars):
        a = tracked[r]
        if a != FREE and (flights[a].over != FLYING or flights[a].timers[r, ENGAGE] <= 0.0):
            tracked[r] = FREE


@inlined
def scan_all(flights: Any, legs: Any, flown: float, plants: Any, p: Any) -> None:
    """Let every radar scan every aircraft that flies, a time [s] after it was at its place."""
    for a in range(len(flights)):
        if legs[a].going == 1:
            flight, phase = flights[a], phase_now(legs[a], plants[a], p)
            scan(flight, flown, phase, plants[a], p)
            if p.detection == STOCHASTIC:
                draw_scans(flight, p)


@inlined
def next_scan(flights: Any, legs: Any, plants: Any, p: Any) -> float:
    """Time to the next drawn scan [s]: whoever flies has the same clock."""
    due = 0.0
    for a in range(len(flights)):
        if legs[a].going == 1:
            due = flights[a].scans * (p.scan_interval * plants[a].scan_interval.factor) - flights[a].time
    return due


@inlined
def fly_span(flights: Any, legs: Any, tracked: Any, duration: float, plants: Any, p: Any) -> None:
    """Fly on for a time [s] in which nobody's velocity or attitude changes, or until a missile hits."""
    pieces = max(1, math.ceil(duration / p.step - 1e-9))
    flown, hit = 0.0, False
    while flown < duration and not hit:
        time = duration / pieces
        if p.detection == STOCHASTIC:
            due = next_scan(flights, legs, plants, p)
            if due <= 1e-9:
                scan_all(flights, legs, flown, plants, p)
                due = next_scan(flights, legs, plants, p)
            time = min(max(due, 1e-9), duration - flown)
        else:
            scan_all(flights, legs, flown + 0.5 * time, plants, p)
        if p.tracking == ONE:
            follow_one(flights, legs, tracked, p)
        for a in range(len(flights)):
            if legs[a].going == 1 and run_timers(flights[a], time, p):
                legs[a].hit, hit = 1, True
        let_go(flights, tracked, p)
        flown = flown + time if flown + time < duration - 1e-9 else duration
    for a in range(len(flights)):
        flight, under = flights[a], legs[a]
        if under.going == 1:
            phase = phase_now(under, plants[a], p)
            flight.place[0] += flown * phase.north
            flight.place[1] += flown * phase.east
            flight.path += flown * math.sqrt(phase.north * phase.north + phase.east * phase.east)
            under.way = max(under.way - phase.speed * flown, 0.0)
            under.banked = under.banked - flown if under.banked - flown > 1e-9 else 0.0


@inlined
def fly_together(flights: Any, legs: Any, tracked: Any, plants: Any, p: Any) -> None:
    """Fly on until the first leg ends: at its waypoint, at the goal, or by a hit."""
    ended = False
    while not ended:
        span = math.inf
        for a in range(len(flights)):
            under = legs[a]
            if under.going == 1:
                left = under.way / phase_now(under, plants[a], p).speed
                span = min(span, under.banked if under.banked > 0.0 else left)
        if span == math.inf:
            return
        fly_span(flights, legs, tracked, span, plants, p)
        for a in range(len(flights)):
            under = legs[a]
            if under.going == 1 and (under.hit == 1 or (under.banked <= 0.0 and under.way <= 1e-9)):
                end_leg(flights[a], under.hit == 1, under.arrives == 1, p)
                under.going, under.hit, under.way, under.banked, ended = 0, 0, 0.0, 0.0, True
        let_go(flights, tracked, p)


@compiled
def start_team(
    flights: NDArray[Any], legs: NDArray[Any], tracked: NDArray[np.int64], which: NDArray[np.int64],
    rules: NDArray[Any],
) -> None:  # fmt: skip
    """Begin the next episode of some teams; see ``advance_team`` for the shapes."""
    for g in which:
        tracked[g, :] = FREE
        for a in range(flights.shape[1]):
            flight, under, p = flights[g, a], legs[g, a], rules[g, a]
            begin(flight, p)
            if p.drawn and a > 0:
                flight.radars[:, :] = flights[g, 0].radars
                key = mixed(flight.key + np.uint64(flight.episode) * GAMMA)
                draw_further(key, p.radars, p.side_on, p.banked, flight.start, flight.goal, flight.radars)
                put_at_start(flight, p)
            under.going, under.hit, under.way, under.banked = 0, 0, 0.0, 0.0


@compiled
def advance_team(
    flights: NDArray[Any],
    legs: NDArray[Any],
    tracked: NDArray[np.int64],
    actions: FloatArray,
    flying: bool,
    plants: NDArray[Any],
    rules: NDArray[Any],
    observed: NDArray[np.float32],
    numbers: FloatArray,
    known: FloatArray,
    reward: FloatArray,
    over: NDArray[np.int64],
) -> bool:
    """Take every team on until its first leg ends, or with ``flying`` off only observe; see ``Team.advance``.

    Args:
        flights: Shape (teams, aircraft), dtype ``FLIGHT``.
        legs: Shape (teams, aircraft), dtype ``UNDERWAY``.
        tracked: Which aircraft each radar follows, or ``FREE``, shape (teams, RADARS).
        actions: Heading and length of each leg, shape (teams * aircraft, 2).
        flying: Whether to fly.
        plants: Shape (teams, aircraft), dtype ``PLANT``.
        rules: Shape (teams, aircraft).
        observed: Filled, shape (teams * aircraft, columns), and so are the others, as ``advance_all`` does.
        numbers: Shape (numbers, teams * aircraft).
        known: Shape (teams * aircraft, columns).
        reward: Shape (teams * aircraft,).
        over: Shape (teams * aircraft,).

    Returns:
        False if an action is not a finite number; then nothing has happened.
    """
    teams, count = flights.shape
    order = np.zeros((2, RADARS))
    if flying and not np.isfinite(actions).all():
        return False
    before = np.empty((count, 2))
    for g in range(teams):
        p = rules[g, 0]
        for a in range(count):
            flight, under, plant, i = flights[g, a], legs[g, a], plants[g, a], g * count + a
            before[a, 0], before[a, 1] = flight.path, flight.time_over
            reward[i] = 0.0
            if flying and flight.over == FLYING and under.going == 0:
                cosine, sine = radial(flight, plant, p.radars)
                length = min(max(actions[i, 1], p.least_leg), p.longest_leg)
                begun = begin_leg(flight, actions[i, 0] + math.atan2(sine, cosine), length, plant, p)
                under.going, under.north, under.east, under.turn = 1, begun.north, begun.east, begun.turn
                under.banked, under.way, under.arrives = begun.banked, begun.way, int(begun.arrives)
            over[i] = flight.over
        if flying:
            fly_together(flights[g], legs[g], tracked[g], plants[g], p)
        for a in range(count):
            flight, i = flights[g, a], g * count + a
            if flying and over[i] == FLYING:
                detected = flight.time_over - before[a, 1]
                reward[i] = score(flight, before[a, 0], detected, p)
            over[i] = flight.over
            write(flight, plants[g, a], i, p, order, observed, numbers, known)
            own = observed[i, observed.shape[1] - 2 - p.radars :]
            own[0], own[1] = within(legs[g, a].way / 100.0), 1.0 if flight.over == FLYING else 0.0
            for k in range(p.radars):
                follows = tracked[g, int(order[0, k])]
                own[2 + k] = 0.0 if follows in (FREE, a) else 1.0
    return True
