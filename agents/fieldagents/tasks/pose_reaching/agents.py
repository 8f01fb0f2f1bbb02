"""Pose reaching: the path memory as printed and as it works, its kin, and the least time possible.

Source: A. I. Chaudhry, "Topics in robot locomotion: state estimation and feasible-path generation for
wheeled and legged robots", Cornell University 2015, chapter 5. Everything that an agent remembers is made
when it is made, from fixed training seeds.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from fieldagents.agent import Agent, Sees
from fieldagents.task import ReferenceAgent
from fieldagents.tasks.pose_reaching.path_memory.least_time import Task, least_time
from fieldagents.tasks.pose_reaching.path_memory.matrices import Floats, Integers
from fieldagents.tasks.pose_reaching.path_memory.memory import PathMemory, States
from fieldagents.tasks.pose_reaching.path_memory.own_data import OwnData
from fieldagents.tasks.pose_reaching.path_memory.practice import own_data, to_action
from fieldagents.tasks.pose_reaching.path_memory.reading import (
    AS_IT_WORKS,
    AS_PRINTED,
    Reading,
    wrapped,
)
from fieldagents.tasks.pose_reaching.path_memory.regression import NeighbourMemory
from fieldagents.tasks.pose_reaching.path_memory.teachers import (
    Teacher,
    graceful_commands,
    starts_anywhere,
    starts_facing,
    taught,
)
from fieldgym.pose_reaching import PoseReachingSettings
from fieldgym.settings import read_settings
from fieldmodels.machines.pose_reaching.parameters import FIELD, GOAL_HEADING, Field

PATHS, POINTS = 9, 14
"""Training paths and states of each: the 126 states of section 5.3.2, which does not say how many paths."""
MIXED_PATHS = 200
"""Training paths of the memories that distinguish headings, from anywhere with any heading."""
SEED = 10_000
"""Of what is random in training data: one of the training seeds."""


class Decides(Protocol):
    """Anything that chooses commands for poses."""

    def __call__(self, poses: Floats) -> tuple[Floats, Integers | None]:
        """What ``to_action`` takes, shape (batch, 2 or 3); the remembered states, if there are any."""


class Driver(Agent):
    """An agent that reads the pose off the observation and asks a memory, a law or a table what to do.

    Args:
        settings: Of the environment.
        decide: Commands for poses.
        states: What it remembers, for drawing.
    """

    def __init__(self, settings: PoseReachingSettings, decide: Decides, states: States | None = None) -> None:
        self._settings, self._decide, self._states = settings, decide, states
        self._paths: Sequence[Floats] = () if states is None else states.paths
        self._chosen: Integers | None = None

    def act(self, observation: NDArray[Any], info: Mapping[str, Any]) -> NDArray[np.float32]:  # noqa: ARG002
        """See ``Agent.act``."""
        commands, self._chosen = self._decide(poses_of(observation))
        return to_action(commands, self._settings)

    def sketch(self) -> Mapping[str, Any] | None:
        """Remembered paths and the state that it acts on, as the environment's ``show`` takes them."""
        if self._states is None:
            return None
        chosen = None
        if self._chosen is not None:
            chosen = np.where(self._chosen[:, None] < 0, np.nan, self._states.poses[self._chosen])
        return {"memory": self._paths, "chosen": chosen}


def poses_of(observation: NDArray[Any]) -> Floats:
    """Position x, y [m] and heading [rad] of an observation, shape (batch, 3)."""
    seen = np.asarray(observation, dtype=np.float64)
    return np.stack([seen[:, 0], seen[:, 1], np.arctan2(seen[:, 3], seen[:, 2])], axis=1)


def away_from_walls(poses: Floats, commands: Floats, max_rate: float, field: Field) -> Floats:
    """Turn on the spot, to the ball, where a wall holds the robot; tables of relative poses know no walls."""
    x, y, heading = poses.T
    ahead = np.stack([np.cos(heading), np.sin(heading)], axis=1)
    edge = np.array([field.length / 2, field.width / 2]) - 1e-3
    outwards = (np.abs(poses[:, :2]) >= edge) & (ahead * np.sign(poses[:, :2]) > 0)
    held = np.asarray(outwards).any(axis=1, keepdims=True)
    left = ahead[:, 0] * -y - ahead[:, 1] * -x  # which side the ball is on
    turn = np.stack([np.zeros(len(x)), np.where(left > 0, max_rate, -max_rate)], axis=1)
    return np.where(held, turn, commands)


def direct(poses: Floats, settings: PoseReachingSettings) -> Floats:
    """Straight to the ball: at once if the robot is omnidirectional, else it turns, drives, and turns.

    Args:
        poses: x [m], y [m], heading [rad], shape (batch, 3).
        settings: Of the environment.

    Returns:
        Speed [m/s], turn rate [rad/s] and speed to the left [m/s], shape (batch, 3).
    """
    distance, tick = np.hypot(poses[:, 0], poses[:, 1]), settings.tick
    speed = np.minimum(settings.max_speed, distance / tick)
    sight = wrapped(np.arctan2(-poses[:, 1], -poses[:, 0]) - poses[:, 2])
    upright = wrapped(GOAL_HEADING - poses[:, 2])
    if settings.drive == "unicycle":
        away = distance > 0.2 * settings.arrival.distance
        rate = np.where(away, sight, upright) / tick
        return np.stack([np.where(away & (np.abs(sight) < 1e-3), speed, 0.0), rate, 0.0 * rate], axis=1)
    rate = np.clip(upright / tick, -settings.max_rate, settings.max_rate)
    angle = sight - 0.5 * rate * tick
    return np.stack([speed * np.cos(angle), rate, speed * np.sin(angle)], axis=1)


