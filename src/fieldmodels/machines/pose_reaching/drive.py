"""The drive between a command and the motion, in pieces that kernels compose: what may be wrong with it.

    command (speed, turn rate) -> what the rims aim at: gains, dead zone, saturation, a jump
                               -> delay, and lag at a limited rate -> the rims' travel
                               -> the body's motion: unequal wheels, slip, slope

Both fronts, a robot that is given speed and turn rate and one that is given its wheels' speeds, are the same
differential drive; inside, its two wheels are rim speeds [m/s]. The environment's robots compose these pieces
from instant to instant, a prediction along its recording. A row ``q`` holds all numbers of one robot, dtype
``ROW``.
"""

from __future__ import annotations

import math
from typing import Any

from fieldmodels.compiled import inlined
from fieldmodels.machines.pose_reaching.declaration import NO_LIMIT
from fieldmodels.machines.pose_reaching.unicycle import slipping_arc


@inlined
def rim(speed: float, q: Any) -> float:
    """What one wheel's rim aims at [m/s]: dead zone, then saturation."""
    width, limit = q.actuator_dead_zone.width, q.actuator_saturation.limit
    if width > 0.0:
        speed = math.copysign(max(abs(speed) - width, 0.0), speed)
    if abs(speed) > limit:
        speed = math.copysign(limit, speed)
    return speed


@inlined
def strength_of(time: float, step: float, q: Any) -> float:
    """Factor on all rims in a step that begins at a time [s]: a jump holds for the share that is left."""
    if q.parameter_step.factor == 1.0:
        return 1.0
    jumped = min(max((time - q.parameter_step.time) / step + 1.0, 0.0), 1.0)
    return float(1.0 + (q.parameter_step.factor - 1.0) * jumped)


@inlined
def rims(speed: float, rate: float, time: float, step: float, q: Any) -> tuple[float, float]:
    """What both rims aim at [m/s] in a step, for the command that holds in it.

    Args:
        speed: Commanded speed [m/s].
        rate: Commanded turn rate [rad/s].
        time: Time at the step's beginning [s].
        step: Length of the step [s].
        q: Numbers of the robot.
    """
    strength = strength_of(time, step, q)
    half, gain = 0.5 * q.track * q.turn_gain.gain * rate, q.actuator_gain.gain
    return strength * rim(gain * (speed - half), q), strength * rim(gain * (speed + half), q)


@inlined
def across(sideways: float, time: float, step: float, q: Any) -> float:
    """What the sideways drive of an omnidirectional robot aims at [m/s]: a third rim; as ``rims``."""
    return strength_of(time, step, q) * rim(q.actuator_gain.gain * sideways, q)


@inlined
def has_dynamics(q: Any) -> bool:
    """Whether a rim follows what it aims at with a lag or at a limited rate."""
    return bool(q.actuator_lag.time_constant > 0.0 or q.actuator_rate_limit.rate < NO_LIMIT)


@inlined
def ramp_within(excess: float, time: float, q: Any) -> float:
    """For how much of a time [s] a rim changes at its rate limit: until its lag alone would be slower."""
    limit = q.actuator_rate_limit.rate
    if limit >= NO_LIMIT:
        return 0.0
    return float(min(max(abs(excess) / limit - q.actuator_lag.time_constant, 0.0), time))


@inlined
def excess_after(excess: float, time: float, q: Any) -> float:
    """What is left after a time [s] of a rim's distance from what it aims at [m/s]."""
    ramp, lag = ramp_within(excess, time, q), q.actuator_lag.time_constant
    if ramp > 0.0:
        excess -= math.copysign(q.actuator_rate_limit.rate * ramp, excess)
        if ramp >= time:
            return excess
    return float(excess * math.exp(-(time - ramp) / lag)) if lag > 0.0 else 0.0


@inlined
def excess_travel(excess: float, time: float, q: Any) -> float:
    """How far a rim gets within a time [s] beyond what it aims at [m]."""
    ramp, lag = ramp_within(excess, time, q), q.actuator_lag.time_constant
    total = 0.0
    if ramp > 0.0:
        slope = math.copysign(q.actuator_rate_limit.rate, excess)
        total = (excess - 0.5 * slope * ramp) * ramp
        excess -= slope * ramp
    if lag > 0.0:
        total -= excess * lag * math.expm1(-(time - ramp) / lag)
    return float(total)


@inlined
def excess_of(speed: float, aim: float, q: Any) -> float:
    """How far a rim is from the speed that it aims at from now on [m/s]; without dynamics it is there."""
    return speed - aim if has_dynamics(q) else 0.0


@inlined
def rim_speed(aim: float, excess: float, time: float, q: Any) -> float:
    """Speed of a rim [m/s] a time [s] after it began to aim at a speed, its excess being what it was then."""
    return aim + excess_after(excess, time, q)


@inlined
def rim_travel(aim: float, excess: float, time: float, q: Any) -> float:
    """Travel of a rim within a time [m]; arguments as of ``rim_speed``."""
    return aim * time + excess_travel(excess, time, q)


@inlined
def moved(
    x: float,
    y: float,
    cosine: float,
    sine: float,
    left: float,
    right: float,
    lateral: float | None,
    duration: float,
    disturbance: float,
    q: Any,
) -> tuple[float, float, float, float, float]:
    """Where the body gets as its rims travel: unequal wheels, slip of yaw and sideways, slope.

    Args:
        x: Position [m].
        y: The same [m].
        cosine: Cosine of the heading.
        sine: Sine of the heading.
        left: Travel of the left rim, by the wheel's angle and nominal radius [m].
        right: The same of the right one.
        lateral: The same of the sideways drive, positive to the left [m]; None for a unicycle.
        duration: Time that it takes [s].
        disturbance: Additional turn rate [rad/s].
        q: Numbers of the robot.

    Returns:
        Position, cosine and sine of the heading at the end, and turn [rad].
    """
    left *= 1.0 + 0.5 * q.unequal_wheels.difference
    right *= 1.0 - 0.5 * q.unequal_wheels.difference
    distance = 0.5 * (left + right)
    turn = (1.0 - q.yaw_slip.share) * (right - left) / q.track + disturbance * duration
    slip, way, ahead, aside = q.sideways_slip.coefficient, abs(distance), distance, 0.0
    if lateral is not None:
        way, aside = math.hypot(distance, lateral), lateral
    if slip != 0.0:  # outwards: across the motion, by the centripetal acceleration
        outwards = slip * turn / duration
        ahead, aside = distance + outwards * aside, aside - outwards * distance
    x, y, cosine, sine = slipping_arc(x, y, cosine, sine, ahead, aside, turn)
    return x + q.slope.x * way, y + q.slope.y * way, cosine, sine, turn
