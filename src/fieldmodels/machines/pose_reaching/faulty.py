"""A robot with faults in play, an instant at a time: the drive's pieces and a pose that is shown late.

Delays are kept in rings, one entry an instant. Each robot's memory is one row of floats: speeds of both
rims, the rings of what the rims aimed at, and the ring of its poses.
"""

from __future__ import annotations

import math

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import inlined
from fieldmodels.machines.pose_reaching.drive import (
    DELAY,
    HEADING_BIAS,
    SENSOR_DELAY,
    SLOPE_X,
    SLOPE_Y,
    STEP_FACTOR,
    STEP_TIME,
    body,
    excess_after,
    excess_travel,
    has_dynamics,
    rims,
)
from fieldmodels.machines.pose_reaching.unicycle import wrapped

BASE = 2
"""Entries of a parameter row before the effects': the wheels' radius and track."""


def faulty(realities: FloatArray, nominal: FloatArray) -> bool:
    """Whether any effect is on.

    Args:
        realities: Parameter rows, shape (batch, PARAMETERS).
        nominal: The nominal row, shape (PARAMETERS,).
    """
    same = realities == nominal
    same[:, :BASE] = True
    same[:, STEP_TIME] = True  # the moment of a jump that is none
    return not bool(same.all())


def ring_size(realities: FloatArray, instant: float) -> int:
    """Entries of a ring that holds the longest delay.

    Args:
        realities: Parameter rows, shape (batch, PARAMETERS).
        instant: Time between entries [s].
    """
    return math.ceil(float(realities[:, [DELAY, SENSOR_DELAY]].max()) / instant) + 2


def memory_size(slots: int) -> int:
    """Length of a memory row with rings of this size."""
    return 2 + 5 * slots


@inlined
def at_rest(memory: FloatArray, slots: int, x: float, y: float, heading: float) -> None:
    """Forget everything: the robot stands, and has stood for ever."""
    memory[: 2 + 2 * slots] = 0.0
    for k in range(slots):
        entry = 2 + 2 * slots + 3 * k
        memory[entry] = x
        memory[entry + 1] = y
        memory[entry + 2] = heading


@inlined
def moved(
    memory: FloatArray, slots: int, instant: int, step: float, speed: float, rate: float, q: FloatArray
) -> tuple[float, float, float]:
    """How the body moves until the next instant: forwards and to the left [m], and turn [rad].

    Args:
        memory: Of this robot, shape (memory_size(slots),).
        slots: Size of its rings.
        instant: Number of instants since it stood.
        step: Time between instants [s].
        speed: Commanded speed [m/s].
        rate: Commanded turn rate [rad/s].
        q: Parameters, shape (PARAMETERS,).
    """
    jumped = 0.0
    if q[STEP_FACTOR] != 1.0:
        jumped = min(max(instant + 1 - q[STEP_TIME] / step, 0.0), 1.0)
    newest = 2 + 2 * (instant % slots)
    memory[newest], memory[newest + 1] = rims(speed, rate, jumped, q)
    # A delay of m instants and a part: for that part of the step the older of two aims holds.
    whole = int(q[DELAY] / step)
    part = q[DELAY] / step - whole
    newer, older = 2 + 2 * ((instant - whole) % slots), 2 + 2 * ((instant - whole - 1) % slots)
    left = travelled(memory, 0, (1.0 - part) * memory[newer] + part * memory[older], step, q)
    right = travelled(memory, 1, (1.0 - part) * memory[newer + 1] + part * memory[older + 1], step, q)
    return body(left, right, step, 0.0, q)


@inlined
def travelled(memory: FloatArray, side: int, aim: float, step: float, q: FloatArray) -> float:
    """Travel of one rim in a step [m]; its speed at the end is remembered."""
    excess = memory[side] - aim if has_dynamics(q) else 0.0
    memory[side] = aim + excess_after(excess, step, q)
    return aim * step + excess_travel(excess, step, q)


@inlined
def crept(distance: float, q: FloatArray) -> tuple[float, float]:
    """How far a slope takes a robot that drives this far [m]."""
    return q[SLOPE_X] * abs(distance), q[SLOPE_Y] * abs(distance)


@inlined
def remember(memory: FloatArray, slots: int, instant: int, x: float, y: float, heading: float) -> None:
    """Note where the robot is at an instant."""
    entry = 2 + 2 * slots + 3 * (instant % slots)
    memory[entry] = x
    memory[entry + 1] = y
    memory[entry + 2] = heading


@inlined
def shown(
    memory: FloatArray, slots: int, instant: int, step: float, q: FloatArray
) -> tuple[float, float, float]:
    """The pose as it is measured at an instant: x [m], y [m], heading [rad]."""
    whole = int(q[SENSOR_DELAY] / step)
    part = q[SENSOR_DELAY] / step - whole
    newer = 2 + 2 * slots + 3 * ((instant - whole) % slots)
    older = 2 + 2 * slots + 3 * ((instant - whole - 1) % slots)
    x = memory[newer] + part * (memory[older] - memory[newer])
    y = memory[newer + 1] + part * (memory[older + 1] - memory[newer + 1])
    heading = memory[newer + 2] + part * wrapped(memory[older + 2] - memory[newer + 2])
    return x, y, wrapped(heading + q[HEADING_BIAS])
