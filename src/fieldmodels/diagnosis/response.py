"""Response of the features to a force on each basis segment of the windows.

The response to a force that varies along the windows is a combination of these, so that many shapes can be
tried without simulating each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.linearisation import Fit
from fieldmodels.diagnosis.problem import Problem
from fieldmodels.drivers.variables import SEGMENTS


@dataclass(frozen=True)
class Answers:
    """How a fit's residual answers to a unit on each segment of the windows.

    What curves would explain follows from products of these columns: none of the curves' own is needed.

    Attributes:
        columns: Whitened, states projected out, shape (windows, rows, segments).
    """

    columns: FloatArray

    @cached_property
    def products(self) -> FloatArray:
        """Of the columns of each window, shape (windows, segments, segments)."""
        return np.asarray(self.columns.transpose(0, 2, 1) @ self.columns)

    def with_all(self, others: FloatArray) -> FloatArray:
        """Products with other columns, shape (windows, segments, others).

        Args:
            others: Columns of all windows below each other, shape (windows * rows, others).
        """
        windows, rows, _ = self.columns.shape
        return np.asarray(self.columns.transpose(0, 2, 1) @ others.reshape(windows, rows, -1))


def segments(lengths: NDArray[np.int64], samples: int) -> NDArray[np.int64]:
    """Number of the segment that each sample belongs to, -1 beyond the window."""
    position = np.arange(samples)[None, :] / lengths[:, None]
    index = np.minimum((position * SEGMENTS).astype(np.int64), SEGMENTS - 1)
    return np.where(position < 1, index, -1)


def averaged(values: FloatArray, segment: NDArray[np.int64]) -> FloatArray:
    """Mean over each segment, shape (windows, segments); one without a sample has that of the one before.

    A window of a slow machine has fewer samples than segments.
    """
    result = np.zeros((len(values), SEGMENTS))
    for k in range(SEGMENTS):
        inside = (segment == k) & np.isfinite(values)
        mean = np.where(inside, values, 0.0).sum(axis=1) / np.maximum(inside.sum(axis=1), 1)
        result[:, k] = np.where(inside.any(axis=1) | (k == 0), mean, result[:, k - 1])
    return result


def sample_times(problem: Problem) -> FloatArray:
    """Mean time of every segment, shape (windows, segments)."""
    result = []
    for part in problem.parts:
        samples = part.slots.shape[1]
        rows = part.windows.starts[:, None] + np.arange(samples)
        time = part.windows.recording.time
        segment = segments(part.windows.lengths, samples)
        result.append(averaged(time[np.minimum(rows, len(time) - 1)], segment))
    return np.concatenate(result)


def odds_responses(problem: Problem, fitted: Fit, output: int) -> FloatArray:
    """Change of an event's features by its log-odds on each segment, (windows, features, segments)."""
    observations, base = problem.observations, problem.features - fitted.raw
    result = np.zeros((*base.shape, SEGMENTS))
    if observations is None:
        return result
    p = np.zeros(base.shape)
    p[:, observations.columns] = observations.probability(fitted.raw)
    first = 0
    for part in problem.parts:
        segment = segments(part.windows.lengths, part.slots.shape[1])
        window, sample = np.nonzero(part.slots[:, :, output] >= 0)
        feature = part.slots[window, sample, output]
        chance = p[first + window, feature]
        result[first + window, feature, segment[window, sample]] = chance * (1.0 - chance)
        first += len(part.windows)
    return result


def offsets(problem: Problem, output: int | None = None) -> FloatArray:
    """Change of the features by an offset of a sensor on each segment, (windows, features, segments).

    Args:
        problem: The windows.
        output: The sensor; by default all at once. What is derived from it errs, too (``Model.derived``).
    """
    result = []
    for part in problem.parts:
        segment = segments(part.windows.lengths, part.slots.shape[1])
        true = np.zeros((SEGMENTS, *part.slots.shape))
        shown = true.copy()
        own = slice(None) if output is None else slice(output, output + 1)
        shown[..., own] = (segment == np.arange(SEGMENTS)[:, None, None])[..., None]
        changed = part.compressed(problem.model.derived(true, shown, part.windows))
        result.append(np.moveaxis(changed, 0, -1))
    return np.concatenate(result)


def _on_segment(problem: Problem, k: int, size: float) -> list[FloatArray]:
    """A signal along every recording that acts on the k-th segment of each window."""
    result = []
    for part in problem.parts:
        segment = segments(part.windows.lengths, part.slots.shape[1])
        signal = np.zeros(len(part.windows.recording))
        window, sample = np.nonzero(segment == k)
        signal[part.windows.starts[window] + sample] = size
        result.append(signal)
    return result


def responses(
    problem: Problem, fitted: Fit, directions: Sequence[str] | None = None
) -> dict[str, FloatArray]:
    """Change of the features by a unit force on each segment, (windows, features, segments), by direction.

    A model that accepts no force gets an offset of its outputs instead.

    Args:
        problem: The windows.
        fitted: What they are fitted by.
        directions: Names of the directions; by default all of the model's.
    """
    pushes = [p for p in problem.model.pushes if directions is None or p.name in directions]
    needed = np.any([push.weights for push in pushes], axis=0)
    if not problem.model.disturbance_unit:
        return {"": offsets(problem)}
    base, columns = problem.features - fitted.raw, len(pushes[0].weights)
    result = np.zeros((columns, *base.shape, SEGMENTS))
    for column in np.flatnonzero(needed):
        axis, size = np.eye(columns)[column], 1.0
        for k in range(SEGMENTS):
            for _ in range(2 if k == 0 else 1):
                signals = _on_segment(problem, k, size)
                forces = signals if columns == 1 else [np.multiply.outer(one, axis) for one in signals]
                change = problem.response(fitted.parameters, fitted.states, forces) - base
                if k == 0:
                    # Small against the motion, so that the response is linear.
                    size *= float(np.sqrt(np.mean(fitted.raw**2) / (np.mean(change**2) + 1e-300)))
            result[column, :, :, k] = change / size
    result = np.where(np.isfinite(result), result, 0.0)
    return {push.name: np.tensordot(push.weights, result, 1) for push in pushes}
