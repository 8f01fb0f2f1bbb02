"""Auto-correlation of prediction errors and their cross-correlation with inputs, with null distributions.

The usual limits of +-1.96 / sqrt(n) hold for white errors of a free run. Here every window's initial
state was fitted, which makes even white noise anticorrelated, and errors may be coloured. So the null
distributions are simulated: for the auto-correlation, white noise after the same fit of the states; for an
input, the errors of some windows against the inputs of others.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled
from fieldmodels.diagnosis.gain import Prediction
from fieldmodels.diagnosis.linearisation import PRIOR, STATE_STEP
from fieldmodels.diagnosis.problem import Part, Problem
from fieldmodels.diagnosis.result import Correlation
from fieldmodels.diagnosis.whitening import whitener_by_output

IntArray = NDArray[np.int64]
LAGS = 20
WINDOWS = 120  # used at most; more make no visible difference
DRAWS = 200
FEWEST = 20  # windows that can be exchanged; fewer give no null distribution
DENSE = 0.9  # share of a window's samples that must be observed for lags in samples to mean anything


def correlations(
    problem: Problem,
    parameters: FloatArray,
    before: Prediction,
    after: Prediction,
    rng: np.random.Generator,
) -> tuple[Correlation, ...]:
    """Correlations of every densely observed signal in the first recording of a problem.

    Args:
        problem: Windows, preferably test windows.
        parameters: Vector with the causes added.
        before: Prediction of the refitted base.
        after: Prediction with the causes.
        rng: Source of randomness.
    """
    part = problem.parts[0]
    count, samples = min(len(part.windows), WINDOWS), part.windows.samples
    names = tuple(o.name for o in problem.model.outputs)
    measured = part.windows.measured(names)[:count]
    first, last = (measured - p.simulated[0][:count] for p in (before, after))
    dense = [
        int(j)
        for j in np.unique(problem.outputs)
        if np.isfinite(last[:, :, j]).mean() > DENSE and not problem.model.outputs[j].event
    ]
    reach = min(LAGS, samples // 2)
    if not dense or reach < 2:
        return ()
    step = part.windows.recording.step
    inputs = _inputs(problem, part.windows.starts[:count], samples, reach)
    chance = _fitted_noise(problem, part, parameters, last, reach, dense, rng)
    result = []
    for k, j in enumerate(dense):
        errors = _centred(first[:, :, j]), _centred(last[:, :, j])
        if not all(e.any() for e in errors):
            continue
        before_after = _autocorrelation(errors[0], reach), _autocorrelation(errors[1], reach)
        lags = step * np.arange(1, reach + 1, dtype=np.float64)
        result.append(_judged(names[j], names[j], lags, *before_after, chance[:, k], chance[:, k]))
        lags = step * np.arange(-reach, reach + 1, dtype=np.float64)
        for name, values in inputs.items():
            result.append(_judged(names[j], name, lags, *_against(errors, values)))
    return tuple(result)


def _judged(
    signal: str,
    other: str,
    lags: FloatArray,
    before: FloatArray,
    after: FloatArray,
    chance_before: FloatArray,
    chance_after: FloatArray,
) -> Correlation:
    low, high = np.percentile(chance_after, [2.5, 97.5], axis=0)
    return Correlation(
        signal, other, lags, before, after, low, high,
        _p_value(before, chance_before), _p_value(after, chance_after),
    )  # fmt: skip


def _p_value(value: FloatArray, chance: FloatArray) -> float:
    """Share of curves under the null whose largest standardised deviation at any lag is as large."""
    middle, spread = chance.mean(axis=0), chance.std(axis=0) + 1e-12
    own = float(np.max(np.abs(value - middle) / spread))
    others = np.max(np.abs(chance - middle) / spread, axis=1)
    return float((1 + np.sum(others >= own)) / (1 + len(others)))


def _centred(values: FloatArray) -> FloatArray:
    """Values less their mean, zeros where unknown."""
    known = np.isfinite(values)
    mean = values[known].mean() if known.any() else 0.0
    return np.where(known, values - mean, 0.0)


@compiled
def _autocorrelation(errors: FloatArray, reach: int) -> FloatArray:
    """Correlation within windows at lags 1 to ``reach`` samples; errors of shape (windows, samples)."""
    power, result = 1e-300, np.zeros(reach)
    for own in errors:
        for value in own:
            power += value * value
        for lag in range(1, reach + 1):
            for n in range(lag, len(own)):
                result[lag - 1] += own[n] * own[n - lag]
    return result / power


def _inputs(problem: Problem, starts: IntArray, samples: int, reach: int) -> dict[str, FloatArray]:
    """Inputs that vary, around each window: shape (windows, samples + 2 reach)."""
    recording = problem.parts[0].windows.recording
    if len(starts) <= FEWEST:
        return {}
    episode = np.searchsorted(recording.bounds[:, 0], starts, side="right") - 1
    first, end = recording.bounds[episode].T[:, :, None]
    rows = np.clip(starts[:, None] + np.arange(-reach, samples + reach), first, end - 1)
    values = {s.name: recording[s.name][rows] for s in problem.model.inputs}
    return {name: _centred(v) for name, v in values.items() if len(np.unique(v)) > 2}


def _against(
    errors: tuple[FloatArray, FloatArray], values: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Correlation of errors with an input, and that of errors with other windows' inputs.

    Under the null whole windows are exchanged by a common shift, which keeps the spectra of both.

    Args:
        errors: Before and after, shape (windows, samples) each.
        values: The input around each window, shape (windows, samples + 2 reach).

    Returns:
        Before and after, shape (lags,), and the same under the null, shape (shifts, lags).
    """
    count, samples = errors[0].shape
    lags = values.shape[1] - samples + 1
    # A later start in `values` is a smaller lag: the last lag is the earliest input.
    around = np.stack([values[:, lags - 1 - k : lags - 1 - k + samples] for k in range(lags)])
    own, others = [], []
    for error in errors:
        scale = np.sqrt(np.sum(error**2) * np.mean(np.sum(around**2, axis=(1, 2)))) + 1e-300
        pairs = np.einsum("wn,kvn->kwv", error, around, optimize=True) / scale
        rows = np.arange(count)
        own.append(pairs[:, rows, rows].sum(axis=1))
        others.append(np.stack([pairs[:, rows, (rows + s) % count].sum(axis=1) for s in range(1, count)]))
    return own[0], own[1], others[0], others[1]


