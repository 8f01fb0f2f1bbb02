"""A job, its result, and how it is done in the process at hand."""

from __future__ import annotations

import json
import os
import traceback
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fieldmodels.files import write_text

Report = Callable[[str, float], None]
"""Called with what is being done and the part of it that is done, 0 to 1."""

RESULT = "result.json"
ERROR = "error.txt"


@dataclass(frozen=True, eq=False)
class Job:
    """A piece of work that gives the same result wherever it is done.

    Attributes:
        key: Hash of all that the result depends on, configuration and code.
        label: What it is, for people.
        function: A module's function. It is called with ``arguments`` and, if there is a folder, with that
            folder and a `Report`; it then returns what JSON can hold, and may leave files in the folder.
        arguments: What can be pickled.
        folder: Where its result and its files stay, as of earlier attempts that were interrupted; None if the
            caller keeps the result.
        share: What it takes, relative to the other jobs; for the display of progress.
    """

    key: str
    label: str
    function: Callable[..., Any]
    arguments: tuple[Any, ...] = ()
    folder: Path | None = None
    share: float = 1.0


@dataclass(frozen=True)
class Done:
    """What became of a job.

    Attributes:
        job: The job.
        result: What its function returned; None if it failed.
        error: Type and message of its error; empty if there was none.
        processor_s: What it took [s of one processor].
        resumed: Whether it had been done before.
    """

    job: Job
    result: Any = None
    error: str = ""
    processor_s: float = 0.0
    resumed: bool = False


class JobsFailedError(RuntimeError):
    """Some jobs failed; the results of the others are kept.

    Attributes:
        done: What became of all.
        exit_code: Of a command that ends with it.
    """

    exit_code = 1

    def __init__(self, done: Iterable[Done]) -> None:
        self.done = done = list(done)
        failed = [one for one in done if one.error]
        lines = [f"{one.job.label}: {one.error}" for one in failed]
        super().__init__(
            "\n".join([f"{len(failed)} of {len(done)} jobs failed, the others are kept:", *lines])
        )


def done_before(job: Job) -> Done | None:
    """A job's result in its folder; None if there is none, or it is one of another key."""
    if job.folder is None:
        return None
    try:
        record = json.loads((job.folder / RESULT).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    if not isinstance(record, dict) or record.get("key") != job.key:
        return None
    return Done(job, record["result"], processor_s=record["processor_s"], resumed=True)


def perform(job: Job, report: Report = lambda _stage, _part: None) -> Done:
    """Do a job in this process; an error in it becomes its outcome."""
    before = _processor_s()
    try:
        if job.folder is None:
            return Done(job, job.function(*job.arguments), processor_s=_processor_s() - before)
        job.folder.mkdir(parents=True, exist_ok=True)
        (job.folder / ERROR).unlink(missing_ok=True)
        result = job.function(*job.arguments, job.folder, report)
        seconds = round(_processor_s() - before, 2)
        record = {"key": job.key, "label": job.label, "processor_s": seconds, "result": result}
        text = json.dumps(record, indent=1, allow_nan=False)
        write_text(job.folder / RESULT, text + "\n")
        return Done(job, json.loads(text)["result"], processor_s=seconds)  # as it will be read again
    except Exception as error:  # of one job: the others go on
        if job.folder is not None:
            write_text(job.folder / ERROR, traceback.format_exc())
        return Done(job, error=f"{type(error).__name__}: {error}", processor_s=_processor_s() - before)


def _processor_s() -> float:
    """Processor time of this process and of those that it has waited for [s]."""
    t = os.times()
    return t.user + t.system + t.children_user + t.children_system
