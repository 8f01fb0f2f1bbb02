"""Excitation."""

from fieldgym.task import Task

TASK = Task(
    name="excitation",
    title="Excitation",
    description="Shake a vehicle with its own arm so that its unknown parameters show.",
    reward_threshold=172.2,
    model_reads=("estimate", "arm", "variances"),
)
