"""Numbers with their intervals, from samples; none needs random numbers."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from fieldagents.evaluation.comparison import mean_interval
from papers.claim import Statistic


def exact(value: float) -> Statistic:
    """A number in which nothing is random."""
    return Statistic(float(value), float(value), float(value))


def mean_of(values: ArrayLike) -> Statistic:
    """Mean of independent samples, with Student's interval."""
    x = _samples(values, 2)
    interval = mean_interval(x, 2)
    assert interval is not None
    return Statistic(float(x.mean()), *interval)


def median_of(values: ArrayLike) -> Statistic:
    """Median of independent samples, with the interval between order statistics that covers it at 95 %.

    It assumes no distribution. Fewer than six samples cannot cover 95 %.
    """
    x = np.sort(_samples(values, 6))
    below = int(stats.binom.ppf(0.025, len(x), 0.5))
    return Statistic(float(np.median(x)), float(x[below - 1]), float(x[-below]))


def share_of(successes: ArrayLike) -> Statistic:
    """Share of successes (0 or 1) among independent trials, with Wilson's interval."""
    x = _samples(successes, 2)
    interval = mean_interval(x, 2, binary=True)
    assert interval is not None
    share = float(x.mean())  # of successes alone, rounding may put the interval's end just below it
    return Statistic(share, min(interval[0], share), max(interval[1], share))


def _samples(values: ArrayLike, least: int) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    x = np.asarray(values, dtype=np.float64).ravel()
    if len(x) < least or not np.isfinite(x).all():
        raise ValueError(f"an interval needs at least {least} finite samples, not {x}")
    return x


def ratio_of(above: ArrayLike, below: ArrayLike) -> Statistic:
    """Ratio of two means of paired samples, with Student's interval by the jackknife."""
    a, b = _samples(above, 3), _samples(below, 3)
    ratio, left_out = a.mean() / b.mean(), (a.sum() - a) / (b.sum() - b)
    half = stats.t.ppf(0.975, len(a) - 1) * (len(a) - 1) ** 0.5 * left_out.std()
    return Statistic(float(ratio), float(ratio - half), float(ratio + half))
