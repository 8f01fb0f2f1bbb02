"""What is measured in an episode of each task."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Metric:
    """A number for each step that is averaged over an episode.

    Attributes:
        name: Column of the results.
        unit: Its unit, "1" if it has none.
        title: What it is, in a few words.
        key: Where the environment's ``info`` has it; an estimator's row reads its own key instead of
            the first metric's.
        lower_is_better: Whether a lower value is a better one.
        common: Whether it does not depend on the agent: proof that all met the same noise.
    """

    name: str
    unit: str
    title: str
    key: str
    lower_is_better: bool = True
    common: bool = False


METRICS: dict[str, tuple[Metric, ...]] = {
    "heel_strike": (
        Metric("error_mm", "mm", "mean |error| at heel strike", "error_mm"),
        Metric(
            "ranger_mm", "mm", "the published estimator's on the same strides", "error_mm_ranger", common=True
        ),
    ),
}
"""A task's metrics; the first is the one that verdicts are about."""
