"""What an evaluation found, as plain numbers."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import pandas as pd

from fieldagents.evaluation.comparison import (
    MIN_EPISODES,
    MIN_RUNS,
    Comparison,
    compare,
    mean_interval,
)
from fieldagents.evaluation.metrics import METRICS


@dataclass(frozen=True)
class Row:
    """One agent in one scenario.

    Attributes:
        agent: Its name.
        kind: What it sees, or that it is an estimator which does not act.
        title: What it does.
        runs: Number of its training runs (1 for an agent that was not trained).
        means: Mean of every metric over runs and episodes.
        ci95: Interval of the first metric's mean over episodes; None with too few episodes.
        episode_return: Mean return; None for an estimator, which does not act.
        against_baseline: Difference to the baseline over episodes, of these very policies; None for the
            baseline itself.
        of_training: Difference to the baseline over training runs: what it says of the algorithm; None
            for agents that were not trained.
    """

    agent: str
    kind: str
    title: str
    runs: int
    means: dict[str, float]
    ci95: tuple[float, float] | None
    episode_return: float | None
    against_baseline: Comparison | None
    of_training: Comparison | None


@dataclass(frozen=True)
class Summary:
    """An evaluation's result.

    Attributes:
        name: Name of the evaluation.
        task: Name of the task.
        baseline: The agent that the others are compared with.
        episodes: Episodes of every agent and run in every scenario.
        first_seed: Seed of the first episode; the others follow one by one.
        seconds: How long it took.
        environments: Scenario to the ``settings`` that are not the defaults and to its ``reality``, in
            full even where the config names a file.
        scenarios: Scenario to its rows, best agent first.
    """

    name: str
    task: str
    baseline: str
    episodes: int
    first_seed: int
    seconds: float
    environments: dict[str, dict[str, Any]]
    scenarios: dict[str, tuple[Row, ...]]

    def to_json(self) -> dict[str, Any]:
        """The content of ``summary.json``."""
        metric = METRICS[self.task][0]
        return {"schema": 1, "metric": asdict(metric), **asdict(self)}


@dataclass(frozen=True)
class Labels:
    """How an agent is labelled.

    Attributes:
        kind: What it sees, or that it is an estimator.
        title: What it does.
        learned: Whether it was trained.
    """

    kind: str
    title: str
    learned: bool


def summarise_scenario(
    episodes: pd.DataFrame, task: str, baseline: str, labels: dict[str, Labels]
) -> tuple[Row, ...]:
    """Compare the agents of one scenario.

    Args:
        episodes: Rows of ``agent``, ``run``, ``seed``, ``return`` and the metrics.
        task: Name of the task.
        baseline: Name of the baseline.
        labels: Every agent's labels.

    Returns:
        One row an agent, the best first.
    """
    metrics = METRICS[task]
    first = metrics[0]
    by_episode = episodes.pivot_table(index="seed", columns="agent", values=first.name)
    base = by_episode[baseline].to_numpy()
    rows = []
    for agent, label in labels.items():
        own = episodes[episodes["agent"] == agent]
        scores = by_episode[agent].to_numpy()
        paired = training = None
        if agent != baseline:
            paired = compare(scores, base, lower_is_better=first.lower_is_better)
        if agent != baseline and label.learned:
            runs = own.groupby("run")[first.name].mean().to_numpy()
            training = compare(
                runs,
                np.full(len(runs), base.mean()),
                lower_is_better=first.lower_is_better,
                # Runs that agree on a handful of episodes may agree on their luck.
                least=MIN_RUNS if len(base) >= MIN_EPISODES else len(runs) + 1,
            )
        mean_return = float(own["return"].mean())
        rows.append(
            Row(
                agent=agent,
                kind=label.kind,
                title=label.title,
                runs=int(own["run"].nunique()),
                means={metric.name: float(own[metric.name].mean()) for metric in metrics},
                ci95=mean_interval(scores, MIN_EPISODES),
                episode_return=None if np.isnan(mean_return) else mean_return,
                against_baseline=paired,
                of_training=training,
            )
        )
    return tuple(sorted(rows, key=lambda row: row.means[first.name], reverse=not first.lower_is_better))
