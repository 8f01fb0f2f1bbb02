"""How finely errors can be told: by the recorded numbers, and by a simulation's own error.

A fit to data without noise is off by rounding and by the steps of an integration. Weighed by their own size
such errors look significant, and the next effect that imitates them would be named. Therefore no error is
weighed finer than the largest of

- the rounding of the recorded numbers: of single precision, of printed decimals or digits, of a coarse
  sensor. In an average independent roundings diminish: a signal rounds anew with each step that it passes;
- ``Model.resolution``, a share of its signal's spread. A Runge-Kutta step of 0.2 of the fastest mode's time,
  the longest that the drivers take, is off by 0.2^4 / 120 = 1.3e-5 of the motion.
"""

from __future__ import annotations

import math

import numpy as np

from fieldmodels.arrays import FloatArray

DIGITS = range(2, 13)
"""Significant digits, or decimals, with which numbers may have been printed."""
LOOKED_AT = 2000
"""Values by which a way of printing is excluded at once."""
TOLERANCE = 0.02
"""Of a lattice's step: how far values may lie from it."""


def rounding(values: FloatArray) -> float:
    """Step from one number to the next in which a signal was recorded; 0 in double precision.

    Args:
        values: What was recorded of one signal, shape (n,).
    """
    known = values[np.isfinite(values) & (values != 0.0)]
    if not len(known):
        return 0.0
    some = known[:: 1 + len(known) // LOOKED_AT]
    steps = [lattice(values) or 0.0]
    if _single(some) and _single(known):
        steps.append(_rms(np.spacing(known.astype(np.float32)).astype(np.float64)))
    for relative in (False, True):
        for digits in DIGITS:
            if _printed(some, digits, relative) and _printed(known, digits, relative):
                steps.append(_rms(_unit(known, digits, relative)))
                break
    return max(steps)


def lattice(values: FloatArray) -> float | None:
    """Step of the lattice on which all values lie, or None if there is no such lattice."""
    unique = np.unique(values[np.isfinite(values)])
    if len(unique) < 4:
        return None
    gaps = np.diff(unique)
    gaps = gaps[gaps > 1e-9 * (unique[-1] - unique[0])]  # rounding errors of a conversion
    step = float(np.median(gaps[gaps < 1.5 * gaps.min()]))
    for _ in range(3):
        counts = np.round((unique - unique[0]) / step)
        if counts[-1] < 3:
            return None
        step = float((counts @ (unique - unique[0])) / (counts @ counts))
    counts = np.round((unique - unique[0]) / step)
    distance = np.abs(unique - unique[0] - counts * step)
    # Values too dense for the lattice lie near it by chance.
    filled = len(unique) <= counts[-1] + 1
    return step if filled and float(distance.max()) < TOLERANCE * step else None


def of_averages(steps: FloatArray, passed: FloatArray, counts: FloatArray) -> FloatArray:
    """Standard deviation of the rounding of averages, shape (windows, features).

    Args:
        steps: What ``rounding`` says of each average's signal, shape (features,).
        passed: How far the signal goes, to and fro, within each average, shape (windows, features).
        counts: Samples of each average, shape (windows, features).
    """
    known = np.where(steps > 0.0, steps, 1.0)
    independent = np.clip(1.0 + passed / known, 1.0, np.maximum(counts, 1.0))
    return np.asarray(steps / np.sqrt(12.0 * independent))


def _single(values: FloatArray) -> bool:
    with np.errstate(over="ignore"):
        return bool(np.array_equal(values.astype(np.float32).astype(np.float64), values))


def _unit(values: FloatArray, digits: int, relative: bool) -> FloatArray:
    """The last printed digit's unit of each value."""
    if not relative:
        return np.full(len(values), 10.0**-digits)
    return np.asarray(10.0 ** (np.floor(np.log10(np.abs(values))) + 1 - digits))


def _printed(values: FloatArray, digits: int, relative: bool) -> bool:
    """Whether values have that many decimals, or significant digits, at most."""
    parts = values / _unit(values, digits, relative)
    near = np.abs(parts - np.round(parts)) <= 1e-14 * np.abs(parts) + 1e-9
    return bool(near.all()) and bool(np.abs(parts).max() < 1e13)


def _rms(values: FloatArray) -> float:
    return math.sqrt(float(np.mean(values**2)))
