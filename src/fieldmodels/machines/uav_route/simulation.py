"""Predicting windows of measured flights: legs towards the commanded waypoints under a radar, batched."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled, inlined
from fieldmodels.machines.uav_route.aircraft import banked_time, ground_speed, turn_into
from fieldmodels.machines.uav_route.parameters import Constants
from fieldmodels.machines.uav_route.plant import (
    BANK,
    BIAS_EAST,
    BIAS_NORTH,
    INTERVAL,
    SPEED,
    TURN_LOSS,
    WIND_EAST,
    WIND_NORTH,
    chance,
)

KM = 1000.0
NORTH, EAST, TILT, DETECTED, GAP = range(5)
"""Outputs of a prediction."""


@inlined
def overlap(first: float, last: float, banked: float) -> float:
    """Time of an interval since a leg's start [s] in which the aircraft is banked."""
    return max(0.0, min(last, banked) - max(first, 0.0))


@inlined
def detection(
    to_north: float,
    to_east: float,
    nose: tuple[float, float],
    slow_nose: tuple[float, float],
    bank: float,
    share: float,
    plant: FloatArray,
    c: Constants,
) -> float:
    """Probability that a look detects an aircraft which is banked for a share of the time.

    Args:
        to_north: From the aircraft to where the radar is believed to be [km].
        to_east: The same [km].
        nose: Cosine and sine of the heading while level.
        slow_nose: The same while banked.
        bank: Bank [rad], signed.
        share: Share of the time in which it is banked.
        plant: What aircraft and radar truly are.
        c: The nominal world.
    """
    result = 0.0
    if share < 1.0:
        result += (1.0 - share) * chance(to_north, to_east, nose[0], nose[1], 1.0, 0.0, plant, c)
    if share > 0.0:
        tilt = -bank if c.left_handed else bank
        result += share * chance(
            to_north, to_east, slow_nose[0], slow_nose[1], math.cos(tilt), math.sin(tilt), plant, c
        )
    return 1.0 - result if c.draw_above else result


@compiled
def simulate(
    plants: FloatArray,
    sites: FloatArray,
    waypoints: FloatArray,
    begun: NDArray[np.int64],
    first: NDArray[np.int64],
    force: FloatArray,
    step: float,
    starts: NDArray[np.int64],
    lengths: NDArray[np.int64],
    states: FloatArray,
    watched: bool,
    c: Constants,
    out: FloatArray,
) -> None:
    """Predict every window with every parameter vector.

    A leg leads straight to its waypoint from where the aircraft is when it is commanded, and on in the same
    direction until the next one is. A radar's look comes at an unknown moment since the sample before: its
    probability is taken in the middle, with the share of that time in which the aircraft is banked.

    Args:
        plants: Rows as in ``plant.py``, shape (batch, 13).
        sites: Where the radar is believed to be, north and east [km], shape (batch, 2).
        waypoints: North and east of the waypoint that is flown to from each sample on [m], shape (n, 2).
        begun: Sample at which each sample's waypoint was commanded, shape (n,).
        first: First sample of each sample's episode, shape (n,).
        force: Speed along the course that is added from each sample on [m/s], shape (n,), or empty.
        step: Time between samples [s].
        starts: First sample of each window.
        lengths: Samples of each window.
        states: Measured north and east [m] and the course before the present leg [rad] at each start.
        watched: Whether a radar's looks are predicted.
        c: The nominal aircraft.
        out: Filled with north [m], east [m], mean bank since the sample before [rad], probability that a
            look since the sample before detects, and time between looks [s] (the last two if watched);
            shape (batch, windows, samples, 5).
    """
    for b in range(len(plants)):
        q = plants[b]
        airspeed, bank = q[SPEED], c.bank * q[BANK]
        slow = airspeed * (1.0 - q[TURN_LOSS])
        gap = c.look_interval * q[INTERVAL]
        for w in range(len(starts)):
            north, east = states[w, 0] / KM - q[BIAS_NORTH], states[w, 1] / KM - q[BIAS_EAST]
            cosine, sine = math.cos(states[w, 2]), math.sin(states[w, 2])
            turn, banked, since, tilt, seen = 0.0, 0.0, 0.0, 0.0, 0.0
            level_north, level_east, slow_north, slow_east = 0.0, 0.0, 0.0, 0.0
            _, ahead, aside = ground_speed(cosine, sine, airspeed, q[WIND_NORTH], q[WIND_EAST])
            nose, slow_nose = (ahead, aside), (ahead, aside)
            before = nose
            for k in range(lengths[w]):
                i = starts[w] + k
                if k > 0:
                    out[b, w, k, TILT] = tilt
                if k == 0 or begun[i] == i:
                    to_north = waypoints[i, 0] / KM - north
                    to_east = waypoints[i, 1] / KM - east
                    distance = math.sqrt(to_north * to_north + to_east * to_east)
                    since = (i - begun[i]) * step
                    turn = 0.0
                    if distance > 0.0:
                        to_north, to_east = to_north / distance, to_east / distance
                        if begun[i] > first[i]:
                            turn = turn_into(cosine, sine, to_north, to_east, 0.0, 0.0, c)
                        cosine, sine = to_north, to_east
                    banked = banked_time(turn, slow, bank, math.inf, c)
                    speed, ahead, aside = ground_speed(cosine, sine, airspeed, q[WIND_NORTH], q[WIND_EAST])
                    level_north, level_east = speed * cosine, speed * sine
                    nose = (ahead, aside)
                    speed, ahead, aside = ground_speed(cosine, sine, slow, q[WIND_NORTH], q[WIND_EAST])
                    slow_north, slow_east = speed * cosine, speed * sine
                    slow_nose = (ahead, aside)
                if k == 0:
                    share = overlap(since - step, since, banked) / step
                    out[b, w, k, TILT] = math.copysign(bank, turn) * share
                    if watched:
                        # at a leg's first sample the look was made on the leg before
                        seen = detection(
                            sites[b, 0] - north,
                            sites[b, 1] - east,
                            before if begun[i] == i and begun[i] > first[i] else nose,
                            slow_nose,
                            math.copysign(bank, turn),
                            share,
                            q,
                            c,
                        )
                if watched:
                    out[b, w, k, DETECTED], out[b, w, k, GAP] = seen, gap
                out[b, w, k, NORTH] = (north + q[BIAS_NORTH]) * KM
                out[b, w, k, EAST] = (east + q[BIAS_EAST]) * KM
                turning = overlap(since, since + step, banked)
                share = turning / step
                ahead = turning * slow_north + (step - turning) * level_north
                aside = turning * slow_east + (step - turning) * level_east
                if watched:
                    seen = detection(
                        sites[b, 0] - north - 0.5 * ahead,
                        sites[b, 1] - east - 0.5 * aside,
                        nose,
                        slow_nose,
                        math.copysign(bank, turn),
                        share,
                        q,
                        c,
                    )
                north += ahead
                east += aside
                if len(force):
                    north += step * force[i] / KM * cosine
                    east += step * force[i] / KM * sine
                tilt = math.copysign(bank, turn) * share
                since += step
