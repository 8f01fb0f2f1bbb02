"""Line following: what is measured, and who records its model's data."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fieldagents.task import Metric, Recorder, TaskDefinition

if TYPE_CHECKING:
    import numpy as np

    from fieldagents.record.config import RecordConfig
    from fieldmodels.model import Model
    from fieldmodels.reality import Reality
    from fieldmodels.recording import Recording

METRICS = (
    Metric("mean_offset", "m", "mean distance from the line, settled", "mean_offset", over="last"),
    Metric("near", "1", "share of strides within 0.10 m", "near", lower_is_better=False, over="last"),
    Metric("effort", "rad", "mean change of the turn", "effort"),
    Metric("overshoot", "m", "farthest beyond the line, seen from the start", "overshoot", over="last"),
    Metric("failed", "1", "left or lost the line", "failed", over="last", binary=True),
    Metric(
        "start_offset", "m", "distance from the line at the start", "start_offset", over="last", common=True
    ),
)


def record(config: RecordConfig, _: Model, reality: Reality, rng: np.random.Generator) -> Recording:
    """A walker that follows a line."""
    from fieldgym.line_following import LineFollowingSettings
    from fieldgym.settings import read_settings
    from fieldmodels.machines.line_following.parameters import Gait
    from fieldmodels.machines.line_following.recording import record_walk

    # a bias that is drawn would be an effect that nobody has switched on
    walked = read_settings(
        {"track": "straight", "bias": 0.0, **(config.settings or {})}, LineFollowingSettings
    )
    strides = max(1, round(config.duration / Gait().stride_time))
    return record_walk(reality, strides, scene=walked.scene(images=False), rng=rng)


TASK = TaskDefinition(
    name="line_following",
    metrics=METRICS,
    recorder=Recorder(("line_following",), ("settings",), record),
)
