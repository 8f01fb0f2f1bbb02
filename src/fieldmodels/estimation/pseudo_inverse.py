"""Least squares over all samples at once: x = (A'A)^-1 A'F, section IV of Sujan and Dubowsky."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from fieldmodels.arrays import FloatArray
from fieldmodels.model import ModelError


@dataclass(frozen=True)
class LeastSquares:
    """A least-squares solution and how well its regressor determines it.

    Attributes:
        x: The unknowns, shape (unknowns,); of least norm (in columns of unit length) if rank is lacking.
        rank: Of the regressor; equal to the number of unknowns if all are identifiable.
        condition: Condition number of the regressor as it is, the quality measure that the source compares
            with (its reference [2]); infinite if rank is lacking.
    """

    x: FloatArray
    rank: int
    condition: float


def pseudo_inverse(regressor: ArrayLike, target: ArrayLike) -> LeastSquares:
    """Solve A x = F in the least-squares sense, by singular values rather than by (A'A)^-1.

    Columns are brought to unit length first: stiffness is in thousands, the centre of gravity in tenths.

    Args:
        regressor: A of all samples, shape (..., unknowns); leading axes are stacked.
        target: F, shape (...).

    Raises:
        ModelError: If shapes do not fit or a number is not finite.
    """
    a = np.asarray(regressor, dtype=np.float64)
    f = np.asarray(target, dtype=np.float64)
    if a.ndim < 2 or f.shape != a.shape[:-1] or f.size == 0:
        raise ModelError(f"the target must have the regressor's shape but for its last axis, not {f.shape}")
    if not np.isfinite(a).all() or not np.isfinite(f).all():
        raise ModelError("regressor and target must be finite")
    a, f = a.reshape(-1, a.shape[-1]), f.ravel()
    length = np.linalg.norm(a, axis=0)
    length[length == 0.0] = 1.0
    x, _, rank, _ = scipy.linalg.lstsq(a / length, f, cond=1e-12)
    singular = np.linalg.svd(a, compute_uv=False)
    whole = int(rank) == a.shape[1] and singular[-1] > 0.0
    return LeastSquares(x / length, int(rank), float(singular[0] / singular[-1]) if whole else np.inf)
