"""Response of the features to a force on each basis segment of the windows.

The response to a force that varies along the windows is a combination of these, so that many shapes can be
tried without simulating each.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import BoolArray, FloatArray, IntArray
from fieldmodels.compiled import compiled
from fieldmodels.diagnosis.linearisation import Fit
from fieldmodels.diagnosis.problem import Part, Problem
from fieldmodels.diagnosis.shapes import Curve
from fieldmodels.drivers.curved import smooth
from fieldmodels.drivers.variables import SEGMENTS, given
from fieldmodels.model import ForceDirection

LITTLE = (
    0.01  # of the errors, that a place moves the features: accelerations grow with the square of its pace
)
SITES = 24  # of a variable, between which a curve of a place is a spline


@dataclass(frozen=True)
class Answers:
    """How a fit's residual answers to a unit on each segment of the windows.

    What curves would explain follows from products of these columns: none of the curves' own is needed.

    Attributes:
        columns: Whitened, states projected out, shape (windows, rows, segments).
        felt: Windows on whose segments each answers, see ``felt_from``; None where it is only its own.
        sites: Of the answers to a place, see ``place_responses``; they stand for segments.
    """

    columns: FloatArray
    felt: IntArray | None = None
    sites: FloatArray | None = None

    def of(self, curve: Curve) -> FloatArray:
        """What each of a curve's columns is on all that a window answers to, (windows, segments, columns)."""
        if curve.place == "parameter":
            return curve.values[:, None, :]
        if self.sites is not None:
            at = smooth(curve.knots, curve.shapes)(self.sites)
            return np.broadcast_to(at, (len(self.columns), *at.shape))
        return self.spread(curve.values)

    def spread(self, values: FloatArray) -> FloatArray:
        """What is given on the segments of every window, (windows, segments, ...), on all of ``felt``."""
        if self.felt is None:
            return values
        return values[self.felt].reshape(len(values), -1, *values.shape[2:])

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
    return _averaged(np.ascontiguousarray(values, dtype=np.float64), segment)


@compiled
def _averaged(values: FloatArray, segment: IntArray) -> FloatArray:
    windows, samples = values.shape
    result = np.zeros((windows, SEGMENTS))
    for w in range(windows):
        counts = np.zeros(SEGMENTS)
        for n in range(samples):
            if segment[w, n] >= 0 and math.isfinite(values[w, n]):
                result[w, segment[w, n]] += values[w, n]
                counts[segment[w, n]] += 1.0
        for k in range(SEGMENTS):
            if counts[k] > 0.0:
                result[w, k] /= counts[k]
            elif k > 0:
                result[w, k] = result[w, k - 1]
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


def mean_outputs(problem: Problem, fitted: Fit, output: int) -> FloatArray:
    """Mean of a simulated output on every segment, shape (windows, segments)."""
    simulated = problem.samples(fitted.parameters, fitted.states)
    return np.concatenate([
        averaged(one[:, :, output], segments(part.windows.lengths, one.shape[1]))
        for part, one in zip(problem.parts, simulated, strict=True)
    ])  # fmt: skip


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


