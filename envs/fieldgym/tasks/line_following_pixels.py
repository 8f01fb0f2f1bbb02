"""Line following by pixels."""

from fieldgym.task import Task

TASK = Task(
    name="line_following_pixels",
    title="Line following by pixels",
    description="Steer a biped along a taped line from its camera's image.",
    version=1,
    module="line_following",
    settings_name="LineFollowingSettings",
    model="line_following",
    operator=True,
)
