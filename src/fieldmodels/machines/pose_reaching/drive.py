"""The drive between a command and the motion, in pieces that kernels compose: what may be wrong with it.

    command (speed, turn rate) -> what the rims aim at: gains, dead zone, saturation, a jump
                               -> delay, and lag at a limited rate -> the rims' travel
                               -> the body's motion: unequal wheels, slip, slope

Both fronts, a robot that is told speed and turn rate and one that is told its wheels' speeds, are the same
differential drive; inside, its two wheels are rim speeds [m/s]. A row ``q`` holds all parameters of one
simulation, in the order of ``PoseReaching.names``.
"""

from __future__ import annotations

import math

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import inlined

RADIUS, TRACK = 0, 1
GAIN, TURN_GAIN, LAG, RATE, DELAY, LIMIT, DEAD_ZONE = 2, 3, 4, 5, 6, 7, 8
UNEQUAL, YAW_SLIP, SIDEWAYS, SLOPE_X, SLOPE_Y = 9, 10, 11, 12, 13
SENSOR_DELAY, HEADING_BIAS, STEP_TIME, STEP_FACTOR = 14, 15, 16, 17
PARAMETERS = 18

NO_LIMIT = 1e6
"""A saturation limit [m/s] or rate limit [m/s^2] from this on means none."""


@inlined
def rim(speed: float, q: FloatArray) -> float:
    """What one wheel's rim aims at [m/s]: dead zone, then saturation."""
    if q[DEAD_ZONE] > 0.0:
        speed = math.copysign(max(abs(speed) - q[DEAD_ZONE], 0.0), speed)
    if abs(speed) > q[LIMIT]:
        speed = math.copysign(q[LIMIT], speed)
    return speed


@inlined
def rims(speed: float, rate: float, jumped: float, q: FloatArray) -> tuple[float, float]:
    """What both rims aim at [m/s] for a command.

    Args:
        speed: Commanded speed [m/s].
        rate: Commanded turn rate [rad/s].
        jumped: Share of the step after the moment of the jump (``parameter_step``).
        q: Parameters, shape (PARAMETERS,).
    """
    strength = 1.0 + (q[STEP_FACTOR] - 1.0) * jumped
    half = 0.5 * q[TRACK] * q[TURN_GAIN] * rate
    return strength * rim(q[GAIN] * (speed - half), q), strength * rim(q[GAIN] * (speed + half), q)


@inlined
def has_dynamics(q: FloatArray) -> bool:
    """Whether a rim follows what it aims at with a lag or at a limited rate."""
    return bool(q[LAG] > 0.0 or q[RATE] < NO_LIMIT)


@inlined
def ramp_within(excess: float, time: float, q: FloatArray) -> float:
    """For how much of a time [s] a rim changes at its rate limit: until its lag alone would be slower."""
    if q[RATE] >= NO_LIMIT:
        return 0.0
    return float(min(max(abs(excess) / q[RATE] - q[LAG], 0.0), time))


@inlined
def excess_after(excess: float, time: float, q: FloatArray) -> float:
    """What is left after a time [s] of a rim's distance from what it aims at [m/s]."""
    ramp = ramp_within(excess, time, q)
    if ramp > 0.0:
        excess -= math.copysign(q[RATE] * ramp, excess)
        if ramp >= time:
            return excess
    return float(excess * math.exp(-(time - ramp) / q[LAG])) if q[LAG] > 0.0 else 0.0


@inlined
def excess_travel(excess: float, time: float, q: FloatArray) -> float:
    """How far a rim gets within a time [s] beyond what it aims at [m]."""
    ramp = ramp_within(excess, time, q)
    total = 0.0
    if ramp > 0.0:
        slope = math.copysign(q[RATE], excess)
        total = (excess - 0.5 * slope * ramp) * ramp
        excess -= slope * ramp
    if q[LAG] > 0.0:
        total -= excess * q[LAG] * math.expm1(-(time - ramp) / q[LAG])
    return float(total)


@inlined
def body(
    left: float, right: float, duration: float, disturbance: float, q: FloatArray
) -> tuple[float, float, float]:
    """How the body moves as its rims do.

    Args:
        left: Travel of the left rim, by the wheel's angle and nominal radius [m].
        right: The same of the right one.
        duration: Time that it takes [s].
        disturbance: Additional turn rate [rad/s].
        q: Parameters, shape (PARAMETERS,).

    Returns:
        Distance forwards and to the left [m], and turn [rad].
    """
    left *= 1.0 + 0.5 * q[UNEQUAL]
    right *= 1.0 - 0.5 * q[UNEQUAL]
    distance = 0.5 * (left + right)
    turn = (1.0 - q[YAW_SLIP]) * (right - left) / q[TRACK] + disturbance * duration
    lateral = -q[SIDEWAYS] * distance * turn / duration if q[SIDEWAYS] != 0.0 else 0.0
    return distance, lateral, turn
