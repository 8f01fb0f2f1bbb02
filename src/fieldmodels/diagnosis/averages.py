"""How many averages a window needs: an oscillation that fits into one leaves no trace in it.

A window starts in states that no sensor sees. Averages over about a period of the machine's own oscillation
say nothing of its phase: a fit leaves it as it is, and every sample is wrong by it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.gain import Prediction, predict
from fieldmodels.diagnosis.linearisation import Fit
from fieldmodels.diagnosis.problem import Problem

FINER = 2, 4, 8  # times as many averages
SHARPER = 0.6  # of the samples' error, below which finer averages tell the starts
ALIKE = 1.1  # times the smallest error: the fewest averages that reach it are enough


def resolving(
    problem: Problem, parameters: FloatArray, refitted: Callable[[int], tuple[Problem, Fit]]
) -> int:
    """How many averages tell the windows' starts; 0 if those that there are do.

    The base is fitted to these averages and to finer ones, and compared by the error of every sample.

    Args:
        problem: Some windows.
        parameters: The whole vector of a fit to them.
        refitted: The same windows with so many averages, and the fit to them.
    """
    if problem.events.any() or problem.model.random_force or problem.runs is not None:
        return 0
    shortest = min(int(part.windows.lengths.min()) for part in problem.parts)
    counts = [times * problem.bins for times in FINER if times * problem.bins <= shortest // 2]
    prediction = predict(problem, parameters)
    present = _error(problem, prediction)
    if _of_averages(problem, prediction) >= SHARPER * present:
        return 0
    errors = {}
    for bins in counts:
        finer, fitted = refitted(bins)
        errors[bins] = _error(finer, predict(finer, fitted.parameters))
    best = min(errors.values(), default=present)
    if not best < SHARPER * present:
        return 0
    return min(bins for bins, error in errors.items() if error <= ALIKE * best)


def _error(problem: Problem, prediction: Prediction) -> float:
    """Error of the samples, of all signals the geometric mean."""
    return _mean(prediction.rmse()[np.unique(problem.outputs)])


def _of_averages(problem: Problem, prediction: Prediction) -> float:
    """The same of the averages: what they show of an error is no smaller where it is fitted more finely."""
    names = tuple(o.name for o in problem.model.outputs)
    squares, counts = np.zeros(len(names)), np.zeros(len(names))
    for part, simulated in zip(problem.parts, prediction.simulated, strict=True):
        error = np.nan_to_num(part.windows.measured(names) - simulated)
        averages = part.compressed(error[None])[0] * part.noise_ratio
        np.add.at(squares, problem.outputs, np.sum(part.counts * averages**2, axis=0))
        np.add.at(counts, problem.outputs, part.counts.sum(axis=0))
    shown = np.unique(problem.outputs)
    return _mean(np.sqrt(squares[shown] / counts[shown]))


def _mean(errors: FloatArray) -> float:
    return float(np.exp(np.mean(np.log(np.maximum(errors, 1e-300)))))
