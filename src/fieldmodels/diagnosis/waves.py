"""Waves that may be missing: hum over time, eccentric gears and wheels over the way, ripple over commands."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len, rfft

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled
from fieldmodels.diagnosis.result import WAVE
from fieldmodels.diagnosis.shapes import Curve, Place, Signals, wave
from fieldmodels.drivers.variables import SHARE, WAY
from fieldmodels.elementary import exponential
from fieldmodels.model import Model

CYCLES = 600.0  # of a wave over the whole range of its variable, at most
VALUES = 4  # of its variable in a cycle, at least
POINTS = 16  # of a cycle, where its table is given
FINER = 21  # periods that are tried about the best one, twice

WIDTH, SHARPNESS = 12, 2.3 * 12  # of the bell by which a sample is spread over a grid, in its points
NODES, _WEIGHTS = np.polynomial.legendre.leggauss(2 * WIDTH)
BELL = 0.5 * WIDTH * _WEIGHTS * np.exp(SHARPNESS * (np.sqrt(1.0 - NODES**2) - 1.0))


def strongest(place: Curve, power: Callable[[Curve, FloatArray], FloatArray]) -> Curve | None:
    """The strongest wave at a place; None if its variable is too fast for any.

    Args:
        place: Where, over what; its values from zero to one in place of columns, see ``places``.
        power: What waves at a place of so many cycles explain.
    """
    # Faster waves are lost in the averages over a segment.
    x, span = place.values, float(place.knots[1] - place.knots[0])
    steps = np.abs(np.diff(x, axis=1))
    most = len(np.unique(x)) / VALUES  # by more, any errors could be reproduced
    if place.over == "time":  # which stands still only where a slow machine has no sample
        steps, most = steps[steps > 0.0], CYCLES
    passed = float(np.median(steps)) + 1e-9
    counts = np.arange(2.0, min(0.5 / passed, CYCLES, most), 0.5)
    if not len(counts):
        return None
    count = float(counts[np.argmax(power(place, counts))])
    for width in (0.5, 0.05):  # the period is no number of half cycles in these data
        near = count + width * np.linspace(-1.0, 1.0, FINER)
        count = float(near[np.argmax(power(place, near))])
    points = np.linspace(0.0, 1.0, POINTS * int(np.ceil(count)) + 1)
    return replace(
        place,
        values=wave(x, count),
        knots=place.knots[0] + span * points,
        shapes=wave(points, count),
        formula=f"{WAVE} {span / count:.3g} {place.over_unit}",
        tried=len(counts),
        period=span / count,
    )


def spectrum(x: FloatArray, columns: FloatArray, counts: FloatArray) -> NDArray[np.complex128]:
    """Sums of columns times exp(2 pi i count x), to 1e-10 of the columns' size.

    Samples are spread over a grid by a narrow bell, whose own spectrum is divided out of the grid's
    (Barnett, Magland and af Klinteberg 2019, SIAM J. Sci. Comput. 41).

    Args:
        x: Shape (samples,).
        columns: Shape (samples, columns).
        counts: Evenly spaced, rising, none negative, shape (counts,).

    Returns:
        Shape (columns, counts).
    """
    if len(counts) == 1:
        return np.asarray(columns.T @ np.exp(2j * np.pi * counts[0] * x))[:, None]
    step = float(counts[-1] - counts[0]) / (len(counts) - 1)
    modes = np.rint(counts[0] / step) + np.arange(len(counts))
    rest = float(counts[0] - modes[0] * step)
    if abs(rest) > 1e-12 * step:
        turned = columns[:, :, None] * np.exp(2j * np.pi * rest * x)[:, None, None].view(np.float64)
        columns = turned.reshape(len(x), -1)
    size = next_fast_len(4 * (int(modes[-1]) + WIDTH), real=True)
    grid = _spread(step * x % 1.0, np.ascontiguousarray(columns), size)
    sums = np.conj(rfft(grid, axis=1)[:, modes.astype(np.int64)]) / _of_bell(modes[0], len(modes), size)
    return np.asarray(sums if abs(rest) <= 1e-12 * step else sums[0::2] + 1j * sums[1::2])


def products(x: FloatArray, answers: FloatArray, counts: FloatArray) -> FloatArray:
    """Products of the answers to a cosine and to a sine of each count, shape (counts, 2, 2).

    Args:
        x: The variable, shape (windows, segments).
        answers: Products of the answers to each segment, shape (windows, segments, segments).
        counts: As of ``spectrum``.
    """
    first, second = np.triu_indices(x.shape[1])  # the others are the same
    weights = (answers[:, first, second] * np.where(first == second, 1.0, 2.0)).reshape(-1, 1)
    # Products of waves are waves of the sum and the difference.
    sums, differences = (
        spectrum(both.ravel(), weights, counts)[0]
        for both in (x[:, first] + x[:, second], x[:, first] - x[:, second])
    )
    even, odd = 0.5 * differences.real, 0.5 * sums
    return np.stack([even + odd.real, odd.imag, odd.imag, even - odd.real], axis=-1).reshape(-1, 2, 2)


def against(x: FloatArray, others: FloatArray, counts: FloatArray) -> FloatArray:
    """Products of the answers to a cosine and to a sine of each count with others, (others, counts, 2).

    Args:
        x: The variable, shape (windows, segments).
        others: Products of the answers to each segment with others, shape (windows, segments, others).
        counts: As of ``spectrum``.
    """
    sums = spectrum(x.ravel(), others.reshape(x.size, -1), counts)
    return np.stack([sums.real, sums.imag], axis=-1)


@lru_cache(64)
def _of_bell(first: float, count: int, size: int) -> FloatArray:
    """The bell's own spectrum at some modes of a grid, shape (modes,)."""
    modes = first + np.arange(count)
    return np.asarray(np.cos(np.pi * WIDTH / size * np.multiply.outer(modes, NODES)) @ BELL)


