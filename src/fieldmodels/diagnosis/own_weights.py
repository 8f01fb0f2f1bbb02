"""Weights of the errors that a curve leaves itself.

Errors are weighed by the covariance of those that a fit leaves, in which what it lacks counts as noise: on
few windows nothing could ever bring more than half a nat a window in its own direction, however large it is.
So a simulation and the same with a curve are compared as two Gaussian models, each with a covariance of its
own; the curve's is that of windows to which it was not fitted, so that a curve that fits noise gains nothing.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fieldmodels.arrays import FloatArray, IntArray
from fieldmodels.diagnosis.candidates import Candidate
from fieldmodels.diagnosis.held_out import held_out_loss, leave_out_steps
from fieldmodels.diagnosis.linearisation import Fit, reweighed
from fieldmodels.diagnosis.problem import Problem
from fieldmodels.diagnosis.whitening import covariance_whitener


def has_own_weights(fitted: Fit) -> bool:
    """Whether a fit can be weighed anew: not whole records, nor one with curves of its own."""
    return fitted.runs is None and fitted.jacobian.shape[2] == fitted.by_free.shape[2]


def weighed(problem: Problem, candidate: Candidate, wide: Fit) -> tuple[Candidate, float]:
    """A fit with the weights of what another one leaves, and the logarithm of their determinant.

    Args:
        problem: The windows.
        candidate: The fit.
        wide: The same, perhaps with a curve.
    """
    # An event's weight is its probability's, whatever errors are left.
    raw = np.where(problem.events, candidate.fit.raw, _left_out(wide, problem.folds))
    whitener = covariance_whitener(problem, replace(candidate.fit, raw=raw))
    fitted = reweighed(problem, candidate.fit, whitener)
    loss = held_out_loss(fitted, problem.folds)
    return replace(candidate, fit=fitted, loss=loss), float(np.linalg.slogdet(whitener)[1])


def _left_out(wide: Fit, folds: IntArray) -> FloatArray:
    """Errors of the windows of each fold, fitted without it, shape (windows, features)."""
    features = len(wide.whitener)
    left = wide.residual[:, :features].copy()
    for fold, step in leave_out_steps(wide, folds):
        inside = folds == fold
        left[inside] -= wide.jacobian[inside, :features] @ step
    return np.asarray(np.linalg.solve(wide.whitener, left.T).T)
