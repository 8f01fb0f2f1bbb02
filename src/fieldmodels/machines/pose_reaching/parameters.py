"""What the task is made of: the field, the robot's limits, when it has arrived, and its wheels.

Source of this package: chapter 5 of the dissertation named in docs/pose_reaching.md ("Path generation
using matrix representations of previous robot state data"). The ball lies at the origin; a pose is
x [m], y [m], heading [rad] counter-clockwise from +x; the goal is the origin with heading +y (psi_f of
figure 5.1).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

GOAL_HEADING = math.pi / 2
"""Heading with which the robot must arrive [rad] (section 5.2.1: "facing up")."""

GOAL = (0.0, 0.0, GOAL_HEADING)
"""Pose that the robot must reach."""


@dataclass(frozen=True)
class Field:
    """The playing field, its centre at the ball.

    Attributes:
        length: Extent along x [m] (section 5.3.2: "roughly 5 meters long").
        width: Extent along y [m] (section 5.3.2: "3 meters wide").
    """

    length: float = 5.0
    width: float = 3.0


FIELD = Field()


@dataclass(frozen=True)
class Limits:
    """What can be commanded (assumed; the source gives no limits).

    Attributes:
        max_speed: Largest speed [m/s]; the unicycle of section 5.1.4 drives forwards only.
        max_rate: Largest turn rate [rad/s].
        radius: Turning circle of the reference lengths [m]; wider than max_speed / max_rate, so that a
            controller can follow it.
    """

    max_speed: float = 1.0
    max_rate: float = 4.0
    radius: float = 0.3


@dataclass(frozen=True)
class Arrival:
    """When the robot has arrived (assumed; the source shows pictures only).

    Attributes:
        distance: Largest distance from the ball [m].
        angle: Largest heading error [rad].
    """

    distance: float
    angle: float


STRICT = Arrival(0.05, math.radians(10.0))
LOOSE = Arrival(0.10, math.radians(15.0))


@dataclass(frozen=True)
class Wheels:
    """A differential drive.

    Attributes:
        radius: Radius of both wheels [m].
        track: Distance between them [m].
    """

    radius: float
    track: float


ROBOCUP = Wheels(0.03, 0.15)
"""A small robot of the league that the source played in (assumed)."""

WARTHOG = Wheels(0.3, 1.1652)
"""The skid-steered vehicle of the public data ``drive_ugv`` (model_training/complete_training.py there)."""
