"""The robot that makes its own training data: what section 5.4 leaves as the next step.

Random motion never reaches the goal, but it reaches every pose that it comes through. Seen from a later pose
of its own, taken as the goal, each earlier pose is one from which that goal was reached, in a known time
and with a known first command (hindsight, Andrychowicz et al. 2017). A table keeps, for every bin of
relative poses, the command of the shortest time seen. Practice then drives by the table and adds what
happens; only faster ways replace what is there (self-imitation, Oh et al. 2018).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from fieldagents.tasks.pose_reaching.path_memory.matrices import FULL_TURN, Floats
from fieldmodels.compiled import compiled
from fieldmodels.machines.pose_reaching.parameters import Field

FIELD = Field()
LONGEST = 8.0
"""Longest time between a pose and the later one that is taken for its goal [s]."""


@dataclass(frozen=True)
class Bins:
    """How relative poses are distinguished.

    Attributes:
        position: Width of a bin [m].
        headings: Number of heading bins in a full turn.
        field: Robots farther from the ball than the field's walls are no robots.
    """

    position: float = 0.1
    headings: int = 36
    field: Field = FIELD

    @property
    def shape(self) -> tuple[int, int, int]:
        """Bins along x (right half; the left one is mirrored), y and heading."""
        half, width = self.field.length / 2, self.field.width
        return math.ceil(half / self.position), math.ceil(width / self.position), self.headings


class OwnData:
    """A table of relative poses, each bin with the first command of the fastest way seen from it.

    Attributes:
        time: Shortest time seen from each bin [s], infinite where none, shape ``bins.shape``.
        command: Speed [m/s] and turn rate [rad/s] with which it began, shape (*bins.shape, 2).
    """

    def __init__(self, bins: Bins | None = None) -> None:
        self.bins = bins or Bins()
        self.time = np.full(self.bins.shape, np.inf)
        self.command = np.zeros((*self.bins.shape, 2))
        self._filled: Floats | None = None

    @property
    def share(self) -> float:
        """Share of the bins that something is known of."""
        return float(np.isfinite(self.time).mean())

    def add(self, poses: Floats, commands: Floats, free: NDArray[np.bool_], tick: float) -> None:
        """Learn from one drive.

        Args:
            poses: x [m], y [m], heading [rad] before each command, and after the last, shape (n + 1, 3).
            commands: Speed [m/s], turn rate [rad/s] of each tick, shape (n, 2).
            free: Ticks that went as commanded; a wall or a new start in between and nothing is learned
                across it, shape (n,).
            tick: Time of a command [s].
        """
        _hindsight(
            np.ascontiguousarray(poses),
            np.ascontiguousarray(commands),
            np.ascontiguousarray(free),
            tick,
            round(LONGEST / tick),
            self.bins.position,
            self.bins.field.width / 2,
            self.time,
            self.command,
        )
        self._filled = None

    def commands(self, poses: Floats) -> Floats:
        """Commands for robots at these poses; where nothing is known, those of the nearest bin.

        Args:
            poses: x [m], y [m], heading [rad], shape (batch, 3).

        Returns:
            Speed [m/s] and turn rate [rad/s], shape (batch, 2).

        Raises:
            ValueError: If nothing has been learned.
        """
        if self._filled is None:
            self._filled = self._fill()
        side = np.where(poses[:, 0] < 0, -1.0, 1.0)
        heading = np.where(side < 0, math.pi - poses[:, 2], poses[:, 2])
        nx, ny, nh = self.bins.shape
        i = np.clip((side * poses[:, 0] / self.bins.position).astype(np.int64), 0, nx - 1)
        down = self.bins.field.width / 2
        j = np.clip(((poses[:, 1] + down) / self.bins.position).astype(np.int64), 0, ny - 1)
        k = np.floor(np.mod(heading, FULL_TURN) * (nh / FULL_TURN)).astype(np.int64) % nh
        found = self._filled[i, j, k].copy()
        found[:, 1] *= side
        return found

    def _fill(self) -> Floats:
        """The commands, with the nearest known bin's where a bin is empty."""
        known = np.argwhere(np.isfinite(self.time))
        if not len(known):
            raise ValueError("nothing has been learned; add drives first")
        box = np.array([0, 0, self.bins.headings])
        empty = np.argwhere(~np.isfinite(self.time))
        filled = self.command.copy()
        if len(empty):
            nearest = known[KDTree(known, boxsize=box).query(empty)[1]]
            filled[tuple(empty.T)] = self.command[tuple(nearest.T)]
        return filled


@compiled
def _hindsight(
    poses: Floats,
    commands: Floats,
    free: NDArray[np.bool_],
    tick: float,
    longest: int,
    width: float,
    down: float,
    time: Floats,
    command: Floats,
) -> None:
    nx, ny, nh = time.shape
    begin = 0
    for goal in range(1, len(poses)):
        if not free[goal - 1]:
            begin = goal
        turn = 0.5 * math.pi - poses[goal, 2]
        c, s = math.cos(turn), math.sin(turn)
        for k in range(goal - 1, max(begin, goal - longest) - 1, -1):
            ahead, aside = poses[k, 0] - poses[goal, 0], poses[k, 1] - poses[goal, 1]
            x, y = c * ahead - s * aside, s * ahead + c * aside
            heading, rate = poses[k, 2] + turn, commands[k, 1]
            if x < 0.0:
                x, heading, rate = -x, math.pi - heading, -rate
            i, j = int(x / width), math.floor((y + down) / width)
            h = math.floor((heading % FULL_TURN) * (nh / FULL_TURN)) % nh
            took = (goal - k) * tick
            if i < nx and 0 <= j < ny and took < time[i, j, h]:
                time[i, j, h] = took
                command[i, j, h, 0] = commands[k, 0]
                command[i, j, h, 1] = rate


def babble(
    ticks: int, robots: int, rng: np.random.Generator, tick: float, max_speed: float, max_rate: float
) -> Floats:
    """Random commands, each held for a random time of 0.1 to 1 s, shape (ticks, robots, 2).

    Speed is drawn evenly from 0 to the largest, the turn rate evenly to both sides.
    """
    result = np.empty((ticks, robots, 2))
    for robot in range(robots):
        at = 0
        while at < ticks:
            held = max(1, round(rng.uniform(0.1, 1.0) / tick))
            result[at : at + held, robot] = rng.uniform(0, max_speed), rng.uniform(-max_rate, max_rate)
            at += held
    return result
