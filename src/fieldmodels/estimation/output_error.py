"""Output-error fit: the parameters whose simulation is closest to all measurements.

Simulated outputs carry no noise, so there are no errors in variables to compensate; the price is a
simulation for each parameter and step. With a Gaussian prior it is the maximum a posteriori (MAP) estimate.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.model import ModelError

_DIFFERENCE = 1e-4
"""Step of the differences, in prior standard deviations."""
_ENOUGH = 1e-3
"""The fit ends when a step lowers the cost by less (the cost is half a chi-square)."""


@dataclass(frozen=True)
class OutputError:
    """An output-error fit.

    Attributes:
        mean: Parameters, shape (unknowns,).
        covariance: Inverse of the Gauss-Newton Hessian there, prior included, shape (unknowns, unknowns).
        chi_square: Sum of squared residuals in units of their noise, without the prior's: about their number
            if model and noise are right, far above if the fit is stuck in a local minimum.
        residuals: Number of residuals in that sum.
        iterations: Steps taken.
    """

    mean: FloatArray
    covariance: FloatArray
    chi_square: float
    residuals: int
    iterations: int


def fit_output_error(
    simulate: Callable[[FloatArray], FloatArray],
    measured: ArrayLike,
    variances: ArrayLike,
    prior_mean: ArrayLike,
    prior_deviation: ArrayLike,
    start: ArrayLike,
    feasible: Callable[[FloatArray], FloatArray],
    iterations: int = 30,
) -> OutputError:
    """Fit by Levenberg and Marquardt's method; each step is projected onto the feasible set.

    Args:
        simulate: Outputs of a batch of parameters: (n, unknowns) to (n, ...).
        measured: Measured outputs, shape (...).
        variances: Variance of the white noise on each, of that shape, positive.
        prior_mean: Shape (unknowns,).
        prior_deviation: Standard deviations, shape (unknowns,); 0 holds a parameter at its start.
        start: Where to begin, shape (unknowns,).
        feasible: The nearest parameters that can be simulated (itself, if these can).
        iterations: Most steps.

    Raises:
        ModelError: If shapes do not fit, a variance is not positive, or the start cannot be simulated.
    """
    data, noise = np.asarray(measured, dtype=np.float64), np.asarray(variances, dtype=np.float64)
    if data.shape != noise.shape or not np.all(noise > 0.0) or not np.isfinite(data).all():
        raise ModelError("output error needs finite measurements, each with a positive variance")
    prior, deviation = np.asarray(prior_mean, dtype=np.float64), np.asarray(prior_deviation, np.float64)
    free = np.flatnonzero(deviation > 0.0)
    weight = 1.0 / np.sqrt(noise.ravel())
    scale = deviation[free]

    def residuals(batch: FloatArray) -> FloatArray:
        """Whitened residuals, prior's last, shape (n, ...)."""
        outputs = np.asarray(simulate(batch), dtype=np.float64)
        if outputs.shape[1:] != data.shape:
            raise ModelError(f"the simulation gives {outputs.shape[1:]} outputs for {data.shape} measured")
        error = (outputs - data).reshape(len(batch), -1) * weight
        return np.hstack([error, (batch[:, free] - prior[free]) / scale])

    x = feasible(np.array(start, dtype=np.float64))
    r = residuals(x[None])[0]
    value = 0.5 * float(r @ r)
    if not np.isfinite(value):
        raise ModelError("the start of an output-error fit cannot be simulated")
    damping, taken = 1e-3, 0
    normal, gradient = _normal_equations(residuals, x, r, free, scale)
    while taken < iterations:
        taken += 1
        step = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), -gradient)
        trial = x.copy()
        trial[free] += scale * step
        trial = feasible(trial)
        r_trial = residuals(trial[None])[0]
        lower = 0.5 * float(r_trial @ r_trial)
        if not lower < value:
            damping *= 10.0
            if damping > 1e8:
                break
            continue
        gained, x, r, value = value - lower, trial, r_trial, lower
        damping = max(0.1 * damping, 1e-9)
        normal, gradient = _normal_equations(residuals, x, r, free, scale)
        if gained < _ENOUGH:
            break
    covariance = np.zeros((len(x), len(x)))
    covariance[np.ix_(free, free)] = np.linalg.inv(normal) * np.outer(scale, scale)
    error = r[: data.size]
    return OutputError(x, covariance, float(error @ error), data.size, taken)


def _normal_equations(
    residuals: Callable[[FloatArray], FloatArray],
    x: FloatArray,
    r: FloatArray,
    free: NDArray[np.intp],
    scale: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """J'J and J'r in prior standard deviations, by one-sided differences, one parameter at a time."""
    jacobian = np.empty((len(free), len(r)))
    for row, (index, size) in enumerate(zip(free, scale, strict=True)):
        moved = x.copy()
        moved[index] += _DIFFERENCE * size
        jacobian[row] = (residuals(moved[None])[0] - r) / _DIFFERENCE
    return jacobian @ jacobian.T, jacobian @ r
