"""Standard errors of a fit's parameters."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.coordinates import Coordinates
from fieldmodels.diagnosis.held_out import INSENSITIVE
from fieldmodels.diagnosis.linearisation import Fit, pseudo_inverse
from fieldmodels.diagnosis.problem import Problem


def standard_errors(problem: Problem, fitted: Fit) -> FloatArray:
    """Standard error of every free parameter.

    The largest of three, since each alone is too small for some kind of error: by the information, and by the
    jackknife over blocks of windows and over pairs of blocks, whose errors may be correlated. All take the
    residual covariance for known; it was estimated from windows with as many averages as ``p`` less the
    states, which makes estimates vary by a factor of sqrt(1 + p / windows) more.

    Args:
        problem: The windows.
        fitted: A fit to them.

    Returns:
        In each parameter's unit, NaN where it has no influence, shape (free,).
    """
    count = len(fitted.free)
    if not count:
        return np.zeros(0)
    result = np.full(count, np.nan)
    size = np.sqrt(np.sum(fitted.jacobian**2, axis=(0, 1)))
    # The probability of an event may be so certain that no derivative is left: its profile says more.
    used = size > (INSENSITIVE if fitted.observations is None else -1.0)
    variances = [np.diag(pseudo_inverse(_powers(fitted, used).sum(axis=0)))]
    free = used & fitted.active
    at = np.flatnonzero(free[used])
    for pooled in (1, 2):
        spread = np.zeros(int(used.sum()))
        spread[at] = _jackknife(problem, fitted, free, pooled)
        variances.append(spread)
    states = fitted.states.shape[1]
    unknown = 1.0 + max(fitted.raw.shape[1] - states, 0) / len(fitted.raw)
    slope = np.abs(
        Coordinates(problem.model.all_parameters, fitted.free).slope(fitted.parameters[fitted.free])
    )
    result[used] = np.sqrt(unknown * np.max(variances, axis=0)) * slope[used]
    return result


def _powers(fitted: Fit, which: NDArray[np.bool_]) -> FloatArray:
    """Information of each window on some parameters, shape (windows, parameters, parameters)."""
    own = fitted.jacobian[:, :, which]
    return np.asarray(own.transpose(0, 2, 1) @ own)


def _jackknife(problem: Problem, fitted: Fit, which: NDArray[np.bool_], pooled: int) -> FloatArray:
    """Variance of coordinates from the changes by leaving out each group of so many blocks, (parameters,)."""
    number = np.unique(problem.blocks // pooled, return_inverse=True)[1]
    groups = int(number.max()) + 1
    power, score = (
        _powers(fitted, which),
        np.einsum("wfk,wf->wk", fitted.jacobian[:, :, which], fitted.residual),
    )
    powers, scores = np.zeros((groups, *power.shape[1:])), np.zeros((groups, score.shape[1]))
    np.add.at(powers, number, power)
    np.add.at(scores, number, score)
    inverse = pseudo_inverse(powers.sum(axis=0) - powers)
    changes = (inverse @ scores[:, :, None])[:, :, 0]
    return np.asarray((groups - 1) / groups * np.sum(changes**2, axis=0))
