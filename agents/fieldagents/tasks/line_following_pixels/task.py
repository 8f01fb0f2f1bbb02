"""Line following by pixels: measured as line following is."""

from fieldagents.task import TaskDefinition
from fieldagents.tasks.line_following.task import METRICS

TASK = TaskDefinition(name="line_following_pixels", metrics=METRICS)
