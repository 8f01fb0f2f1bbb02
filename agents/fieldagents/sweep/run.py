"""`fieldgym sweep`: a grid or a search, as the config's keys say."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from fieldagents.config import has_key, load_config
from fieldagents.progress import Report
from fieldagents.sweep.config import SweepConfig, TuneConfig
from fieldagents.sweep.grid import sweep
from fieldagents.sweep.tune import Trial, tune
from fieldagents.task import get_task
from fieldmodels.engine import Engine

if TYPE_CHECKING:
    from rich.console import Console

BEST = 3
"""Trials of a study that are shown, beside the config as it is."""


@dataclass(frozen=True)
class Swept:
    """What a sweep gave.

    Attributes:
        data: What ``--json`` prints.
        files: What was written.
        table: What the terminal shows.
    """

    data: Any
    files: dict[str, Path]
    table: pd.DataFrame


def load(path: Path, overrides: Sequence[str]) -> SweepConfig | TuneConfig:
    """The config of a grid or of searches, as its keys say.

    Raises:
        ConfigError: With every mistake in it.
    """
    if has_key(path, "studies"):
        return load_config(path, TuneConfig, overrides)
    return load_config(path, SweepConfig, overrides)


def run(config: SweepConfig | TuneConfig, folder: Path, engine: Engine, progress: Report) -> Swept:
    """Do what a config says.

    Args:
        config: A grid, or searches.
        folder: Result folder, which this process holds.
        engine: Who does the jobs.
        progress: Called with what is being done and the part that is done.

    Raises:
        JobsFailedError: If some runs failed; the others are kept.
    """
    if isinstance(config, SweepConfig):
        names, table = ["runs.csv", "table.csv"], sweep(config, folder, progress, engine)
        data = json.loads(table.to_json(orient="records"))
    else:
        names = ["tune.json", *(f"{name}.yaml" for name, one in config.studies.items() if one.train)]
        table = _ranked(tune(config, folder, progress, engine), config.task)
        data = json.loads((folder / "tune.json").read_text(encoding="utf-8"))["studies"]
    return Swept(data, {name: folder / name for name in names}, table)


def show(found: Swept, console: Console) -> None:
    """Print the table."""
    from rich.table import Table

    table = Table(*map(str, found.table.columns))
    for row in found.table.itertuples(index=False):
        table.add_row(*map(_text, row))
    console.print(table)


def _ranked(studies: dict[str, list[Trial]], task: str) -> pd.DataFrame:
    """A study's best trials, and the config as it was."""
    metric, rows = get_task(task).metrics[0], []
    sign = 1.0 if metric.lower_is_better else -1.0
    for name, trials in studies.items():
        head = (name, len(trials), sum(trial.pruned for trial in trials), sum(t.steps for t in trials))
        whole = [(sign * t.scores[-1], t) for t in trials if not t.pruned and t.scores[-1] is not None]
        for place, (loss, trial) in enumerate(sorted(whole, key=lambda pair: pair[0])):
            if place < BEST or not trial.values:
                values = ", ".join(f"{key}={_text(value)}" for key, value in trial.values.items())
                rows.append((*(head if place == 0 else ("",) * 4), sign * loss, values or "as it is"))
    return pd.DataFrame(rows, columns=["study", "trials", "pruned", "steps", metric.name, "values"])


def _text(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
