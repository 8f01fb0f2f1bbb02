"""A stand-in for the human operator of section 5.4: four arrow keys, pressed as a slow person would."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from fieldagents.operator import Operator, moved
from fieldagents.tasks.pose_reaching.path_memory.matrices import Floats
from fieldagents.tasks.pose_reaching.path_memory.teachers import graceful_command
from fieldagents.tasks.pose_reaching.task import steer
from fieldgym.pose_reaching import PoseReachingEnv
from fieldmodels.machines.pose_reaching.parameters import GOAL_HEADING

REACTION = 2
"""Ticks between what the pilot sees and the keys it presses."""
CRUISE = 0.4
"""Share of the largest speed at which it drives."""


class Pilot:
    """Taps the arrow keys so that the stick is on average where it wants it; sees the robot 0.2 s late."""

    def __init__(self) -> None:
        self._seen: list[Floats] = []
        self._owed = np.zeros(2)

    def keys(self, pose: Floats, operator: Operator, max_speed: float, max_rate: float) -> tuple[int, int]:
        """Keys held for the coming tick: left (1) or right (-1), ahead (1) or back (-1), 0 for none.

        Args:
            pose: x [m], y [m], heading [rad] as it is now.
            operator: Whose stick the keys move.
            max_speed: Of the robot [m/s].
            max_rate: Of the robot [rad/s].
        """
        self._seen.append(np.asarray(pose, dtype=np.float64))
        x, y, heading = self._seen[max(0, len(self._seen) - 1 - REACTION)]
        speed, rate = graceful_command(x, y, heading, GOAL_HEADING, CRUISE * max_speed, max_rate)
        left, ahead = operator.joystick, operator.ahead
        self._owed += rate / max_rate, speed / max_speed
        keys = _key(left, self._owed[0]), _key(ahead, self._owed[1])
        self._owed -= moved(left, keys[0]), moved(ahead, keys[1])
        self._owed = np.clip(self._owed, -1.0, 1.0)
        return keys


def _key(place: float, want: float) -> int:
    """The key of one axis of the stick after which it is nearest to where it is wanted."""
    return min((0, -1, 1), key=lambda key: abs(moved(place, key) - want))


def drive_by_keys(env: PoseReachingEnv, drives: Any, start: Floats) -> str:
    """Drive once by the keys, from a pose, and add the drive; returns what became of it."""
    settings, pilot, operator, rows = env.settings, Pilot(), Operator(steering=True), []
    _, info = env.reset(seed=0, options={"pose": start})
    over, own = False, np.zeros(settings.action_count, dtype=np.float32)
    while not over:
        operator.move(*pilot.keys(info["pose"], operator, settings.max_speed, settings.max_rate))
        action = steer(operator, own)
        before: Mapping[str, Any] = info
        _, _, arrived, late, info = env.step(action)
        rows.append(drives.row(before, action))
        over = arrived or late
    rows.append(drives.row(info, action))
    return str(drives.add(rows))
