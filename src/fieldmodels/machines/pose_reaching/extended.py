"""Robots with effects, from instant to instant: the drive's pieces, and a pose that is measured late.

Delays are kept in rings, one entry an instant.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import inlined
from fieldmodels.machines.pose_reaching.drive import across, excess_of, rim_speed, rim_travel, rims
from fieldmodels.machines.pose_reaching.unicycle import wrapped


class Extended(NamedTuple):
    """What a batch of robots truly is, and what its effects remember; None stands for nominal robots.

    Attributes:
        rows: Numbers of each robot, shape (batch,), dtype ``ROW``.
        on: Which robots have an effect, shape (batch,).
        speeds: Speed of each rim and of the sideways drive [m/s], shape (batch, 3).
        aims: What these aimed at in the latest instants [m/s], shape (batch, slots, 3).
        poses: Poses at the latest instants: x [m], y [m], heading [rad]; shape (batch, slots, 3).
    """

    rows: NDArray[Any]
    on: NDArray[np.bool_]
    speeds: FloatArray
    aims: FloatArray
    poses: FloatArray


def make_extended(
    rows: NDArray[Any], on: NDArray[np.bool_], instant: float, possible: NDArray[Any]
) -> Extended:
    """Robots at rest, with rings that hold the longest delay.

    Args:
        rows: Numbers of each robot, shape (batch,), dtype ``ROW``.
        on: Which robots have an effect, shape (batch,).
        instant: Time between instants [s].
        possible: Numbers that robots may have later, of any shape and that dtype.
    """
    delays = ("actuator_delay", "sensor_delay")
    longest = max(float(kind[name]["delay"].max()) for name in delays for kind in (rows, possible))
    batch, slots = len(rows), math.ceil(longest / instant) + 2
    return Extended(rows, on, np.zeros((batch, 3)), np.zeros((batch, slots, 3)), np.zeros((batch, slots, 3)))


@inlined
def at_rest(e: Extended, b: int, x: float, y: float, heading: float) -> None:
    """Forget everything of robot ``b``: it stands, and has stood for ever."""
    e.speeds[b] = 0.0
    e.aims[b] = 0.0
    for k in range(e.poses.shape[1]):
        e.poses[b, k, 0], e.poses[b, k, 1], e.poses[b, k, 2] = x, y, heading


@inlined
def travelled(
    e: Extended, b: int, instant: int, step: float, speed: float, rate: float
) -> tuple[float, float]:
    """Travel of both rims of robot ``b`` until the next instant [m]; it remembers their speeds.

    Args:
        e: All robots.
        b: Number of the robot.
        instant: Number of instants since it stood.
        step: Time between instants [s].
        speed: Commanded speed [m/s].
        rate: Commanded turn rate [rad/s].
    """
    q, slots = e.rows[b], e.aims.shape[1]
    newest = instant % slots
    e.aims[b, newest, 0], e.aims[b, newest, 1] = rims(speed, rate, instant * step, step, q)
    newer, older, early = late_aims(instant, step, slots, q)
    left = rim_in_step(e, b, 0, e.aims[b, older, 0], early, e.aims[b, newer, 0], step - early)
    right = rim_in_step(e, b, 1, e.aims[b, older, 1], early, e.aims[b, newer, 1], step - early)
    return left, right


@inlined
def travelled_sideways(e: Extended, b: int, instant: int, step: float, sideways: float) -> float:
    """Travel to the left of an omnidirectional robot ``b`` [m]; arguments as of ``travelled``."""
    q, slots = e.rows[b], e.aims.shape[1]
    e.aims[b, instant % slots, 2] = across(sideways, instant * step, step, q)
    newer, older, early = late_aims(instant, step, slots, q)
    return rim_in_step(e, b, 2, e.aims[b, older, 2], early, e.aims[b, newer, 2], step - early)


@inlined
def late_aims(instant: int, step: float, slots: int, q: Any) -> tuple[int, int, float]:
    """Where the newer and the older aim of a step stand, and for how long the older one holds [s].

    A delay is of m instants and a part: for that part of the step the older of two aims holds.
    """
    whole = int(q.actuator_delay.delay / step)
    early = q.actuator_delay.delay - whole * step
    return (instant - whole) % slots, (instant - whole - 1) % slots, early


@inlined
def rim_in_step(
    e: Extended, b: int, side: int, older: float, early: float, newer: float, late: float
) -> float:
    """Travel of one rim [m] that aims at one speed [m/s] for a time [s], then at another."""
    q, way = e.rows[b], 0.0
    if early > 0.0:
        excess = excess_of(e.speeds[b, side], older, q)
        way = rim_travel(older, excess, early, q)
        e.speeds[b, side] = rim_speed(older, excess, early, q)
    excess = excess_of(e.speeds[b, side], newer, q)
    e.speeds[b, side] = rim_speed(newer, excess, late, q)
    return way + rim_travel(newer, excess, late, q)


@inlined
def remember(e: Extended, b: int, instant: int, x: float, y: float, heading: float) -> None:
    """Note where robot ``b`` is at an instant."""
    entry = instant % e.poses.shape[1]
    e.poses[b, entry, 0], e.poses[b, entry, 1], e.poses[b, entry, 2] = x, y, heading


@inlined
def measured(e: Extended, b: int, instant: int, step: float) -> tuple[float, float, float]:
    """The pose of robot ``b`` as it is measured at an instant: x [m], y [m], heading [rad]."""
    q, slots = e.rows[b], e.poses.shape[1]
    whole = int(q.sensor_delay.delay / step)
    part = q.sensor_delay.delay / step - whole
    newer, older = e.poses[b, (instant - whole) % slots], e.poses[b, (instant - whole - 1) % slots]
    x = newer[0] + part * (older[0] - newer[0])
    y = newer[1] + part * (older[1] - newer[1])
    heading = newer[2] + part * wrapped(older[2] - newer[2])
    return x, y, wrapped(heading + q.heading_bias.angle)
