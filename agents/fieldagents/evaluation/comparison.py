"""Paired differences with intervals, and what they allow to say."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

Verdict = Literal["better", "worse", "cannot tell", "insufficient"]

MIN_EPISODES = 20
"""With fewer episodes no interval is given: it would not cover what it promises."""

MIN_RUNS = 5
"""With fewer training runs nothing is said about the algorithm, only about these policies."""


@dataclass(frozen=True)
class Comparison:
    """How much an agent differs from the baseline on the same episodes.

    Attributes:
        n: Number of pairs.
        difference: Mean of agent minus baseline, in the metric's unit.
        ci95: Interval that covers the true mean difference in 95 of 100 evaluations; None if ``n`` is
            too small for that.
        percent: The difference in per cent of the baseline's mean; None if that is zero.
        verdict: ``better`` or ``worse`` if the interval lies on one side of zero, else ``cannot tell``;
            ``insufficient`` without an interval.
    """

    n: int
    difference: float
    ci95: tuple[float, float] | None
    percent: float | None
    verdict: Verdict


def mean_interval(values: ArrayLike, least: int) -> tuple[float, float] | None:
    """Student's t interval for the mean, at 95 %.

    On differences of skewed errors it covers at least as often as the BCa bootstrap from 5 to 100
    samples (the tests state how often), and needs no random numbers.

    Args:
        values: Independent samples, shape (n,).
        least: Smallest n for which an interval is given.
    """
    x = np.asarray(values, dtype=np.float64)
    if len(x) < max(least, 2):
        return None
    half = float(stats.t.ppf(0.975, len(x) - 1) * stats.sem(x))
    return float(x.mean()) - half, float(x.mean()) + half


def compare(
    agent: ArrayLike, baseline: ArrayLike, *, lower_is_better: bool, least: int = MIN_EPISODES
) -> Comparison:
    """Compare an agent with the baseline, pair by pair.

    Args:
        agent: Scores of the agent, shape (n,).
        baseline: Scores of the baseline on the same episodes in the same order, shape (n,).
        lower_is_better: Whether a lower score is a better one.
        least: Smallest number of pairs for which a verdict is given.

    Raises:
        ValueError: If the two have different shapes.
    """
    a, b = np.asarray(agent, dtype=np.float64), np.asarray(baseline, dtype=np.float64)
    if a.shape != b.shape:
        raise ValueError(f"pairs must match: {a.shape} against {b.shape}")
    difference = float((a - b).mean())
    interval = mean_interval(a - b, least)
    verdict: Verdict = "cannot tell"
    if interval is None:
        verdict = "insufficient"
    elif interval[1] < 0 or interval[0] > 0:
        verdict = "better" if (difference < 0) == lower_is_better else "worse"
    base = float(b.mean())
    percent = 100 * difference / abs(base) if base else None
    return Comparison(len(a), difference, interval, percent, verdict)
