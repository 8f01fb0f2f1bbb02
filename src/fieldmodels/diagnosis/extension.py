"""The extended simulation: the named effects and the remaining curves, fitted together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.candidates import Candidate, Candidates
from fieldmodels.diagnosis.curves import Scored
from fieldmodels.diagnosis.fit import fit, refit
from fieldmodels.diagnosis.gain import Prediction, predict
from fieldmodels.diagnosis.linearisation import Fit, reweighed
from fieldmodels.diagnosis.problem import Problem
from fieldmodels.diagnosis.result import WAVE
from fieldmodels.diagnosis.shapes import is_table, wave
from fieldmodels.diagnosis.whitening import covariance_whitener
from fieldmodels.drivers.curved import Curved

STEPS = 30
REWEIGHED = 2
"""Times that the weights of a delivered extension follow what is left."""
PERIODS, MOST_LONGER = 3, 0.1
"""Steps in which a wave's period is fitted, and by how much one changes its logarithm at most."""


@dataclass(frozen=True)
class Extension:
    """A simulation with everything that the data call for.

    Attributes:
        model: The model with the curves as further effects; the model itself if there are none.
        fit: Parameters and states, fitted together.
        curves: The curves with their final coefficients.
        gain: What the curves bring with the weights of what they were added to [nats].
    """

    model: Curved
    fit: Fit
    curves: tuple[Scored, ...]
    gain: float

    def predict(self, testing: Problem) -> Prediction:
        """Predict windows."""
        return predict(replace(testing, model=self.model), self.fit.parameters)


def extend(
    candidates: Candidates, kept: Candidate, curves: Sequence[Scored], whitener: FloatArray | None = None
) -> Extension | None:
    """Fit the named effects and the curves together.

    Args:
        candidates: Training windows, and what was made of them.
        kept: The named effects, as fitted without the curves.
        curves: The curves.
        whitener: Weights of the errors; by default those of the named effects, and where these make nothing
            of errors that the curves explain, those of what is left.

    Returns:
        None if there are no curves, or the simulation with them fits no better.
    """
    if not curves:
        return None
    key = id(kept), id(whitener), *map(id, curves)
    if key not in candidates.extensions:
        # All are kept with their ids, so that these cannot be used again.
        made = _extended(candidates, kept, curves, whitener)
        candidates.extensions[key] = kept, tuple(curves), whitener, made
    extension: Extension | None = candidates.extensions[key][-1]
    return extension


def _extended(
    candidates: Candidates, kept: Candidate, curves: Sequence[Scored], whitener: FloatArray | None
) -> Extension | None:
    """See ``extend``.

    A table goes on along a line beyond its knots where the training data clearly call for that, with the
    weights of what is left: those of what the curves explain would make nothing of it.
    """
    problem = candidates.problem
    for k in (k for k, one in enumerate(curves) if one.curve.formula.startswith(WAVE)):
        curves = _tuned(problem, kept, curves, whitener, k)
    made = _fitted(problem, kept, curves, whitener)
    for k in (k for k, one in enumerate(curves) if is_table(one.curve)):
        if made is None:
            break
        extended = replace(problem, model=made.model)
        own = covariance_whitener(extended, made.fit)
        on = [one.continued if k == j else one for j, one in enumerate(made.curves)]
        again = _fitted(problem, kept, on, own)
        ends = refit(extended, made.fit, own, STEPS)
        if again is not None and again.fit.cost < ends.cost - candidates.options.undecided:
            made = _fitted(problem, kept, on, whitener) or made
    return made if made is None or whitener is not None else _weighed(problem, made)


def _weighed(problem: Problem, made: Extension) -> Extension:
    """The same with the weights of what is left: those of what the curves explain look away from it."""
    extended, fitted = replace(problem, model=made.model), made.fit
    for _ in range(REWEIGHED):
        fitted = refit(extended, fitted, covariance_whitener(extended, fitted), STEPS)
    return replace(made, fit=fitted, curves=final(made.curves, fitted, len(problem.model.names)))


