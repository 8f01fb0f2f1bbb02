"""Running an agent on fixed episodes, all of them side by side in one vector environment."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pkgutil import resolve_name
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from fieldagents.agent import Agent, checked_actions, visible
from fieldagents.config import EnvironmentConfig
from fieldagents.progress import Report
from fieldagents.task import Metric, get_task
from fieldgym import find_task


@dataclass(frozen=True)
class Played:
    """Episodes that an agent has played.

    Attributes:
        table: One row an episode: ``seed``, ``steps``, ``return`` and the task's metrics. An estimator's
            row has no return and none of the other metrics: its actions mean nothing.
        decision_ms: Time that the agent took for a decision [ms]: of a call for the whole batch, divided by
            the number of its environments; the median over the calls. NaN for an estimator.
    """

    table: pd.DataFrame
    decision_ms: float


def run_episodes(
    agent: Agent,
    task: str,
    environment: EnvironmentConfig,
    seeds: range,
    progress: Report = lambda _stage, _part: None,
) -> pd.DataFrame:
    """Run one episode for each seed; see `play_episodes`, whose table this is."""
    return play_episodes(agent, task, environment, seeds, progress).table


def play_episodes(
    agent: Agent,
    task: str,
    environment: EnvironmentConfig,
    seeds: range,
    progress: Report = lambda _stage, _part: None,
) -> Played:
    """Run one episode for each seed.

    Args:
        agent: Who acts, on all episodes at once.
        task: Name of the task.
        environment: Its settings and reality.
        seeds: Consecutive seeds, one an episode.
        progress: Called with what is prepared, empty while they play, and the part that is done, 0 to 1.
    """
    n = len(seeds)
    settings, envs = _environments(agent, task, environment, n)
    try:
        agent.fits(envs.single_observation_space, envs.single_action_space)
        agent.reset(seeds[0])
        observation, info = envs.reset(seed=seeds[0])
        agent.begin_episodes(np.ones(n, dtype=np.bool_))
        running = np.ones(n, dtype=np.bool_)
        steps = np.zeros(n, dtype=np.int64)
        returns = np.zeros(n)
        tallies = [Tally(metric, key, n) for metric, key in _measured(task, agent)]
        for tally in tallies:
            tally.begin(settings, info, lambda stage: progress(stage, 0.0))
        took: list[float] = []
        longest = _episode_length(envs)
        while running.any():
            seen = visible(info, agent.sees, task)
            began = time.perf_counter()
            action = agent.act(observation, seen)
            took.append(time.perf_counter() - began)
            action = checked_actions(action, agent.name, n, envs.single_action_space)
            observation, reward, terminated, truncated, info = envs.step(action)
            steps += running
            returns += np.where(running, reward, 0.0)
            told = {**info, "reward": reward, "agent": agent.account()}
            for tally in tallies:
                tally.add(told, running)
            running &= ~(terminated | truncated)
            progress("", min(float(steps.max()) / longest, 1.0))
    finally:
        envs.close()
    values = {metric.name: np.full(n, np.nan) for metric in get_task(task).metrics}
    values |= {tally.metric.name: tally.result(steps) for tally in tallies}
    if agent.estimator:
        returns[:] = np.nan
    table = pd.DataFrame({"seed": list(seeds), "steps": steps, "return": returns, **values})
    return Played(table, np.nan if agent.estimator else 1000 * float(np.median(took)) / n)


def check_fits(agents: Iterable[Agent], task: str, environment: EnvironmentConfig) -> None:
    """Make sure that agents can act in an environment.

    Raises:
        ValueError: If one of them cannot.
    """
    for agent in agents:
        _, envs = _environments(agent, task, environment, 1)
        try:
            agent.fits(envs.single_observation_space, envs.single_action_space)
        finally:
            envs.close()


def _environments(
    agent: Agent, task: str, environment: EnvironmentConfig, count: int
) -> tuple[dict[str, Any], Any]:
    """Settings as this agent needs them, and a vector environment with them."""
    settings = {**environment.settings, **agent.settings}
    return settings, find_task(task).make_vec(count, **environment.options | {"settings": settings})


class Tally:
    """Makes a metric's number for each episode of a batch, step by step.

    Args:
        metric: What is measured.
        key: Where ``info`` has it.
        batch: Number of episodes.
    """

    def __init__(self, metric: Metric, key: str, batch: int) -> None:
        self.metric, self._key = metric, key
        self._value = np.zeros(batch)
        self._given = np.ones(batch)
        self._per = np.ones(batch)
        self._bound = np.ones(batch)

    def begin(self, settings: Mapping[str, Any], info: Mapping[str, Any], say: Callable[[str], None]) -> None:
        """Take in what is known before the first step: ``settings`` other than the defaults, and ``info``."""
        if self.metric.bound:
            self._bound = resolve_name(self.metric.bound)(settings, info, say)

    def add(self, info: Mapping[str, Any], running: NDArray[np.bool_]) -> None:
        """Take one step's ``info`` into account, for the episodes that are still running."""
        value = look_up(info, self._key)
        if self.metric.over == "last":
            np.copyto(self._value, value, where=running)
        else:
            self._value += np.where(running, value, 0.0)
        if self.metric.given:
            np.copyto(self._given, look_up(info, self.metric.given), where=running)
        if self.metric.per:
            np.copyto(self._per, look_up(info, self.metric.per), where=running)

    def result(self, steps: NDArray[np.int64]) -> NDArray[np.float64]:
        """The episodes' numbers, shape (batch,); NaN where one has none.

        Args:
            steps: Number of steps of each episode, shape (batch,).

        Raises:
            MetricError: If a value is missing that must not be, or is not 0 or 1 where it must be.
        """
        metric = self.metric
        value = self._value / steps if metric.over == "mean" else self._value
        value = np.where(self._given > 0, value / (self._per * self._bound), np.nan)
        if not metric.may_miss and np.isnan(value).any():
            raise MetricError(f"{metric.name}: {self._key!r} of info is not a number in some episode")
        if metric.binary and not np.isin(value[~np.isnan(value)], (0.0, 1.0)).all():
            raise MetricError(f"{metric.name}: {self._key!r} of info must be 0 or 1 at an episode's end")
        return value


class MetricError(ValueError):
    """An environment whose ``info`` does not hold what the task's metrics say."""


def _measured(task: str, agent: Agent) -> list[tuple[Metric, str]]:
    """Metrics that mean something for this agent, each with its key."""
    first, *others = get_task(task).metrics
    if agent.estimator:
        return [(first, agent.estimator), *((metric, metric.key) for metric in others if metric.common)]
    return [(metric, metric.key) for metric in (first, *others)]


def look_up(info: Mapping[str, Any], key: str) -> Any:
    """An entry of an ``info``; a dot leads into a nested one, as third-party environments may have.

    What an agent does not say of itself (``agent.``) is NaN.
    """
    if key in info:
        return info[key]
    first, *rest = key.split(".")
    if first == "agent":
        return info[first].get(rest[0], np.nan)
    value: Any = info[first]
    for part in rest:
        value = value[part]
    return value


def _episode_length(envs: Any) -> int:
    """Largest number of steps, for the progress display only."""
    spec = getattr(envs, "spec", None)
    return int(getattr(spec, "max_episode_steps", None) or 200)
