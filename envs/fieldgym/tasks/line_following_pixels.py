"""Line following by pixels."""

from fieldgym.task import Task

TASK = Task(
    name="line_following_pixels",
    title="Line following by pixels",
    description="Steer a biped along a taped line from its camera's image.",
    reward_threshold=62.7,
    version=1,
    module="line_following",
    settings_name="LineFollowingSettings",
    model="line_following",
    operator=True,
)
