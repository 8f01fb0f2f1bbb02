"""How much of an error may be anything's: what remains of it above the sensor's white noise.

A curve over one signal shows from a certain size on (``power``). What depends on nothing measured, on several
signals at once, or acts seldom need not, but it adds no more to an error than is there beside the noise:
squares add. What changes by chance from sample to sample cannot be told from a sensor's noise, and counts as
that.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fieldmodels.arrays import FloatArray, IntArray
from fieldmodels.diagnosis.gain import NONE, Prediction, noise_floor
from fieldmodels.diagnosis.linearisation import linearise
from fieldmodels.diagnosis.problem import Problem
from fieldmodels.diagnosis.whitening import whitener_by_output

LIMIT = 1.645
"""Standard errors above a mean square that one record in twenty exceeds."""


def may_add(problem: Problem, prediction: Prediction, parameters: FloatArray) -> FloatArray:
    """The most that anything may add to each output's error, white noise aside (95 % upper limit).

    Args:
        problem: Windows that were not fitted.
        prediction: Of these windows.
        parameters: Of what predicts, whole vector.

    Returns:
        Root mean square in the output's unit, shape (outputs,); NaN for an output that is not measured. Where
        the noise is unknown it is the whole error.
    """
    counts = prediction.counts.sum(axis=0)
    kept = 1.0 - _absorbed(problem, prediction, parameters) / np.maximum(counts, 1.0)
    result = np.full(len(counts), np.nan)
    for j in np.unique(problem.outputs):
        mean, error = mean_square(prediction.squares[:, j], prediction.counts[:, j], problem.blocks)
        noise = np.nan_to_num(noise_floor(problem, prediction, int(j))) ** 2 * kept[j]
        result[j] = np.sqrt(max(mean - noise, 0.0) + LIMIT * error)
    return result


def mean_square(squares: FloatArray, counts: FloatArray, blocks: IntArray) -> tuple[float, float]:
    """Mean square of the samples of all windows, and its standard error over blocks (of a ratio)."""
    number = np.unique(blocks, return_inverse=True)[1]
    mean = float(squares.sum() / counts.sum())
    off = np.bincount(number, squares - mean * counts)
    return mean, float(np.sqrt(np.sum(off**2) * len(off) / max(len(off) - 1, 1)) / counts.sum())


def _absorbed(problem: Problem, prediction: Prediction, parameters: FloatArray) -> FloatArray:
    """How many samples' noise of each output the fitted starts of windows absorb, shape (outputs,)."""
    if problem.model.corrected:
        problem = replace(problem, model=problem.model.running_free())
    raw = problem.features - problem.simulate(parameters[None], prediction.states)[0]
    whitener = whitener_by_output(problem, raw)
    fitted = linearise(problem, parameters, NONE, whitener, prediction.states, raw)
    taken = np.sum(fitted.basis[:, : len(whitener)] ** 2, axis=(0, 2))
    return np.bincount(
        problem.outputs, np.where(problem.events, 0.0, taken), prediction.counts.shape[1]
    ).astype(np.float64)
