"""The aircraft of eqs (4.1)-(4.2): straight legs between waypoints, and a bank after each turn.

Heading and bank change at once; a turn shows only as a bank of 45 degrees for the time that the turn would
take, or for the whole leg if that is shorter.
"""

from __future__ import annotations

import math

from fieldmodels.compiled import inlined
from fieldmodels.machines.uav_route.parameters import GRAVITY, Constants


@inlined
def heading_of(north: float, east: float, two_quadrant: bool) -> float:
    """Heading of a leg [rad], (4.1); printed, legs to the south point to the north."""
    if two_quadrant:
        return math.atan(east / north) if north != 0.0 else math.copysign(0.5 * math.pi, east)
    return math.atan2(east, north)


@inlined
def turn_into(
    old_north: float,
    old_east: float,
    north: float,
    east: float,
    to_north: float,
    to_east: float,
    c: Constants,
) -> float:
    """Turn from one direction of flight into another [rad], positive to the right, (4.2).

    Args:
        old_north: Velocity before the turn, in any unit.
        old_east: The same to the east.
        north: The leg after it.
        east: The same to the east.
        to_north: Position of its end, which decides the side in the printed form.
        to_east: The same to the east.
        c: How the equations are read.
    """
    cross = old_north * east - old_east * north
    dot = old_north * north + old_east * east
    if c.upper_clamp:
        lengths = math.sqrt(old_north * old_north + old_east * old_east) * math.sqrt(
            north * north + east * east
        )
        angle = math.acos(min(1.0, dot / lengths))
    else:
        angle = math.atan2(abs(cross), dot)
    if c.absolute_side:
        return -angle if to_east * old_north - to_north * old_east > 0.0 else angle
    return angle if cross >= 0.0 else -angle


@inlined
def turn_time(turn: float, speed: float, bank: float) -> float:
    """T_turn [s]: the time of a level coordinated turn at this bank; 0 without a bank."""
    return abs(turn) * speed / (GRAVITY * math.tan(bank)) if bank > 0.0 else 0.0


@inlined
def banked_time(turn: float, speed: float, bank: float, duration: float, c: Constants) -> float:
    """Time of a leg [s], from its start, in which the aircraft is banked."""
    if not abs(turn) >= c.least_turn:  # a turn that is not a number (the printed clamp) is none
        return 0.0
    return min(turn_time(turn, speed, bank), duration)


@inlined
def ground_speed(
    cosine: float, sine: float, speed: float, wind_north: float, wind_east: float
) -> tuple[float, float, float]:
    """Speed over ground, and the nose's direction, of an aircraft that holds a course in wind by crabbing.

    Args:
        cosine: Cosine of the course.
        sine: Sine of the course.
        speed: Airspeed, larger than the wind.
        wind_north: Wind (whereto it blows), in the unit of the speed.
        wind_east: The same to the east.

    Returns:
        Speed over ground; cosine and sine of the heading.
    """
    if wind_north == 0.0 and wind_east == 0.0:
        return speed, cosine, sine
    along = wind_north * cosine + wind_east * sine
    across = wind_east * cosine - wind_north * sine
    crab_sine = -across / speed
    crab_cosine = math.sqrt(max(1.0 - crab_sine * crab_sine, 0.0))
    return (
        along + speed * crab_cosine,
        cosine * crab_cosine - sine * crab_sine,
        sine * crab_cosine + cosine * crab_sine,
    )
