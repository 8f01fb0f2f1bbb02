"""What the aircraft, the radars and their missiles are, and how the source's equations are read.

Source of this package: chapter 4 of the dissertation named in docs/uav_route.md ("Path planning using
mixed integer linear programming"). Lengths are kilometres, since Table 4.2 is; x is north and y is east;
a heading is clockwise from north, seen from above; a bank is positive with the right wing down.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Annotated, Any, Literal

from fieldmodels.model import ModelError
from fieldmodels.recording.units import STANDARD_GRAVITY
from fieldmodels.settings import Setting, check_declared, code, kernel_rows

GRAVITY = STANDARD_GRAVITY / 1000.0
"""Acceleration of gravity [km/s^2]."""

RADARS = 4
"""Largest number of radars that a batch of flights has room for."""

TEAM = 8
"""Largest number of aircraft in one episode."""

Interpolation = Literal["linear", "log"]


@dataclass(frozen=True)
class Aircraft:
    """The aircraft of section 4.2.1."""

    speed: Annotated[
        float,
        Setting("Speed of the aircraft (assumed).", "km/s", least=1e-3, most=1),
    ] = 0.25
    altitude: Annotated[float, Setting("Its height above the radars (assumed).", "km", least=0, most=50)] = (
        10.0
    )
    bank: Annotated[
        float, Setting("Bank angle in turns (section 4.2.1); 0 leaves them level.", "rad", least=0, most=1.5)
    ] = math.pi / 4
    least_turn: Annotated[
        float,
        Setting("Smallest turn that is banked (assumed).", "rad", least=0, most=math.pi),
    ] = 1e-3

    def __post_init__(self) -> None:
        """Check the numbers; see ``check_declared``."""
        check_declared(self)


@dataclass(frozen=True)
class Detection:
    """When a radar detects the aircraft (section 4.2.2)."""

    threshold: Annotated[
        float,
        Setting(
            "Probability above which a detection counts, or is certain.",
            least=0.01,
            below=0.99,
        ),
    ] = 0.5
    interpolation: Annotated[
        Interpolation,
        Setting("Table 4.2 between its entries: `linear`, or `log` in signature and range."),
    ] = "linear"
    detection: Annotated[
        Literal["deterministic", "stochastic"],
        Setting("`deterministic` detects above the threshold; `stochastic` draws each scan."),
    ] = "deterministic"
    scan_interval: Annotated[
        float, Setting("Time between a radar's scans if they are drawn (assumed).", "s", least=0.01)
    ] = 5.0
    reach: Annotated[
        float,
        Setting(
            "Slant range beyond which a radar does not scan.",
            "km",
            above=0,
        ),
    ] = 656.6

    def __post_init__(self) -> None:
        """Check the numbers; see ``check_declared``."""
        check_declared(self)


@dataclass(frozen=True)
class LockLoss:
    """The thresholds of eq (4.3), in seconds.

    The source leaves them to its platform. By default they mirror its example: four steps of 50 s without
    a break destroy the aircraft, one undetected step frees it (section 4.3.3).
    """

    lose: Annotated[
        float,
        Setting("Undetected time after which a lock is lost, T_LL.", "s", least=0, finite=False),
    ] = 50.0
    engage: Annotated[
        float,
        Setting("Detected time after which a missile is launched, T_eng.", "s", least=0, finite=False),
    ] = 150.0
    target: Annotated[float, Setting("Flight time of the missile, T_target.", "s", least=0, finite=False)] = (
        50.0
    )
    engaged: Annotated[
        Literal["accumulated", "unbroken", "elapsed"],
        Setting(
            "What the engage timer (4.6) counts: time detected, `accumulated` since the last lock loss "
            "(printed) or `unbroken` (4.33); or time `elapsed` since the first detection."
        ),
    ] = "accumulated"

    def __post_init__(self) -> None:
        """Check the numbers; see ``check_declared``."""
        check_declared(self)


INSTANT_KILL = LockLoss(math.inf, 0.0, 0.0)
"""Whoever is detected is destroyed at once."""


@dataclass(frozen=True)
class Reading:
    """How the source's equations are read: by default as they should be, else as printed."""

    heading: Annotated[
        Literal["own_leg", "next_leg"],
        Setting("(4.1): the aircraft heads along its `own_leg`, or (printed) along the `next_leg`."),
    ] = "own_leg"
    arctangent: Annotated[
        Literal["four_quadrant", "two_quadrant"],
        Setting("(4.1): `four_quadrant`, or (printed) `two_quadrant`: tan^-1 of a quotient."),
    ] = "four_quadrant"
    side: Annotated[
        Literal["relative", "absolute"],
        Setting(
            "Section 4.2.1: a turn's side from the `relative` position of the waypoint, or (printed) from "
            "its `absolute` one, with the opposite sign."
        ),
    ] = "relative"
    clamp: Annotated[
        Literal["both", "upper"],
        Setting("(4.2): the cosine is clamped on `both` sides, or (printed) on the `upper` one only."),
    ] = "both"
    axes: Annotated[
        Literal["right_handed", "left_handed"],
        Setting(
            "Section 4.2.1: `right_handed` (north, east, down), or (printed) `left_handed` (north, east, up) "
            "taken as though it were right-handed: the bank tilts the wrong way."
        ),
    ] = "right_handed"
    draw: Annotated[
        Literal["below", "above"],
        Setting(
            "Section 4.2.2: detected if the drawn number is `below` the probability, or (printed) `above`."
        ),
    ] = "below"
    timers: Annotated[
        Literal["seconds", "samples"],
        Setting(
            "(4.5)-(4.7): timers hold `seconds`, or (printed) numbers of `samples` compared with times, each "
            "event coming a sample late."
        ),
    ] = "seconds"


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


