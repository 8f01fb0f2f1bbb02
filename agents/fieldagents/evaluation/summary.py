"""What an evaluation found, as plain numbers."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np
import pandas as pd

from fieldagents.evaluation.comparison import (
    MIN_EPISODES,
    MIN_RUNS,
    Comparison,
    Interval,
    compare,
    mean_interval,
)
from fieldagents.evaluation.ranking import Pair, Standing, all_pairs, scores_of, standings
from fieldagents.task import Metric, get_task


@dataclass(frozen=True)
class Score:
    """One agent's score by one metric in one scenario.

    Attributes:
        mean: Mean over the episodes that have a value (over runs first); None if none has.
        ci95: Interval of the mean over episodes; None with too few of them.
        share: Part of the episodes of all runs that have a value.
        against_baseline: Difference to the baseline over episodes, of these very policies; None for the
            baseline itself.
        of_training: Difference to the baseline over training runs: what it says of the algorithm; None
            for agents that were not trained.
    """

    mean: float | None
    ci95: Interval | None
    share: float
    against_baseline: Comparison | None
    of_training: Comparison | None


@dataclass(frozen=True)
class Row:
    """One agent in one scenario.

    Attributes:
        agent: Its name.
        kind: What it sees, or that it is an estimator which does not act.
        title: What it does.
        runs: Number of its training runs (1 for an agent that was not trained).
        episode_return: Mean return; None for an estimator, which does not act.
        scores: Its score by each of the task's metrics; the first one is what verdicts are about.
        standing: How it stands among all, by the first metric.
    """

    agent: str
    kind: str
    title: str
    runs: int
    episode_return: float | None
    scores: dict[str, Score]
    standing: Standing

    @property
    def first(self) -> Score:
        """Its score by the first metric."""
        return next(iter(self.scores.values()))

    @property
    def means(self) -> dict[str, float | None]:
        """Mean of every metric over runs and episodes."""
        return {name: score.mean for name, score in self.scores.items()}

    @property
    def ci95(self) -> Interval | None:
        """Interval of the first metric's mean."""
        return self.first.ci95

    @property
    def against_baseline(self) -> Comparison | None:
        """Difference to the baseline in the first metric, over episodes."""
        return self.first.against_baseline

    @property
    def of_training(self) -> Comparison | None:
        """Difference to the baseline in the first metric, over training runs."""
        return self.first.of_training

    def to_json(self) -> dict[str, Any]:
        """Its part of ``summary.json``; the first metric's values stand at the top, too."""
        plain = asdict(self)
        scores = plain.pop("scores")
        headline = {key: value for key, value in asdict(self.first).items() if key not in ("mean", "share")}
        return {**plain, "means": self.means, **headline, "scores": scores}


