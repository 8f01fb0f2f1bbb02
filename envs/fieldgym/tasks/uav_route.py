"""UAV route."""

from fieldgym.task import Task

TASK = Task(
    name="uav_route",
    title="UAV route",
    description="Fly to a goal past radars that see an aircraft's sides, leg by leg.",
    reward_threshold=7.2,
    version=1,
    model_reads=("place", "course", "radial", "path_length", "layout", "leg_left"),
    turned_by="radial",
)
