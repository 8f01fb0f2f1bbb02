"""What an engine costs beside the jobs: measured here, and simulated for 1 to 1000 jobs on more machines.

python benchmarks/engine_speed.py
"""

from __future__ import annotations

import heapq
import time
from pkgutil import resolve_name
from typing import NamedTuple

from fieldmodels.engine import Engine, Job, run_jobs

COUNT = 200
JOB_S = 60.0
"""Length of the simulated jobs: a short training run."""


class Cost(NamedTuple):
    """Of an engine [s]: until the first job is done, then a job in the driver, which does them in turn."""

    start: float
    each: float


def measured(engine: Engine) -> Cost:
    """Of jobs that only import what training needs, once in each worker."""
    jobs = [Job(str(i), "", resolve_name, ("fieldagents.learned.session:__name__",)) for i in range(COUNT)]
    began = time.perf_counter()
    times = [time.perf_counter() - began for _ in run_jobs(jobs, engine)]
    half = COUNT // 2  # all workers have begun by then
    return Cost(times[0], (times[-1] - times[half - 1]) / half)


def simulated(cost: Cost, jobs: int, workers: int) -> float:
    """Time until all jobs are done: the driver hands out one after another, workers start side by side."""
    free = [cost.start] * workers
    driver = 0.0
    for _ in range(jobs):
        driver += cost.each
        heapq.heapreplace(free, max(free[0], driver) + JOB_S)
    return max(free)


def main() -> None:
    """Print a table."""
    for name, engine in {"processes": Engine(workers=2), "ray": Engine("ray")}.items():
        cost = measured(engine)
        print(f"{name}: {cost.start:.2f} s to the first result, then {1000 * cost.each:.1f} ms a job")
        for jobs, workers in ((1, 1), (10, 10), (100, 50), (1000, 50), (1000, 1000)):
            took = simulated(cost, jobs, workers)
            ratio = took / (JOB_S * -(-jobs // workers))
            print(f"  {jobs:5d} jobs on {workers:4d} processors: {took:7.1f} s, {ratio:.3f} x the jobs alone")


if __name__ == "__main__":
    main()
