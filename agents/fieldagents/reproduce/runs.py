"""One run of a table or figure: done once for its code and options, kept on disk."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from fieldagents.claim import Statistic
from fieldagents.progress import Report
from fieldagents.reproduce.fingerprint import fingerprint
from fieldagents.reproduce.report import to_json
from fieldagents.reproduce.run import carry_out, reproducible
from fieldagents.task import Reproducible
from fieldmodels.files import write_text


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
        text = f"{self.what} {self.options!r} {fingerprint(self.task)}"
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


def execute(run: Run, out: Path, progress: Report) -> Outcome:
    """Do a run and keep its result below ``out``; a fault in it becomes its outcome."""
    folder, before = out / run.folder, _processor_s()
    progress(run.what, 0.0)
    try:
        result = carry_out(
            run.what, folder, dict(run.options), lambda stage, x: progress(f"{run.what}: {stage}", x)
        )
    except Exception as error:  # a fault in one run must not stop the others
        return _failed(run, f"{type(error).__name__}: {error}")
    record = to_json(result, folder) | {"key": run.key, "processor_s": round(_processor_s() - before, 2)}
    write_text(folder / "result.json", json.dumps(record, indent=1, allow_nan=False))
    outcome = stored(run, out)
    assert outcome is not None
    return replace(outcome, resumed=False)


def stored(run: Run, out: Path) -> Outcome | None:
    """A run's result below ``out``; None if there is none, or it is that of other code or options."""
    path = out / run.folder / "result.json"
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    if record.get("key") != run.key:
        return None
    return Outcome(
        run,
        {name: Statistic(**number) for name, number in record["statistics"].items()},
        tuple(record["remarks"]),
        tuple(path.parent / name for name in record["files"] if name.endswith(".png")),
        record["processor_s"],
        True,
    )


def recorded_seconds(run: Run, quick: bool) -> float | None:
    """Processor seconds that it took when they were recorded; None if nobody has."""
    seconds = run.entry.processor_s if run.entry else None
    return seconds[quick] if seconds else None


def _failed(run: Run, error: str) -> Outcome:
    return Outcome(run, {}, (), (), 0.0, resumed=False, error=error)


def _processor_s() -> float:
    """Processor time of this process and of those that it has waited for [s]."""
    t = os.times()
    return t.user + t.system + t.children_user + t.children_system
