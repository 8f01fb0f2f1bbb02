"""Held-out likelihood of a fit's windows."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray, IntArray
from fieldmodels.diagnosis.linearisation import Fit, pseudo_inverse, stacked

TAIL = 10.0  # degrees of freedom of the held-out likelihood: bad windows count less than in a Gaussian
INSENSITIVE = (
    0.01  # norm of a whitened column below which a change by ten coordinates is negligible (0.005 nats)
)


def held_out_loss(fitted: Fit, folds: IntArray) -> FloatArray:
    """Held-out negative log-likelihood [nats] of every window, up to a constant.

    The fit is repeated without each fold by one Gauss-Newton step from the joint optimum. The likelihood
    is Student's t over a window, so that outlying windows do not dominate.

    Args:
        fitted: A fit to all windows.
        folds: Fold of each window, shape (windows,).

    Returns:
        Loss, shape (windows,).
    """
    loss = np.zeros(len(fitted.residual))
    for fold, step in leave_out_steps(fitted, folds):
        inside = folds == fold
        loss[inside] = window_loss(fitted, inside, fitted.jacobian[inside] @ step)
    return loss


def leave_out_steps(fitted: Fit, folds: IntArray) -> Iterator[tuple[int, FloatArray]]:
    """Each fold, and the Gauss-Newton step of the free coordinates without it, shape (free,)."""
    # Nearly unidentifiable parameters would be moved by thousands of coordinates.
    active = fitted.active & (np.sqrt(np.sum(fitted.jacobian**2, axis=(0, 1))) > INSENSITIVE)
    jacobian = fitted.jacobian[:, :, active]
    flat = stacked(jacobian)
    whole, gradient = flat.T @ flat, flat.T @ fitted.residual.reshape(-1)
    numbers = np.unique(folds)
    rest = np.repeat(whole[None], len(numbers), axis=0)
    left = np.repeat(gradient[None], len(numbers), axis=0)
    for k, fold in enumerate(numbers):
        inside = folds == fold
        flat = stacked(jacobian[inside])
        rest[k] -= flat.T @ flat
        left[k] -= flat.T @ fitted.residual[inside].reshape(-1)
    steps = np.zeros((len(numbers), len(active)))
    steps[:, active] = (pseudo_inverse(rest) @ left[:, :, None])[:, :, 0]
    yield from zip(numbers.tolist(), steps, strict=True)


def window_loss(
    fitted: Fit, which: NDArray[np.bool_] | slice = slice(None), change: FloatArray | float = 0.0
) -> FloatArray:
    """Negative log-likelihood [nats] of windows, up to a constant: heavy-tailed averages and exact events.

    Args:
        fitted: A fit.
        which: The windows.
        change: Reduction of their whitened residual by a step, shape (windows, features + states).

    Returns:
        Loss, shape (windows,).
    """
    residual = fitted.residual[which]
    moved = residual - change
    observations, features = fitted.observations, fitted.raw.shape[1]
    if observations is None or fitted.weight is None:
        return heavy_tailed(moved, features)
    row, event = observations.rows(fitted.whitener)
    # A weighted step of a probability, times its weight, is a step of the log-odds.
    odds = np.zeros(observations.seen[which].shape)
    odds[:, event] = (residual - moved)[:, row] * fitted.weight[which][:, observations.columns][:, event]
    exact = observations.select(which).loss(fitted.raw[which], odds)[:, event].sum(axis=1)
    moved[:, row] = 0.0
    return np.asarray(heavy_tailed(moved, features - int(observations.columns.sum())) + exact)


def heavy_tailed(residual: FloatArray, features: int) -> FloatArray:
    """Negative log-likelihood [nats] of windows under Student's t, up to a constant, shape (windows,)."""
    return np.asarray(0.5 * (TAIL + features) * np.log1p(np.sum(residual**2, axis=1) / TAIL))