SHAPE, SCALE = "it shapes the observation", "it scales the actions"
"""Why a setting is one for all flights."""


@dataclass(frozen=True, kw_only=True)
class LegRules:
    """What an episode is, and what its legs are worth."""

    radars: Annotated[
        int, Setting("Number of radars of random layouts.", least=1, most=RADARS, fixed=SHAPE)
    ] = 1
    aircraft: Annotated[
        int, Setting("Number of aircraft that fly at once.", least=1, most=TEAM, fixed=SHAPE)
    ] = 1
    tracking: Annotated[
        Literal["each", "one"],
        Setting(
            "What a radar follows of several aircraft: `each` by itself, or `one` at a time (figure 4.2)."
        ),
    ] = "each"
    capture: Annotated[float, Setting("Distance from the goal at which it is reached.", "km", above=0)] = 5.0
    max_legs: Annotated[int, Setting("Legs in an episode.", least=1, most=10_000)] = 60
    least_leg: Annotated[float, Setting("Shortest leg.", "km", above=0, fixed=SCALE)] = 2.5
    longest_leg: Annotated[float, Setting("Longest leg.", "km", above=0, most=20_000, fixed=SCALE)] = 500.0
    length_cost: Annotated[float, Setting("Cost of a kilometre flown.", least=0)] = 0.02
    progress_reward: Annotated[float, Setting("Reward of a kilometre towards the goal.", least=0)] = 0.04
    progress: Annotated[
        Literal["straight", "around"],
        Setting(
            "The way to the goal for that reward: `straight`, or `around` the circle in which its nearest "
            "radar sees an aircraft's side."
        ),
    ] = "around"
    arrival_reward: Annotated[float, Setting("Reward of arriving.", least=0)] = 3.0
    damage_cost: Annotated[float, Setting("Cost of being hit.", least=0)] = 1.5
    late_cost: Annotated[float, Setting("Cost of running out of legs.", least=0)] = 1.0
    detection_cost: Annotated[float, Setting("Cost of a second of being detected.", least=0)] = 0.0
    sighting_cost: Annotated[float, Setting("Cost of a leg on which the aircraft is detected.", least=0)] = (
        0.0
    )

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            ModelError: If one is not possible.
        """
        check_declared(self)
        if self.least_leg > self.longest_leg:
            raise ModelError(
                f"the shortest of the legs, {self.least_leg} km, is longer than the longest, "
                f"{self.longest_leg} km"
            )


LOG = code(Detection, "interpolation", "log")
STOCHASTIC = code(Detection, "detection", "stochastic")
UNBROKEN, ELAPSED = (code(LockLoss, "engaged", name) for name in ("unbroken", "elapsed"))
NEXT_LEG = code(Reading, "heading", "next_leg")
TWO_QUADRANT = code(Reading, "arctangent", "two_quadrant")
ABSOLUTE = code(Reading, "side", "absolute")
UPPER = code(Reading, "clamp", "upper")
LEFT_HANDED = code(Reading, "axes", "left_handed")
ABOVE = code(Reading, "draw", "above")
IN_SAMPLES = code(Reading, "timers", "samples")
AROUND = code(LegRules, "progress", "around")
ONE = code(LegRules, "tracking", "one")


@lru_cache(maxsize=64)
def kernel_world(world: World) -> Any:
    """A world as the kernels read it: a record of its declared numbers."""
    return kernel_rows(world, 1)[0]
