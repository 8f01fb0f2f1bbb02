"""An evaluation: every agent, in every scenario, on the same published episodes."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from fieldagents.evaluation.config import EvaluateConfig
from fieldagents.evaluation.episodes import check_fits
from fieldagents.evaluation.play import EPISODES, Player, player, written_out
from fieldagents.evaluation.report import write_report
from fieldagents.evaluation.summary import DecisionTime, Labels, Summary, summarise
from fieldagents.progress import Report
from fieldagents.task import get_task
from fieldmodels.engine import HERE, Engine, run_all
from fieldmodels.files import replacing, write_text


class EvaluationError(ValueError):
    """An evaluation whose episodes cannot be compared."""


def evaluate(
    config: EvaluateConfig,
    out: Path,
    progress: Report = lambda _stage, _part: None,
    engine: Engine = HERE,
) -> Summary:
    """Run an evaluation and write ``episodes.parquet``, ``summary.json`` and ``report.html``.

    Every run of an agent in a scenario is a job; ``jobs/`` keeps what was played, and a job whose config and
    code have not changed is not played again.

    Args:
        config: What to compare.
        out: Result folder; files appear whole or not at all.
        progress: Called with what is being run and the part of the whole that is done, 0 to 1.
        engine: Who does the jobs.

    Raises:
        JobsFailedError: If some jobs failed; what the others played is kept.
        EvaluationError: If two agents did not meet the same noise on the same seed.
    """
    began = time.perf_counter()
    players = [
        player(scenario, name, config.task, environment, config.trust_pickle)
        for scenario, environment in config.environments.items()
        for name in config.agents
    ]
    for one in players:  # before the first episode: nobody's work is lost by another's
        check_fits(one.entry.runs, config.task, one.environment)
    seeds = range(config.first_seed, config.first_seed + config.episodes)
    jobs = {
        one.job(run, seeds, out / "jobs"): (one, run) for one in players for run in range(len(one.entry.runs))
    }
    done = run_all(list(jobs), engine, progress)
    tables: list[pd.DataFrame] = []
    times: dict[Player, list[Any]] = {one: [] for one in players}
    for result, (one, run) in zip(done, jobs.values(), strict=True):
        assert result.job.folder is not None
        table = pd.read_parquet(result.job.folder / EPISODES)
        table.insert(0, "scenario", one.scenario)
        table.insert(1, "agent", one.name)
        table.insert(2, "run", run)
        tables.append(table)
        times[one].append(result.result)
    took: dict[str, dict[str, DecisionTime | None]] = {name: {} for name in config.environments}
    for one, of_runs in times.items():
        took[one.scenario][one.name] = _decision_time(of_runs)
    entries = [one.entry for one in players]
    labels = {one.name: Labels(one.kind, one.runs[0].title, one.learned) for one in entries}
    episodes = pd.concat(tables, ignore_index=True)
    check_pairs(episodes, config.task)
    scenarios, pairs = summarise(episodes, config.task, config.baseline, labels)
    summary = Summary(
        name=config.name,
        task=config.task,
        baseline=config.baseline,
        episodes=config.episodes,
        first_seed=config.first_seed,
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


def _decision_time(of_runs: list[dict[str, float] | None]) -> DecisionTime | None:
    """How long a participant takes to decide, of its runs' times."""
    known = [times for times in of_runs if times is not None]
    if not known:
        return None
    both = float(np.median([times["batch"] for times in known])), known[0]["alone"]
    return DecisionTime(*(float(f"{ms:.3g}") for ms in both))


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
