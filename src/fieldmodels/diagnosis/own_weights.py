"""A curve judged with the weights of the errors that it leaves itself.

Errors are weighed by the covariance of those that a fit leaves, in which what it lacks counts as noise: on
few windows nothing could ever bring more than half a nat a window in its own direction, however large it is.
So a simulation and the same with a curve are compared as two Gaussian models, each with a covariance of its
own; the curve's is that of windows to which it was not fitted, so that a curve that fits noise gains nothing.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from fieldmodels.arrays import FloatArray, IntArray
from fieldmodels.diagnosis.candidates import Candidate
from fieldmodels.diagnosis.held_out import held_out_loss, leave_out_steps
from fieldmodels.diagnosis.linearisation import Fit, reweighed
from fieldmodels.diagnosis.problem import Problem
from fieldmodels.diagnosis.whitening import covariance_whitener

if TYPE_CHECKING:
    from fieldmodels.diagnosis.curves import Curves, Scored


def with_own_weights(
    curves: Curves, candidate: Candidate, scored: Scored
) -> tuple[Curves, Candidate, Scored] | None:
    """The curves, the fit and the curve beside it, with the weights of the errors that the curve leaves.

    Losses hold the logarithms of both covariances' determinants, so that their difference is the logarithm of
    a likelihood ratio. Whether the curve helps steadily (its p-value) is asked with its weights alone: what
    the determinants add is the same in all windows.

    Args:
        curves: What was tried.
        candidate: The fit.
        scored: The curve, scored beside it.

    Returns:
        None where that is not defined: in whole records, and beside further curves.
    """
    problem, fitted = curves.problem, candidate.fit
    linear = fitted.jacobian.shape[2] == fitted.by_free.shape[2]  # without curves of its own
    if fitted.runs is not None or not linear:
        return None
    plain, of_plain = _weighed(problem, candidate, candidate.fit)
    own, of_own = _weighed(problem, candidate, scored.candidate.fit)
    beside = curves.reweighed(own.fit)
    again = next(iter(beside.judge(own, [scored.curve])), None)
    if again is None:
        return None
    before = plain.loss + of_own - of_plain
    gain = before - again.candidate.loss
    return (
        beside,
        replace(own, loss=before),
        replace(again, gain=gain),
    )


def _weighed(problem: Problem, candidate: Candidate, wide: Fit) -> tuple[Candidate, float]:
    """A fit with the weights of what another leaves, and the logarithm of their determinant."""
    # An event's weight is its probability's, whatever errors are left.
    raw = np.where(problem.events, candidate.fit.raw, _left_out(wide, problem.folds))
    left = replace(candidate.fit, raw=raw)
    whitener = covariance_whitener(problem, left)
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
