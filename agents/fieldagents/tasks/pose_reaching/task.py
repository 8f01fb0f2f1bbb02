"""Pose reaching: what is measured, who records its model's data, and how a human drives."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fieldagents.task import Metric, Recorder, TaskDefinition

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from fieldagents.operator import Operator
    from fieldagents.record.config import RecordConfig
    from fieldmodels.model import Model
    from fieldmodels.reality import Reality
    from fieldmodels.recording import Recording


def record(config: RecordConfig, model: Model, reality: Reality, rng: np.random.Generator) -> Recording:
    """A robot that drives by random commands, or by those of a file."""
    from fieldagents.record.make import commands
    from fieldmodels.machines.pose_reaching.model import PoseReaching
    from fieldmodels.machines.pose_reaching.recording import record_commands, record_drive

    assert isinstance(model, PoseReaching)
    step = config.step or 0.05
    if config.input is not None:
        given = commands(config, model, 0.05)
        return record_commands(
            given, rng, reality, step=step, episodes=config.episodes, noise=config.noise, model=model
        )
    return record_drive(
        config.duration, rng, reality, step=step, episodes=config.episodes, noise=config.noise, model=model
    )


def steer(operator: Operator, own: NDArray[np.float32]) -> NDArray[np.float32]:
    """The stick gives speed and turn rate, to an omnidirectional robot its velocity; then twisting turns."""
    if len(own) == 2:
        return np.array([2 * max(operator.ahead, 0.0) - 1, operator.joystick], dtype=own.dtype)
    return np.array([operator.ahead, operator.turn, operator.joystick], dtype=own.dtype)


TASK = TaskDefinition(
    name="pose_reaching",
    metrics=(
        Metric("success", "1", "arrived", "success", lower_is_better=False, over="last", binary=True),
        Metric("time", "s", "time, if arrived", "time", over="last", given="success"),
        Metric(
            "time_ratio",
            "1",
            "time over the Dubins path's at full speed, if arrived",
            "time",
            over="last",
            given="success",
            per="dubins_time",
        ),
        Metric(
            "length_ratio",
            "1",
            "length over the Dubins path's, if arrived",
            "path_length",
            over="last",
            given="success",
            per="dubins_length",
        ),
        Metric("wall_hits", "1", "walls driven into", "wall_hits", over="last"),
        Metric("dubins_length", "m", "length of the Dubins path", "dubins_length", over="last", common=True),
    ),
    recorder=Recorder(
        ("pose_reaching", "differential_drive"), ("input", "step", "episodes", "noise"), record
    ),
    picture="path_memory",
    steer=steer,
    drives="fieldagents.tasks.pose_reaching.drives:RecordedDrives",
)
