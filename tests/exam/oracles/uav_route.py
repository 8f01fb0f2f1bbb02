"""The aircraft and its radar, written from docs/uav_route.md and the dissertation's chapter 4.

Places are complex numbers, north + i east [m], so that a positive phase turns to the right. Between a leg's
start, the end of its bank and its end the flight is straight: all of it is in closed form. Nothing here is
shared with the simulation that it is compared with, the tables included.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from exam.oracles import Values, filled
from fieldmodels.arrays import FloatArray

NEUTRAL: Values = {
    "wind": {"north": 0.0, "east": 0.0},
    "turn_speed_loss": {"share": 0.0},
    "weaker_bank": {"factor": 1.0},
    "sensor_bias": {"north": 0.0, "east": 0.0},
    "signature_scale": {"factor": 1.0},
    "nose_cone_width": {"factor": 1.0},
    "radar_range_scale": {"factor": 1.0},
    "radar_position": {"north": 0.0, "east": 0.0},
    "scan_interval": {"factor": 1.0},
}

GRAVITY = 9.80665
ALTITUDE = 10e3
BANK = math.radians(45.0)
LEAST_TURN = 1e-3
SCAN_INTERVAL = 5.0
REACH = 656.6e3

AZIMUTH = (0.0, 30.0, 31.0, 159.0, 160.0, 180.0)
"""Columns of Table 4.1 [deg]."""
ELEVATION = (0.0, 20.0, 45.0, 90.0)
"""Rows of Table 4.1, from the bottom [deg]."""
SIGNATURE = ((5e-5, 5e-1), (5e-4, 5e-1), (5e-3, 1.0), (1.0, 1.0))
"""Table 4.1: within the cones about nose and tail, and between them, by elevation."""
SIZE = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0)
"""Rows of Table 4.2, from the bottom: signature."""
CHANCE = (0.99, 0.5, 0.1, 0.01)
"""Columns of Table 4.2: probability of detection."""
RANGE = (
    (12.0, 21.4, 38.0, 67.6, 120.2, 213.7, 380.0),
    (15.2, 27.1, 48.1, 85.6, 152.2, 270.6, 481.2),
    (17.6, 31.2, 55.6, 98.8, 175.7, 312.5, 555.6),
    (20.8, 36.9, 65.7, 116.8, 207.6, 369.2, 656.6),
)
"""Table 4.2, column by column: slant range [km]."""


@dataclass(frozen=True)
class Aircraft:
    """An aircraft with effects, and the radars that see it.

    Attributes:
        effects: Values of the effects that are on.
        speed: Airspeed [m/s].
    """

    effects: Values
    speed: float = 250.0

    def value(self, effect: str, name: str) -> float:
        """Value of one parameter of an effect."""
        return self._given[effect][name]

    @cached_property
    def _given(self) -> Values:
        return filled(self.effects, NEUTRAL)

    def place(self, effect: str) -> complex:
        """An effect's north and east as one number."""
        return complex(self.value(effect, "north"), self.value(effect, "east"))

    @property
    def slow(self) -> float:
        """Airspeed in a turn [m/s]."""
        return self.speed * (1.0 - self.value("turn_speed_loss", "share"))

    @property
    def bank(self) -> float:
        """Bank in a turn [rad]."""
        return BANK * self.value("weaker_bank", "factor")

    @property
    def scan_interval(self) -> float:
        """Time between looks [s]."""
        return SCAN_INTERVAL * self.value("scan_interval", "factor")

    def velocity(self, course: complex, airspeed: float) -> complex:
        """Velocity over ground along a course of length 1: wind and airspeed add up to it."""
        wind = self.place("wind")
        along = (wind * course.conjugate()).real
        return course * (along + math.sqrt(along**2 - abs(wind) ** 2 + airspeed**2))

    def leg(self, place: complex, before: complex | None, course: complex) -> Leg:
        """A leg from a place along a course, after a turn from the course before, if there was one."""
        turn = cmath.phase(course / before) if before else 0.0
        banked = abs(turn) * self.slow / (GRAVITY * math.tan(self.bank)) if abs(turn) >= LEAST_TURN else 0.0
        wind = self.place("wind")
        slow, level = self.velocity(course, self.slow), self.velocity(course, self.speed)
        return Leg(place, banked, math.copysign(self.bank, turn), (slow, level), (slow - wind, level - wind))

    def signature(self, azimuth: float, elevation: float) -> float:
        """Table 4.1 with the nose cone stretched, times the factor of all signatures; angles in [rad]."""
        width = self.value("nose_cone_width", "factor")
        edges = np.radians(AZIMUTH) * (1.0, width, width, 1.0, 1.0, 1.0)
        side = np.interp(abs(azimuth), edges, (0.0, 0.0, 1.0, 1.0, 0.0, 0.0))
        rows = [cone + side * (between - cone) for cone, between in SIGNATURE]
        shown = np.interp(abs(elevation), np.radians(ELEVATION), rows)
        return self.value("signature_scale", "factor") * float(shown)

    def chance(self, place: complex, nose: complex, bank: float, radar: complex) -> float:
        """Probability that a look of a radar that is believed to stand somewhere detects the aircraft."""
        ahead = radar + self.place("radar_position") - place
        to = np.array([ahead.real, ahead.imag, ALTITUDE])
        forward = np.array([nose.real, nose.imag, 0.0]) / abs(nose)
        level = np.array([-forward[1], forward[0], 0.0])
        right = math.cos(bank) * level + math.sin(bank) * np.array([0.0, 0.0, 1.0])
        up = np.cross(right, forward)
        slant = float(np.linalg.norm(to))
        if slant > REACH:
            return 0.0
        azimuth = math.atan2(to @ right, to @ forward)
        shown = self.signature(azimuth, math.asin(to @ up / slant))
        scale = 1e3 * self.value("radar_range_scale", "factor")
        return float(np.interp(slant, [scale * np.interp(shown, SIZE, column) for column in RANGE], CHANCE))


