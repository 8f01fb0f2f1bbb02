"""Faults that resemble an effect which the models list, and are another: to develop a diagnosis on.

They grow by another power, act in one direction or on one part, at some time, or come and go.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping

import numpy as np
from scipy.signal import lfilter

from exam.plants.axis import Axis
from exam.plants.axis_unlisted import (
    LATE,
    OF_COMMAND,
    OF_PLACE,
    OF_PLACE_AND_SPEED,
    OF_SPEED,
    ZERO,
    AxisFault,
    Scale,
    U,
    X,
)
from exam.plants.drive import Drive, Motion, Pose
from exam.plants.drive_faults import (
    FORWARD,
    LEFT,
    LEFT_RIM,
    OF_TURN_AND_SPEED,
    PAST_TURNS,
    TURN,
    TURNING,
    DriveFault,
)
from exam.plants.drive_faults import Scale as DriveScale
from exam.plants.faults import Fault
from exam.plants.flight import TRACKER_OVER_TIME, WIND, WIND_OVER_TIME, Flight, FlightFault
from exam.plants.leg import GYRO_OVER_TIME, OF_ANGLE, OF_RATE, OVER_TIME, Leg, LegFault
from exam.plants.walk import CAMERA_OVER_TIME, OF_STEERING, Walker, WalkFault

Rng = np.random.Generator
LATER = (f"force over past of {U}", f"force over past of {U}*time")
"""Commands that come later: half of it is a delay that stays."""


def _wandering(rng: Rng, duration: float, step: float, slow: float) -> list[float]:
    """Chance of deviation one that is remembered for a time, a value a sample."""
    decay = math.exp(-step / slow)
    drawn = rng.standard_normal(round(duration / step) + 2)
    return list(map(float, lfilter([math.sqrt(1.0 - decay**2)], [1.0, -decay], drawn)))


# An axis.


def _blade_drag(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    size = 0.2 * k * s.f / s.v**1.5
    axis.forces.append(lambda _t, _x, v, _f: -size * math.copysign(abs(v) ** 1.5, v))


def _one_way_drag(axis: Axis, k: float, s: Scale, rng: Rng) -> None:
    size, way = 0.2 * k * s.f / s.v**2, rng.choice([-1.0, 1.0])
    axis.forces.append(lambda _t, _x, v, _f: -size * v * abs(v) if way * v > 0.0 else 0.0)


def _square_spring(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    size = 0.1 * k * s.f / s.x**2
    axis.forces.append(lambda _t, x, _v, _f: -size * x * abs(x))


def _fifth_power_spring(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    size = 0.05 * k * s.f / s.x**5
    axis.forces.append(lambda _t, x, _v, _f: -size * x**5)


def _friction_at_the_ends(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    size = 0.1 * k * s.f
    axis.dry.append(lambda _t, x, _v, _f: size * abs(x) / s.x)


def _late_machine_next_door(axis: Axis, k: float, s: Scale, rng: Rng) -> None:
    size, begin, phase = 0.1 * k * s.f, 0.4 * s.duration, rng.uniform(0.0, 2.0 * math.pi)
    turns = 2.0 * math.pi * 1.7
    axis.forces.append(lambda t, _x, _v, _f: size * math.sin(turns * t + phase) if t >= begin else 0.0)


def _load_taken_up(axis: Axis, k: float, s: Scale, rng: Rng) -> None:
    begin, heavier = rng.uniform(0.3, 0.7) * s.duration, axis.inertia * (1.0 + 0.05 * k)

    def take(u: float, t: float) -> float:
        if t >= begin:
            axis.inertia = heavier
        return u

    axis.maps.append(take)


def _brownout(axis: Axis, k: float, s: Scale, rng: Rng) -> None:
    begin, kept = rng.uniform(0.2, 0.5) * s.duration, math.exp(-0.05 * k)
    axis.maps.append(lambda u, t: u * kept if begin <= t < begin + 0.3 * s.duration else u)


def _weak_for_small(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    kept, knee = math.exp(-0.1 * k), 0.3 * s.u
    axis.maps.append(lambda u, _t: kept * u if abs(u) < knee else u - (1.0 - kept) * math.copysign(knee, u))


def _command_square(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    axis.maps.append(lambda u, _t: u + 0.02 * k * u * u / s.u)


def _filling_buffer(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    past: list[float] = []

    def wait(u: float, t: float) -> float:
        past.append(u)
        late = 0.5 * k * t / s.duration
        place = max(len(past) - 1 - late, 0.0)
        low = int(place)
        return past[low] + (place - low) * (past[min(low + 1, len(past) - 1)] - past[low])

    axis.maps.append(wait)


def _busy_bus(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    past = [0.0]
    size = min(0.25 * k, 1.0)

    def wait(u: float, t: float) -> float:
        before, past[0] = past[0], u
        return before * size + u * (1.0 - size) if math.sin(2.0 * t * 100.0 * s.step) > 0.0 else u

    axis.maps.append(wait)


def _wandering_delay(axis: Axis, k: float, s: Scale, rng: Rng) -> None:
    late = _wandering(rng, s.duration, s.step, 50.0 * s.step)
    axis.late = lambda t: 0.3 * k * s.step * abs(late[round(t / s.step)])


def _warming_zero(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    axis.position.append(
        lambda y, t, _x, _v, _f: y + 0.02 * k * s.x * (1.0 - math.exp(-6.0 * t / s.duration))
    )


def _fading_sensor(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    axis.position.append(lambda y, t, _x, _v, _f: y * (1.0 - min(0.02 * k, 0.9) * t / s.duration))


AXIS: Mapping[str, AxisFault] = {
    "blade_drag": Fault("Drag grows with the power 1.5 of the speed.", _blade_drag, shows=OF_SPEED),
    "one_way_drag": Fault("Drag acts in one direction.", _one_way_drag, shows=OF_SPEED),
    "square_spring": Fault(
        "A spring resists with the square of the deflection.", _square_spring, shows=OF_PLACE
    ),
    "fifth_power_spring": Fault(
        "A spring resists with the fifth power.", _fifth_power_spring, shows=OF_PLACE
    ),
    "friction_at_the_ends": Fault(
        "Dry friction grows with the deflection.", _friction_at_the_ends, shows=OF_PLACE_AND_SPEED
    ),
    "late_machine_next_door": Fault(
        "From some time on a periodic force acts.", _late_machine_next_door, shows=("force over time",)
    ),
    "load_taken_up": Fault(
        "At some time it takes up a load.",
        _load_taken_up,
        shows=("parameter mass|inertia over time", "force over rate of velocity*time"),
    ),
    "brownout": Fault("For some time the actuator gives less.", _brownout, shows=(f"force over {U}*time",)),
    "weak_for_small": Fault("The actuator gives less for small commands.", _weak_for_small, shows=OF_COMMAND),
    "command_square": Fault("The actuator is bent by a square.", _command_square, shows=OF_COMMAND),
    "filling_buffer": Fault("Commands come later and later.", _filling_buffer, shows=LATER),
    "busy_bus": Fault("Commands come later every other while.", _busy_bus, shows=LATER),
    "wandering_delay": Fault(
        "Positions are late by times that wander.", _wandering_delay, random=True, shows=LATE
    ),
    "warming_zero": Fault("The position sensor's zero moves until it is warm.", _warming_zero, shows=ZERO),
    "fading_sensor": Fault(
        "The position sensor shows less and less.", _fading_sensor, shows=(f"sensor {X} over {X}*time",)
    ),
}


# A drive.


def _trim(drive: Drive, k: float, s: DriveScale, _rng: Rng) -> None:
    size = 0.005 * k * s.rate
    drive.ground.append(lambda m, _p, _t: (m[0], m[1], m[2] + (size if abs(m[0]) > 0.05 * s.speed else 0.0)))


def _square_sideslip(drive: Drive, k: float, s: DriveScale, _rng: Rng) -> None:
    size = 0.05 * k / (s.rate * s.speed)
    drive.ground.append(lambda m, _p, _t: (m[0], m[1] - size * m[0] * abs(m[0]) * m[2], m[2]))


def _uphill(drive: Drive, k: float, _s: DriveScale, rng: Rng) -> None:
    top, share = rng.uniform(-math.pi, math.pi), 1.0 - math.exp(-0.02 * k)

    def climb(motion: Motion, pose: Pose, _t: float) -> Motion:
        return motion[0] * (1.0 - share * max(math.cos(pose[2] - top), 0.0)), motion[1], motion[2]

    drive.ground.append(climb)


def _late_turns(drive: Drive, k: float, s: DriveScale, _rng: Rng) -> None:
    past: list[float] = []

    def wait(speed: float, rate: float, _t: float) -> tuple[float, float]:
        past.append(rate)
        place = max(len(past) - 1 - 0.3 * k, 0.0)
        low = int(place)
        return speed, past[low] + (place - low) * (past[min(low + 1, len(past) - 1)] - past[low])

    del s
    drive.commands.append(wait)


def _slow_left_wheel(drive: Drive, k: float, _s: DriveScale, _rng: Rng) -> None:
    share, turning = 1.0 - math.exp(-1.0 / (0.3 * k)), [0.0]

    def follow(rim: float, side: float, _t: float) -> float:
        if side > 0.0:
            return rim
        turning[0] += share * (rim - turning[0])
        return turning[0]

    drive.rims.append(follow)


def _slips_on_the_spot(drive: Drive, k: float, s: DriveScale, _rng: Rng) -> None:
    share = 1.0 - math.exp(-0.05 * k)
    drive.ground.append(
        lambda m, _p, _t: (m[0], m[1], m[2] * (1.0 - share * math.exp(-((3.0 * m[0] / s.speed) ** 2))))
    )


def _heading_jump(drive: Drive, k: float, s: DriveScale, rng: Rng) -> None:
    when = rng.uniform(0.3, 0.7) * s.duration
    drive.sensors.append(lambda p, _true, t: (p[0], p[1], p[2] + (0.005 * k if t > when else 0.0)))


def _shared_battery(drive: Drive, k: float, s: DriveScale, _rng: Rng) -> None:
    most = 2.0 * s.rim / (1.0 + 0.1 * k)

    def share(speed: float, rate: float, _t: float) -> tuple[float, float]:
        asked = 2.0 * max(abs(speed), 0.5 * drive.track * abs(rate))
        kept = min(1.0, most / asked) if asked else 1.0
        return kept * speed, kept * rate

    drive.commands.append(share)


DRIVE: Mapping[str, DriveFault] = {
    "trim": Fault(
        "While it drives it turns by a constant rate.", _trim, shows=("force turn rate over speed",)
    ),
    "square_sideslip": Fault(
        "It slides outwards with the square of the speed.",
        _square_sideslip,
        shows=(f"force sideways speed over speed*{TURNING}",),
    ),
    "uphill": Fault(
        "It is slower uphill and not faster downhill.",
        _uphill,
        ("slope",),
        shows=("force share of forward speed over heading", "force forward speed over speed*heading"),
    ),
    "late_turns": Fault("Turns are late, speeds are not.", _late_turns, shows=PAST_TURNS),
    "slow_left_wheel": Fault(
        "One wheel lags.",
        _slow_left_wheel,
        ("actuator_lag",),
        shows=(f"force {LEFT}|{TURN} over past of {LEFT_RIM}",),
    ),
    "slips_on_the_spot": Fault(
        "It turns too little on the spot.", _slips_on_the_spot, shows=OF_TURN_AND_SPEED
    ),
    "heading_jump": Fault(
        "The shown heading jumps at some time.", _heading_jump, shows=("sensor heading over time",)
    ),
    "shared_battery": Fault(
        "Both wheels slow down where they ask for too much.",
        _shared_battery,
        ("saturation",),
        shows=(f"force {FORWARD} over speed", f"force {TURN} over turn rate*speed"),
    ),
}


# A leg.


def _air_drag(leg: Leg, k: float, _s: float, _rng: Rng) -> None:
    leg.forces.append(lambda _t, _x, v: -0.05 * k * math.copysign(abs(v) ** 1.5, v))


def _spring_in_the_hip(leg: Leg, k: float, _s: float, _rng: Rng) -> None:
    leg.forces.append(lambda _t, x, _v: -0.2 * k * x * abs(x))


def _one_way_friction(leg: Leg, k: float, _s: float, _rng: Rng) -> None:
    leg.forces.append(lambda _t, _x, v: -0.02 * k * v * v if v > 0.0 else 0.0)


def _warming_gyro(leg: Leg, k: float, s: float, _rng: Rng) -> None:
    leg.gyro.append(lambda y, t: y + 0.002 * k * math.exp(-6.0 * t / s))


def _gyro_knocked_twice(leg: Leg, k: float, s: float, rng: Rng) -> None:
    first = rng.uniform(0.2, 0.4) * s
    leg.gyro.append(lambda y, t: y + (0.002 * k if first <= t < first + 0.3 * s else 0.0))


def _late_push(leg: Leg, k: float, s: float, rng: Rng) -> None:
    phase = rng.uniform(0.0, 2.0 * math.pi)
    leg.forces.append(lambda t, _x, _v: 0.03 * k * math.sin(11.0 * t + phase) if t > 0.5 * s else 0.0)


LEG: Mapping[str, LegFault] = {
    "air_drag": Fault("Drag grows with the power 1.5 of the rate.", _air_drag, shows=OF_RATE),
    "spring_in_the_hip": Fault(
        "A spring resists with the square of the angle.", _spring_in_the_hip, shows=OF_ANGLE
    ),
    "one_way_friction": Fault("Drag acts in one direction.", _one_way_friction, shows=OF_RATE),
    "warming_gyro": Fault("The gyro's bias fades until it is warm.", _warming_gyro, shows=GYRO_OVER_TIME),
    "gyro_knocked_twice": Fault(
        "For some time the gyro has a bias.", _gyro_knocked_twice, shows=GYRO_OVER_TIME
    ),
    "late_push": Fault("From some time on a periodic torque acts.", _late_push, shows=OVER_TIME),
}


# A walker.


def _late_by_half(walker: Walker, k: float, n: int, _rng: Rng) -> None:
    share, last = 1.0 - math.exp(-0.1 * k), [0.0]

    def wait(turn: float, stride: int) -> float:
        before, last[0] = last[0], turn
        return share * before + (1.0 - share) * turn if stride > n / 2 else turn

    walker.turns.append(wait)


def _soft_limit(walker: Walker, k: float, _n: int, _rng: Rng) -> None:
    knee = 1.0 / k
    walker.turns.append(lambda turn, _k: knee * math.tanh(turn / knee))


def _turned_until_warm(walker: Walker, k: float, n: int, _rng: Rng) -> None:
    walker.turns.append(lambda turn, stride: turn + 0.005 * k * math.exp(-5.0 * stride / n))


def _camera_turned_back(walker: Walker, k: float, n: int, rng: Rng) -> None:
    first = rng.uniform(0.2, 0.4) * n
    walker.sights.append(
        lambda line, stride: line + (0.005 * k if first <= stride < first + 0.3 * n else 0.0)
    )


WALK: Mapping[str, WalkFault] = {
    "late_by_half": Fault(
        "In the second half turns come late.",
        _late_by_half,
        shows=("force turn over past of steering*time", "force turn over past of steering"),
    ),
    "soft_limit": Fault("Turns saturate softly.", _soft_limit, ("saturation",), shows=OF_STEERING),
    "turned_until_warm": Fault(
        "It turns aside until it is warm.", _turned_until_warm, shows=("force turn over time",)
    ),
    "camera_turned_back": Fault(
        "For some time the camera is aside.", _camera_turned_back, shows=CAMERA_OVER_TIME
    ),
}


# A flight.


def _wind_by_day(flight: Flight, k: float, s: float, rng: Rng) -> None:
    blow = cmath.rect(k, rng.uniform(0.0, 2.0 * math.pi))
    flight.drifts.append(lambda t, _p, _c, _b: blow * math.exp(-3.0 * t / s))


def _shy_of_wind(flight: Flight, k: float, _s: float, rng: Rng) -> None:
    north = cmath.rect(1.0, rng.uniform(0.0, 2.0 * math.pi))
    flight.drifts.append(lambda _t, _p, c, _b: 0.5 * k * c * max((c / north).real, 0.0))


def _tracker_jump(flight: Flight, k: float, s: float, rng: Rng) -> None:
    when, aside = rng.uniform(0.3, 0.7) * s, cmath.rect(2.0 * k, rng.uniform(0.0, 2.0 * math.pi))
    flight.tracker.append(lambda place, t: place + (aside if t > when else 0.0))


def _turns_faster(flight: Flight, k: float, _s: float, _rng: Rng) -> None:
    flight.drifts.append(lambda _t, _p, c, b: -k * c if b > 0.0 else 0.0)


def _tired_operator(flight: Flight, k: float, s: float, _rng: Rng) -> None:
    flight.scans.append(lambda p, t, _b: p * (1.0 - min(0.05 * k, 0.9) * t / s))


FLIGHT: Mapping[str, FlightFault] = {
    "wind_by_day": Fault("The wind dies down.", _wind_by_day, shows=WIND_OVER_TIME),
    "shy_of_wind": Fault(
        "It is faster in one direction and not slower in the other.",
        _shy_of_wind,
        ("wind",),
        shows=(f"force speed along the course|{WIND} over rate of north|rate of east",),
    ),
    "tracker_jump": Fault("The tracker's zero jumps at some time.", _tracker_jump, shows=TRACKER_OVER_TIME),
    "turns_faster": Fault(
        "It is slower in turns to one side.", _turns_faster, shows=("force speed along the course over bank",)
    ),
    "tired_operator": Fault(
        "Fewer and fewer detections are reported.",
        _tired_operator,
        shows=("odds detected over time", "odds detected over detected*time"),
    ),
}
