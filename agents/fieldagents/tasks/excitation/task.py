"""Excitation: what is measured, and who records its model's data."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fieldagents.task import Metric, Recorder, TaskDefinition

if TYPE_CHECKING:
    import numpy as np

    from fieldagents.record.config import RecordConfig
    from fieldmodels.model import Model
    from fieldmodels.reality import Reality
    from fieldmodels.recording import Recording


def record(config: RecordConfig, model: Model, reality: Reality, rng: np.random.Generator) -> Recording:
    """A vehicle that its arm shakes by random sinusoids, in all three modes."""
    from fieldmodels.machines.excitation.model import ExcitationModel
    from fieldmodels.machines.excitation.recording import record_experiment

    assert isinstance(model, ExcitationModel)
    return record_experiment(
        rng,
        reality,
        duration=config.duration,
        step=config.step or 0.01,
        repeats=config.episodes,
        noise=config.noise,
        model=model,
    )


TASK = TaskDefinition(
    name="excitation",
    metrics=(
        Metric("error", "%", "average |error| of the parameters at the end", "error_percent", over="last"),
        Metric(
            "error_naive",
            "%",
            "average |error| of the naive filter at the end",
            "error_percent_naive",
            over="last",
        ),
        Metric(
            "normalised",
            "%",
            "average |error| at the end in shares of the prior's range",
            "error_normalised",
            over="last",
        ),
        Metric(
            "normalised_naive",
            "%",
            "the naive filter's in shares of the prior's range",
            "error_normalised_naive",
            over="last",
        ),
        Metric("bits", "bits", "information at the end", "bits", lower_is_better=False, over="last"),
        Metric(
            "bits_naive",
            "bits",
            "what the naive filter takes for information at the end",
            "bits_naive",
            lower_is_better=False,
            over="last",
        ),
        Metric(
            "reached_20",
            "1",
            "error below 20 % at the end",
            "reached_20",
            lower_is_better=False,
            over="last",
            binary=True,
        ),
        Metric(
            "time_to_20",
            "s",
            "time since when the error stayed below 20 %, if it ends there",
            "time_to_20",
            over="last",
            given="reached_20",
        ),
        Metric("noise", "1", "mean of the draws behind the noise", "noise_draw", common=True),
    ),
    recorder=Recorder(("excitation",), ("step", "episodes", "noise"), record),
    picture="frozen_weight",
)