@dataclass(frozen=True)
class Leg:
    """A straight leg: banked for a time, then level.

    Attributes:
        start: Where it begins.
        banked: Time for which the aircraft is banked [s].
        bank: Bank in that time [rad].
        velocities: Over ground, banked and level [m/s].
        noses: Through the air, banked and level [m/s].
    """

    start: complex
    banked: float
    bank: float
    velocities: tuple[complex, complex]
    noses: tuple[complex, complex]

    def place(self, time: float) -> complex:
        """Place at a time since the start."""
        turning = min(time, self.banked)
        return self.start + turning * self.velocities[0] + (time - turning) * self.velocities[1]

    def time_of(self, length: float) -> float:
        """When a length [m] has been flown."""
        slow, level = map(abs, self.velocities)
        turning = min(length / slow, self.banked)
        return turning + (length - turning * slow) / level

    def share(self, first: float, last: float) -> float:
        """Share of a time since the start in which the aircraft is banked."""
        return max(min(last, self.banked) - max(first, 0.0), 0.0) / (last - first)


def simulate(
    base: Mapping[str, float],
    effects: Values,
    commands: FloatArray,
    step: float,
    start: Mapping[str, float] | None = None,
) -> FloatArray:
    """Work out what ``UavRoute`` describes; see ``Simulate``.

    The bank is the mean since the sample before; ``detected`` the probability of a detection in the middle of
    the way since then, banked for its share of the time (at the first sample: there).

    Args:
        base: ``speed`` [m/s], ``radar_north`` and ``radar_east`` [m].
        effects: Values of the effects that are on.
        commands: Waypoint that is flown to, north and east [m]; a new one begins a leg.
        step: Sampling interval [s].
        start: ``north`` and ``east`` [m] as they truly are at the first sample; ``course_before`` [rad], of
            the leg before the one that is being flown, none if that is the first; ``since`` [s], for how long
            it has been flown already.
    """
    begun = {"north": 0.0, "east": 0.0, "since": 0.0, **(start or {})}
    aircraft, radar = Aircraft(effects, base["speed"]), complex(base["radar_north"], base["radar_east"])
    bias = aircraft.place("sensor_bias")
    place, since = complex(begun["north"], begun["east"]), begun["since"]
    targets = commands @ (1, 1j)
    before = cmath.rect(1.0, begun["course_before"]) if "course_before" in begun else None
    course = (targets[0] - place) / abs(targets[0] - place)
    leg = aircraft.leg(place, before, course)
    leg = replace(leg, start=2 * place - leg.place(since))
    share, seen = leg.share(since - step, since), place
    # At a leg's first sample the look was made on the leg before.
    looked = aircraft.leg(place, None, before) if since == 0 and before is not None else leg
    out = np.empty((len(commands), 5))
    for k, target in enumerate(targets):
        if k > 0:
            was, place = place, leg.place(since + step)
            share, seen, looked = leg.share(since, since + step), 0.5 * (was + place), leg
            since += step
        chance = sum(
            part * aircraft.chance(seen, nose, bank, radar)
            for part, nose, bank in (
                (share, looked.noses[0], looked.bank),
                (1.0 - share, looked.noses[1], 0.0),
            )
            if part > 0.0
        )
        out[k] = (place + bias).real, (place + bias).imag, looked.bank * share, chance, aircraft.scan_interval
        if k > 0 and target != targets[k - 1]:
            before, course = course, (target - place) / abs(target - place)
            leg, since = aircraft.leg(place, before, course), 0.0
    return out


