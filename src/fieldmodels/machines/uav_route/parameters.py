"""What the aircraft, the radars and their missiles are, and how the source's equations are read.

Source of this package: chapter 4 of the dissertation named in docs/uav_route_physics.md ("Path planning using
mixed integer linear programming"). Lengths are kilometres, since Table 4.2 is; x is north and y is east;
a heading is clockwise from north, seen from above; a bank is positive with the right wing down.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal, NamedTuple, get_args

from fieldmodels.model import ModelError
from fieldmodels.recording.units import STANDARD_GRAVITY

GRAVITY = STANDARD_GRAVITY / 1000.0
"""Acceleration of gravity [km/s^2]."""

RADARS = 4
"""Largest number of radars that a batch of flights has room for."""

Interpolation = Literal["linear", "log"]
Engaged = Literal["accumulated", "unbroken", "elapsed"]


@dataclass(frozen=True)
class Aircraft:
    """The aircraft of section 4.2.1.

    Attributes:
        speed: Speed [km/s] (assumed; 12.5 km in a step of 50 s).
        altitude: Height above the radars [km] (assumed).
        bank: Bank angle in a turn [rad] (section 4.2.1); 0 leaves turns level.
        least_turn: Smallest turn that is banked [rad] (the source's epsilon; assumed).
    """

    speed: float = 0.25
    altitude: float = 10.0
    bank: float = math.pi / 4
    least_turn: float = 1e-3

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            ModelError: If one is not possible.
        """
        if not (self.speed > 0 and math.isfinite(self.speed)):
            raise ModelError(f"the speed must be positive [km/s], not {self.speed}")
        if not (self.altitude >= 0 and math.isfinite(self.altitude)):
            raise ModelError(f"the altitude must not be negative [km], not {self.altitude}")
        if not 0 <= self.bank < math.pi / 2:
            raise ModelError(f"the bank angle must lie in [0, pi/2), not {self.bank}")
        if not 0 <= self.least_turn <= math.pi:
            raise ModelError(f"the least turn must lie in [0, pi], not {self.least_turn}")


@dataclass(frozen=True)
class Detection:
    """When a radar detects the aircraft (section 4.2.2).

    Attributes:
        threshold: Probability of detection above which a detection is certain.
        interpolation: Table 4.2 between its entries: ``linear`` in signature, range and probability, or
            ``log``: in the logarithms of signature and range.
        stochastic: True draws each scan; False detects above the threshold.
        scan_interval: Time between a radar's scans if they are drawn [s] (assumed).
        reach: Slant range beyond which a radar does not scan at all [km]: the largest of Table 4.2, as
            the source has radars count only "within an engagement range".
    """

    threshold: float = 0.5
    interpolation: Interpolation = "linear"
    stochastic: bool = False
    scan_interval: float = 5.0
    reach: float = 656.6

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            ModelError: If one is not possible.
        """
        if not 0.01 <= self.threshold < 0.99:
            raise ModelError(
                f"the threshold must lie in [0.01, 0.99), Table 4.2's range, not {self.threshold}"
            )
        if self.interpolation not in get_args(Interpolation):
            raise ModelError(f"interpolation is linear or log, not {self.interpolation!r}")
        if not self.scan_interval > 0:
            raise ModelError(f"the scan interval must be positive [s], not {self.scan_interval}")
        if not self.reach > 0:
            raise ModelError(f"the radars' reach must be positive [km], not {self.reach}")


@dataclass(frozen=True)
class LockLoss:
    """The thresholds of eq (4.3), in seconds.

    The source leaves them to its platform. By default they mirror its example: four steps of 50 s without
    a break destroy the aircraft, one undetected step frees it (section 4.3.3).

    Attributes:
        lose: T_LL, undetected time after which a lock is lost [s].
        engage: T_eng, detected time after which a missile is launched [s].
        target: T_target, flight time of the missile [s].
    """

    lose: float = 50.0
    engage: float = 150.0
    target: float = 50.0

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            ModelError: If a time is negative or not a number.
        """
        for name in ("lose", "engage", "target"):
            if not getattr(self, name) >= 0:
                raise ModelError(f"lock loss: {name} must not be negative [s], not {getattr(self, name)}")


INSTANT_KILL = LockLoss(math.inf, 0.0, 0.0)
"""Whoever is detected is destroyed at once."""


@dataclass(frozen=True)
class Reading:
    """How the source's equations are read: by default as they should be, else as printed.

    Attributes:
        heading: (4.1): the aircraft heads along its ``own_leg``, or (printed) along the ``next_leg``.
        arctangent: (4.1): ``four_quadrant``, or (printed) ``two_quadrant``: tan^-1 of a quotient.
        side: Section 4.2.1: a turn's side from the ``relative`` position of the waypoint, or (printed) from
            its ``absolute`` one, with the opposite sign.
        clamp: (4.2): the cosine is clamped on ``both`` sides, or (printed) on the ``upper`` one only.
        axes: Section 4.2.1: ``right_handed`` (north, east, down), or (printed) ``left_handed``
            (north, east, up) taken as though it were right-handed: the bank tilts the wrong way.
        draw: Section 4.2.2: detected if the drawn number is ``below`` the probability, or (printed) if it
            is ``above``.
        timers: (4.5)-(4.7): timers hold ``seconds``, or (printed) numbers of ``samples`` compared with
            times, each event coming a sample late.
        engaged: (4.6): the engage timer holds the detected time ``accumulated`` since the last lock loss
            (printed); the ``unbroken`` one, as (4.33) limits; or all time ``elapsed`` since the first
            detection, as the text says ("increments when the system is engaged").
    """

    heading: Literal["own_leg", "next_leg"] = "own_leg"
    arctangent: Literal["four_quadrant", "two_quadrant"] = "four_quadrant"
    side: Literal["relative", "absolute"] = "relative"
    clamp: Literal["both", "upper"] = "both"
    axes: Literal["right_handed", "left_handed"] = "right_handed"
    draw: Literal["below", "above"] = "below"
    timers: Literal["seconds", "samples"] = "seconds"
    engaged: Engaged = "accumulated"


RIGHT = Reading()
PRINTED = Reading("next_leg", "two_quadrant", "absolute", "upper", "left_handed", "above", "samples")
"""Every equation as it is printed."""


@dataclass(frozen=True)
class World:
    """An aircraft, the radars' way of detecting it, and their way of losing it.

    Attributes:
        aircraft: The aircraft.
        detection: When it is detected.
        lock_loss: What follows.
        reading: How the source's equations are read.
    """

    aircraft: Aircraft = field(default_factory=Aircraft)
    detection: Detection = field(default_factory=Detection)
    lock_loss: LockLoss = field(default_factory=LockLoss)
    reading: Reading = RIGHT


@dataclass(frozen=True)
class Layout:
    """Where a flight begins and ends, and what stands in between.

    Attributes:
        start: North and east [km].
        goal: North and east [km].
        radars: North and east of each radar [km].
    """

    start: tuple[float, float]
    goal: tuple[float, float]
    radars: tuple[tuple[float, float], ...]


EXAMPLE = Layout((350.0, 125.0), (340.0, 0.0), ((0.0, 0.0),))
"""The source's example (section 4.5.1)."""

SECOND_UAV = Layout((-350.0, 125.0), (-340.0, 0.0), ((0.0, 0.0),))
"""Its second aircraft; the source gives its start, its goal is assumed to mirror the first one's."""


class Constants(NamedTuple):
    """A world as the kernels take it."""

    speed: float
    altitude: float
    bank: float
    least_turn: float
    threshold: float
    log: bool
    stochastic: bool
    scan_interval: float
    reach: float
    lose: float
    engage: float
    target: float
    next_leg: bool
    two_quadrant: bool
    absolute_side: bool
    upper_clamp: bool
    left_handed: bool
    draw_above: bool
    samples: bool
    engaged: int


def make_constants(world: World) -> Constants:
    """Put a world into the form of the kernels."""
    aircraft, detection, lock_loss, reading = world.aircraft, world.detection, world.lock_loss, world.reading
    return Constants(
        speed=float(aircraft.speed),
        altitude=float(aircraft.altitude),
        bank=float(aircraft.bank),
        least_turn=float(aircraft.least_turn),
        threshold=float(detection.threshold),
        log=detection.interpolation == "log",
        stochastic=detection.stochastic,
        scan_interval=float(detection.scan_interval),
        reach=float(detection.reach),
        lose=float(lock_loss.lose),
        engage=float(lock_loss.engage),
        target=float(lock_loss.target),
        next_leg=reading.heading == "next_leg",
        two_quadrant=reading.arctangent == "two_quadrant",
        absolute_side=reading.side == "absolute",
        upper_clamp=reading.clamp == "upper",
        left_handed=reading.axes == "left_handed",
        draw_above=reading.draw == "above",
        samples=reading.timers == "samples",
        engaged=get_args(Engaged).index(reading.engaged),
    )
