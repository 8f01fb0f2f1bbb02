"""Gain in prediction accuracy on data that were used neither for fits nor for selection."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.fit import fit
from fieldmodels.diagnosis.problem import Problem, build
from fieldmodels.diagnosis.result import HorizonGain, Share
from fieldmodels.diagnosis.whitening import whitener_by_output
from fieldmodels.recording import RecordingError

RESAMPLES = 1000
NONE = np.zeros(0, dtype=np.int64)
FEWEST = 4  # windows at another horizon that suffice for a gain


@dataclass(frozen=True)
class Prediction:
    """Errors of one parameter vector on the windows of a problem.

    Each window starts from the state that fits that window best (the measured one is its prior), so
    that noise of the measured initial state does not mask model errors. All parameter vectors are treated
    the same way.

    Attributes:
        simulated: Outputs of each recording's windows, shape (windows, samples, outputs) each.
        squares: Sum of squared errors by window and output, shape (windows, outputs).
        counts: Observed samples by window and output, shape (windows, outputs).
        states: The start of each window that fits it best, shape (windows, states).
    """

    simulated: list[FloatArray]
    squares: FloatArray
    counts: FloatArray
    states: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))

    def rmse(self) -> FloatArray:
        """Root mean square error by output; NaN for an output that was not measured."""
        return np.asarray(np.sqrt(_ratio(self.squares.sum(axis=0), self.counts.sum(axis=0))))


def predict(problem: Problem, parameters: FloatArray, wandering: Sequence[int] = ()) -> Prediction:
    """Predict every window with its best initial state, and nothing else that was measured in it.

    Args:
        problem: The windows.
        parameters: The whole vector.
        wandering: Outputs whose zero is free in each window.
    """
    key = parameters.tobytes(), tuple(wandering)
    if key not in problem.predicted:
        problem.predicted[key] = _predicted(problem, parameters, wandering)
    prediction: Prediction = problem.predicted[key]
    return prediction


def _predicted(problem: Problem, parameters: FloatArray, wandering: Sequence[int]) -> Prediction:
    if problem.model.corrected:
        problem = replace(problem, model=problem.model.running_free())
    apart = np.eye(len(problem.outputs))
    for j in wandering:
        own = (problem.outputs == j).astype(np.float64)
        apart -= np.outer(own, own) / own.sum()
    raw = problem.features - problem.simulate(parameters[None], problem.states)[0]
    states = problem.states
    for _ in range(3):
        # Signals are weighted by their residuals, which the measured states still inflate at first.
        fitted = fit(problem, parameters, NONE, whitener_by_output(problem, raw @ apart) @ apart, states, 5)
        raw, states = fitted.raw, fitted.states
    simulated = problem.samples(parameters, fitted.states)
    outputs = tuple(o.name for o in problem.model.outputs)
    squares, counts = [], []
    used = np.isin(np.arange(len(outputs)), problem.outputs)
    for part, values in zip(problem.parts, simulated, strict=True):
        error = part.windows.measured(outputs) - values
        seen = np.isfinite(error) & used
        for j in wandering:
            known = np.isfinite(error[:, :, j]).sum(axis=1, keepdims=True)  # 0 where a simulation failed
            means = np.nansum(error[:, :, j], axis=1, keepdims=True) / np.maximum(known, 1)
            error[:, :, j] -= means
        squares.append((np.where(seen, error, 0.0) ** 2).sum(axis=1))
        counts.append(seen.sum(axis=1))
    return Prediction(
        simulated, np.concatenate(squares), np.concatenate(counts).astype(np.float64), fitted.states
    )


def share(
    before: Prediction,
    after: Prediction,
    output: int,
    blocks: NDArray[np.int64],
    rng: np.random.Generator,
) -> Share:
    """Reduction of an output's root mean square error in percent, resampled by blocks of windows."""
    number = np.unique(blocks, return_inverse=True)[1]
    count = int(number.max()) + 1
    sums = np.stack([
        np.bincount(number, weights=column[:, output], minlength=count)
        for column in (before.squares, after.squares)
    ])  # fmt: skip
    draws = rng.integers(0, count, size=(RESAMPLES, count))
    resampled = sums[:, draws].sum(axis=2)
    gains = _percent(resampled[0], resampled[1])
    low, high = np.percentile(gains, [2.5, 97.5])
    total = sums.sum(axis=1)
    return Share(float(_percent(total[:1], total[1:])[0]), (float(low), float(high)))


