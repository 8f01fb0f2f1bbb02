"""The numbers of the robot's drive, ground and sensors: each is declared here and nowhere else."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fieldmodels.declared import row_type
from fieldmodels.machines.pose_reaching.parameters import ROBOCUP, Wheels
from fieldmodels.model import Effect, Parameter

NO_LIMIT = 1e6
"""A saturation limit [m/s] or rate limit [m/s^2] from this on means none."""


def base_parameters(wheels: Wheels) -> tuple[Parameter, ...]:
    """The numbers that a nominal robot depends on."""
    return (
        Parameter("wheel_radius", "m", wheels.radius, 1e-3, 10.0, 0.01, refitted=False),
        Parameter("track", "m", wheels.track, 1e-3, 100.0, 0.05, refitted=False),
    )


@dataclass(frozen=True)
class Scales:
    """Typical sizes of one robot's record, from which fits take their steps and starts.

    Attributes:
        speeds: Rim speeds that 0.5, 3, 10 and 30 % of the commands exceed [m/s].
        rate: Largest rate of a rim's commanded speed from one sample to the next [m/s^2].
        duration: Length of the longest recording [s].
        step: Sampling interval [s].
    """

    speeds: tuple[float, ...] = (1.3, 1.1, 0.8, 0.5)
    rate: float = 20.0
    duration: float = 60.0
    step: float = 0.05


def drive_effects(scales: Scales) -> tuple[Effect, ...]:
    """All effects, at the scales of a record."""
    late = tuple(scales.step * k for k in (0.5, 2.0, 6.0))
    return (
        *_command_effects(scales, late),
        *_rim_effects(scales),
        *_ground_effects(),
        *_sensor_effects(scales, late),
        _parameter_step(scales),
    )


def _command_effects(scales: Scales, late: tuple[float, ...]) -> tuple[Effect, ...]:
    return (
        Effect(
            "actuator_gain",
            "Both wheels turn faster or slower than commanded, in proportion.",
            "actuator",
            (Parameter("gain", "1", 1.0, 0.05, 20.0, 0.05, starts=(0.9, 1.1)),),
            "rims = gain * commanded rims",
        ),
        Effect(
            "turn_gain",
            "The wheels are driven for more or less turning than commanded, as if the drive's controller "
            "assumed another track.",
            "actuator",
            (Parameter("gain", "1", 1.0, 0.05, 20.0, 0.05, starts=(0.9, 1.1)),),
            "right rim - left rim = gain * track * commanded turn rate",
        ),
        Effect(
            "actuator_lag",
            "The wheels follow their command with a first-order lag (motors, powertrain, load).",
            "actuator",
            (Parameter("time_constant", "s", 0.0, 0.0, 10.0, 0.5 * scales.step, starts=late),),
            "time_constant * d(rim)/dt = commanded rim - rim",
        ),
        Effect(
            "actuator_rate_limit",
            "The wheels cannot change their speed faster than at a certain rate (a ramp in the drive, its "
            "current's limit).",
            "actuator",
            (
                Parameter(
                    "rate", "m/s^2", NO_LIMIT, 1e-6, NO_LIMIT, 0.05 * scales.rate,
                    starts=tuple(scales.rate / k for k in (0.5, 1.5, 4.0, 10.0, 25.0)),
                ),
            ),
            "|d(rim)/dt| <= rate",
        ),
        Effect(
            "actuator_delay",
            "The command acts late (radio, bus, computing time).",
            "actuator",
            (Parameter("delay", "s", 0.0, 0.0, 2.0, 0.5 * scales.step, starts=late),),
            "rim(t) = commanded rim(t - delay)",
        ),
    )  # fmt: skip


def _rim_effects(scales: Scales) -> tuple[Effect, ...]:
    fast = scales.speeds[0]
    return (
        Effect(
            "actuator_saturation",
            "A wheel cannot turn faster than a certain speed.",
            "actuator",
            (
                Parameter("limit", "m/s", NO_LIMIT, 1e-6, NO_LIMIT, 0.05 * fast, starts=scales.speeds),
            ),
            "|rim| <= limit",
        ),
        Effect(
            "actuator_dead_zone",
            "Small wheel speeds are not carried out (static friction in the drive).",
            "actuator",
            (
                Parameter(
                    "width", "m/s", 0.0, 0.0, 1e3, 0.02 * fast,
                    starts=tuple(fast * k for k in (0.02, 0.1, 0.3)),
                ),
            ),
            "rim = 0 for |command| < width, else command - width sign(command)",
        ),
    )  # fmt: skip


def _ground_effects() -> tuple[Effect, ...]:
    """What acts between the wheels' turning and the body's motion."""
    return (
        Effect(
            "unequal_wheels",
            "One wheel is larger than the other, so that the robot veers in proportion to its speed.",
            "actuator",
            (Parameter("difference", "1", 0.0, -1.0, 1.0, 0.02),),
            "left travel * (1 + difference / 2), right travel * (1 - difference / 2)",
        ),
        Effect(
            "yaw_slip",
            "The wheels slip when the robot turns: it turns by less than they do (skid steering).",
            "environment",
            (Parameter("share", "1", 0.0, -2.0, 0.99, 0.05),),
            "turn rate = (1 - share) * (right rim - left rim) / track",
        ),
        Effect(
            "sideways_slip",
            "The robot slides outwards in curves, in proportion to its centripetal acceleration.",
            "environment",
            (Parameter("coefficient", "s", 0.0, 0.0, 5.0, 0.02),),
            "sideways velocity = -coefficient * speed * turn rate",
        ),
        Effect(
            "slope",
            "The ground slopes: for each metre driven the wheels creep a little downhill.",
            "environment",
            (
                Parameter("x", "1", 0.0, -1.0, 1.0, 0.02),
                Parameter("y", "1", 0.0, -1.0, 1.0, 0.02),
            ),
            "velocity + (x, y) * |speed|",
        ),
    )


def _sensor_effects(scales: Scales, late: tuple[float, ...]) -> tuple[Effect, ...]:
    return (
        Effect(
            "sensor_delay",
            "The pose is measured late (vision, radio); the wheels' speeds are not.",
            "sensor",
            (Parameter("delay", "s", 0.0, 0.0, 2.0, 0.5 * scales.step, starts=late),),
            "measured pose (t) = pose(t - delay)",
        ),
        Effect(
            "heading_bias",
            "The heading is measured with a constant error (a marker or compass mounted askew).",
            "sensor",
            (Parameter("angle", "rad", 0.0, -3.2, 3.2, 0.02),),
            "measured heading = heading + angle",
        ),
    )


def _parameter_step(scales: Scales) -> Effect:
    return Effect(
        "parameter_step",
        "The drive's strength jumps during the record (a battery sags, a coupling slips).",
        "change",
        (
            Parameter(
                "time", "s", 0.0, 0.0, 1e6, 0.02 * scales.duration,
                starts=tuple(float(t) for t in np.linspace(0.1, 0.9, 17) * scales.duration),
                smooth=False,
            ),
            Parameter("factor", "1", 1.0, 0.05, 20.0, 0.05, starts=(0.9,)),
        ),
        "rims = factor * commanded rims (and their limit) from time on, in proportion within its sample",
    )  # fmt: skip


BASE = base_parameters(ROBOCUP)
EFFECTS = drive_effects(Scales())
AFTER_THE_WHEELS = tuple(
    effect.name for effect in (*_ground_effects(), *_sensor_effects(Scales(), (Scales().step,)))
)
"""Effects that act between the wheels' turning and the pose that is measured; all others act before."""
ROW = row_type(BASE, EFFECTS)
"""Type of a robot's numbers as kernels read them."""
