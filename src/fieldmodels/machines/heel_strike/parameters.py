"""What a walk is made of: the leg, its noises, their hidden regimes, and an estimator's gains.

Source of this package: A. I. Chaudhry, "Topics in robot locomotion: state estimation and
feasible-path generation for wheeled and legged robots", Cornell University 2015, chapter 2
("the dissertation"). Equation numbers in this package are that chapter's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

CollisionKind = Literal["low_pass", "ar1"]


@dataclass(frozen=True)
class Leg:
    """The pendulum that stands in for the stance leg, and the rate at which it is sampled.

    Attributes:
        length: Length of the pendulum [m] (section 2.4.1).
        gravity: Acceleration of free fall [m/s2].
        step: Sampling interval [s] (500 Hz, section 2.3.1).
        step_length: Turns angles into foot heights [m] (Ranger's step length, section 2.3.2).
        speed: Angular speed at heel strike that the push-off aims at, and at the start [rad/s] (assumed).
        push_off: Share of the speed error that each push-off removes; 0 is the undamped pendulum of the
            source, which goes over the top after some minutes of process noise (assumed 0.5).
        limit: Longest stride [s]; a leg that takes longer has fallen (assumed).
    """

    length: float = 1.0
    gravity: float = 9.81
    step: float = 0.002
    step_length: float = 0.35
    speed: float = 1.0
    push_off: float = 0.5
    limit: float = 2.5

    def __post_init__(self) -> None:
        """Check that the numbers make sense.

        Raises:
            ValueError: If a length, speed or time is not positive or the push-off is outside [0, 1].
        """
        for name in ("length", "gravity", "step", "step_length", "speed", "limit"):
            if not getattr(self, name) > 0:
                raise ValueError(f"leg: {name} must be positive, not {getattr(self, name)}")
        if not 0 <= self.push_off <= 1:
            raise ValueError(f"leg: push_off must be in [0, 1], not {self.push_off}")


@dataclass(frozen=True)
class Noise:
    """Amplitudes and kinds of the four noises; the defaults are Ranger's nominal values.

    Attributes:
        gyro: Standard deviation of the gyro's white noise [rad/s] (section 2.3.1, printed there as
            "variance").
        collision: Largest amplitude C of the collision noise [rad/s] (section 2.4.3).
        collision_kind: ``low_pass``: x' = rho x + (1 - rho) U(-C, C) from x = 0 at every strike, which
            gives the errors of Fig 2.10; ``ar1``: x' = rho x + sqrt(1 - rho^2) U(-C, C) from U(-C, C) at
            every strike, which gives the amplitude of the text.
        correlation: Correlation rho of neighbouring samples (section 2.4.3).
        envelope: Time after a strike in which the collision noise dies down linearly [s] (section 2.4.3).
        process: Largest amplitude A of the process torque per inertia [rad/s2] (section 2.5.2).
        hold: Time T for which the process torque is constant [s] (section 2.5.2).
        floor: Largest floor height error h [m] (section 2.4.5).
        floor_one_sided: True draws the height from [0, h] as section 2.4.5 prints, False from [-h, h] as
            section 2.6.1 does.
    """

    gyro: float = 0.0041
    collision: float = 0.5
    collision_kind: CollisionKind = "low_pass"
    correlation: float = 0.995
    envelope: float = 0.25
    process: float = 0.5
    hold: float = 0.25
    floor: float = 0.004
    floor_one_sided: bool = False

    def __post_init__(self) -> None:
        """Check that the numbers make sense.

        Raises:
            ValueError: If an amplitude is negative, a time not positive, or the kind unknown.
        """
        for name in ("gyro", "collision", "process", "floor"):
            if not (getattr(self, name) >= 0 and math.isfinite(getattr(self, name))):
                raise ValueError(f"noise: {name} must not be negative, it is {getattr(self, name)}")
        for name in ("envelope", "hold"):
            if not getattr(self, name) > 0:
                raise ValueError(f"noise: {name} must be positive, not {getattr(self, name)}")
        if not 0 <= self.correlation < 1:
            raise ValueError(f"noise: correlation must be in [0, 1), not {self.correlation}")
        if self.collision_kind not in ("low_pass", "ar1"):
            raise ValueError(
                f"noise: collision_kind must be 'low_pass' or 'ar1', not {self.collision_kind!r}"
            )

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


SILENT = Noise(gyro=0.0, collision=0.0, process=0.0, floor=0.0)


@dataclass(frozen=True)
class Regimes:
    """Hidden Markov regimes: three noise levels that switch between low and high at heel strikes.

    Each level is a two-state chain of its own. The source's noise is stationary; with hidden regimes the
    gains become a control problem.

    Attributes:
        process: Low and high amplitude of the process torque [rad/s2].
        floor: Low and high floor height error [m].
        collision: Low and high amplitude of the collision noise [rad/s].
        dwell: Mean number of strides between switches of one level.
        noise: What does not switch: gyro noise, kinds, times.
    """

    process: tuple[float, float] = (0.05, 0.8)
    floor: tuple[float, float] = (0.0005, 0.004)
    collision: tuple[float, float] = (0.1, 0.9)
    dwell: float = 30.0
    noise: Noise = Noise()

    def __post_init__(self) -> None:
        """Check that the numbers make sense.

        Raises:
            ValueError: If a level is negative or the dwell is shorter than one stride.
        """
        for name in ("process", "floor", "collision"):
            levels = getattr(self, name)
            if len(levels) != 2 or min(levels) < 0:
                raise ValueError(f"regimes: {name} needs two levels that are not negative, not {levels}")
        if not self.dwell >= 1:
            raise ValueError(f"regimes: dwell must be at least one stride, not {self.dwell}")

    @classmethod
    def preset(cls, kind: CollisionKind) -> Regimes:
        """The regimes of the environment for one kind of collision noise."""
        collision = (0.1, 0.9) if kind == "low_pass" else (0.02, 0.3)
        return cls(collision=collision, noise=Noise(collision_kind=kind))

    @classmethod
    def fixed(cls, noise: Noise) -> Regimes:
        """A stationary noise as a regime that never switches."""
        return cls(
            process=(noise.process, noise.process),
            floor=(noise.floor, noise.floor),
            collision=(noise.collision, noise.collision),
            dwell=math.inf,
            noise=noise,
        )


@dataclass(frozen=True)
class Gains:
    """Gains of the model-based estimator (2.14), with the model-sensor ratio gated by the stride's phase.

    Attributes:
        sensor_early: S_MS while the collision dies down (the envelope's time after a strike).
        sensor_late: S_MS in the rest of the stride; equal to ``sensor_early`` it is the paper's estimator.
        reset: S_HR, share of the geometry's angle in the heel-strike reset (2.10).
        decay: S_FD [1/s], inverse of the gyro filter's decay time.
    """

    sensor_early: float
    sensor_late: float
    reset: float
    decay: float = 1000 / 3

    def as_row(self) -> tuple[float, float, float, float]:
        """The gains in the order of ``Strides.advance``'s columns."""
        return (self.sensor_early, self.sensor_late, self.reset, self.decay)