def _fitted_noise(
    problem: Problem,
    part: Part,
    parameters: FloatArray,
    errors: FloatArray,
    reach: int,
    dense: list[int],
    rng: np.random.Generator,
) -> FloatArray:
    """Autocorrelation of white noise after each window's state was fitted to it, (draws, dense, reach)."""
    count, samples, outputs = errors.shape
    states = part.windows.states[:count]
    batch = np.stack(
        [states] + [states + STATE_STEP * problem.state_scale * unit for unit in np.eye(states.shape[1])]
    )
    windows = part.windows.select(np.arange(count))
    simulated = np.stack([
        problem.model.simulate(parameters[None], windows.with_states(s))[0] for s in batch
    ])  # fmt: skip
    moved = np.nan_to_num(np.moveaxis(simulated[1:] - simulated[0], 0, -1) / STATE_STEP)
    features = part.counts.shape[1]
    slots = part.slots[:count].reshape(count, -1)
    counts = np.maximum(part.counts[:count, :, None], 1.0)  # an event that was not observed averages nothing
    averaging = (slots[:, None, :] == np.arange(features)[None, :, None]) / counts
    observed = np.isfinite(errors)
    squares = np.where(observed, errors, 0.0) ** 2
    size = np.sqrt(squares.sum(axis=(0, 1)) / np.maximum(observed.sum(axis=(0, 1)), 1))
    whiten = np.diag(whitener_by_output(problem, size[problem.outputs][None]))[:, None]
    moved = moved.reshape(count, samples * outputs, -1)
    prior = np.broadcast_to(np.eye(moved.shape[2]) / PRIOR, (count, moved.shape[2], moved.shape[2]))
    design = np.concatenate([whiten * (averaging @ moved), prior], axis=1)
    fitted = np.linalg.pinv(design)[:, :, :features] @ (whiten * averaging)
    result = np.empty((DRAWS, len(dense), reach))
    for draw in range(DRAWS):
        noise = np.where(observed, size * rng.standard_normal(errors.shape), 0.0)
        flat = noise.reshape(count, -1, 1)
        left = (flat - moved @ (fitted @ flat)).reshape(errors.shape)
        left = np.where(observed, left, np.nan)
        for k, j in enumerate(dense):
            result[draw, k] = _autocorrelation(_centred(left[:, :, j]), reach)
    return result