def _tuned(
    problem: Problem, kept: Candidate, curves: Sequence[Scored], whitener: FloatArray | None, k: int
) -> Sequence[Scored]:
    """The same with the period of wave ``k`` fitted with the whole simulation, by Gauss and Newton."""
    one, knots, period = curves[k], curves[k].curve.knots, curves[k].curve.period
    weights = whitener
    for _ in range(PERIODS):
        values, about = one.basis @ one.coefficients, knots - knots.mean()
        slope = -about * np.gradient(values, knots)  # by the period's logarithm
        longer = replace(one, curve=replace(one.curve, period=0.0), basis=np.column_stack([one.basis, slope]),
                         coefficients=np.append(one.coefficients, 0.0))  # fmt: skip
        made = _fitted(problem, kept, [*curves[:k], longer, *curves[k + 1 :]], weights)
        if made is None:
            return curves
        weights = covariance_whitener(replace(problem, model=made.model), made.fit)
        change = made.curves[k].coefficients[-1]
        period *= float(np.exp(np.clip(change, -MOST_LONGER, MOST_LONGER)))
        basis = wave((knots - knots[0]) / period, 1.0)
        shown = made.curves[k].basis @ made.curves[k].coefficients
        first = np.asarray(np.linalg.lstsq(basis, shown, rcond=None)[0], dtype=np.float64)
        formula = f"{WAVE} {period:.3g} {one.curve.over_unit}"
        one = replace(one, curve=replace(one.curve, period=period, formula=formula), basis=basis,
                      coefficients=first, covariance=np.zeros((2, 2)))  # fmt: skip
    return [*curves[:k], one, *curves[k + 1 :]]


def _fitted(
    problem: Problem, kept: Candidate, curves: Sequence[Scored], whitener: FloatArray | None
) -> Extension | None:
    model = Curved(problem.model, [scored.free for scored in curves])
    count, first = len(kept.fit.parameters), np.concatenate([c.coefficients for c in curves])
    free = np.concatenate([kept.fit.free, np.arange(count, count + len(first))])
    extended, weights = replace(problem, model=model), kept.fit.whitener if whitener is None else whitener
    for coefficients in (first, np.zeros_like(first)):
        start = np.concatenate([kept.fit.parameters, coefficients])
        fitted = fit(extended, start, free, weights, kept.fit.states, STEPS)
        gain = reweighed(problem, kept.fit, weights).cost - fitted.cost
        better = gain
        if whitener is None and gain <= 0.0 and np.isfinite(fitted.cost):
            # Weights of errors that the curves explain may make nothing of them.
            own = covariance_whitener(extended, fitted)
            fitted = refit(extended, fitted, own, STEPS)
            better = reweighed(problem, kept.fit, own).cost - fitted.cost
        if better > 0.0:
            return Extension(model, fitted, final(curves, fitted, count), gain)
    return None


def cost(candidates: Candidates, kept: Candidate, curves: Sequence[Scored], whitener: FloatArray) -> float:
    """Of the simulation with named effects and curves, and the price of their numbers [nats].

    Args:
        candidates: As of ``extend``.
        kept: As of ``extend``.
        curves: As of ``extend``.
        whitener: Weights of the errors.
    """
    extension = extend(candidates, kept, curves, whitener)
    return _priced(candidates, kept, curves, extension)


def first_cost(
    candidates: Candidates, kept: Candidate, curves: Sequence[Scored], whitener: FloatArray
) -> float:
    """As ``cost``, with tables that do not go on beyond their knots: a quarter of the work."""
    return _priced(candidates, kept, curves, _fitted(candidates.problem, kept, curves, whitener))


def _priced(
    candidates: Candidates, kept: Candidate, curves: Sequence[Scored], extension: Extension | None
) -> float:
    count = kept.size + sum(len(one.coefficients) for one in curves)
    return candidates.options.price * count + (np.inf if extension is None else extension.fit.cost)


def improving(
    candidates: Candidates, kept: Candidate, curves: Sequence[Scored], testing: Problem, after: Prediction
) -> Extension | None:
    """The extension with as many of the curves, the first ones, as predict test windows better.

    Better are errors whose logarithms have a lower mean over the outputs.

    Args:
        candidates: As of ``extend``.
        kept: As of ``extend``.
        curves: As of ``extend``.
        testing: Test windows.
        after: Their prediction by the named effects alone.
    """
    for count in range(len(curves), 0, -1):
        extension = extend(candidates, kept, curves[:count])
        if extension is None:
            continue
        if compared(extension.predict(testing), after) < 0.0:
            return extension
    return None


def compared(one: Prediction, other: Prediction) -> float:
    """Mean over the outputs of the logarithm of their errors by one prediction over those by another."""
    with np.errstate(divide="ignore", invalid="ignore"):  # outputs that are exact, or not measured
        logs = np.log(one.rmse() / other.rmse())
    told = logs[~np.isnan(logs)]
    return float(told.mean()) if len(told) else 0.0


def final(curves: Sequence[Scored], fitted: Fit, first: int) -> tuple[Scored, ...]:
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
