"""Data for the figures of a report: predictions and measurements, residuals, correlations."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.candidates import Candidate
from fieldmodels.diagnosis.correlation import correlations
from fieldmodels.diagnosis.events import calibration
from fieldmodels.diagnosis.free_run import first_stretch
from fieldmodels.diagnosis.gain import Prediction, predict
from fieldmodels.diagnosis.problem import Problem
from fieldmodels.diagnosis.result import Evidence
from fieldmodels.diagnosis.selection import Selection

DRAWN = 1500  # samples of a trace
BINS = 24


def collect(
    training: Problem,
    testing: Problem,
    selection: Selection,
    chosen: Candidate,
    predictions: tuple[Prediction, Prediction],
    ranking: tuple[tuple[str, float, float, str], ...],
    rng: np.random.Generator,
    brief: bool = False,
) -> Evidence:
    """Collect the data for the figures.

    Args:
        training: Windows used for selection.
        testing: Windows not used for it.
        selection: Its result, with the refitted base.
        chosen: The extended simulation.
        predictions: Of the test windows, by the base and by the extended simulation.
        ranking: Rows as in ``Evidence.ranking``.
        rng: Source of randomness.
        brief: Whether residuals and correlations are left out, which take as long as all the rest.
    """
    before, after = selection.base.fit.parameters, chosen.fit.parameters
    return Evidence(
        traces=_traces(testing, *predictions),
        residuals={} if brief else _residuals(training, before, after),
        correlations=() if brief else correlations(testing, after, *predictions, rng),
        calibration=_calibration(testing, *predictions),
        ranking=ranking,
        base=before[: len(training.model.names)],
        stretch=first_stretch(testing.parts[0].windows.recording, testing.horizon),
    )


def _used(problem: Problem) -> list[int]:
    return [int(j) for j in np.unique(problem.outputs)]


def _traces(problem: Problem, before: Prediction, after: Prediction) -> dict[str, dict[str, FloatArray]]:
    """Consecutive test windows of the first recording."""
    part = problem.parts[0]
    count = max(1, DRAWN // part.windows.samples)
    rows = part.windows.starts[:count, None] + np.arange(part.windows.samples)
    recording = part.windows.recording
    time = recording.time[np.minimum(rows, len(recording) - 1)]
    outputs = tuple(o.name for o in problem.model.outputs)
    measured = part.windows.measured(outputs)[:count]
    first, last = (p.simulated[0][:count] for p in (before, after))
    return {
        outputs[j]: {
            "time": time,
            "measured": measured[:, :, j],
            "before": first[:, :, j],
            "after": last[:, :, j],
        }
        for j in _used(problem)
    }


def _calibration(
    problem: Problem, before: Prediction, after: Prediction
) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Predicted against observed frequency of every event signal."""
    outputs = tuple(o.name for o in problem.model.outputs)
    measured = [part.windows.measured(outputs) for part in problem.parts]
    result = {}
    for j in _used(problem):
        if not problem.model.outputs[j].event:
            continue
        seen = [np.isfinite(values[:, :, j]) for values in measured]
        happened = np.concatenate([values[:, :, j][s] for values, s in zip(measured, seen, strict=True)])
        first, last = (
            np.concatenate([one[:, :, j][s] for one, s in zip(p.simulated, seen, strict=True)])
            for p in (before, after)
        )
        result[outputs[j]] = calibration(first, happened), calibration(last, happened)
    return result


def _residuals(problem: Problem, before: FloatArray, after: FloatArray) -> dict[str, dict[str, FloatArray]]:
    """Mean residual with its standard error in bins of time, the signals and the inputs.

    Rows of each array: centre of the bin, mean before, its standard error, mean after, its standard error.
    """
    outputs = tuple(o.name for o in problem.model.outputs)
    errors: dict[int, list[FloatArray]] = {j: [] for j in _used(problem)}
    against: dict[str, list[FloatArray]] = {}
    windows_of: list[NDArray[np.int64]] = []
    first, last = predict(problem, before), predict(problem, after)
    recordings = [part.windows.recording for part in problem.parts]
    inputs = [s.name for s in problem.model.inputs if max(len(np.unique(r[s.name])) for r in recordings) > 2]
    offset = 0
    for part, a, b in zip(problem.parts, first.simulated, last.simulated, strict=True):
        recording = part.windows.recording
        rows = np.minimum(part.windows.starts[:, None] + np.arange(a.shape[1]), len(recording) - 1)
        measured = part.windows.measured(outputs)
        against.setdefault("time", []).append(recording.time[rows].ravel())
        for j in _used(problem):
            against.setdefault(outputs[j], []).append(a[:, :, j].ravel())
            errors[j].append(np.stack([(measured - s)[:, :, j].ravel() for s in (a, b)]))
        for name in inputs:
            against.setdefault(name, []).append(recording[name][rows].ravel())
        windows_of.append(np.repeat(np.arange(len(rows)) + offset, rows.shape[1]))
        offset += len(rows)
    numbers = np.concatenate(windows_of)
    return {
        outputs[j]: {
            name: _binned(np.concatenate(x), np.concatenate(errors[j], axis=1), numbers)
            for name, x in against.items()
        }
        for j in _used(problem)
    }


def _binned(x: FloatArray, errors: FloatArray, windows: NDArray[np.int64]) -> FloatArray:
    known = np.isfinite(x) & np.isfinite(errors).all(axis=0)
    if known.sum() < BINS:
        return np.zeros((0, 5))
    x, errors, windows = x[known], errors[:, known], windows[known]
    edges = np.unique(np.quantile(x, np.linspace(0, 1, BINS + 1)))
    index = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, max(len(edges) - 2, 0))
    rows = []
    for k in np.unique(index):
        inside = index == k
        # Samples of a window are not independent: the error is that of the windows' means.
        effective = max(len(np.unique(windows[inside])), 1)
        mean, spread = errors[:, inside].mean(axis=1), errors[:, inside].std(axis=1) / np.sqrt(effective)
        rows.append([x[inside].mean(), mean[0], spread[0], mean[1], spread[1]])
    return np.array(rows)
