"""What an experiment is worth: information or relative accuracy, weighted as a problem needs (section VI)."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.machines.excitation.parameters import CG, DAMPING, INERTIA, MASS, STIFFNESS, UNKNOWNS

GROUPS: Mapping[str, range] = MappingProxyType(
    {
        "mass": range(MASS, INERTIA),
        "inertia": range(INERTIA, CG),
        "c.g.": range(CG, DAMPING),
        "damping": range(DAMPING, STIFFNESS),
        "stiffness": range(STIFFNESS, UNKNOWNS),
    }
)
"""The unknowns that are weighted alike."""


def weight_of_each(weights: FloatArray) -> FloatArray:
    """The weight of each unknown, shape (..., 22), from those of the groups, shape (..., 5)."""
    return np.repeat(weights, [len(group) for group in GROUPS.values()], axis=-1)


def bits(information: FloatArray, weights: FloatArray) -> FloatArray:
    """Weighted sum of the information about each parameter [bits], shape (batch,).

    Args:
        information: By the filter [bits], shape (batch, 22).
        weights: Of each parameter, of that shape.
    """
    return np.asarray((weights * information).sum(axis=-1))


def relative_accuracy(
    deviation: FloatArray, nominal: FloatArray, weights: FloatArray, estimated: NDArray[np.bool_]
) -> FloatArray:
    """How often 100 % of expected relative error have been halved: -log2 of its mean, shape (batch,).

    The expected relative error of a parameter is its standard deviation by the filter over its nominal size,
    as Table I counts errors; parameters that are nominally zero have none. Bits count each halving of each
    parameter alike, the well-known mass like the badly known inertia; here what is known worst counts most.

    Args:
        deviation: Standard deviations of the estimates, shape (batch, 22).
        nominal: Nominal values, of that shape.
        weights: Of each parameter, of that shape.
        estimated: Which parameters are estimated, shape (22,).
    """
    counts = weights * (estimated & (nominal != 0.0))
    error = deviation / np.where(nominal == 0.0, 1.0, np.abs(nominal))
    return np.asarray(-np.log2((counts * error).sum(axis=-1) / counts.sum(axis=-1)))
