"""Candidate inputs for a next measurement, within the limits of the recordings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled
from fieldmodels.model import Model
from fieldmodels.recording import Recording

SLACK = 0.02  # of an output's range by which it may be exceeded
ROUND = 0.9 * 2 * np.pi  # an angle that has covered this range is unlimited
Shape = Callable[[FloatArray, np.random.Generator], FloatArray]


@dataclass(frozen=True)
class Limits:
    """Range of inputs and outputs in the recordings, which a next measurement must not exceed.

    Attributes:
        lowest: Least value of each input, shape (inputs,).
        highest: Largest, shape (inputs,).
        change: Largest change of each input from one sample to the next, shape (inputs,).
        below: Least value of each output, minus infinity where it is unlimited, shape (outputs,).
        above: Largest, shape (outputs,).
    """

    lowest: FloatArray
    highest: FloatArray
    change: FloatArray
    below: FloatArray
    above: FloatArray

    def excess(self, values: FloatArray, which: NDArray[np.int64]) -> float:
        """Largest excursion of simulated outputs relative to the measured range: inside it up to 1.

        Args:
            values: Simulated, shape (n, len(which)).
            which: Their indices.
        """
        ends = np.isfinite(self.above[which])
        low, high = self.below[which][ends], self.above[which][ends]
        if not np.isfinite(values).all():
            return np.inf
        middle, half = 0.5 * (high + low), (0.5 + SLACK) * (high - low)
        return float(np.max(np.abs(values[:, ends] - middle) / half, initial=0.0))


def limits_of(model: Model, recordings: Sequence[Recording]) -> Limits:
    """Limits from recordings."""
    inputs = [np.concatenate([r[signal.name] for r in recordings]) for signal in model.inputs]
    changes = [
        max(float(np.max(np.abs(np.diff(r[s.name])), initial=0.0)) for r in recordings) for s in model.inputs
    ]
    below, above = np.full(len(model.outputs), -np.inf), np.full(len(model.outputs), np.inf)
    for j, signal in enumerate(model.outputs):
        if signal.name in model.unbounded_outputs or not all(signal.name in r for r in recordings):
            continue
        values = np.concatenate([r[signal.name] for r in recordings])
        if signal.angle and np.ptp(values) > ROUND:
            continue
        below[j], above[j] = values.min(), values.max()
    return Limits(
        lowest=np.array([values.min() for values in inputs]),
        highest=np.array([values.max() for values in inputs]),
        change=np.array(changes),
        below=below,
        above=above,
    )


def planned(
    limits: Limits, shape: Shape, time: FloatArray, scale: float, rng: np.random.Generator
) -> FloatArray:
    """A shape scaled into the inputs' ranges and slowed to their largest changes, shape (n, inputs).

    Args:
        limits: Of the machine.
        shape: Gives values from -1 to 1, shape (n, inputs).
        time: Sample times [s], shape (n,).
        scale: Share of the range that is used.
        rng: Source of all randomness.
    """
    middle, half = 0.5 * (limits.highest + limits.lowest), 0.5 * (limits.highest - limits.lowest)
    return slowed(middle + scale * half * shape(time, rng), limits)


def slowed(values: FloatArray, limits: Limits) -> FloatArray:
    """The same values, changing from sample to sample by no more than was recorded."""
    first = np.clip(np.zeros(values.shape[1]), limits.lowest, limits.highest)
    return _slowed(np.ascontiguousarray(values, dtype=np.float64), first, limits.change)


@compiled
def _slowed(values: FloatArray, first: FloatArray, change: FloatArray) -> FloatArray:
    result = np.empty_like(values)
    for k in range(values.shape[1]):
        now = first[k]
        for i in range(len(values)):
            now += min(max(values[i, k] - now, -change[k]), change[k])
            result[i, k] = now
    return result


def shapes(step: float, recorded: FloatArray, limits: Limits) -> dict[tuple[str, float], Shape]:
    """Candidate inputs by kind and shortest time [s].

    Args:
        step: Sampling interval [s].
        recorded: The commands as recorded, shape (n, inputs): repeated as they are and with a fast binary
            sequence added, for machines that other inputs would drive out of range.
        limits: Of the machine.
    """
    fast, medium = max(0.05, 2 * step), max(0.2, 4 * step)
    half = np.maximum(0.5 * (limits.highest - limits.lowest), 1e-300)
    scaled = (recorded - 0.5 * (limits.highest + limits.lowest)) / half

    def every(single: Shape) -> Shape:
        """An independent draw of a shape for each input."""
        return lambda t, rng: np.column_stack([single(t, rng) for _ in range(recorded.shape[1])])

    return {
        ("pseudo-random binary input", 2 * step): every(binary(2 * step, step)),
        ("pseudo-random binary input", fast): every(binary(fast, step)),
        ("pseudo-random binary input", medium): every(binary(medium, step)),
        ("pseudo-random binary input", 0.5): every(binary(0.5, step)),
        ("sequence of random steps", 0.5): every(levels(0.5, step)),
        ("fast multisine", 4 * step): every(sines(4 * step, 40 * step)),
        ("multisine", medium): every(sines(medium, 10.0)),
        ("multisine", 1.0): every(sines(1.0, 10.0)),
        ("chirp", medium): every(sweep(medium)),
        ("recorded input", step): repeated(scaled, 0.0, fast, step),
        ("recorded input with a pseudo-random binary input", fast): repeated(scaled, 0.3, fast, step),
    }


def binary(shortest: float, step: float) -> Shape:
    """A pseudo-random binary sequence with a shortest pulse [s]."""
    count = max(round(shortest / step), 1)
    return lambda t, rng: np.repeat(rng.choice([-1.0, 1.0], len(t) // count + 1), count)[: len(t)]


def levels(shortest: float, step: float) -> Shape:
    """Random levels, each held for a time [s]."""
    count = max(round(shortest / step), 1)
    return lambda t, rng: np.repeat(rng.uniform(-1, 1, len(t) // count + 1), count)[: len(t)]


def sines(shortest: float, longest: float) -> Shape:
    """Ten sines of random phase between two periods [s]."""
    frequencies = np.geomspace(1 / longest, 1 / shortest, 10)

    def waves(t: FloatArray, rng: np.random.Generator) -> FloatArray:
        values = np.sin(2 * np.pi * np.outer(t, frequencies) + rng.uniform(0, 2 * np.pi, 10)).sum(axis=1)
        return np.asarray(values / np.abs(values).max())

    return waves


def sweep(shortest: float) -> Shape:
    """A sine whose period falls from 10 s to the shortest [s]."""

    def wave(t: FloatArray, rng: np.random.Generator) -> FloatArray:
        ratio = 10.0 / shortest
        phase = 2 * np.pi * 0.1 * t[-1] / np.log(ratio) * (ratio ** (t / t[-1]) - 1.0)
        return np.asarray(np.sin(phase + rng.uniform(0, 2 * np.pi)))

    return wave


def repeated(recorded: FloatArray, share: float, shortest: float, step: float) -> Shape:
    """The recorded commands, repeated from their start, with a binary sequence added."""
    noise = binary(shortest, step)

    def shape(t: FloatArray, rng: np.random.Generator) -> FloatArray:
        top = np.column_stack([noise(t, rng) for _ in range(recorded.shape[1])])
        return np.asarray((1.0 - share) * np.resize(recorded, top.shape) + share * top)

    return shape
