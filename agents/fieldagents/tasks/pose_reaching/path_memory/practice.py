"""The drives that own training data come from: in the environment itself, with its walls and its faults."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fieldagents.tasks.pose_reaching.path_memory.matrices import Floats
from fieldagents.tasks.pose_reaching.path_memory.own_data import OwnData, babble
from fieldgym.pose_reaching import PoseReachingSettings, PoseReachingVectorEnv

ROBOT_SECONDS = 15.0
"""Time that each robot of a round drives [s]."""
STRAYING = 0.3
"""Share of the practice that is random all the same: without it nothing faster is ever met."""
STRAYING_TICKS = 5


def to_action(commands: Floats, settings: PoseReachingSettings) -> NDArray[np.float32]:
    """Actions of commands, taken to the robot's limits, shape (batch, 2 or, omnidirectional, 3).

    Args:
        commands: Speed [m/s], turn rate [rad/s] and perhaps, of an omnidirectional robot, speed to the left
            [m/s], shape (batch, 2 or 3).
        settings: Of the environment.
    """
    ahead, rate = commands[:, 0] / settings.max_speed, commands[:, 1] / settings.max_rate
    if settings.drive == "unicycle":
        chosen = [2.0 * ahead - 1.0, rate]
    else:
        left = commands[:, 2] / settings.max_speed if commands.shape[1] > 2 else 0.0 * rate
        chosen = [ahead, rate, left]
    return np.clip(np.stack(chosen, axis=1), -1.0, 1.0).astype(np.float32)


def own_data(
    settings: PoseReachingSettings,
    reality: Any = None,
    *,
    seconds: float = 300.0,
    rounds: int = 6,
    seed: int = 10_000,
) -> OwnData:
    """Let robots babble, then practise.

    Args:
        settings: Of the environment; its starts are taken to be anywhere.
        reality: Of the environment: what is learned is learned in it.
        seconds: Robot time of the babble, and again of each round of practice [s].
        rounds: Rounds of practice.
        seed: Of starts and random commands; one of the training seeds.
    """
    robots = max(1, round(seconds / ROBOT_SECONDS))
    ticks = round(ROBOT_SECONDS / settings.tick)
    rng = np.random.default_rng(seed)
    learned = OwnData()
    envs = PoseReachingVectorEnv(robots, settings={**_plain(settings), "starts": "T3"}, reality=reality)
    for part in range(rounds + 1):
        random = babble(ticks, robots, rng, settings.tick, settings.max_speed, settings.max_rate)
        stray = np.ones((ticks, robots, 1), dtype=np.bool_)  # at first there is nothing but random motion
        if part > 0:
            random[..., 0] = settings.max_speed  # who wants to become faster does not try to be slow
            begin = rng.random((ticks, robots, 1)) < STRAYING / STRAYING_TICKS
            stray = begin.copy()
            for later in range(1, STRAYING_TICKS):
                stray[later:] |= begin[:-later]
        _drive(envs, random, stray, settings, learned, seed + part * robots)
    envs.close()
    return learned


def _plain(settings: PoseReachingSettings) -> dict[str, Any]:
    return {name: getattr(settings, name) for name in settings.__dataclass_fields__}


def _drive(
    envs: PoseReachingVectorEnv,
    random: Floats,
    stray: NDArray[np.bool_],
    settings: PoseReachingSettings,
    learned: OwnData,
    seed: int,
) -> None:
    """Drive for a while and learn from it; what is learned serves from the next round on."""
    _, info = envs.reset(seed=seed)
    poses, commands, free = [info["pose"]], [], []
    over = np.zeros(envs.num_envs, dtype=np.bool_)
    for k in range(len(random)):
        command = random[k] if stray[k].all() else np.where(stray[k], random[k], learned.commands(poses[-1]))
        command = np.stack(
            [
                np.clip(command[:, 0], 0, settings.max_speed),
                np.clip(command[:, 1], -settings.max_rate, settings.max_rate),
            ],
            axis=1,
        )
        _, _, arrived, late, info = envs.step(to_action(command, settings))
        pose = info["pose"]
        moved = np.hypot(*(pose - poses[-1])[:, :2].T)
        half_turn = command[:, 1] * settings.tick / 2
        meant = command[:, 0] * settings.tick * np.abs(np.sinc(half_turn / np.pi))
        # A tick that a wall held, one cut short by the goal, and the jump to a new start teach nothing.
        free.append(~over & ~arrived & (moved >= 0.5 * meant))
        commands.append(command)
        poses.append(pose)
        over = arrived | late
    path, driven, free_ticks = np.stack(poses, 1), np.stack(commands, 1), np.stack(free, 1)
    for robot in range(envs.num_envs):
        learned.add(path[robot], driven[robot], free_ticks[robot], settings.tick)