def by_horizon(
    testing: Problem,
    before: FloatArray,
    extended: tuple[Problem, FloatArray],
    rng: np.random.Generator,
) -> dict[str, tuple[HorizonGain, ...]]:
    """Gain of every signal at each of the model's horizons, on the same test data.

    Args:
        testing: Test windows at the main horizon; windows of other lengths are cut from these.
        before: Parameter vector of the refitted base.
        extended: The test windows with the model of the extended simulation, and its whole vector.
        rng: Source of the resampling.
    """
    model = testing.model
    result: dict[str, list[HorizonGain]] = {model.outputs[j].name: [] for j in np.unique(testing.outputs)}
    for horizon in model.horizons:
        problem = testing if horizon == testing.horizon else _within(testing, horizon)
        if problem is None:
            continue
        own = extended[0] if problem is testing else replace(problem, model=extended[0].model)
        first, last = predict(problem, before), predict(own, extended[1])
        for j in np.unique(problem.outputs):
            gain = share(first, last, int(j), problem.blocks, rng)
            errors = float(first.rmse()[j]), float(last.rmse()[j])
            result[model.outputs[j].name].append(HorizonGain(horizon, *errors, gain, len(problem)))
    return {name: tuple(rows) for name, rows in result.items()}


def _within(testing: Problem, horizon: float) -> Problem | None:
    """Windows of another length on the samples that test windows cover; None if they are too few.

    Samples between test windows have been used for fits and selection.
    """
    recordings = [part.windows.recording for part in testing.parts]
    try:
        bins = round(testing.bins * horizon / testing.horizon) if testing.fine else 0
        problem = build(testing.model, recordings, horizon, None, 0.0, bins)
    except RecordingError:
        return None
    inside = []
    for part in problem.parts:
        free = np.zeros(len(part.windows.recording), dtype=np.bool_)
        for own in testing.parts:
            if own.windows.recording.time is part.windows.recording.time:  # a model may add signals to it
                for start, length in zip(own.windows.starts, own.windows.lengths, strict=True):
                    free[start : start + length] = True
        covered = np.concatenate([[0], np.cumsum(free)])
        starts, lengths = part.windows.starts, part.windows.lengths
        inside.append(covered[starts + lengths] - covered[starts] == lengths)
    kept = np.concatenate(inside)
    return problem.select(kept) if kept.sum() >= FEWEST else None


def noise_floor(problem: Problem, prediction: Prediction, output: int) -> float:
    """Standard deviation of an output's white noise, from second differences of the errors.

    Differences are clipped to their 1st and 99th percentile before the root mean square is taken. It is no
    less than what can be resolved (see ``resolution``). For an event it is the error that remains if its
    simulated probability p is right: the root mean of p (1 - p).
    """
    outputs = tuple(o.name for o in problem.model.outputs)
    if problem.model.outputs[output].event:
        return _chance(problem, prediction, output)
    differences = []
    for part, simulated in zip(problem.parts, prediction.simulated, strict=True):
        error = (part.windows.measured(outputs) - simulated)[:, :, output]
        second = np.diff(error, 2, axis=1)
        differences.append(second[np.isfinite(second)])
    values = np.concatenate(differences)
    if len(values) < 20:
        return float("nan")
    white = float(np.sqrt(np.mean(np.clip(values, *np.percentile(values, [1, 99])) ** 2) / 6))
    return max(white, problem.resolved(output))


def _chance(problem: Problem, prediction: Prediction, output: int) -> float:
    names = tuple(o.name for o in problem.model.outputs)
    probabilities = []
    for part, simulated in zip(problem.parts, prediction.simulated, strict=True):
        seen = np.isfinite(part.windows.measured(names)[:, :, output])
        probabilities.append(simulated[:, :, output][seen])
    p = np.concatenate(probabilities)
    return float(np.sqrt(np.mean(p * (1.0 - p)))) if len(p) else float("nan")


def _percent(before: FloatArray, after: FloatArray) -> FloatArray:
    return np.asarray(100 * (1 - np.sqrt(_ratio(after, before))))


def _ratio(above: FloatArray, below: FloatArray) -> FloatArray:
    return np.asarray(np.divide(above, below, out=np.full_like(above, np.nan), where=below > 0))
