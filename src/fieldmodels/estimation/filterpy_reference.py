"""The library filterpy: reference for the compiled filters, and the published Kalman filter with it.

filterpy is an extra: whoever imports this module without it is told how to get it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from fieldmodels.arrays import FloatArray
from fieldmodels.extras import needed

_kalman = needed("filterpy.kalman")
ExtendedKalmanFilter, IMMEstimator = _kalman.ExtendedKalmanFilter, _kalman.IMMEstimator
KalmanFilter = _kalman.KalmanFilter

__all__ = ["ExtendedKalmanFilter", "FilterpyFilter", "IMMEstimator"]


class FilterpyFilter:
    """Kalman filter of constant unknowns x with measurements F = A x (Fig. 5 of Sujan and Dubowsky).

    No process noise (Q_k = 0) and constant R_k, for which the source gives no numbers.
    """

    def __init__(self, prior_mean: ArrayLike, prior_deviation: ArrayLike, variance: ArrayLike) -> None:
        """Start at the prior.

        Args:
            prior_mean: Shape (unknowns,).
            prior_deviation: Standard deviations, shape (unknowns,).
            variance: Diagonal of R_k, or the full matrix: shape (rows,) or (rows, rows).
        """
        mean = np.array(prior_mean, dtype=np.float64)
        noise = np.array(variance, dtype=np.float64)
        self._filter = KalmanFilter(dim_x=len(mean), dim_z=len(noise))
        self._filter.x = mean
        self._filter.P = np.diag(np.square(prior_deviation))
        self._filter.R = np.diag(noise) if noise.ndim == 1 else noise

    @property
    def mean(self) -> FloatArray:
        """Estimate, shape (unknowns,); a copy."""
        return np.array(self._filter.x)

    @property
    def covariance(self) -> FloatArray:
        """Its covariance, shape (unknowns, unknowns); a copy."""
        return np.array(self._filter.P)

    def update(self, regressor: ArrayLike, target: ArrayLike) -> None:
        """Update with one sample: A of shape (rows, unknowns), F of shape (rows,)."""
        self._filter.update(np.asarray(target), H=np.asarray(regressor))
