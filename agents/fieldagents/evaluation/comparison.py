"""Paired differences with intervals, and what they allow to say."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

Verdict = Literal["better", "worse", "cannot tell", "insufficient"]

MIN_EPISODES = 20
"""With fewer episodes no interval is given: it would not cover what it promises."""

MIN_RUNS = 5
"""With fewer training runs nothing is said about the algorithm, only about these policies."""


Interval = tuple[float, float]

Z = float(stats.norm.ppf(0.975))


@dataclass(frozen=True)
class Comparison:
    """How much an agent differs from the baseline on the same episodes.

    Attributes:
        n: Number of pairs: episodes in which both have a value.
        difference: Mean of agent minus baseline, in the metric's unit; None without any pair.
        ci95: Interval that covers the true mean difference in 95 of 100 evaluations; None if ``n`` is
            too small for that.
        percent: The difference in per cent of the baseline's mean; None if that is zero, or if the metric
            is a share, whose difference says it itself.
        verdict: ``better`` or ``worse`` if the interval lies on one side of zero, else ``cannot tell``;
            ``insufficient`` without an interval.
    """

    n: int
    difference: float | None
    ci95: Interval | None
    percent: float | None
    verdict: Verdict


def mean_interval(values: ArrayLike, least: int, *, binary: bool = False) -> Interval | None:
    """Interval for the mean, at 95 %: Student's t, or Wilson's for a share.

    On differences of skewed errors Student's covers at least as often as the BCa bootstrap from 5 to 100
    samples (the tests state how often), and needs no random numbers. Wilson's keeps a width where all
    episodes agree. It is exact in its variance for values 0 and 1, and on the safe side for values between,
    the means of several training runs on an episode, which vary less.

    Args:
        values: Independent samples, shape (n,); NaN is no sample.
        least: Smallest n for which an interval is given.
        binary: Whether the values are successes (0 or 1), or the means of several runs' successes.
    """
    x = _present(values)
    n, mean = len(x), float(x.mean()) if len(x) else np.nan
    if n < max(least, 2):
        return None
    if binary:
        centre = (mean + Z**2 / (2 * n)) / (1 + Z**2 / n)
        half = Z / (1 + Z**2 / n) * np.sqrt(mean * (1 - mean) / n + Z**2 / (4 * n**2))
        return max(float(centre - half), 0.0), min(float(centre + half), 1.0)
    half = float(stats.t.ppf(0.975, n - 1) * stats.sem(x))
    return mean - half, mean + half


def compare(
    agent: ArrayLike,
    baseline: ArrayLike,
    *,
    lower_is_better: bool,
    least: int = MIN_EPISODES,
    binary: bool = False,
) -> Comparison:
    """Compare an agent with the baseline, pair by pair.

    A difference of paired shares has the interval of Agresti and Min (2005, "Simple improved confidence
    intervals for comparing matched proportions"): half an episode is added to each of the four outcomes, so
    that it keeps a width where all pairs agree.

    Args:
        agent: Scores of the agent, shape (n,); NaN where it has none.
        baseline: Scores of the baseline on the same episodes in the same order, shape (n,).
        lower_is_better: Whether a lower score is a better one.
        least: Smallest number of pairs for which a verdict is given.
        binary: Whether the scores are successes (0 or 1), or the means of several runs' successes.

    Raises:
        ValueError: If the two have different shapes.
    """
    a, b = np.asarray(agent, dtype=np.float64), np.asarray(baseline, dtype=np.float64)
    if a.shape != b.shape:
        raise ValueError(f"pairs must match: {a.shape} against {b.shape}")
    both = ~(np.isnan(a) | np.isnan(b))
    a, b = a[both], b[both]
    if not len(a):
        return Comparison(0, None, None, None, "insufficient")
    interval = _agresti_min(a - b, least) if binary else mean_interval(a - b, least)
    difference = float((a - b).mean())
    verdict: Verdict = "cannot tell"
    if interval is None:
        verdict = "insufficient"
    elif interval[1] < 0 or interval[0] > 0:
        verdict = "better" if (difference < 0) == lower_is_better else "worse"
    base = float(b.mean())
    percent = 100 * difference / abs(base) if base and not binary else None
    return Comparison(len(a), difference, interval, percent, verdict)


def _agresti_min(differences: NDArray[np.float64], least: int) -> Interval | None:
    """Interval for the mean of paired differences of successes, each -1, 0 or 1 (or between, over runs)."""
    n = len(differences) + 2  # half an episode for each of four outcomes, two of which differ
    if n - 2 < max(least, 2):
        return None
    mean = differences.sum() / n
    half = Z * np.sqrt((((differences**2).sum() + 1) / n - mean**2) / n)
    return max(float(mean - half), -1.0), min(float(mean + half), 1.0)


def _present(values: ArrayLike) -> NDArray[np.float64]:
    x = np.asarray(values, dtype=np.float64)
    return x[~np.isnan(x)]
