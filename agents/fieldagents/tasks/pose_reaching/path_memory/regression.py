"""Memories without bins: the nearest remembered pose, and a regression on the nearest ones."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial import KDTree

from fieldagents.tasks.pose_reaching.path_memory.matrices import Floats, Integers
from fieldagents.tasks.pose_reaching.path_memory.memory import States

METRES_PER_RADIAN = 0.1 / math.radians(10)
"""How far off a heading counts: 10 degrees as much as 0.1 m, twice the strict arrival's distance."""


def features(poses: Floats) -> tuple[Floats, Floats]:
    """Poses on the right half (mirrored if need be) as points, shape (batch, 4), and the side, +-1."""
    side = np.where(poses[:, 0] < 0, -1.0, 1.0)
    heading = np.where(side < 0, math.pi - poses[:, 2], poses[:, 2])
    return (
        np.stack(
            [
                side * poses[:, 0],
                poses[:, 1],
                METRES_PER_RADIAN * np.cos(heading),
                METRES_PER_RADIAN * np.sin(heading),
            ],
            axis=1,
        ),
        side,
    )


class NeighbourMemory:
    """Speed and turn rate of remembered poses that are near, heading included.

    Args:
        states: The training data.
        neighbours: 1 takes the nearest one's command. More fit a plane to the commands of so many by least
            squares, the nearer the heavier (locally weighted regression: Atkeson, Moore and Schaal 1997).
    """

    def __init__(self, states: States, neighbours: int = 1) -> None:
        points, side = features(states.poses)
        self._points, self._tree = points, KDTree(points)
        self._commands = np.stack([states.speed, side * states.rate], axis=1)
        self._neighbours = min(neighbours, len(states))

    def commands(self, poses: Floats) -> tuple[Floats, Integers]:
        """Commands for robots at these poses.

        Args:
            poses: x [m], y [m], heading [rad], shape (batch, 3).

        Returns:
            Speed [m/s] and turn rate [rad/s], shape (batch, 2), and the nearest remembered states.
        """
        points, side = features(poses)
        away, near = (
            np.asarray(found) for found in self._tree.query(points, k=range(1, self._neighbours + 1))
        )
        found = self._commands[near[:, 0]] if self._neighbours == 1 else self._plane(points, away, near)
        return np.stack([found[:, 0], side * found[:, 1]], axis=1), near[:, 0]

    def _plane(self, points: Floats, away: Floats, near: Integers) -> Floats:
        """Value at each point of the plane through its neighbours' commands, within what they commanded."""
        width = np.maximum(away[:, -1:], 1e-9) / 2
        weight = np.exp(-0.5 * (away / width) ** 2)
        offset = self._points[near] - points[:, None]
        design = np.concatenate([np.ones((*offset.shape[:2], 1)), offset], axis=2)
        weighted = design * weight[..., None]
        # Ridge on the slopes: neighbours of a single path lie on a line and leave the others open.
        ridge = 1e-2 * width[:, :, None] ** 2 * np.diag([0.0, 1.0, 1.0, 1.0, 1.0])
        normal = np.swapaxes(weighted, 1, 2) @ design + ridge
        known = self._commands[near]
        value = np.linalg.solve(normal, np.swapaxes(weighted, 1, 2) @ known)[:, 0]
        return np.clip(value, known.min(axis=1), known.max(axis=1))