@dataclass(frozen=True)
class DecisionTime:
    """How long an agent takes to decide, on the machine at hand [ms].

    Attributes:
        batch: Of a call for all episodes at once, divided by their number.
        alone: Of a call for a single robot.
    """

    batch: float
    alone: float


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
        decision_ms: Scenario and agent to the time of a decision; None for an estimator. It and ``seconds``
            are what differs from one evaluation to the next.
        environments: Scenario to the ``settings`` that are not the defaults and to its ``reality``, in
            full even where the config names a file.
        scenarios: Scenario to its rows, best agent first.
        pairs: Scenario to all pairs of its agents, by the first metric.
    """

    name: str
    task: str
    baseline: str
    episodes: int
    first_seed: int
    seconds: float
    decision_ms: dict[str, dict[str, DecisionTime | None]]
    environments: dict[str, dict[str, Any]]
    scenarios: dict[str, tuple[Row, ...]]
    pairs: dict[str, tuple[Pair, ...]]

    def to_json(self) -> dict[str, Any]:
        """The content of ``summary.json``."""
        metrics = [asdict(metric) for metric in get_task(self.task).metrics]
        rows = {name: [row.to_json() for row in rows] for name, rows in self.scenarios.items()}
        plain = {field.name: getattr(self, field.name) for field in fields(self)}
        took = {
            scenario: {agent: time and asdict(time) for agent, time in agents.items()}
            for scenario, agents in self.decision_ms.items()
        }
        pairs = {name: [asdict(pair) for pair in of] for name, of in self.pairs.items()}
        changed = {"decision_ms": took, "scenarios": rows, "pairs": pairs}
        return {"schema": 2, "metric": metrics[0], "metrics": metrics, **plain, **changed}


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


def summarise(
    episodes: pd.DataFrame, task: str, baseline: str, labels: dict[str, Labels]
) -> tuple[dict[str, tuple[Row, ...]], dict[str, tuple[Pair, ...]]]:
    """Rows and pairs of every scenario; see `summarise_scenario`, whose episodes also have a ``scenario``."""
    first = get_task(task).metrics[0]
    parts = {str(name): part for name, part in episodes.groupby("scenario", sort=False)}
    rows = {name: summarise_scenario(part, task, baseline, labels) for name, part in parts.items()}
    learned = [agent for agent, label in labels.items() if label.learned]
    return rows, {name: all_pairs(scores_of(part, first), first, learned) for name, part in parts.items()}


def summarise_scenario(
    episodes: pd.DataFrame, task: str, baseline: str, labels: dict[str, Labels]
) -> tuple[Row, ...]:
    """Compare the agents of one scenario.

    Args:
        episodes: Rows of ``agent``, ``run``, ``seed``, ``return`` and the metrics (NaN: none).
        task: Name of the task.
        baseline: Name of the baseline.
        labels: Every agent's labels.

    Returns:
        One row an agent, the best first; where the first metric is equal, the next one decides.
    """
    rows = []
    first = get_task(task).metrics[0]
    privileged = {agent for agent, label in labels.items() if label.kind == "privileged"}
    stand = standings(scores_of(episodes, first), baseline, privileged, first)
    for agent, label in labels.items():
        own = episodes[episodes["agent"] == agent]
        mean_return = float(own["return"].mean())
        rows.append(
            Row(
                agent=agent,
                kind=label.kind,
                title=label.title,
                runs=int(own["run"].nunique()),
                episode_return=None if np.isnan(mean_return) else mean_return,
                scores={
                    metric.name: _score(episodes, agent, baseline, metric, label.learned)
                    for metric in get_task(task).metrics
                },
                standing=stand[agent],
            )
        )
    return tuple(
        sorted(rows, key=lambda row: [_rank(row.scores[m.name].mean, m) for m in get_task(task).metrics])
    )


def _score(episodes: pd.DataFrame, agent: str, baseline: str, metric: Metric, learned: bool) -> Score:
    """Score an agent by one metric; NaN in the episodes' table is an episode without a value."""
    two = episodes[episodes["agent"].isin((agent, baseline))]
    table = two.pivot_table(index="seed", columns=["agent", "run"], values=metric.name, dropna=False)
    runs = table.loc[:, [agent]]
    scores = runs.mean(axis=1).to_numpy()  # of the runs that have a value
    base = table.loc[:, [baseline]].mean(axis=1).to_numpy()
    paired = training = None
    if agent != baseline:
        paired = compare(scores, base, lower_is_better=metric.lower_is_better, binary=metric.binary)
    if agent != baseline and learned:
        level = float(np.nanmean(base)) if not np.isnan(base).all() else np.nan
        by_run = level + runs.sub(base, axis=0).mean().to_numpy()
        training = compare(
            by_run,
            np.full(len(by_run), level),
            lower_is_better=metric.lower_is_better,
            # Runs that agree on a handful of episodes may agree on their luck.
            least=MIN_RUNS if len(base) >= MIN_EPISODES else len(by_run) + 1,
        )
    return Score(
        mean=None if np.isnan(scores).all() else float(np.nanmean(scores)),
        ci95=mean_interval(scores, MIN_EPISODES, binary=metric.binary),
        share=float(runs.notna().to_numpy().mean()),
        against_baseline=paired,
        of_training=training,
    )


def _rank(mean: float | None, metric: Metric) -> float:
    """Sorts the best mean first and an agent without one last."""
    if mean is None:
        return np.inf
    return mean if metric.lower_is_better else -mean