@dataclass
class Flight:
    """A flight leg by leg under radars, as the environment's ``info`` tells of it.

    Attributes:
        aircraft: The aircraft.
        place: Where it is [m].
        radars: Where the radars are believed to stand [m].
        threshold: Probability above which a detection is certain.
        lose: Undetected time after which a lock is lost [s].
        engage: Detected time since then after which a missile is launched [s].
        drawn: True looks at the radars' own times (results unknown), False at most every 5 s.
        longest_step: Longest time between looks if they are not drawn [s].
        course: Direction of the last leg, of length 1.
        time: Time flown [s].
        path: Length flown [m].
        looks: Number of drawn looks.
        largest: Largest probability of a detection at a look.
        time_over: Time over the threshold [s].
        detected: Whether each radar's last look was over it.
        timers: Lock loss, engage and launch of each radar (4.3)-(4.7) [s], shape (radars, 3).
    """

    aircraft: Aircraft
    place: complex
    radars: tuple[complex, ...]
    threshold: float = 0.5
    lose: float = 50.0
    engage: float = 150.0
    drawn: bool = False
    longest_step: float = 5.0
    course: complex | None = None
    time: float = 0.0
    path: float = 0.0
    looks: int = 0
    largest: float = 0.0
    time_over: float = 0.0
    detected: tuple[bool, ...] = ()
    timers: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        """Begin with every radar's timers at zero."""
        self.timers = np.zeros((len(self.radars), 3))

    @property
    def measured(self) -> complex:
        """Where the aircraft believes to be [m]."""
        return self.place + self.aircraft.place("sensor_bias")

    @property
    def radial(self) -> float:
        """Bearing of the radar nearest to where the aircraft believes to be [rad]."""
        return min((abs(r - self.measured), cmath.phase(r - self.measured)) for r in self.radars)[1]

    def fly(self, heading: float, length: float) -> None:
        """Fly a length [m] at a heading relative to the bearing of the nearest radar [rad]."""
        course = cmath.rect(1.0, self.radial + heading)
        leg = self.aircraft.leg(self.place, self.course, course)
        end = leg.time_of(length)
        turned = min(leg.banked, end)
        for begin, stop, number in ((0.0, turned, 0), (turned, end, 1)):
            for at, time in self._looks(begin, stop):
                if at is not None:
                    self._look(leg.place(at), leg.noses[number], leg.bank if number == 0 else 0.0)
                self._wait(time)
        self.place, self.course, self.path = leg.place(end), course, self.path + length

    def _looks(self, begin: float, stop: float) -> Iterator[tuple[float | None, float]]:
        """Pieces of a leg: when in it the radars look, if they do, and the piece's length [s]."""
        if not self.drawn:
            count = math.ceil((stop - begin) / self.longest_step - 1e-9)
            for j in range(count):
                yield begin + (j + 0.5) * (stop - begin) / count, (stop - begin) / count
            return
        started = self.time - begin
        while begin < stop - 1e-9:
            due = self.looks * self.aircraft.scan_interval - started
            looking = due <= begin + 1e-9
            self.looks += looking
            end = min(self.looks * self.aircraft.scan_interval - started, stop)
            yield begin if looking else None, end - begin
            begin = end

    def _look(self, place: complex, nose: complex, bank: float) -> None:
        chances = [self.aircraft.chance(place, nose, bank, radar) for radar in self.radars]
        self.largest = max(self.largest, *chances)
        self.detected = tuple(chance > self.threshold for chance in chances)

    def _wait(self, time: float) -> None:
        """Let the timers of (4.3)-(4.7) run: lock loss, engage, launch."""
        self.time += time
        if self.drawn:
            return
        self.time_over += time * any(self.detected)
        for row, detected in zip(self.timers, self.detected, strict=True):
            late = max(row[1] + time * detected - self.engage, 0.0)
            launched = row[1] >= self.engage
            row[0] = 0.0 if detected else row[0] + time
            row[1] += time * detected
            row[2] = row[2] + time if launched else late
            if row[0] >= self.lose:
                row[1:] = 0.0
