"""A long signal as few points: the smallest and the largest value of every pixel."""

from __future__ import annotations

import numpy as np

from fieldmodels.arrays import FloatArray


def buckets(time: FloatArray, values: FloatArray, begin: float, end: float, width: int) -> FloatArray:
    """Points that draw a signal as all of its samples would.

    Args:
        time: Increasing times, shape (n,).
        values: The signal, shape (n,).
        begin: First time that is shown; a sample before it is kept, so that the line goes on.
        end: Last one, likewise.
        width: Pixels.

    Returns:
        Times and values, shape (2, at most 2 width + 2).
    """
    first = max(int(np.searchsorted(time, begin)) - 1, 0)
    last = min(int(np.searchsorted(time, end, side="right")) + 1, len(time))
    t, v = time[first:last], values[first:last]
    if len(t) <= 2 * width:
        return np.array([t, v])
    edges = np.linspace(0, len(t), width + 1).astype(np.int64)[:-1]
    padded = np.where(np.isnan(v), np.inf, v)
    low = np.minimum.reduceat(padded, edges)
    high = np.maximum.reduceat(np.where(np.isnan(v), -np.inf, v), edges)
    pairs = np.column_stack([low, high]).ravel()
    return np.array([np.repeat(t[edges], 2), np.where(np.isinf(pairs), np.nan, pairs)])
