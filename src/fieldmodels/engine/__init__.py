"""Many independent jobs: one after another, in processes of this machine, or on a Ray cluster."""

from fieldmodels.engine.job import Done, Job, JobsFailedError, done_before
from fieldmodels.engine.run import HERE, Engine, run_all, run_jobs
from fieldmodels.engine.stopping import interruptible, stop_between

__all__ = [
    "HERE",
    "Done",
    "Engine",
    "Job",
    "JobsFailedError",
    "done_before",
    "interruptible",
    "run_all",
    "run_jobs",
    "stop_between",
]
