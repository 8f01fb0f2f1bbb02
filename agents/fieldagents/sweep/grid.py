"""A grid of training runs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd

from fieldagents.progress import Report
from fieldagents.sweep.config import SweepConfig
from fieldagents.sweep.jobs import train_job
from fieldagents.task import get_task
from fieldmodels.engine import HERE, Engine, run_all
from fieldmodels.files import write_text


def sweep(
    config: SweepConfig, out: Path, progress: Report = lambda _stage, _part: None, engine: Engine = HERE
) -> pd.DataFrame:
    """Train what is missing of a grid; writes ``runs.csv`` and ``table.csv``, the latter over seeds.

    Args:
        config: Which runs.
        out: Result folder; ``runs/`` in it has a folder for each run, as `fieldgym train` makes it.
        progress: Called with what is being done and the part of the whole that is done.
        engine: Who does the runs.

    Returns:
        A row for each base config and combination but the seed: number of runs, mean and standard deviation
        over seeds of each run's best validation.

    Raises:
        JobsFailedError: If some runs failed; the others are kept.
    """
    jobs = [train_job(whole, _label(base, differs), out / "runs") for base, differs, whole in config.runs]
    rows: list[dict[str, Any]] = []
    for (base, differs, whole), done in zip(config.runs, run_all(jobs, engine, progress), strict=True):
        assert done.job.folder is not None
        values = {k: value if isinstance(value, int | float) else str(value) for k, value in differs.items()}
        found = {"metric": get_task(whole.task).metrics[0].name, **done.result}
        run = {"processor_s": done.processor_s, "run": str(done.job.folder.relative_to(out))}
        rows.append({"config": base, **values, **found, **run})
    runs = pd.DataFrame(rows)
    keys = ["config", *(key for key in config.grid if key != "seed"), "metric"]
    table = runs.groupby(keys, sort=False)["score"].agg(["count", "mean", "std"]).reset_index()
    write_text(out / "runs.csv", runs.to_csv(index=False, lineterminator="\n"))
    write_text(out / "table.csv", table.to_csv(index=False, lineterminator="\n"))
    return table


def _label(base: str, differs: dict[str, Any]) -> str:
    return " ".join([base, *(f"{key}={value}" for key, value in differs.items())])
