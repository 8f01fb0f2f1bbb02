"""Predicting windows of measured flights: legs towards the commanded waypoints under a radar, batched."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled, inlined
from fieldmodels.machines.uav_route.aircraft import Attitude, Leg, leg_of, turn_into
from fieldmodels.machines.uav_route.declaration import KM
from fieldmodels.machines.uav_route.parameters import ABOVE
from fieldmodels.machines.uav_route.radar import chance

NORTH, EAST, BANK, DETECTED, GAP = range(5)
"""Outputs of a prediction, in the order of ``UavRoute.outputs``."""


class Commands(NamedTuple):
    """What a recording says of the way, sample by sample.

    Attributes:
        waypoints: North and east of the waypoint that is flown to [m], shape (n, 2).
        begun: Sample at which it was commanded, shape (n,).
        first: First sample of the episode, shape (n,).
        force: Speeds that are added along the course, to the right, to the north and to the east [m/s], shape
            (n, 4) or (0, 4).
        step: Time between samples [s].
    """

    waypoints: FloatArray
    begun: NDArray[np.int64]
    first: NDArray[np.int64]
    force: FloatArray
    step: float


@inlined
def overlap(first: float, last: float, banked: float) -> float:
    """Time of an interval since a leg's start [s] in which the aircraft is banked."""
    return max(0.0, min(last, banked) - max(first, 0.0))


@inlined
def detection(
    to_north: float,
    to_east: float,
    level: Attitude,
    turning: Attitude,
    share: float,
    plant: Any,
    c: Any,
) -> float:
    """Probability that a scan detects an aircraft which is banked for a share of the time.

    Args:
        to_north: From the aircraft to where the radar is believed to be [km].
        to_east: The same [km].
        level: Its attitude while level.
        turning: Its attitude while banked.
        share: Share of the time in which it is banked.
        plant: What aircraft and radar truly are.
        c: The nominal world.
    """
    result = 0.0
    if share < 1.0:
        result += (1.0 - share) * chance(to_north, to_east, level, plant, c)
    if share > 0.0:
        result += share * chance(to_north, to_east, turning, plant, c)
    return 1.0 - result if c.draw == ABOVE else result


@inlined
def begin_leg(
    i: int, north: float, east: float, cosine: float, sine: float, log: Commands, plant: Any, c: Any
) -> tuple[Leg, float, float]:
    """The leg flown at sample ``i`` from a place [km], and its course's cosine and sine.

    Args:
        i: The sample.
        north: Where the aircraft is [km].
        east: The same [km].
        cosine: Cosine of the course before; it stays where the waypoint is reached already.
        sine: Sine of it.
        log: What is commanded.
        plant: What the aircraft truly is.
        c: The nominal world.
    """
    to_north, to_east = log.waypoints[i, 0] / KM - north, log.waypoints[i, 1] / KM - east
    distance = math.sqrt(to_north * to_north + to_east * to_east)
    turn = 0.0
    if distance > 0.0:
        to_north, to_east = to_north / distance, to_east / distance
        if log.begun[i] > log.first[i]:
            turn = turn_into(cosine, sine, to_north, to_east, 0.0, 0.0, c)
        cosine, sine = to_north, to_east
    return leg_of(cosine, sine, turn, plant, c), cosine, sine


@inlined
def predict(
    plant: Any, state: FloatArray, log: Commands, start: int, watched: bool, c: Any, out: FloatArray
) -> None:
    """Predict one window from its first sample ``start``; ``out`` has its length, see ``simulate``."""
    step = log.step
    north, east = state[0] / KM - plant.sensor_bias.north, state[1] / KM - plant.sensor_bias.east
    cosine, sine = math.cos(state[2]), math.sin(state[2])
    leg = leg_of(cosine, sine, 0.0, plant, c)
    before = leg.level.attitude
    since, bank, seen = 0.0, 0.0, 0.0
    for k in range(len(out)):
        i = start + k
        begins = log.begun[i] == i
        if k == 0 or begins:
            since = (i - log.begun[i]) * step
            leg, cosine, sine = begin_leg(i, north, east, cosine, sine, log, plant, c)
        if k == 0:
            share = overlap(since - step, since, leg.banked) / step
            bank = leg.bank * share
            if watched:
                # at a leg's first sample the scan was made on the leg before
                level = before if begins and i > log.first[i] else leg.level.attitude
                to_north, to_east = plant.radar_north - north, plant.radar_east - east
                seen = detection(to_north, to_east, level, leg.turning.attitude, share, plant, c)
        out[k, BANK] = bank
        if watched:
            out[k, DETECTED], out[k, GAP] = seen, c.scan_interval * plant.scan_interval.factor
        out[k, NORTH] = (north + plant.sensor_bias.north) * KM
        out[k, EAST] = (east + plant.sensor_bias.east) * KM
        turning = overlap(since, since + step, leg.banked)
        ahead = turning * leg.turning.north + (step - turning) * leg.level.north
        aside = turning * leg.turning.east + (step - turning) * leg.level.east
        share = turning / step
        if watched:
            to_north = plant.radar_north - north - 0.5 * ahead
            to_east = plant.radar_east - east - 0.5 * aside
            seen = detection(to_north, to_east, leg.level.attitude, leg.turning.attitude, share, plant, c)
        north += ahead
        east += aside
        if len(log.force) > 0:
            along, right = step * log.force[i, 0] / KM, step * log.force[i, 1] / KM
            north += along * cosine - right * sine + step * log.force[i, 2] / KM
            east += along * sine + right * cosine + step * log.force[i, 3] / KM
        bank = leg.bank * share
        since += step


@compiled
def simulate(
    plants: NDArray[Any],
    log: Commands,
    starts: NDArray[np.int64],
    lengths: NDArray[np.int64],
    states: FloatArray,
    watched: bool,
    c: Any,
    out: FloatArray,
) -> None:
    """Predict every window with every plant.

    A leg leads straight to its waypoint from where the aircraft is when it is commanded, and on in the same
    direction until the next one is. A radar's scan comes at an unknown moment since the sample before: its
    probability is taken in the middle, with the share of that time in which the aircraft is banked.

    Args:
        plants: What aircraft and radar truly are, shape (batch,), dtype ``PLANT``.
        log: What is commanded.
        starts: First sample of each window.
        lengths: Samples of each window.
        states: Measured north and east [m] and the course before the present leg [rad] at each start.
        watched: Whether a radar's scans are predicted.
        c: The nominal aircraft.
        out: Filled with north [m], east [m], mean bank since the sample before [rad], probability that a
            scan since the sample before detects, and time between scans [s] (the last two if watched);
            shape (batch, windows, samples, 5).
    """
    for b in range(len(plants)):
        for w in range(len(starts)):
            predict(plants[b], states[w], log, starts[w], watched, c, out[b, w, : lengths[w]])
