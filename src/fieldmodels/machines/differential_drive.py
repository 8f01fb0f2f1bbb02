"""A differential drive that is commanded by its wheels' speeds."""

from __future__ import annotations

from fieldmodels.machines.pose_reaching.model import PoseReaching
from fieldmodels.model import Signal


class DifferentialDrive(PoseReaching):
    """The robot of pose reaching, commanded by ``left_command`` and ``right_command`` [rad/s]."""

    name = "differential_drive"
    inputs = (Signal("left_command", "rad/s"), Signal("right_command", "rad/s"))
    wheel_front = True
