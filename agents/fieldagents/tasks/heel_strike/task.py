"""Heel strike: what is measured, and who records its model's data."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fieldagents.task import Metric, Recorder, TaskDefinition

if TYPE_CHECKING:
    import numpy as np

    from fieldagents.record.config import RecordConfig
    from fieldmodels.model import Model
    from fieldmodels.reality import Reality
    from fieldmodels.recording import Recording


def record(config: RecordConfig, _: Model, reality: Reality, rng: np.random.Generator) -> Recording:
    """A walker that nobody drives."""
    from fieldagents.record.config import WalkConfig
    from fieldmodels.machines.heel_strike.parameters import Noise, Regimes
    from fieldmodels.machines.heel_strike.recording import record_walk

    walk = config.walk or WalkConfig()
    kind = walk.collision_kind
    noise = Regimes(collision_kind=kind) if walk.regimes else Noise(collision_kind=kind)
    return record_walk(config.duration, rng, noise, reality)


TASK = TaskDefinition(
    name="heel_strike",
    metrics=(
        Metric("error_mm", "mm", "mean |error| at heel strike", "error_mm"),
        Metric(
            "ranger_mm", "mm", "the published estimator's on the same strides", "error_mm_ranger", common=True
        ),
    ),
    recorder=Recorder(("heel_strike",), ("walk",), record),
)
