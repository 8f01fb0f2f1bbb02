"""Table 4.2: the probability of detection by signature and range, and its inverse."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled, inlined
from fieldmodels.machines.uav_route.parameters import Interpolation
from fieldmodels.machines.uav_route.signature import cell
from fieldmodels.model import ModelError

PROBABILITIES = np.array([0.99, 0.5, 0.1, 0.01])
"""Columns of Table 4.2."""
SIGNATURES = np.array([1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0])
"""Rows of Table 4.2, from the bottom."""
RANGES = np.array(
    [
        [12.0, 15.2, 17.6, 20.8],
        [21.4, 27.1, 31.2, 36.9],
        [38.0, 48.1, 55.6, 65.7],
        [67.6, 85.6, 98.8, 116.8],
        [120.2, 152.2, 175.7, 207.6],
        [213.7, 270.6, 312.5, 369.2],
        [380.0, 481.2, 555.6, 656.6],
    ]
)
"""Table 4.2: slant range [km] by signature and probability."""
_LOG_SIGNATURES = np.log(SIGNATURES)
_LOG_RANGES = np.log(RANGES)
_MOST, _LEAST = 0.99, 0.01

EXACT = 1e-9
"""A probability is above the threshold if it exceeds it by more than rounding."""


@inlined
def range_in_column(i: int, up: float, column: int, log: bool) -> float:
    """Range at which a signature between two rows is seen with a column's probability (its log if so)."""
    if log:
        return float(_LOG_RANGES[i, column] + up * (_LOG_RANGES[i + 1, column] - _LOG_RANGES[i, column]))
    return float(RANGES[i, column] + up * (RANGES[i + 1, column] - RANGES[i, column]))


@inlined
def row_of(signature: float, log: bool) -> tuple[int, float]:
    """Which rows a signature lies between, and where."""
    return cell(_LOG_SIGNATURES, math.log(signature)) if log else cell(SIGNATURES, signature)


@inlined
def probability(signature: float, slant: float, log: bool) -> float:
    """Probability with which a signature is detected at a slant range [km], within 0.01 and 0.99."""
    i, up = row_of(signature, log)
    place = math.log(max(slant, 1e-9)) if log else slant
    near = range_in_column(i, up, 0, log)
    if place <= near:
        return _MOST
    for column in range(1, 4):
        far = range_in_column(i, up, column, log)
        if place <= far:
            share = (place - near) / (far - near)
            lower = PROBABILITIES[column - 1]
            return float(lower + share * (PROBABILITIES[column] - lower))
        near = far
    return _LEAST


@inlined
def range_at(signature: float, probability: float, log: bool) -> float:
    """Slant range [km] at which a signature is detected with a probability within 0.01 and 0.99."""
    i, up = row_of(signature, log)
    column = 0
    while column < 2 and probability < PROBABILITIES[column + 1]:
        column += 1
    share = (PROBABILITIES[column] - probability) / (PROBABILITIES[column] - PROBABILITIES[column + 1])
    near, far = range_in_column(i, up, column, log), range_in_column(i, up, column + 1, log)
    place = near + share * (far - near)
    return math.exp(place) if log else place


@compiled
def _probabilities(signatures: FloatArray, ranges: FloatArray, log: bool, out: FloatArray) -> None:
    for i in range(len(out)):
        out[i] = probability(signatures[i], ranges[i], log)


@compiled
def _ranges(signatures: FloatArray, probabilities: FloatArray, log: bool, out: FloatArray) -> None:
    for i in range(len(out)):
        out[i] = range_at(signatures[i], probabilities[i], log)


def probability_of_detection(
    signature: ArrayLike, slant_range: ArrayLike, interpolation: Interpolation = "linear"
) -> FloatArray:
    """Table 4.2 for arrays of any shapes that fit together.

    Args:
        signature: Signatures, positive; beyond the table's rows its outermost row holds.
        slant_range: Slant ranges [km].
        interpolation: See ``Detection``.

    Raises:
        ModelError: If a signature is not positive.
    """
    s, r = np.broadcast_arrays(
        np.asarray(signature, dtype=np.float64), np.asarray(slant_range, dtype=np.float64)
    )
    _check_signatures(s)
    out = np.empty(s.size)
    _probabilities(s.ravel(), r.ravel(), interpolation == "log", out)
    return out.reshape(s.shape)


def detection_range(
    signature: ArrayLike, probability: ArrayLike, interpolation: Interpolation = "linear"
) -> FloatArray:
    """Slant range [km] at which signatures are detected with given probabilities: Table 4.2 inverted.

    Raises:
        ModelError: If a signature is not positive or a probability lies outside 0.01 to 0.99.
    """
    s, p = np.broadcast_arrays(
        np.asarray(signature, dtype=np.float64), np.asarray(probability, dtype=np.float64)
    )
    _check_signatures(s)
    if not ((p >= _LEAST) & (p <= _MOST)).all():
        raise ModelError("a probability of detection lies within 0.01 and 0.99, as in Table 4.2")
    out = np.empty(s.size)
    _ranges(s.ravel(), p.ravel(), interpolation == "log", out)
    return out.reshape(s.shape)


def _check_signatures(signatures: FloatArray) -> None:
    if not (signatures > 0).all():
        raise ModelError("a signature must be positive")
