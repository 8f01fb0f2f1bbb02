"""Pose reaching."""

from fieldgym.task import Task

TASK = Task(
    name="pose_reaching",
    title="Pose reaching",
    description="Drive a unicycle to a ball and arrive with the right heading.",
    reward_threshold=7.4,
    operator=True,
)
