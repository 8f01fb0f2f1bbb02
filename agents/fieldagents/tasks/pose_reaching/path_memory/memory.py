"""Remembered robot states, and the robot that drives by them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fieldagents.tasks.pose_reaching.path_memory.lookup import FORMS, Lookup
from fieldagents.tasks.pose_reaching.path_memory.matrices import Floats, Integers
from fieldagents.tasks.pose_reaching.path_memory.reading import (
    AS_IT_WORKS,
    Reading,
    columns,
    measure,
    rounded_speed,
    wrapped,
)


@dataclass(frozen=True)
class States:
    """What a robot went through, and what it was commanded there: the source's p, before any rounding.

    Attributes:
        poses: x [m], y [m], heading [rad], shape (states, 3).
        speed: Speed over the coming tick [m/s], shape (states,).
        rate: Mean turn rate over the coming tick [rad/s], shape (states,).
        direction: Direction of the commanded velocity [rad], shape (states,): the heading at the end of that
            tick; of an omnidirectional robot that of its way.
        path: Number of the path that a state belongs to, shape (states,).
    """

    poses: Floats
    speed: Floats
    rate: Floats
    direction: Floats
    path: Integers

    def __len__(self) -> int:
        return len(self.poses)

    @property
    def paths(self) -> list[Floats]:
        """Poses of each path, for drawing."""
        return [self.poses[self.path == path] for path in np.unique(self.path)]


class PathMemory:
    """A path memory under one reading of the chapter.

    Args:
        states: The training data.
        reading: How the chapter is read.
        form: How the largest lambda is found: ``dense``, ``sparse``, ``table`` or ``tree``; all give the
            same winner.

    Raises:
        ValueError: If there are no states, or no such form.
    """

    def __init__(self, states: States, reading: Reading = AS_IT_WORKS, form: str = "table") -> None:
        if form not in FORMS:
            raise ValueError(f"the look-up has the forms {', '.join(FORMS)}, not {form!r}")
        self.states, self.reading = states, reading
        inputs, self._side = measure(states.poses, reading)
        grids = reading.grids
        self.lookup: Lookup = FORMS[form](columns(inputs, grids), grids, reading.fallback, reading.ties)
        self._speed = rounded_speed(states.speed, reading.speed)

    def commands(self, poses: Floats, tick: float, max_rate: float | None = None) -> tuple[Floats, Integers]:
        """Commands for robots at these poses.

        Args:
            poses: x [m], y [m], heading [rad], shape (batch, 3).
            tick: Time for which a command holds [s].
            max_rate: Largest turn rate of an omnidirectional robot [rad/s]; None for a unicycle.

        Returns:
            Speed [m/s] and turn rate [rad/s] (beyond the robot's limits where it should turn faster than it
            can), shape (batch, 2), of an omnidirectional robot also the speed to the left [m/s], shape
            (batch, 3); and the remembered states that they come from, -1 where none does.
        """
        inputs, side = measure(poses, self.reading)
        winner = self.lookup.winners(inputs)
        # A state on the left half was mirrored when it was remembered, the robot is when it is measured.
        flip = side * self._side[winner]
        speed = self._speed[winner]

        def away(angle: Floats) -> Floats:
            from_heading = np.where(flip < 0, np.pi - angle, angle) - poses[:, 2]
            return wrapped(from_heading) if self.reading.wrap else from_heading

        if self.reading.command == "rate":
            given = np.stack([speed, flip * self.states.rate[winner]], axis=1)
        elif max_rate is None:
            given = np.stack([speed, away(self.states.direction[winner]) / tick], axis=1)
        else:
            later = self.states.poses[winner, 2] + tick * self.states.rate[winner]
            rate = np.clip(away(later) / tick, -max_rate, max_rate)
            # The way of a tick leads where the velocity points at half of its turn.
            angle = away(self.states.direction[winner]) - 0.5 * rate * tick
            given = np.stack([speed * np.cos(angle), rate, speed * np.sin(angle)], axis=1)
        return np.where(winner[:, None] < 0, 0.0, given), winner
