"""The extended simulation: the named effects and the remaining curves, fitted together."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fieldmodels.diagnosis.candidates import Candidate
from fieldmodels.diagnosis.curves import Curves, Scored
from fieldmodels.diagnosis.fit import fit
from fieldmodels.diagnosis.gain import Prediction, predict
from fieldmodels.diagnosis.linearisation import Fit
from fieldmodels.diagnosis.problem import Problem
from fieldmodels.drivers.curved import Curved

STEPS = 20
OTHERS = 3
"""Curves at other places that are tried with the whole simulation, if to first order they explain as much."""


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
    model = Curved(problem.model, [scored.free for scored in curves])
    count = len(kept.fit.parameters)
    start = np.concatenate([kept.fit.parameters, *(np.zeros(len(c.coefficients)) for c in curves)])
    free = np.concatenate([kept.fit.free, np.arange(count, len(start))])
    fitted = fit(replace(problem, model=model), start, free, kept.fit.whitener, kept.fit.states, STEPS)
    if not fitted.cost < kept.fit.cost:
        return None
    return Extension(model, fitted, _final(curves, fitted, count))


def told_apart(
    problem: Problem, kept: Candidate, found: Sequence[Scored], tried: Curves
) -> tuple[Scored, ...]:
    """Curves, the first of which may give way to one that explains as much to first order.

    A heater that fades and a thermometer that does are the same to first order; the whole simulation tells
    them apart.

    Args:
        problem: Training windows.
        kept: The named effects.
        found: Curves beside them, the most important first.
        tried: All that were tried beside them.
    """
    if not found:
        return ()
    first, options = found[0], tried.options
    near = first.candidate.total + options.undecided
    others = (s for s in tried.judge(kept) if s.candidate.total < near and _acts(s) != _acts(first))
    choices = [first, *(tried.as_formula(kept, s) for s in itertools.islice(others, OTHERS))]
    if len(choices) == 1:
        return tuple(found)
    best, cost = first, _cost(problem, kept, first) - options.undecided
    for one in choices[1:]:
        own = _cost(problem, kept, one)
        if own < cost:
            best, cost = one, own
    if best is first:
        return tuple(found)
    return best, *tried.rivals(best.candidate, options.most_curves - 1)


def _acts(scored: Scored) -> tuple[str, str]:
    """Where a curve acts."""
    return scored.curve.place, scored.curve.target


def _cost(problem: Problem, kept: Candidate, scored: Scored) -> float:
    """Of the simulation with a curve and its price [nats]."""
    extension = extend(problem, kept, [scored])
    cost = kept.fit.cost if extension is None else extension.fit.cost
    return cost + kept.price * len(scored.coefficients)


def improving(
    problem: Problem, kept: Candidate, curves: Sequence[Scored], testing: Problem, after: Prediction
) -> Extension | None:
    """The extension with as many of the curves, the first ones, as predict test windows better.

    Better are errors whose logarithms have a lower mean over the outputs.

    Args:
        problem: As of ``extend``.
        kept: As of ``extend``.
        curves: As of ``extend``.
        testing: Test windows.
        after: Their prediction by the named effects alone.
    """
    for count in range(len(curves), 0, -1):
        extension = extend(problem, kept, curves[:count])
        if extension is None:
            continue
        with np.errstate(divide="ignore", invalid="ignore"):  # outputs that are exact, or not measured
            lower = np.log(extension.predict(testing).rmse() / after.rmse())
        if np.nanmean(lower) < 0.0:
            return extension
    return None


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
