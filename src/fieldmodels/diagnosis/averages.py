"""How many averages a window needs: an oscillation that fits into one leaves no trace in it.

A window starts in states that no sensor sees. Averages over about a period of the machine's own oscillation
say nothing of its phase: a fit leaves it as it is, and every sample is wrong by it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.gain import predict
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
    present = _error(problem, parameters)
    errors = {}
    for bins in counts:
        finer, fitted = refitted(bins)
        errors[bins] = _error(finer, fitted.parameters)
    best = min(errors.values(), default=present)
    if not best < SHARPER * present:
        return 0
    return min(bins for bins, error in errors.items() if error <= ALIKE * best)


def _error(problem: Problem, parameters: FloatArray) -> float:
    """Error of the samples, of all signals the geometric mean."""
    errors = predict(problem, parameters).rmse()[np.unique(problem.outputs)]
    return float(np.exp(np.mean(np.log(np.maximum(errors, 1e-300)))))
