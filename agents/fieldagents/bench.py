"""A bench of one's own as a task: what is measured, who acts, and how these are tuned for a simulation."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from fieldagents.agent import Agent
from fieldagents.config import Config
from fieldagents.seeds import TUNING_SEEDS
from fieldagents.task import Metric, ReferenceAgent, TaskDefinition, Tuner
from fieldgym import find_task
from fieldgym.bench import BenchSettings
from fieldgym.settings import read_settings
from fieldmodels.machine import Machine
from fieldmodels.registry import get_model

Floats = NDArray[np.float64]

FEEDBACK = "Linear feedback of error, its integral, reference, its slope and every sensor; weights by CMA-ES"
METRICS = (
    Metric("cost", "1", "cost of the episode", "cost", over="sum"),
    Metric("distance", "1", "distance from the reference, by its reach", "distance"),
    Metric("effort", "1", "command, by the largest", "effort"),
    Metric("escaped", "1", "left its bounds", "escaped", over="last", binary=True),
)


@dataclass(frozen=True)
class BenchDefinition(TaskDefinition):
    """A machine as a task of this floor.

    Attributes:
        machine: Name or Python file of the machine.
    """

    metrics: tuple[Metric, ...] = METRICS
    machine: str = field(default="", kw_only=True)

    def _listed(self, module: str, name: str = "") -> Sequence[Any]:
        """Agents and tuners, made for the machine."""
        del name
        if module == "agents":
            still = ReferenceAgent(
                "still",
                "No command at all: what the reference alone costs",
                lambda settings: Feedback(self.machine, settings),
            )
            return still, ReferenceAgent("feedback", FEEDBACK, self._nominal, extra="train")
        return (Tuner("feedback", FEEDBACK, Search, self._tuned),) if module == "tuning" else ()

    def _tuned(self, settings: Mapping[str, Any], reality: Any, options: Search) -> Agent:
        return tuned(self.machine, settings, reality, options)

    def _nominal(self, settings: Mapping[str, Any]) -> Agent:
        weights = _nominal_weights(self.machine, json.dumps(dict(settings), sort_keys=True))
        return Feedback(self.machine, settings, weights)


class Search(Config):
    """How long weights are searched.

    Attributes:
        rounds: Rounds of the search, of 16 candidates each.
        episodes: Tuning episodes on which each candidate is judged.
    """

    rounds: int = Field(default=25, ge=1, le=10_000)
    episodes: int = Field(default=4, ge=1, le=1000)


class Feedback(Agent):
    """Commands that are linear in what is seen.

    Args:
        machine: Name or Python file of the machine.
        settings: Of the environment.
        weights: Shape (inputs, features), or (rows, inputs, features) where rows differ; zero by default.
    """

    def __init__(self, machine: str, settings: Mapping[str, Any], weights: Floats | None = None) -> None:
        own, found = read_settings(settings, BenchSettings), get_model(machine)
        assert isinstance(found, Machine)
        outputs = [s.name for s in found.outputs]
        track = own.track or outputs[0]
        sizes = [found.typical(one)[1] or 1.0 for one in outputs]
        self.shape = max(len(found.inputs), 1), 4 + len(outputs)
        self._weights = np.zeros(self.shape) if weights is None else weights
        self._tracked, self._sizes = outputs.index(track), np.array(sizes)
        self._reach = own.reach or sizes[self._tracked]
        self._step, self._pace = own.step, 2 * np.pi * own.fastest
        self._integral = np.zeros(0)

    def reset(self, seed: int) -> None:
        """See ``Agent.reset``."""
        del seed
        self._integral = np.zeros(0)

    def begin_episodes(self, begun: NDArray[np.bool_]) -> None:
        """See ``Agent.begin_episodes``."""
        if len(self._integral) == len(begun):
            self._integral[begun] = 0.0

    def act(self, observation: NDArray[Any], info: Mapping[str, Any]) -> NDArray[Any]:
        """See ``Agent.act``."""
        del info
        seen, now, ahead = observation[:, :-2].astype(np.float64), observation[:, -2], observation[:, -1]
        if len(self._integral) != len(seen):
            self._integral = np.zeros(len(seen))
        error = (now - seen[:, self._tracked]) / self._reach
        self._integral += self._step * self._pace * error
        slope = (ahead - now) / (self._reach * self._step * self._pace)
        features = np.column_stack([error, self._integral, now / self._reach, slope, seen / self._sizes])
        commands = np.einsum("...if,...f->...i", self._weights, np.nan_to_num(features))
        clipped: NDArray[Any] = np.clip(commands, -1.0, 1.0).astype(np.float32)
        return clipped


def tuned(machine: str, settings: Mapping[str, Any], reality: Any, options: Search) -> Feedback:
    """The feedback of least cost in a reality, on tuning seeds alone; equal arguments give an equal agent."""
    from fieldagents.tasks.line_following.search import CANDIDATES, evolve

    inputs, features = Feedback(machine, settings).shape
    seeds = list(TUNING_SEEDS[: options.episodes]) * CANDIDATES
    envs = find_task(machine).make_vec(len(seeds), settings=dict(settings), reality=reality)

    def loss(candidates: Floats) -> Floats:
        weights = np.repeat(candidates.reshape(-1, inputs, features), options.episodes, axis=0)
        costs = _played(envs, Feedback(machine, settings, weights), seeds)
        return np.asarray(costs.reshape(-1, options.episodes).mean(axis=1))

    try:
        start = np.zeros((inputs, features))
        start[:, 0] = 1.0
        found = evolve(loss, start.ravel().tolist(), 0.5, options.rounds)
    finally:
        envs.close()
    return Feedback(machine, settings, found.reshape(inputs, features))


def _played(envs: Any, agent: Feedback, seeds: Sequence[int]) -> Floats:
    """What an episode of each seed costs, shape (rows,)."""
    observation, info = envs.reset(seed=list(seeds))
    running, costs = np.ones(len(seeds), dtype=np.bool_), np.zeros(len(seeds))
    while running.any():
        observation, reward, terminated, truncated, info = envs.step(agent.act(observation, info))
        costs -= np.where(running, reward, 0.0)
        running &= ~(terminated | truncated)
    return costs


@lru_cache(maxsize=16)
def _nominal_weights(machine: str, settings: str) -> Floats:
    return tuned(machine, json.loads(settings), None, Search())._weights


def definition(machine: str) -> BenchDefinition:
    """A machine as a task of this floor."""
    return BenchDefinition(find_task(machine).name, machine=machine)
