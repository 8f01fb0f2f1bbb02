"""What an experiment is worth: information or relative accuracy, weighted as a problem needs (section VI)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import inlined
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


@inlined
def bits(information: FloatArray, weights: FloatArray) -> float:
    """Weighted sum of the information about each parameter [bits]; both of shape (22,)."""
    total = 0.0
    for k in range(len(weights)):
        total += weights[k] * information[k]
    return total


@inlined
def relative_accuracy(
    covariance: FloatArray, nominal: FloatArray, weights: FloatArray, estimated: NDArray[np.bool_]
) -> float:
    """How often 100 % of expected relative error have been halved: -log2 of its mean.

    The expected relative error of a parameter is its standard deviation by the filter over its nominal size,
    as Table I counts errors; parameters that are nominally zero have none. Bits count each halving of each
    parameter alike, the well-known mass like the badly known inertia; here what is known worst counts most.

    Args:
        covariance: Of the estimates, shape (22, 22).
        nominal: Nominal values, shape (22,).
        weights: Of each parameter, of that shape.
        estimated: Which parameters are estimated, of that shape.
    """
    total, counted = 0.0, 0.0
    for k in range(len(weights)):
        if estimated[k] and nominal[k] != 0.0:
            total += weights[k] * math.sqrt(covariance[k, k]) / abs(nominal[k])
            counted += weights[k]
    return -math.log2(total / counted)
