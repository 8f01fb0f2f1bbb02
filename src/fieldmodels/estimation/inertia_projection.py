"""The nearest physical inertia: positive definite, and satisfying the triangle inequality.

An inertia tensor I belongs to some distribution of positive mass if and only if the second moment of that
mass, S = 1/2 tr(I) 1 - I, is positive semidefinite (Wensing, Kim and Slotine, IEEE RA-L 3(1), 2018): its
eigenvalues are halves of I_j + I_k - I_i, so that this covers both conditions.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares, nnls

from fieldmodels.arrays import FloatArray
from fieldmodels.model import ModelError

ORDER = ((0, 0), (1, 1), (2, 2), (0, 2), (1, 2), (0, 1))
"""Elements of the tensor in the order of Table I: x, y, z, xz, yz, xy."""

# Principal moments of inertia from principal second moments of mass: each is the sum of the other two.
_SUMS = np.ones((3, 3)) - np.eye(3)


def tensor(inertia: ArrayLike) -> FloatArray:
    """Symmetric tensor [kg m2], shape (3, 3), of six elements in the order x, y, z, xz, yz, xy."""
    values = np.asarray(inertia, dtype=np.float64)
    if values.shape != (6,) or not np.isfinite(values).all():
        raise ModelError(f"an inertia has six finite elements (x, y, z, xz, yz, xy), not {values}")
    matrix = np.empty((3, 3))
    for value, (i, j) in zip(values, ORDER, strict=True):
        matrix[i, j] = matrix[j, i] = value
    return matrix


def is_physical(inertia: ArrayLike, least: float = 0.0) -> bool:
    """Whether some body can have this inertia: principal second moments of mass of at least ``least``."""
    matrix = tensor(inertia)
    return bool(np.linalg.eigvalsh(0.5 * np.trace(matrix) * np.eye(3) - matrix)[0] >= least)


def project(inertia: ArrayLike, covariance: ArrayLike | None = None, least: float = 1e-6) -> FloatArray:
    """Nearest physical inertia.

    Args:
        inertia: Elements x, y, z, xz, yz, xy [kg m2], shape (6,).
        covariance: Of the estimate, shape (6, 6): nearness is measured in its standard deviations. None
            measures it in the tensor's own (Frobenius) norm, in which the projection is closed: principal
            axes stay, and their moments go to the nearest point of a cone.
        least: Smallest principal second moment of mass [kg m2].

    Returns:
        Elements in the same order, shape (6,); the argument itself if it is physical already.

    Raises:
        ModelError: If these are no six finite elements, or the covariance is not positive definite.
    """
    matrix = tensor(inertia)
    if is_physical(inertia, least):
        return np.array(inertia, dtype=np.float64)
    moments, axes = np.linalg.eigh(matrix)
    second = nnls(_SUMS, moments - _SUMS @ np.full(3, least))[0] + least
    nearest = axes @ np.diag(_SUMS @ second) @ axes.T
    start = np.array([nearest[i, j] for i, j in ORDER])
    if covariance is None:
        return start
    try:
        whiten = np.linalg.inv(np.linalg.cholesky(np.asarray(covariance, dtype=np.float64)))
    except np.linalg.LinAlgError as error:
        raise ModelError("the covariance of an inertia must be positive definite, shape (6, 6)") from error
    # S = least 1 + B B with symmetric B is every physical S, and needs no constraint.
    root = np.linalg.eigh(0.5 * np.trace(nearest) * np.eye(3) - nearest - least * np.eye(3))
    b = root[1] @ np.diag(np.sqrt(np.maximum(root[0], 1e-3 * abs(root[0]).max()))) @ root[1].T

    def elements(values: FloatArray) -> FloatArray:
        half = tensor(values)
        mass = least * np.eye(3) + half @ half
        full = np.trace(mass) * np.eye(3) - mass
        return np.array([full[i, j] for i, j in ORDER])

    target = np.asarray(inertia, dtype=np.float64)

    def distance(values: FloatArray) -> FloatArray:
        return np.asarray(whiten @ (elements(values) - target))

    return elements(least_squares(distance, [b[i, j] for i, j in ORDER]).x)