@compiled
def _spread(places: FloatArray, columns: FloatArray, size: int) -> FloatArray:
    """Columns spread over a periodic grid by a bell around each place, from zero to one, (columns, size)."""
    wide = np.zeros((columns.shape[1], size + 2 * WIDTH))
    shares = np.empty(WIDTH)
    for n in range(len(places)):
        middle = places[n] * size
        first = math.ceil(middle - 0.5 * WIDTH)
        for i in range(WIDTH):
            z = ((first - middle) + i) * (2.0 / WIDTH)
            shares[i] = exponential(SHARPNESS * (math.sqrt(max(1.0 - z * z, 0.0)) - 1.0))
        for k in range(columns.shape[1]):
            for i in range(WIDTH):
                wide[k, first + WIDTH + i] += shares[i] * columns[n, k]
    result = wide[:, WIDTH : size + WIDTH].copy()
    result[:, -WIDTH:] += wide[:, :WIDTH]
    result[:, :WIDTH] += wide[:, size + WIDTH :]
    return result


def places(
    model: Model, signals: Signals, shown: Mapping[str, object], averaged: Callable[[str], FloatArray]
) -> Iterator[Curve]:
    """Where there may be waves, and over what: the variable from zero to one in place of columns.

    Args:
        model: The machine.
        signals: Variables, their units and values on the segments of every window.
        shown: Measured outputs.
        averaged: Any other variable of what a machine is told, on the segments.
    """
    outputs = {s.name: s.unit for s in model.outputs}
    inputs = {s.name for s in model.inputs} | {s.name for s in model.sums}

    def over_range(at: Place, target: str, unit: str, over: str, over_unit: str, x: FloatArray) -> Curve:
        ends = np.array([x.min(), x.max()])
        return Curve(at, target, over, over_unit, unit, (x - ends[0]) / np.ptp(ends), ends, np.eye(2))

    for target in shown:
        for over, (unit, values) in signals.items():
            if over == "time" or (over == target and not unit.endswith("/s")):
                yield over_range("sensor", target, outputs[target], over, unit, values)
    for push in model.pushes:
        one_way = sum(weight != 0.0 for weight in push.weights) == 1
        for over, (unit, values) in signals.items():
            if one_way and not push.over and (over in inputs or over == "time"):
                yield over_range("force", push.name, push.unit or "1", over, unit, values)
        if push.rate in signals and push.rate not in outputs and one_way:
            per, way = signals[push.rate][0], f"{WAY}{push.rate}"
            values = averaged(way)
            if np.ptp(values) > 0:
                share = "1" if per == push.unit else f"{push.unit} / ({per})"
                yield over_range("force", SHARE + push.name, share, way, per.removesuffix("/s"), values)
