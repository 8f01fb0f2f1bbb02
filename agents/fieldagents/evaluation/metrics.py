"""What is measured in an episode of each task."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Metric:
    """A number for each episode, made from what ``info`` says at its steps.

    Attributes:
        name: Column of the results.
        unit: Its unit, "1" if it has none.
        title: What it is, in a few words.
        key: Where the environment's ``info`` has it; an estimator's row reads its own key instead of
            the first metric's.
        lower_is_better: Whether a lower value is a better one.
        common: Whether it does not depend on the agent: proof that all met the same noise.
        over: How an episode's number comes from its steps: their ``mean``, their ``sum``, or the ``last``
            one's.
        binary: Whether an episode's number is 0 or 1, as a success is; its mean is then a share, with an
            interval of its own kind.
        optional: Whether an episode may have no value (NaN), as the time at which something was reached
            that was not; means and differences are then over the episodes that have one.
        given: Entry of ``info`` without which an episode has no value: a metric of the successful episodes
            names that of the success, which the episode's last step must hold.
        per: Entry of ``info`` that the episode's value is divided by, as it is at the last step.
        bound: Where a function is, ``module:function``, of the environment's settings and its first ``info``,
            whose value for each episode that episode's is divided by.
    """

    name: str
    unit: str
    title: str
    key: str
    lower_is_better: bool = True
    common: bool = False
    over: Literal["mean", "sum", "last"] = "mean"
    binary: bool = False
    optional: bool = False
    given: str = ""
    per: str = ""
    bound: str = ""

    @property
    def may_miss(self) -> bool:
        """Whether an episode may be without a value."""
        return self.optional or bool(self.given)

    @property
    def label(self) -> str:
        """Title and unit."""
        unit = "%" if self.binary else self.unit
        return self.title if unit == "1" else f"{self.title} [{unit}]"


LINE_FOLLOWING = (
    Metric("mean_offset", "m", "mean distance from the line, settled", "mean_offset", over="last"),
    Metric("near", "1", "share of strides within 0.10 m", "near", lower_is_better=False, over="last"),
    Metric("effort", "rad", "mean change of the turn", "effort"),
    Metric("overshoot", "m", "farthest beyond the line, seen from the start", "overshoot", over="last"),
    Metric("failed", "1", "left or lost the line", "failed", over="last", binary=True),
    Metric(
        "start_offset", "m", "distance from the line at the start", "start_offset", over="last", common=True
    ),
)

METRICS: dict[str, tuple[Metric, ...]] = {
    "excitation": (
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
    "heel_strike": (
        Metric("error_mm", "mm", "mean |error| at heel strike", "error_mm"),
        Metric(
            "ranger_mm", "mm", "the published estimator's on the same strides", "error_mm_ranger", common=True
        ),
    ),
    "line_following": LINE_FOLLOWING,
    "line_following_pixels": LINE_FOLLOWING,
    "pose_reaching": (
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
    "uav_route": (
        Metric("success", "1", "arrived", "success", lower_is_better=False, over="last", binary=True),
        Metric(
            "length_ratio",
            "1",
            "length over the bound of undetected paths, if arrived",
            "path_length",
            over="last",
            given="success",
            bound="fieldagents.reference.uav_route.lower_bound:shortest_flights",
        ),
        Metric("path_length", "km", "length, if arrived", "path_length", over="last", given="success"),
        Metric("damaged", "1", "hit by a missile", "damaged", over="last", binary=True),
        Metric("time_over", "s", "time detected", "time_over", over="last"),
        Metric(
            "longest_detection", "s", "longest detection without a break", "longest_detection", over="last"
        ),
        Metric(
            "largest_probability",
            "1",
            "largest probability of detection",
            "largest_probability",
            over="last",
        ),
        Metric("lock_losses", "1", "locks that radars lost", "lock_losses", over="last"),
        Metric("legs", "1", "legs", "legs", over="last"),
    ),
}
"""A task's metrics; the first is the one that verdicts are about."""
