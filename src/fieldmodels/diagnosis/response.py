"""How the features respond to a force on each stretch of the windows.

A force that varies in any way along the windows is then a combination of these responses, so that many
shapes can be tried without simulating each.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.fit import Fit
from fieldmodels.diagnosis.problem import Problem

STRETCHES = 16  # pieces of a window on which a force is constant


def stretches(lengths: NDArray[np.int64], samples: int) -> NDArray[np.int64]:
    """Number of the stretch that each sample belongs to, -1 beyond the window."""
    position = np.arange(samples)[None, :] / lengths[:, None]
    index = np.minimum((position * STRETCHES).astype(np.int64), STRETCHES - 1)
    return np.where(position < 1, index, -1)


def averaged(values: FloatArray, stretch: NDArray[np.int64]) -> FloatArray:
    """Mean over each stretch, shape (windows, stretches)."""
    result = np.zeros((len(values), STRETCHES))
    for k in range(STRETCHES):
        inside = (stretch == k) & np.isfinite(values)
        result[:, k] = np.where(inside, values, 0.0).sum(axis=1) / np.maximum(inside.sum(axis=1), 1)
    return result


def sample_times(problem: Problem) -> FloatArray:
    """Mean time of every stretch, shape (windows, stretches)."""
    result = []
    for part in problem.parts:
        samples = part.slots.shape[1]
        rows = part.windows.starts[:, None] + np.arange(samples)
        time = part.windows.recording.time
        stretch = stretches(part.windows.lengths, samples)
        result.append(averaged(time[np.minimum(rows, len(time) - 1)], stretch))
    return np.concatenate(result)


def odds_responses(problem: Problem, fitted: Fit, output: int) -> FloatArray:
    """Change of an event's features by its log-odds on each stretch, (windows, features, stretches)."""
    looks, base = problem.looks, problem.features - fitted.raw
    result = np.zeros((*base.shape, STRETCHES))
    if looks is None:
        return result
    p = np.zeros(base.shape)
    p[:, looks.columns] = looks.probability(fitted.raw)
    first = 0
    for part in problem.parts:
        stretch = stretches(part.windows.lengths, part.slots.shape[1])
        window, sample = np.nonzero(part.slots[:, :, output] >= 0)
        feature = part.slots[window, sample, output]
        chance = p[first + window, feature]
        result[first + window, feature, stretch[window, sample]] = chance * (1.0 - chance)
        first += len(part.windows)
    return result


def responses(problem: Problem, fitted: Fit) -> FloatArray:
    """Change of the features by a unit force on each stretch, shape (windows, features, stretches).

    A model without such an entry gets an offset of its outputs instead.
    """
    base = problem.features - fitted.raw
    result = np.zeros((*base.shape, STRETCHES))
    size = 1.0
    for k in range(STRETCHES):
        forces = []
        for part in problem.parts:
            stretch = stretches(part.windows.lengths, part.slots.shape[1])
            force = np.zeros(len(part.windows.recording))
            window, sample = np.nonzero(stretch == k)
            force[part.windows.starts[window] + sample] = 1.0
            forces.append(force)
        if not problem.model.disturbance_unit:
            result[:, :, k] = problem.average(forces)
            continue
        for _ in range(2 if k == 0 else 1):
            change = problem.response(fitted.parameters, fitted.states, [size * f for f in forces]) - base
            if k == 0:
                # Small against the motion, so that the response is linear.
                size *= float(np.sqrt(np.mean(fitted.raw**2) / (np.mean(change**2) + 1e-300)))
        result[:, :, k] = change / size
    return np.where(np.isfinite(result), result, 0.0)
