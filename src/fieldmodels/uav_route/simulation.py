"""Predicting windows of measured flights: legs towards the commanded waypoints, batched."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from fieldmodels.compiled import compiled, inlined
from fieldmodels.model import FloatArray
from fieldmodels.uav_route.aircraft import banked_time, ground_speed, turn_into
from fieldmodels.uav_route.parameters import Constants

SPEED, WIND_NORTH, WIND_EAST, TURN_LOSS, BANK, BIAS_NORTH, BIAS_EAST = range(7)
PARAMETERS = 7
"""An aircraft's row of numbers: airspeed, wind, share of the airspeed lost in turns, factor of the bank, bias
of the measured position; in ``UavRoute`` in SI units, in ``Flights`` in [km] and [km/s]."""
KM = 1000.0


@inlined
def overlap(first: float, last: float, banked: float) -> float:
    """Time of an interval since a leg's start [s] in which the aircraft is banked."""
    return max(0.0, min(last, banked) - max(first, 0.0))


@compiled
def simulate(
    parameters: FloatArray,
    waypoints: FloatArray,
    begun: NDArray[np.int64],
    first: NDArray[np.int64],
    force: FloatArray,
    step: float,
    starts: NDArray[np.int64],
    lengths: NDArray[np.int64],
    states: FloatArray,
    c: Constants,
    out: FloatArray,
) -> None:
    """Predict every window with every parameter vector.

    A leg leads straight to its waypoint from where the aircraft is when it is commanded, and on in the same
    direction until the next one is.

    Args:
        parameters: As in ``UavRoute.names``, shape (batch, 7), in SI units.
        waypoints: North and east of the waypoint that is flown to from each sample on [m], shape (n, 2).
        begun: Sample at which each sample's waypoint was commanded, shape (n,).
        first: First sample of each sample's episode, shape (n,).
        force: Speed along the course that is added from each sample on [m/s], shape (n,), or empty.
        step: Time between samples [s].
        starts: First sample of each window.
        lengths: Samples of each window.
        states: Measured north and east [m] and the course before the present leg [rad] at each start.
        c: The nominal aircraft.
        out: Filled with north [m], east [m] and mean bank since the sample before [rad]; shape
            (batch, windows, samples, 3).
    """
    for b in range(len(parameters)):
        q = parameters[b]
        airspeed, bank = q[SPEED] / KM, c.bank * q[BANK]
        slow = airspeed * (1.0 - q[TURN_LOSS])
        wind_north, wind_east = q[WIND_NORTH] / KM, q[WIND_EAST] / KM
        bias_north, bias_east = q[BIAS_NORTH] / KM, q[BIAS_EAST] / KM
        for w in range(len(starts)):
            north, east = states[w, 0] / KM - bias_north, states[w, 1] / KM - bias_east
            cosine, sine = math.cos(states[w, 2]), math.sin(states[w, 2])
            turn, banked, since, tilt = 0.0, 0.0, 0.0, 0.0
            level_north, level_east, slow_north, slow_east = 0.0, 0.0, 0.0, 0.0
            for k in range(lengths[w]):
                i = starts[w] + k
                if k > 0:
                    out[b, w, k, 2] = tilt
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
                    speed, _, _ = ground_speed(cosine, sine, airspeed, wind_north, wind_east)
                    level_north, level_east = speed * cosine, speed * sine
                    speed, _, _ = ground_speed(cosine, sine, slow, wind_north, wind_east)
                    slow_north, slow_east = speed * cosine, speed * sine
                if k == 0:
                    out[b, w, k, 2] = math.copysign(bank, turn) * overlap(since - step, since, banked) / step
                out[b, w, k, 0] = (north + bias_north) * KM
                out[b, w, k, 1] = (east + bias_east) * KM
                turning = overlap(since, since + step, banked)
                north += turning * slow_north + (step - turning) * level_north
                east += turning * slow_east + (step - turning) * level_east
                if len(force):
                    north += step * force[i] / KM * cosine
                    east += step * force[i] / KM * sine
                tilt = math.copysign(bank, turn) * turning / step
                since += step
