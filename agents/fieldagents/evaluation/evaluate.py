"""An evaluation: every agent, in every scenario, on the same published episodes."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from fieldagents.config import EnvironmentConfig
from fieldagents.evaluation.agents import AgentRuns, make_agent
from fieldagents.evaluation.config import EvaluateConfig
from fieldagents.evaluation.episodes import check_fits, play_episodes
from fieldagents.evaluation.report import write_report
from fieldagents.evaluation.summary import DecisionTime, Labels, Summary, summarise
from fieldagents.seeds import TEST_SEEDS
from fieldagents.task import get_task
from fieldgym import TASKS
from fieldmodels.drivers.named import flown
from fieldmodels.files import replacing, write_text
from fieldmodels.registry import get_model


class EvaluationError(ValueError):
    """An evaluation whose episodes cannot be compared."""


def evaluate(
    config: EvaluateConfig, out: Path, progress: Callable[[str, float], None] = lambda _stage, _part: None
) -> Summary:
    """Run an evaluation and write ``episodes.parquet``, ``summary.json`` and ``report.html``.

    Args:
        config: What to compare.
        out: Result folder; files appear whole or not at all.
        progress: Called with what is being run and the part of the whole that is done, 0 to 1.

    Raises:
        EvaluationError: If two agents did not meet the same noise on the same seed.
    """
    began = time.perf_counter()
    seeds = TEST_SEEDS[: config.episodes]
    entries = [
        (scenario, environment, make_agent(name, config.task, environment.settings, config.trust_pickle))
        for scenario, environment in config.environments.items()
        for name in config.agents
    ]
    for _, environment, entry in entries:  # before the first episode: nobody's work is lost by another's
        check_fits(entry.runs, config.task, environment)
    total = sum(len(entry.runs) for _, _, entry in entries)
    tables: list[pd.DataFrame] = []
    took: dict[str, dict[str, DecisionTime | None]] = {name: {} for name in config.environments}
    for scenario, environment, entry in entries:
        batch = []
        for run, agent in enumerate(entry.runs):
            report = partial(_report, progress, f"{scenario}: {entry.name}", len(tables), total)
            played = play_episodes(agent, config.task, environment, seeds, report)
            batch.append(played.decision_ms)
            table = played.table
            table.insert(0, "scenario", scenario)
            table.insert(1, "agent", entry.name)
            table.insert(2, "run", run)
            tables.append(table)
        took[scenario][entry.name] = _decision_time(entry, config.task, environment, seeds, batch)
    labels = {one.name: Labels(one.kind, one.runs[0].title, one.learned) for _, _, one in entries}
    episodes = pd.concat(tables, ignore_index=True)
    check_pairs(episodes, config.task)
    scenarios, pairs = summarise(episodes, config.task, config.baseline, labels)
    summary = Summary(
        name=config.name,
        task=config.task,
        baseline=config.baseline,
        episodes=config.episodes,
        first_seed=seeds[0],
        seconds=round(time.perf_counter() - began, 1),
        decision_ms=took,
        environments={name: written_out(config.task, one) for name, one in config.environments.items()},
        scenarios=scenarios,
        pairs=pairs,
    )
    with replacing(out / "episodes.parquet") as temporary:
        episodes.to_parquet(temporary, index=False)
    write_text(out / "summary.json", json.dumps(summary.to_json(), indent=2, allow_nan=False) + "\n")
    write_report(summary, episodes, out / "report.html")
    return summary


def written_out(task: str, environment: EnvironmentConfig) -> dict[str, Any]:
    """Settings and reality as plain values; a file may change later."""
    _, truth = flown(get_model(TASKS[task].model), environment.reality)
    settings = {  # JSON has no infinity
        key: str(value) if value == math.inf else value for key, value in environment.settings.items()
    }
    return {"settings": settings, "reality": truth.plain()}


def _decision_time(
    entry: AgentRuns, task: str, environment: EnvironmentConfig, seeds: range, batch: list[float]
) -> DecisionTime | None:
    """How long a participant takes to decide; plays one more episode, alone."""
    agent = entry.runs[0]
    if agent.estimator:
        return None
    alone = play_episodes(agent, task, environment, seeds[:1]).decision_ms
    return DecisionTime(*(float(f"{ms:.3g}") for ms in (float(np.median(batch)), alone)))


def _report(progress: Callable[[str, float], None], stage: str, done: int, total: int, part: float) -> None:
    progress(stage, (done + part) / total)


def check_pairs(episodes: pd.DataFrame, task: str) -> None:
    """Make sure that all agents met the same noise on the same seed; else no pair is a pair."""
    for metric in get_task(task).metrics:
        if metric.common:
            values = episodes.groupby(["scenario", "seed"])[metric.name].nunique()
            if (values > 1).any():
                scenario, seed = values.index[values > 1][0]
                raise EvaluationError(
                    f"{scenario}, seed {seed}: {metric.name} differs between agents, so they did not meet "
                    "the same noise and cannot be compared in pairs"
                )
