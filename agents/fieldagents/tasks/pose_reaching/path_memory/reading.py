"""How chapter 5 is read: what theta and omega are, and each rule that the text leaves open."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from fieldagents.tasks.pose_reaching.path_memory.lookup import Fallback, Ties
from fieldagents.tasks.pose_reaching.path_memory.matrices import (
    BEARING,
    DISTANCE,
    EXAMPLE_ANGLE,
    FULL_TURN,
    Floats,
    Grid,
)
from fieldmodels.machines.pose_reaching.parameters import GOAL_HEADING


@dataclass(frozen=True)
class Reading:
    """One reading of the chapter, every rule explicit.

    Attributes:
        theta: What the second input is: the robot's ``heading``, as section 5.2.1 says, or its ``bearing``
            around the ball, from straight below it (0) by the right to straight above (pi).
        offset: Whether the heading offset psi = heading - psi_f is a third input, as in section 5.2.3; the
            simulation (5.3.2) lists two matrices only.
        command: What omega is: a turn ``rate``, as section 5.1.4 says, or the ``direction`` of the commanded
            velocity in the goal's frame, which the robot turns to at once.
        distance: Values of d.
        angle: Values of theta.
        mirror: Whether the left half of the field is taken for the right one, mirrored; the source relies on
            "the symmetric nature of the field" and does not say how.
        wrap: Whether angles are compared around the circle: the direction with the heading, and, on a grid of
            a full turn, its last value with its first.
        clamp: Whether measurements beyond a grid's ends count as its ends (d reaches 2.9 m, its grid 1.6 m).
        ties: Which of equal lambdas wins.
        fallback: What answers where every lambda is zero.
        speed: How remembered speeds are rounded: not at all (``exact``; section 5.3.2 gives no grid), to the
            ``grid`` of 0.5 of the worked example, or to ``integers``, as that example does nevertheless.
    """

    theta: Literal["bearing", "heading"] = "bearing"
    offset: bool = False
    command: Literal["direction", "rate"] = "direction"
    distance: Grid = DISTANCE
    angle: Grid = BEARING
    mirror: bool = True
    wrap: bool = True
    clamp: bool = True
    ties: Ties = "first"
    fallback: Fallback = "nearest"
    speed: Literal["exact", "grid", "integers"] = "exact"

    @property
    def grids(self) -> tuple[Grid, ...]:
        """The grids of d, theta and, with ``offset``, psi."""
        angles = (self.angle, EXAMPLE_ANGLE) if self.offset else (self.angle,)
        full = [math.isclose(grid.count * grid.step, FULL_TURN) for grid in angles]
        return (
            replace(self.distance, clamp=self.clamp),
            *(
                replace(grid, periodic=self.wrap and turn, clamp=self.clamp)
                for grid, turn in zip(angles, full, strict=True)
            ),
        )


AS_PRINTED = Reading(
    theta="heading", offset=True, command="rate", angle=EXAMPLE_ANGLE, fallback="first", speed="integers"
)
"""Sections 5.1.4 to 5.2.4 to the letter: heading and offset, a turn rate, rounded speeds, argmax of zeros."""

AS_IT_WORKS = Reading()
"""Bearing and direction; a fallback for the states that no path came near."""


def measure(poses: Floats, reading: Reading) -> tuple[Floats, Floats]:
    """The inputs of poses.

    Args:
        poses: x [m], y [m], heading [rad], shape (batch, 3).
        reading: What is measured.

    Returns:
        Inputs, shape (batch, 2 or 3), and 1 or, where the pose was mirrored, -1, shape (batch,).
    """
    x, y, heading = poses.T
    side = np.where(reading.mirror & (x < 0), -1.0, 1.0)
    heading = np.where(side < 0, math.pi - heading, heading)
    theta = np.arctan2(side * x, -y) if reading.theta == "bearing" else wrapped(heading)
    inputs = [np.hypot(x, y), theta]
    if reading.offset:
        inputs.append(wrapped(heading - GOAL_HEADING))
    return np.stack(inputs, axis=1), side


def rounded_speed(speed: Floats, rule: str) -> Floats:
    """Remembered speeds by a reading's rule; halves are rounded up (assumed)."""
    if rule == "exact":
        return speed
    step = 0.5 if rule == "grid" else 1.0
    return np.asarray(np.floor(speed / step + 0.5) * step)


def wrapped(angle: Floats) -> Floats:
    """The same angles in [-pi, pi)."""
    return np.asarray(np.mod(angle + math.pi, FULL_TURN) - math.pi)


def columns(inputs: Floats, grids: Sequence[Grid]) -> np.ndarray[tuple[int, int], np.dtype[np.int64]]:
    """Round inputs to their grids (section 5.2.2), shape (states, inputs)."""
    return np.stack([grid.nearest(inputs[:, i]) for i, grid in enumerate(grids)], axis=1)