def nine_paths(teacher: Teacher, settings: PoseReachingSettings, paths: int = PATHS) -> States:
    """The training data of section 5.3.2: from the right half, facing the ball, 14 states a path."""
    return taught(teacher, starts_facing(paths), POINTS, settings.tick, settings.limits)


def mixed_paths(settings: PoseReachingSettings, paths: int = MIXED_PATHS) -> States:
    """Shortest paths from anywhere with any heading."""
    starts = starts_anywhere(paths, np.random.default_rng(SEED))
    return taught("dubins", starts, POINTS, settings.tick, settings.limits)


@cache
def learned_table(settings: PoseReachingSettings, rounds: int) -> OwnData:
    """Own training data, made once a process for each kind of environment."""
    return own_data(settings, rounds=rounds, seed=SEED)


def path_memory(teacher: Teacher, reading: Reading) -> Callable[[PoseReachingSettings], Agent]:
    """How a path memory of nine paths is made for an environment."""
    return lambda settings: memory_driver(settings, PathMemory(nine_paths(teacher, settings), reading))


def memory_driver(settings: PoseReachingSettings, memory: PathMemory, sideways: bool = False) -> Agent:
    """An agent that drives by a path memory.

    Args:
        settings: Of the environment.
        memory: What it remembers.
        sideways: Whether an omnidirectional robot drives as one; else as a unicycle, as the source's did.
    """
    max_rate = settings.max_rate if sideways and settings.drive == "omnidirectional" else None
    return Driver(settings, lambda poses: memory.commands(poses, settings.tick, max_rate), memory.states)


def table_driver(settings: PoseReachingSettings, table: OwnData) -> Agent:
    """An agent that drives by a table of own training data."""

    def decide(poses: Floats) -> tuple[Floats, None]:
        commands = table.commands(poses)
        return away_from_walls(poses, commands, settings.max_rate, FIELD), None

    return Driver(settings, decide)


def _straight(settings: PoseReachingSettings) -> Agent:
    return memory_driver(settings, PathMemory(nine_paths("straight", settings)), sideways=True)


def _neighbours(number: int) -> Callable[[PoseReachingSettings], Agent]:
    def make(settings: PoseReachingSettings) -> Agent:
        states = mixed_paths(settings)
        return Driver(settings, NeighbourMemory(states, number).commands, states)

    return make


def _graceful(settings: PoseReachingSettings) -> Agent:
    most = settings.limits.max_speed, settings.limits.max_rate
    return Driver(settings, lambda poses: (graceful_commands(poses, GOAL_HEADING, *most), None))


def _least_time(settings: PoseReachingSettings) -> Agent:
    solved = least_time(Task(settings.arrival, settings.limits, FIELD))
    return Driver(settings, lambda poses: (solved.commands(poses, settings.tick), None))


def _reference(
    name: str, title: str, make: Callable[[PoseReachingSettings], Agent], sees: Sees = "observation"
) -> ReferenceAgent:
    return ReferenceAgent(name, title, lambda given: make(read_settings(given, PoseReachingSettings)), sees)


AGENTS = (
    _reference(
        "path_memory_printed",
        "The path memory as printed: heading, offset and turn rate",
        path_memory("graceful", AS_PRINTED),
    ),
    _reference(
        "path_memory",
        "The path memory with bearing and direction: nine smooth paths, 126 states",
        path_memory("graceful", AS_IT_WORKS),
    ),
    _reference(
        "path_memory_stop",
        "The same, standing still where every lambda is zero",
        path_memory("graceful", replace(AS_IT_WORKS, fallback="stop")),
    ),
    _reference(
        "path_memory_dubins",
        "The path memory, taught by nine shortest paths",
        path_memory("dubins", AS_IT_WORKS),
    ),
    _reference(
        "path_memory_straight",
        "The same, taught by nine straight paths of an omnidirectional robot, and driving as one where it is",
        _straight,
    ),
    _reference(
        "nearest_neighbour",
        "Command of the nearest state of 200 shortest paths",
        _neighbours(1),
    ),
    _reference(
        "locally_weighted",
        "Locally weighted regression on the ten nearest of the same states",
        _neighbours(10),
    ),
    _reference(
        "own_data",
        "Its own data: 300 s of random motion in hindsight",
        lambda settings: table_driver(settings, learned_table(settings, 0)),
    ),
    _reference(
        "own_data_practised",
        "The same after six rounds of practice of 300 s each",
        lambda settings: table_driver(settings, learned_table(settings, 6)),
    ),
    _reference(
        "graceful",
        "The smooth law of Park and Kuipers, the teacher of path_memory",
        _graceful,
    ),
    _reference(
        "direct",
        "Straight to the ball: turn, drive, turn; all at once on an omnidirectional robot",
        lambda settings: Driver(settings, lambda poses: (direct(poses, settings), None)),
    ),
    _reference(
        "least_time",
        "Near-optimal time by value iteration on the ideal robot: the ceiling",
        _least_time,
        "model",
    ),
)
"""The reference agents, in the order of presentation."""
