"""Running an agent on fixed episodes, all of them side by side in one vector environment."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import gymnasium
import numpy as np
import pandas as pd

from fieldagents.agent import Agent, visible
from fieldagents.config import EnvironmentConfig
from fieldagents.evaluation.metrics import METRICS
from fieldgym import TASKS


def run_episodes(
    agent: Agent,
    task: str,
    environment: EnvironmentConfig,
    seeds: range,
    progress: Callable[[float], None] = lambda _: None,
) -> pd.DataFrame:
    """Run one episode for each seed.

    Args:
        agent: Who acts, on all episodes at once.
        task: Name of the task.
        environment: Its settings and reality.
        seeds: Consecutive seeds, one an episode.
        progress: Called with the part that is done, 0 to 1.

    Returns:
        One row an episode: ``seed``, ``steps``, ``return`` and the task's metrics, each averaged over
        the episode's steps. An estimator's row has no return: its actions mean nothing.
    """
    n = len(seeds)
    metrics = METRICS[task]
    keys = [metric.key for metric in metrics]
    if agent.estimator:
        keys[0] = agent.estimator
    envs = gymnasium.make_vec(
        TASKS[task].env_id,
        num_envs=n,
        vectorization_mode="vector_entry_point",
        settings={**environment.settings, **agent.settings},
        reality=environment.reality,
    )
    try:
        agent.reset(seeds[0])
        observation, info = envs.reset(seed=seeds[0])
        agent.begin_episodes(np.ones(n, dtype=np.bool_))
        running = np.ones(n, dtype=np.bool_)
        steps = np.zeros(n, dtype=np.int64)
        returns = np.zeros(n)
        sums = np.zeros((len(keys), n))
        longest = _episode_length(envs)
        while running.any():
            action = agent.act(observation, visible(info, agent.sees))
            observation, reward, terminated, truncated, info = envs.step(action)
            steps += running
            returns += np.where(running, reward, 0.0)
            for row, key in zip(sums, keys, strict=True):
                row += np.where(running, look_up(info, key), 0.0)
            running &= ~(terminated | truncated)
            progress(float(steps.max()) / longest)
    finally:
        envs.close()
    averages = {metric.name: total / steps for metric, total in zip(metrics, sums, strict=True)}
    if agent.estimator:
        returns[:] = np.nan
    return pd.DataFrame({"seed": list(seeds), "steps": steps, "return": returns, **averages})


def look_up(info: Mapping[str, Any], key: str) -> Any:
    """An entry of an ``info``; a dot leads into a nested one, as in ``privileged.error_mm_imm``."""
    value: Any = info
    for part in key.split("."):
        value = value[part]
    return value


def _episode_length(envs: Any) -> int:
    """Largest number of steps, for the progress display only."""
    spec = getattr(envs, "spec", None)
    return int(getattr(spec, "max_episode_steps", None) or 200)
