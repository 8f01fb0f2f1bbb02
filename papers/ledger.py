"""All claims of the sources: run what decides them, once for its code and options, and say what came out."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from fieldagents.progress import Report
from fieldmodels.engine import HERE, Done, Engine, Job, done_before, run_jobs
from fieldmodels.names import did_you_mean
from papers.claim import VERDICTS, Claim, Decided, Ours, Statistic, Verdict
from papers.report import to_json
from papers.run import ReproductionError, carry_out, reproducible
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


@dataclass(frozen=True)
class Ledger:
    """All claims, decided.

    Attributes:
        claims: In the order of tasks and sources.
        runs: By name and options.
        quick: Whether the runs were the short ones.
    """

    claims: tuple[Decided, ...]
    runs: Mapping[Run, Outcome]
    quick: bool

    @property
    def counts(self) -> dict[Verdict, int]:
        """Claims by verdict."""
        found = Counter(one.verdict for one in self.claims)
        return {verdict: found[verdict] for verdict in VERDICTS if found[verdict]}

    @property
    def good(self) -> bool:
        """Whether nothing failed and no verdict is unexpected."""
        return not any(one.unexpected for one in self.claims)

    def outcomes(self, one: Decided) -> list[Outcome]:
        """The runs behind a claim, each once."""
        return [self.runs[run] for run in needed([(one.task, one.claim)], self.quick)]


def claims_of(task: str | None = None) -> list[tuple[str, Claim]]:
    """All claims with their task, or those of one task.

    Raises:
        ReproductionError: If there is no such task.
    """
    if task is not None and task not in (known := all_sources()):
        raise ReproductionError(f"there is no source of a task {task!r}{did_you_mean(task, known)}")
    sources = [one for name, one in all_sources().items() if task in (None, name)]
    return [(one.name, claim) for one in sources for claim in one.claims.values()]


def run_of(task: str, ours: Ours, quick: bool) -> Run:
    """The run that computes a number."""
    entry = reproducible().get(f"{task}/{ours.run}")
    options = {**(entry.quick if quick and entry else {}), **ours.options}
    return Run(task, ours.run, tuple(sorted(options.items())))


def needed(claims: Iterable[tuple[str, Claim]], quick: bool) -> list[Run]:
    """The runs that decide claims, each once."""
    runs = (run_of(task, ours, quick) for task, claim in claims for ours in claim.readings.values())
    return list(dict.fromkeys(runs))


def left(out: Path, task: str | None, quick: bool) -> tuple[int, list[float | None]]:
    """How many runs decide the claims, and what each that is not done yet took when recorded [s].

    Raises:
        ReproductionError: If there is no such task.
    """
    runs = needed(claims_of(task), quick)
    todo = [run for run in runs if done_before(job_of(run, out, quick)) is None]
    return len(runs), [recorded_seconds(run, quick) for run in todo]


def decide(
    out: Path,
    task: str | None = None,
    *,
    quick: bool = False,
    engine: Engine = HERE,
    progress: Report = lambda _stage, _part: None,
) -> Ledger:
    """Run what decides the claims, and decide them.

    A run whose code and options have not changed since its result was written to ``out`` is not repeated. One
    that fails is listed, and the others go on.

    Args:
        out: Result folder; each run has its own below it.
        task: Only this task's claims.
        quick: Take each run's quick options.
        engine: Who does the runs.
        progress: Called with what is being done and the part of the whole that is done.

    Raises:
        ReproductionError: If there is no such task.
    """
    claims = claims_of(task)
    jobs = {job_of(run, out, quick): run for run in needed(claims, quick)}
    finished = {done.job: done for done in run_jobs(list(jobs), engine, progress)}
    outcomes = {run: outcome_of(run, finished[job]) for job, run in jobs.items()}
    return Ledger(tuple(_decided(name, claim, outcomes, quick) for name, claim in claims), outcomes, quick)


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


def _decided(task: str, claim: Claim, runs: Mapping[Run, Outcome], quick: bool) -> Decided:
    measured: dict[str, Statistic | None] = {}
    errors: dict[str, str] = {}
    for reading, ours in claim.readings.items():
        outcome = runs[run_of(task, ours, quick)]
        measured[reading] = outcome.statistics.get(ours.statistic)
        if outcome.error:
            errors[reading] = outcome.error
        elif measured[reading] is None:
            known = did_you_mean(ours.statistic, outcome.statistics)
            errors[reading] = f"{outcome.run.what} gives no {ours.statistic!r}{known}"
    return Decided(claim, task, measured, errors)


def as_data(ledger: Ledger) -> dict[str, Any]:
    """The ledger as plain data: what ``--json`` prints."""
    return {
        "schema": 1,
        "quick": ledger.quick,
        "counts": ledger.counts,
        "good": ledger.good,
        "claims": [_claim_data(ledger, one) for one in ledger.claims],
        "runs": [
            {
                "what": outcome.run.what,
                "options": dict(outcome.run.options),
                "processor_s": outcome.processor_s,
                "resumed": outcome.resumed,
                "error": outcome.error or None,
            }
            for outcome in ledger.runs.values()
        ],
    }


def _claim_data(ledger: Ledger, one: Decided) -> dict[str, Any]:
    claim, verdicts = one.claim, one.verdicts
    return {
        "name": f"{one.task}/{claim.name}",
        "where": list(claim.where),
        "says": claim.says,
        "printed": claim.printed,
        "condition": claim.condition,
        "verdict": one.verdict,
        "words": one.words,
        "expected": claim.expected,
        "unexpected": one.unexpected,
        "because": claim.because or None,
        "remark": claim.remark,
        "assumes": claim.assumes,
        "ours": [
            {
                "reading": reading,
                "run": f"{one.task}/{ours.run}",
                "options": dict(ours.options),
                "statistic": ours.statistic,
                **(asdict(number) if (number := one.measured[reading]) else {}),
                "verdict": verdicts[reading],
                "error": one.errors.get(reading),
            }
            for reading, ours in claim.readings.items()
        ],
        "figures": [str(path) for outcome in ledger.outcomes(one) for path in outcome.figures],
    }
