"""The aircraft of eqs (4.1)-(4.2): straight legs between waypoints, and a bank after each turn.

Heading and bank change at once; a turn shows only as a bank of 45 degrees for the time that the turn would
take, or for the whole leg if that is shorter. ``leg_of`` is the one description of a leg's flight;
predictions, batches of flights and simulated plans fly it in steps of their own.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from fieldmodels.compiled import inlined
from fieldmodels.machines.uav_route.parameters import ABSOLUTE, GRAVITY, LEFT_HANDED, UPPER


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
    c: Any,
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
    if c.clamp == UPPER:
        lengths = math.sqrt(old_north * old_north + old_east * old_east) * math.sqrt(
            north * north + east * east
        )
        angle = math.acos(min(1.0, dot / lengths))
    else:
        angle = math.atan2(abs(cross), dot)
    if c.side == ABSOLUTE:
        return -angle if to_east * old_north - to_north * old_east > 0.0 else angle
    return angle if cross >= 0.0 else -angle


@inlined
def turn_time(turn: float, speed: float, bank: float) -> float:
    """T_turn [s]: the time of a level coordinated turn at this bank; 0 without a bank."""
    return abs(turn) * speed / (GRAVITY * math.tan(bank)) if bank > 0.0 else 0.0


@inlined
def banked_time(turn: float, speed: float, bank: float, duration: float, c: Any) -> float:
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


class Attitude(NamedTuple):
    """Heading and bank of an aircraft, the bank as the radars' axes take it."""

    cosine: float  # of the heading
    sine: float
    bank_cosine: float
    bank_sine: float  # of the opposite sign in the printed axes


class Phase(NamedTuple):
    """A part of a leg that is flown with one velocity and one attitude."""

    speed: float  # over ground [km/s]
    north: float  # its components [km/s]
    east: float
    attitude: Attitude


class Leg(NamedTuple):
    """How a leg is flown: banked at first, then level."""

    bank: float  # of its turning phase [rad], positive with the right wing down
    banked: float  # time of that phase [s], if the leg is long enough
    turning: Phase
    level: Phase


@inlined
def phase_of(cosine: float, sine: float, airspeed: float, bank: float, plant: Any, c: Any) -> Phase:
    """Velocity and attitude on a course, at an airspeed [km/s] and a signed bank [rad]; see ``leg_of``."""
    speed, ahead, aside = ground_speed(cosine, sine, airspeed, plant.wind.north, plant.wind.east)
    tilt = -bank if c.axes == LEFT_HANDED else bank
    attitude = Attitude(ahead, aside, math.cos(tilt), math.sin(tilt))
    return Phase(speed, speed * cosine, speed * sine, attitude)


@inlined
def leg_of(cosine: float, sine: float, turn: float, plant: Any, c: Any) -> Leg:
    """How an aircraft flies a leg, with all that may differ from the nominal one.

    Args:
        cosine: Cosine of the leg's course.
        sine: Sine of it.
        turn: Turn into the leg [rad], positive to the right.
        plant: What the aircraft truly is, dtype ``PLANT``: its speed, wind, weaker bank, speed lost in turns.
        c: How the equations are read.
    """
    bank = c.bank * plant.weaker_bank.factor
    slow = plant.speed * (1.0 - plant.turn_speed_loss.share)
    banked = banked_time(turn, slow, bank, math.inf, c)
    bank = math.copysign(bank, turn)
    turning = phase_of(cosine, sine, slow, bank, plant, c)
    return Leg(bank, banked, turning, phase_of(cosine, sine, plant.speed, 0.0, plant, c))
