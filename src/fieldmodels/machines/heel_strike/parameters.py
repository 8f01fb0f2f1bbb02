"""What a walk is made of: the leg, its noises, their hidden regimes, and an estimator's gains.

Source of this package: A. I. Chaudhry, "Topics in robot locomotion: state estimation and
feasible-path generation for wheeled and legged robots", Cornell University 2015, chapter 2
("the dissertation"). Equation numbers in this package are that chapter's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

from fieldmodels.settings import Setting, check_declared, part_of

PushOff = Annotated[
    float,
    Setting(
        "Share of the speed error at a strike that the push-off removes; 0 is the source's pendulum.",
        least=0,
        most=1,
    ),
]


@dataclass(frozen=True)
class Leg:
    """The pendulum that stands in for the stance leg, and the rate at which it is sampled."""

    length: Annotated[float, Setting("Length of the pendulum (section 2.4.1).", "m", above=0)] = 1.0
    gravity: Annotated[float, Setting("Acceleration of free fall.", "m/s2", above=0)] = 9.81
    step: Annotated[float, Setting("Sampling interval (500 Hz, section 2.3.1).", "s", above=0)] = 0.002
    step_length: Annotated[
        float,
        Setting("Turns angles into foot heights (Ranger's step length, section 2.3.2).", "m", above=0),
    ] = 0.35
    speed: Annotated[
        float,
        Setting(
            "Angular speed at heel strike that the push-off aims at, and at the start (assumed).",
            "rad/s",
            above=0,
        ),
    ] = 1.0
    push_off: PushOff = 0.5
    limit: Annotated[
        float, Setting("Longest stride; a leg that takes longer has fallen (assumed).", "s", above=0)
    ] = 2.5

    def __post_init__(self) -> None:
        """Check the numbers; see ``check_declared``."""
        check_declared(self)


CollisionKind = Annotated[
    Literal["ar1", "low_pass"],
    Setting(
        "`ar1`: x' = rho x + sqrt(1 - rho^2) U(-C, C) from U(-C, C) at every strike, the text of section "
        "2.4.3; `low_pass`: x' = rho x + (1 - rho) U(-C, C) from x = 0, the errors of Fig 2.10."
    ),
]


@dataclass(frozen=True, kw_only=True)
class CommonNoise:
    """What stationary noise and hidden regimes have in common; the defaults are Ranger's nominal values."""

    gyro: Annotated[
        float,
        Setting(
            "Standard deviation of the gyro's noise (section 2.3.1).",
            "rad/s",
            least=0,
            most=1,
        ),
    ] = 0.0041
    collision_kind: CollisionKind = "low_pass"
    correlation: Annotated[
        float,
        Setting(
            "Correlation rho of neighbouring samples of the collision noise (section 2.4.3).",
            least=0,
            below=1,
        ),
    ] = 0.995
    envelope: Annotated[
        float,
        Setting(
            "Time after a strike in which the collision noise dies down (section 2.4.3) and the first "
            "gain holds.",
            "s",
            above=0,
            most=10,
        ),
    ] = 0.25
    hold: Annotated[
        float,
        Setting("Time for which the process torque is constant (section 2.5.2).", "s", above=0, most=100),
    ] = 0.25
    floor_one_sided: Annotated[
        bool,
        Setting("Draw the floor's height from [0, h] (section 2.4.5), not [-h, h] (section 2.6.1)."),
    ] = False

    def __post_init__(self) -> None:
        """Check the numbers; see ``check_declared``."""
        check_declared(self)

    @property
    def collision_drive(self) -> float:
        """Factor of the uniform draw that drives the collision noise, by its kind."""
        if self.collision_kind == "ar1":
            return math.sqrt(1 - self.correlation**2)
        return 1 - self.correlation

    @property
    def collision_first(self) -> float:
        """Factor of the uniform draw at a strike, by the kind."""
        return 1.0 if self.collision_kind == "ar1" else 0.0


@dataclass(frozen=True, kw_only=True)
class Noise(CommonNoise):
    """Stationary noise."""

    collision: Annotated[
        float, Setting("Largest amplitude C of the collision noise (section 2.4.3).", "rad/s", least=0)
    ] = 0.5
    process: Annotated[
        float,
        Setting("Largest amplitude A of the process torque per inertia (section 2.5.2).", "rad/s2", least=0),
    ] = 0.5
    floor: Annotated[float, Setting("Largest height error h of the floor (section 2.4.5).", "m", least=0)] = (
        0.004
    )


SILENT = Noise(gyro=0.0, collision=0.0, process=0.0, floor=0.0)

Level = Annotated[float, Setting("", least=0, most=10)]
Levels = tuple[Level, Level]
COLLISION_LEVELS = {"ar1": (0.02, 0.3), "low_pass": (0.1, 0.9)}
"""Low and high amplitude of the collision noise by its kind [rad/s]."""


@dataclass(frozen=True, kw_only=True)
class Regimes(CommonNoise):
    """Hidden Markov regimes: three noise levels that switch between low and high at heel strikes.

    Each level is a two-state chain of its own. The source's noise is stationary; with hidden regimes the
    gains become a control problem.
    """

    process: Annotated[
        Levels,
        Setting("Low and high amplitude of the process torque; equal levels never switch.", "rad/s2"),
    ] = (0.05, 0.8)
    floor: Annotated[Levels, Setting("Low and high floor height error.", "m")] = (0.0005, 0.004)
    collision: Annotated[
        Levels | None,
        Setting(
            "Low and high amplitude of the collision noise; None is (0.02, 0.3) for `ar1`, (0.1, 0.9) for "
            "`low_pass`.",
            "rad/s",
        ),
    ] = None
    dwell: Annotated[
        float, Setting("Mean number of strides between switches of one level.", least=1, finite=False)
    ] = 30.0

    @property
    def collision_levels(self) -> Levels:
        """Low and high amplitude of the collision noise [rad/s]."""
        return self.collision or COLLISION_LEVELS[self.collision_kind]

    @classmethod
    def fixed(cls, noise: Noise) -> Regimes:
        """A stationary noise as a regime that never switches."""
        return part_of(
            noise,
            cls,
            process=(noise.process, noise.process),
            floor=(noise.floor, noise.floor),
            collision=(noise.collision, noise.collision),
            dwell=math.inf,
        )
