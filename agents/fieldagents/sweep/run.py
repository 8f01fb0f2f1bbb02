"""`fieldgym sweep`: a grid or a search, as the config's keys say."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fieldagents.config import has_key, load_config
from fieldagents.progress import Report
from fieldagents.sweep.config import SweepConfig, TuneConfig
from fieldagents.sweep.grid import sweep
from fieldagents.sweep.tune import Trial, tune
from fieldagents.task import get_task
from fieldmodels.engine import Engine

if TYPE_CHECKING:
    from rich.console import Console


@dataclass(frozen=True)
class Swept:
    """What a sweep gave.

    Attributes:
        data: What ``--json`` prints.
        files: What was written.
        rows: The table for the terminal, its header first.
    """

    data: Any
    files: dict[str, Path]
    rows: tuple[tuple[str, ...], ...]


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
        table = sweep(config, folder, progress, engine)
        rows = [
            tuple(map(str, table.columns)),
            *(tuple(map(_text, row)) for row in table.itertuples(index=False)),
        ]
        data = json.loads(table.to_json(orient="records"))
        return Swept(data, {name: folder / name for name in ("runs.csv", "table.csv")}, tuple(rows))
    search, studies = config, tune(config, folder, progress, engine)
    files = {"tune.json": folder / "tune.json"}
    files |= {f"{name}.yaml": folder / f"{name}.yaml" for name, one in search.studies.items() if one.train}
    plain = {name: [asdict(trial) for trial in trials] for name, trials in studies.items()}
    return Swept(plain, files, tuple(_ranked(studies, get_task(search.task).metrics[0].name, search)))


def show(found: Swept, console: Console) -> None:
    """Print the table."""
    from rich.table import Table

    header, *rows = found.rows
    table = Table(*header)
    for row in rows:
        table.add_row(*row)
    console.print(table)


def _ranked(studies: dict[str, list[Trial]], metric: str, config: TuneConfig) -> list[tuple[str, ...]]:
    """A study's best trials, and the config as it was."""
    lower = get_task(config.task).metrics[0].lower_is_better
    rows: list[tuple[str, ...]] = [("study", "trials", "pruned", "steps", metric, "values")]
    for name, trials in studies.items():
        whole = [trial for trial in trials if not trial.pruned and trial.scores[-1] is not None]
        ranked = sorted(whole, key=lambda trial: (trial.scores[-1] or 0.0) * (1 if lower else -1))
        sums = (
            str(len(trials)),
            str(sum(trial.pruned for trial in trials)),
            str(sum(t.steps for t in trials)),
        )
        for place, trial in enumerate(ranked):
            if place < 3 or not trial.values:
                values = ", ".join(f"{key}={_text(value)}" for key, value in trial.values.items())
                head = (name, *sums) if place == 0 else ("", "", "", "")
                rows.append((*head, _text(trial.scores[-1]), values or "as it is"))
    return rows


def _text(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
