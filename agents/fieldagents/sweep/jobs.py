"""Training runs and scored agents as jobs."""

from __future__ import annotations

import csv
import hashlib
import json
import math
from collections.abc import Mapping
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from fieldagents.config import EnvironmentConfig
from fieldagents.evaluation.episodes import run_episodes
from fieldagents.learned.config import VALIDATION_SEEDS, TrainConfig
from fieldagents.learned.training import prepare, self_contained
from fieldagents.progress import Report
from fieldagents.task import code_of, get_task
from fieldmodels.engine import Job

LEARNING = "fieldagents.learned.session"


def train_job(config: TrainConfig, name: str, folder: Path, until: int | None = None) -> Job:
    """The job of a training run, which goes on from its last checkpoint.

    Args:
        config: What to train.
        name: What it is, for people.
        folder: Where the runs' folders are.
        until: Train as many steps only, up to the next validation; the job of more goes on from there.
    """
    config = self_contained(config)
    parts = [config.model_dump(mode="json"), code_of(config.task, LEARNING)]
    run = f"{config.name}-{_hash(parts)}"
    if until is not None:
        step = config.round_steps * config.validation.every
        until = -(-until // step) * step
        until = None if until >= config.steps else until
    share = float(until or config.steps or 1)
    return Job(_hash([*parts, until]), name, trained, (config, until), folder / run, share)


def trained(config: TrainConfig, until: int | None, folder: Path, report: Report) -> dict[str, Any]:
    """Train, or go on; what the learning curve says up to there."""
    from fieldagents.learned.session import run_training

    checkpoints = [int(path.stem) for path in (folder / "checkpoints").glob("*.pt")]
    if prepare(config, folder) and (until is None or max(checkpoints, default=0) < until):
        run_training(config, folder, report, until)
    metric = get_task(config.task).metrics[0]
    with (folder / "curve.csv").open(encoding="utf-8", newline="") as stream:
        rows = [row for row in csv.DictReader(stream) if until is None or int(row["steps"]) <= until]
    scores = [float(row[f"validation_{metric.name}"] or "nan") for row in rows]
    known = [score for score in scores if not math.isnan(score)]
    best = (min if metric.lower_is_better else max)(known) if known else None
    return {"steps": int(rows[-1]["steps"]), "score": best}


def score_job(
    agent: str,
    values: Mapping[str, Any],
    task: str,
    environment: EnvironmentConfig,
    episodes: int,
    folder: Path,
) -> Job:
    """The job that scores a reference agent with some values on tuning seeds."""
    module = agent.partition(":")[0]
    asked = [agent, dict(values), environment.model_dump(mode="json"), episodes]
    key = _hash([*asked, code_of(task, "fieldagents.evaluation.episodes", module)])
    return Job(key, label(values), scored, (agent, dict(values), task, environment, episodes), folder / key)


def scored(
    agent: str,
    values: Mapping[str, Any],
    task: str,
    environment: EnvironmentConfig,
    episodes: int,
    folder: Path,  # noqa: ARG001 - nothing is left there but the result
    report: Report,
) -> dict[str, Any]:
    """Play the tuning episodes."""
    made = resolve_name(agent)(environment.settings, **values)
    made.name = made.name or agent
    table = run_episodes(made, task, environment, VALIDATION_SEEDS[:episodes], report)
    score = float(table[get_task(task).metrics[0].name].mean())
    return {"steps": int(table["steps"].sum()), "score": None if math.isnan(score) else score}


def label(values: Mapping[str, Any]) -> str:
    """What was tried, for people."""
    shown = {k: f"{value:.3g}" if isinstance(value, float) else value for k, value in values.items()}
    return ", ".join(f"{name}={value}" for name, value in shown.items())


def _hash(parts: Any) -> str:
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:12]
