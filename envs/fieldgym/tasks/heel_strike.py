"""Heel strike."""

from fieldgym.task import Task

TASK = Task(
    name="heel_strike",
    title="Heel strike",
    description="Choose a walking robot's estimator gains, stride by stride, under hidden noise.",
    reward_threshold=-170.1,
)
