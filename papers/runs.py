"""One run of a table or figure: done once for its code and options, kept on disk."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fieldagents.progress import Report
from fieldmodels.engine import Done, Job
from papers.claim import Statistic
from papers.report import to_json
from papers.run import carry_out, reproducible
from papers.source import Reproducible, all_sources


@dataclass(frozen=True)
class Run:
    """A run that decides claims, with its options.

    Attributes:
        task: Name of the task.
        name: Name of its `Reproducible`.
        options: Options that differ from its defaults, sorted by name.
    """

    task: str
    name: str
    options: tuple[tuple[str, Any], ...]

    @property
    def entry(self) -> Reproducible | None:
        """What is run; None if nothing has the name."""
        return reproducible().get(self.what)

    @property
    def what(self) -> str:
        """What ``fieldgym reproduce`` calls it."""
        return f"{self.task}/{self.name}"

    @property
    def key(self) -> str:
        """Stands for code and options: equal keys give equal results."""
        text = f"{self.what} {self.options!r} {all_sources()[self.task].code}"
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    @property
    def folder(self) -> str:
        """Its place below the result folder, by name and options alone."""
        options = hashlib.sha256(repr(self.options).encode()).hexdigest()[:6]
        return f"runs/{self.task}/{self.name}" + (f"-{options}" if self.options else "")

    @property
    def command(self) -> str:
        """How it is repeated alone."""
        return " ".join([f"fieldgym reproduce {self.what}", *(f"--set {k}={v}" for k, v in self.options)])


@dataclass(frozen=True)
class Outcome:
    """What a run gave.

    Attributes:
        run: Which.
        statistics: Its numbers by name.
        remarks: What it says in words.
        figures: Files of its figures.
        processor_s: What it took [s of one processor].
        resumed: Whether it had been done before.
        error: What went wrong; empty if nothing did.
    """

    run: Run
    statistics: Mapping[str, Statistic]
    remarks: tuple[str, ...]
    figures: tuple[Path, ...]
    processor_s: float
    resumed: bool
    error: str = ""


def job_of(run: Run, out: Path, quick: bool) -> Job:
    """The job that does a run, its result below ``out``."""
    share = recorded_seconds(run, quick) or 1.0
    return Job(run.key, run.what, _redo, (run,), out / run.folder, share)


def _redo(run: Run, folder: Path, report: Report) -> dict[str, Any]:
    return to_json(carry_out(run.what, folder, dict(run.options), report), folder)


def outcome_of(run: Run, done: Done) -> Outcome:
    """What a run's job gave."""
    if done.error:
        return Outcome(run, {}, (), (), 0.0, resumed=False, error=done.error)
    record, folder = done.result, done.job.folder
    assert folder is not None
    return Outcome(
        run,
        {name: Statistic(**number) for name, number in record["statistics"].items()},
        tuple(record["remarks"]),
        tuple(folder / name for name in record["files"] if name.endswith(".png")),
        done.processor_s,
        done.resumed,
    )


def recorded_seconds(run: Run, quick: bool) -> float | None:
    """Processor seconds that it took when they were recorded; None if nobody has."""
    seconds = run.entry.processor_s if run.entry else None
    return seconds[quick] if seconds else None
