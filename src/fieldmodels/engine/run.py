"""Which jobs are left, and who does them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from fieldmodels.engine.cluster import on_ray
from fieldmodels.engine.job import Done, Job, JobsFailedError, Report, done_before, perform
from fieldmodels.engine.local import in_processes
from fieldmodels.engine.stopping import terminated_like_interrupted


@dataclass(frozen=True)
class Engine:
    """Who does jobs; results never depend on it.

    Attributes:
        name: ``local``: this machine; ``ray``: a cluster.
        workers: Of ``local``: processes of one thread each; 0: one job after another, in this process.
        address: Of ``ray``: see `on_ray`.
    """

    name: Literal["local", "ray"] = "local"
    workers: int = 0
    address: str = ""


HERE = Engine()


def run_jobs(jobs: Sequence[Job], engine: Engine = HERE, report: Report = lambda *_: None) -> Iterator[Done]:
    """Do what is left of some jobs, each as it is finished; those that were done before come first.

    SIGTERM and Ctrl-C end all jobs under way; those that can stop in good order keep a checkpoint.

    Args:
        jobs: The jobs; each has a folder of its own, or none.
        engine: Who does them.
        report: Called with what is being done and the part of the whole that is done.

    Raises:
        EngineError: If the engine is not installed, or its cluster not there.
    """
    before = {job: done for job in jobs if (done := done_before(job)) is not None}
    yield from before.values()
    left = [job for job in jobs if job not in before]
    whole = sum(job.share for job in left)
    finished, count = 0.0, 0

    def within(stage: str, part: float) -> None:
        share = left[count].share if engine.name == "local" and engine.workers == 0 else 0.0
        report(stage, (finished + part * share) / whole)

    with terminated_like_interrupted():
        try:
            for done in _by(engine, left, within):
                finished, count = finished + done.job.share, count + 1
                report(done.job.label, finished / whole)
                yield done
        except KeyboardInterrupt:
            kept = len(before) + count
            raise KeyboardInterrupt(
                f"{kept} of {len(jobs)} jobs are done; the same command does the others"
            ) from None


def run_all(jobs: Sequence[Job], engine: Engine = HERE, report: Report = lambda *_: None) -> list[Done]:
    """Do what is left of some jobs; their results in the order of the jobs.

    Raises:
        JobsFailedError: If some failed; the results of the others are kept in their folders.
        EngineError: If the engine is not installed, or its cluster not there.
    """
    found = {done.job: done for done in run_jobs(jobs, engine, report)}
    done = [found[job] for job in jobs]
    if any(one.error for one in done):
        raise JobsFailedError(done)
    return done


def _by(engine: Engine, jobs: Sequence[Job], report: Report) -> Iterator[Done]:
    if not jobs:
        return iter(())
    if engine.name == "ray":
        return on_ray(jobs, engine.address)
    if engine.workers:
        return in_processes(jobs, engine.workers, report)
    return (perform(job, lambda stage, part, at=job.label: report(f"{at}: {stage}", part)) for job in jobs)  # type: ignore[misc]
