"""Values that vary by chance: errors are larger where a named value matters more, whichever way they point.

A gain, a delay or a friction that changes from moment to moment is on average what it is named for, but the
name alone explains only that average. What is left then grows with how strongly the simulation depends on the
value, while noise of a sensor does not.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np
from scipy import stats

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.candidates import Candidate
from fieldmodels.diagnosis.gain import noise_floor, predict
from fieldmodels.diagnosis.phrases import CHANCE
from fieldmodels.diagnosis.problem import IntArray, Problem
from fieldmodels.diagnosis.resolution import rounding

LEVEL = 0.002
"""Share of steady values that are said to vary: the least p-value of a value's tests, times their number."""
FEWEST = 30
"""Windows that suffice for a test."""
STEP = 0.05
"""Of a value, by which it is changed to see where it matters."""
COARSE = 0.3
"""Of an output's white noise, above which the rounding of its numbers makes up the error when it moves."""


def varying_by_chance(problem: Problem, kept: Candidate) -> Mapping[str, str]:
    """Named effects whose values seem to vary by chance, each with that in words.

    Tested is, sample by sample of every output, whether squared errors go with the squared sensitivity to a
    parameter: errors themselves, which a value in front of the motion moves, and their second differences,
    which a value in front of a sensor does. Left out are events, data without noise, coarse sensors, and
    machines that chance drives anyhow.
    """
    fitted, model = kept.fit, problem.model
    if model.random_force or fitted.observations is not None or len(problem) < FEWEST:
        return {}
    if not kept.effects or problem.is_exact(fitted.raw):
        return {}
    result = {}
    for name in kept.effects:
        p_values = list(_tests(problem, kept, name))
        if p_values and len(p_values) * min(p_values) < LEVEL:
            result[name] = f"{CHANCE}{name.replace('_', ' ')}"
    return result


def _tests(problem: Problem, kept: Candidate, name: str) -> Iterator[float]:
    """p-values of an effect: of each of its parameters and each output, with and without differences."""
    fitted, model = kept.fit, problem.model
    names, place = tuple(o.name for o in model.outputs), model.slice_of(name)
    prediction = predict(problem, fitted.parameters)
    measured = [part.windows.measured(names) for part in problem.parts]
    errors = [shown - own for shown, own in zip(measured, prediction.simulated, strict=True)]
    outputs = [
        j
        for j in np.unique(problem.outputs).tolist()
        if rounding(np.concatenate([shown[:, :, j].ravel() for shown in measured]))
        < COARSE * math.sqrt(12.0) * noise_floor(problem, prediction, j)
    ]
    for i in fitted.free[fitted.active]:
        if not place.start <= i < place.stop:
            continue
        moved = fitted.parameters.copy()
        moved[i] += STEP * moved[i] if moved[i] else 1e-6
        changes = [
            other - own
            for other, own in zip(
                problem.samples(moved, prediction.states), prediction.simulated, strict=True
            )
        ]
        for j in outputs:
            both = [(e[:, :, j], c[:, :, j]) for e, c in zip(errors, changes, strict=True)]
            yield _p_value(both, problem.blocks)
            yield _p_value([(np.diff(e, 2, axis=1), c[:, 1:-1]) for e, c in both], problem.blocks)


def _p_value(pairs: list[tuple[FloatArray, FloatArray]], blocks: IntArray) -> float:
    """One-sided p-value, by a t-test over blocks of windows, that errors go with sensitivities in size.

    Both are compared by their ranks among samples as late in their windows, as both may grow from its start.

    Args:
        pairs: Errors and sensitivities of each recording, shape (windows, samples) each.
        blocks: Block of each window of all recordings.
    """
    covariances = []
    for error, change in pairs:
        seen = np.isfinite(error)
        ranks = [
            stats.rankdata(np.where(seen, values**2, np.nan), axis=0, nan_policy="omit")
            for values in (error, change)
        ]
        counts = [np.maximum(np.isfinite(r).sum(axis=0), 1) for r in ranks]  # a late sample may have none
        centred = [r - np.nansum(r, axis=0) / n for r, n in zip(ranks, counts, strict=True)]
        covariances.append(np.nansum(centred[0] * centred[1], axis=1) / max(len(error), 1) ** 2)
    number = np.unique(blocks, return_inverse=True)[1]
    sums = np.bincount(number, weights=np.concatenate(covariances))
    if np.ptp(sums) == 0.0:
        return 1.0
    return float(stats.ttest_1samp(sums, 0.0, alternative="greater").pvalue)