def offsets(problem: Problem, output: int | None = None, fitted: Fit | None = None) -> FloatArray:
    """Change of the features by an offset of a sensor on each segment, (windows, features, segments).

    Args:
        problem: The windows.
        output: The sensor; by default all at once. What is derived from it errs, too (``Model.derived``).
        fitted: Gives the motion of which an observer takes a part of the offset for.
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
    whole = np.concatenate(result)
    if fitted is not None and output is not None and problem.model.corrected:
        whole -= _believed(problem, fitted, output)
    return whole


def _believed(problem: Problem, fitted: Fit, output: int) -> FloatArray:
    """What an observer makes of an offset on each segment, (windows, features, segments)."""
    name, base = problem.model.outputs[output].name, problem.features - fitted.raw
    size = float(np.sqrt(np.mean(fitted.raw[:, problem.outputs == output] ** 2)))
    result = np.zeros((*base.shape, SEGMENTS))
    number = np.arange(len(base))
    # Windows in turn: what is shown in one is believed in the next one, too.
    for k, turn in itertools.product(range(SEGMENTS), range(2)):
        parts, first = [], 0
        for part in problem.parts:
            acting = number[first : first + len(part.windows)] % 2 == turn
            segment = segments(part.windows.lengths, part.slots.shape[1])
            errors = size * ((segment == k) & acting[:, None])
            parts.append(replace(part, windows=part.windows.with_errors(name, errors)))
            first += len(part.windows)
        changed = replace(problem, parts=tuple(parts)).simulate(fitted.parameters[None], fitted.states)[0]
        result[turn::2, :, k] = (base - changed)[turn::2] / size
    return result


def felt_from(problem: Problem) -> IntArray | None:
    """Windows of which each feels what acts in them: itself and those before it, shape (windows, felt).

    Where there is no such window its own number stands.

    Returns:
        None where windows have starts of their own, and feel only what acts in themselves.
    """
    lags = _lags(problem)
    if len(lags) == 1:
        return None
    found, first = [], 0
    for part in problem.parts:
        run, place = _places(part)
        known = {one: w for w, one in enumerate(zip(run.tolist(), place.tolist(), strict=True))}
        rows = [
            [known.get((r, p - lag), w) for lag in lags]
            for w, (r, p) in enumerate(zip(run.tolist(), place.tolist(), strict=True))
        ]
        found.append(first + np.array(rows, dtype=np.int64))
        first += len(part.windows)
    return np.concatenate(found)


def _lags(problem: Problem) -> range:
    """How many windows later what acts in one is felt."""
    lasting = problem.model.lasting
    if not lasting > 0.0:
        return range(1)
    return range(1 + math.ceil(lasting / problem.horizon))


def _places(part: Part) -> tuple[IntArray, IntArray]:
    """Run of every window, and its place in that."""
    windows = part.windows
    bounds = windows.recording.bounds[:, 0]
    run = np.searchsorted(bounds, windows.starts, side="right") - 1
    return run.astype(np.int64), (windows.starts - bounds[run]) // windows.samples


def _on_segment(problem: Problem, k: int, acting: BoolArray) -> list[FloatArray]:
    """A signal along every recording that is one on the k-th segment of some windows."""
    result, first = [], 0
    for part in problem.parts:
        segment = segments(part.windows.lengths, part.slots.shape[1])
        inside = acting[first : first + len(part.windows)]
        window, sample = np.nonzero((segment == k) & inside[:, None])
        signal = np.zeros(len(part.windows.recording))
        signal[part.windows.starts[window] + sample] = 1.0
        result.append(signal)
        first += len(part.windows)
    return result


def responses(
    problem: Problem, fitted: Fit, directions: Sequence[str] | None = None
) -> dict[str, FloatArray]:
    """Change of the features by a unit force on each segment, by direction.

    A model that accepts no force gets an offset of its outputs instead.

    Args:
        problem: The windows.
        fitted: What they are fitted by.
        directions: Names of the directions; by default all of the model's, but for places (``moves``).

    Returns:
        Shape (windows, features, segments); where windows feel what acted before, (windows, features, felt *
        segments), see ``felt_from``.
    """
    pushes = [p for p in problem.model.pushes if (p.name in directions if directions else not p.moves)]
    needed = np.any([push.weights for push in pushes], axis=0)
    if not problem.model.disturbance_unit:
        return {"": offsets(problem)}
    felt = felt_from(problem)
    lags = np.arange(1 if felt is None else felt.shape[1])
    shape, columns = problem.features.shape, len(pushes[0].weights)
    result = np.zeros((columns, *shape, len(lags), SEGMENTS))
    places = np.concatenate([_places(part)[1] for part in problem.parts])
    own = np.arange(len(places))[:, None]
    there = np.ones((len(places), 1), dtype=np.bool_) if felt is None else (felt != own) | (lags == 0)
    for column in np.flatnonzero(needed):
        answer = _Small(problem, fitted, np.eye(columns)[column])
        # Windows of each turn are so far apart that it is known which of them is felt.
        for k, turn in itertools.product(range(SEGMENTS), lags):
            change = answer(_on_segment(problem, k, places % len(lags) == turn))
            window, lag = np.nonzero(there & ((places[:, None] - lags) % len(lags) == turn))
            result[column, window, :, lag, k] = change[window]
    result = result.reshape(columns, *shape, -1)
    return {push.name: np.tensordot(push.weights, result, 1) for push in pushes}


class _Small:
    """Change of the features by a signal in one direction, small against the motion, so that it is linear."""

    def __init__(self, problem: Problem, fitted: Fit, weights: FloatArray, share: float = 1.0) -> None:
        self._problem, self._fitted, self._weights = problem, fitted, weights
        self._base, self._share, self._size = problem.features - fitted.raw, share, 0.0

    def __call__(self, signals: Sequence[FloatArray]) -> FloatArray:
        """Of a unit of signals along the recordings, shape (windows, features); zero where it is infinite."""
        if not self._size:
            errors, change = np.mean(self._fitted.raw**2), self._change(signals, 1.0)
            self._size = self._share * float(np.sqrt(errors / (np.mean(change**2) + 1e-300)))
        change = self._change(signals, self._size) / self._size
        return np.where(np.isfinite(change), change, 0.0)

    def _change(self, signals: Sequence[FloatArray], size: float) -> FloatArray:
        alone, weights = len(self._weights) == 1, size * self._weights
        forces = [weights[0] * one if alone else np.multiply.outer(one, weights) for one in signals]
        return self._problem.response(self._fitted.parameters, self._fitted.states, forces) - self._base


def sites_over(values: FloatArray) -> FloatArray:
    """Values of a variable through which a curve of a place is a spline, shape (SITES,)."""
    return np.linspace(values.min(), values.max(), SITES)


def place_responses(problem: Problem, fitted: Fit, push: ForceDirection, over: str) -> FloatArray:
    """Change of the features by a place that is one at a site of a variable, (windows, features, sites).

    Second derivatives of a place act, so that it cannot be put together from segments; but it depends on
    nothing but what the machine is told, so that a few splines over that make every curve.

    Args:
        problem: The windows.
        fitted: What they are fitted by.
        push: The direction.
        over: The variable.
    """
    told = [given(problem.model, part.windows.recording, over) for part in problem.parts]
    sites = sites_over(np.concatenate(told))
    answer = _Small(problem, fitted, np.array(push.weights), LITTLE)
    return np.stack([answer([smooth(sites, unit)(v) for v in told]) for unit in np.eye(SITES)], axis=2)
