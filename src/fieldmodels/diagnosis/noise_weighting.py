"""Noise weighting: recordings of unequal noise are scaled, so that a noisy one does not dominate the fit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.gain import Prediction, noise_floor
from fieldmodels.diagnosis.problem import Problem

UNEQUAL = 1.5  # ratio of two recordings' noise from which on they are weighted
LIMIT = 20.0  # largest ratio: a sensor at rest may have no noise at all


def weighted_by_noise(training: Problem, testing: Problem, parameters: FloatArray) -> tuple[Problem, Problem]:
    """Divide each recording's features by the ratio of its noise to the training data's average noise.

    Noise is estimated from second differences of the error, which hardly depend on the parameters, so they
    need not be fitted yet. Recordings of about equal noise are left unchanged.

    Args:
        training: Windows for the fits and the selection.
        testing: Windows on which the gain is measured.
        parameters: Any vector for which the simulation is finite.
    """
    problems = training, testing
    levels = [_noise(problem, parameters) for problem in problems]
    usual = np.array([np.exp(_mean(np.log(column))) for column in levels[0].T])
    ratios = [np.clip(np.nan_to_num(level / usual, nan=1.0), 1 / LIMIT, LIMIT) for level in levels]
    if max(np.abs(np.log(ratio)).max() for ratio in ratios) < np.log(UNEQUAL):
        return training, testing
    return _divided(training, ratios[0]), _divided(testing, ratios[1])


def _noise(problem: Problem, parameters: FloatArray) -> FloatArray:
    """Noise of each recording and output, NaN where it is unknown, shape (parts, outputs)."""
    simulated = problem.samples(parameters, problem.states)
    result = np.full((len(simulated), len(problem.model.outputs)), np.nan)
    for i, (part, outputs) in enumerate(zip(problem.parts, simulated, strict=True)):
        one = replace(problem, parts=(part,))
        prediction = Prediction([outputs], np.zeros(0), np.zeros(0))
        for j in np.unique(problem.outputs[~problem.events]):
            result[i, j] = noise_floor(one, prediction, int(j))
    return np.where(result > 0, result, np.nan)


def _mean(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")


def _divided(problem: Problem, ratios: FloatArray) -> Problem:
    parts = []
    for part, ratio in zip(problem.parts, ratios, strict=True):
        noise_ratio = np.where(problem.events, 1.0, ratio[problem.outputs])
        parts.append(replace(part, features=part.features / noise_ratio, noise_ratio=noise_ratio))
    return replace(problem, parts=tuple(parts))
