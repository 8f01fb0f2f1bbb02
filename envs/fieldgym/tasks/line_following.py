"""Line following."""

from fieldgym.task import Task

TASK = Task(
    name="line_following",
    title="Line following",
    description="Steer a biped along a taped line from the line's place in its camera.",
    reward_threshold=55.0,
    version=1,
    operator=True,
)
