"""The extended simulation: the named effects and the remaining curves, fitted together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fieldmodels.diagnosis.candidates import Candidate
from fieldmodels.diagnosis.curves import Scored
from fieldmodels.diagnosis.fit import fit
from fieldmodels.diagnosis.gain import Prediction, predict
from fieldmodels.diagnosis.held_out import held_out_loss
from fieldmodels.diagnosis.linearisation import Fit
from fieldmodels.diagnosis.problem import Problem
from fieldmodels.drivers.curved import Curved

STEPS = 20


@dataclass(frozen=True)
class Extension:
    """A simulation with everything that the data call for.

    Attributes:
        model: The model with the curves as further effects; the model itself if there are none.
        fit: Parameters and states, fitted together.
        curves: The curves with their final coefficients.
    """

    model: Curved
    fit: Fit
    curves: tuple[Scored, ...]

    def predict(self, testing: Problem) -> Prediction:
        """Predict windows."""
        return predict(replace(testing, model=self.model), self.fit.parameters)


def extend(problem: Problem, kept: Candidate, curves: Sequence[Scored]) -> Extension | None:
    """Fit the named effects and the curves together.

    Args:
        problem: Training windows.
        kept: The named effects, as fitted without the curves.
        curves: The curves.

    Returns:
        None if there are no curves, or the simulation with them fits no better.
    """
    if not curves:
        return None
    model, fitted = _together(problem, kept, curves)
    if not fitted.cost < kept.fit.cost:
        return None
    return Extension(model, fitted, _final(curves, fitted, len(kept.fit.parameters)))


def simulated(problem: Problem, kept: Candidate, curves: Sequence[Scored]) -> Candidate:
    """Curves beside a fit, judged by the whole simulation with them where that predicts held-out windows.

    To first order a curve that changes much is worth less than it is, and names are fitted with the whole
    simulation.

    Args:
        problem: Training windows.
        kept: The fit.
        curves: The curves, each judged beside those before.
    """
    last = curves[-1].candidate
    loss = held_out_loss(_together(problem, kept, curves)[1], problem.folds)
    return replace(last, loss=loss) if loss.sum() < last.loss.sum() else last


def _together(problem: Problem, kept: Candidate, curves: Sequence[Scored]) -> tuple[Curved, Fit]:
    """A fit of the whole simulation with curves beside what was fitted without them."""
    model = Curved(problem.model, [scored.free for scored in curves])
    count = len(kept.fit.parameters)
    start = np.concatenate([kept.fit.parameters, *(np.zeros(len(c.coefficients)) for c in curves)])
    free = np.concatenate([kept.fit.free, np.arange(count, len(start))])
    whole = replace(problem, model=model)
    return model, fit(whole, start, free, kept.fit.whitener, kept.fit.states, STEPS)


def _final(curves: Sequence[Scored], fitted: Fit, first: int) -> tuple[Scored, ...]:
    """The curves with the coefficients of a fit, and their covariance."""
    inverse = np.linalg.pinv(fitted.information, hermitian=True, rcond=1e-10)
    place = {int(index): k for k, index in enumerate(fitted.free)}
    result = []
    for scored in curves:
        last = first + len(scored.coefficients)
        rows = [place[i] for i in range(first, last)]
        covariance = np.asarray(inverse[np.ix_(rows, rows)], dtype=np.float64)
        result.append(replace(scored, coefficients=fitted.parameters[first:last], covariance=covariance))
        first = last
    return tuple(result)
