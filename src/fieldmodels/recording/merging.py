"""Several rates, and several files of one run, on one clock."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import correlate

from fieldmodels.arrays import FloatArray
from fieldmodels.recording.bench import Channel
from fieldmodels.recording.data import RecordingError
from fieldmodels.recording.tables import Table
from fieldmodels.recording.units import factor

ALIKE = 0.8
"""Least correlation at which two loggers' signals tell how far apart their clocks are."""
DISTINCT = 0.95
"""Largest correlation at another shift, as a share of the best; a periodic motion fits at many."""
_GRID = 1 << 15  # points of the common grid
_TRIED = 8  # columns of each file


@dataclass(frozen=True)
class Shift:
    """How far apart the clocks of two loggers are.

    Attributes:
        seconds: To be added to the second one's times.
        correlation: Of the two signals then, negative for reversed ones.
        signals: Names of the two signals that tell.
    """

    seconds: float
    correlation: float
    signals: tuple[str, str]


class JoinedTable(Table):
    """The columns of several files of one run, each with its own clock."""

    def __init__(self, tables: Sequence[Table], channels: Sequence[Channel]) -> None:
        clocks = [channel.column for channel in channels]
        names = [name for table in tables for name in table.header]
        self.path = tables[0].path
        self._places: dict[str, tuple[int, str]] = {}
        self._shifts = [0.0] * len(tables)
        self._seconds = [factor(channel.unit or "s", "s") for channel in channels]
        self._tables = list(tables)
        units: dict[str, str] = {}
        marks: dict[str, str] = {}
        for k, (table, clock) in enumerate(zip(tables, clocks, strict=True)):
            new = {n: n if names.count(n) == 1 else f"{n} ({table.path.stem})" for n in table.header}
            for name in table.header:
                self._places[new[name]] = k, name
                marks[new[name]] = new[table.clocks.get(name) or clock]
                if name in table.units:
                    units[new[name]] = table.units[name]
            units[new[clock]] = "s"
        self.header, self.units, self.clocks = tuple(self._places), units, marks
        self.notes = tuple(self._aligned(k, clocks[0], clocks[k]) for k in range(1, len(tables)))

    def read(self, names: Sequence[str], rows: int | None = None) -> dict[str, FloatArray]:
        """Read columns of all files; times are the first file's, in seconds."""
        result = {}
        for name in names:
            k, inner = self._places[name]
            result[name] = self._tables[k].read([inner], rows)[inner]
            if self.clocks[name] == name:
                result[name] = self._seconds[k] * result[name] + self._shifts[k]
        return result

    def numbers(self) -> tuple[str, ...]:
        """Columns of numbers and times."""
        return tuple(name for name, (k, inner) in self._places.items() if inner in self._tables[k].numbers())

    def _aligned(self, k: int, clock: str, other: str) -> str:
        """Put a file on the first one's clock; says how."""
        first, second = self._tables[0], self._tables[k]
        a = {n: first[n] for n in [clock, *[n for n in first.numbers() if n != clock][:_TRIED]]}
        b = {n: second[n] for n in [other, *[n for n in second.numbers() if n != other][:_TRIED]]}
        a[clock], b[other] = self._seconds[0] * a[clock], self._seconds[k] * b[other]
        apart = b[other][0] > a[clock][-1] or a[clock][0] > b[other][-1]
        shift = clock_shift(a.pop(clock), a, b.pop(other), b)
        if shift is None:
            if apart:
                raise RecordingError(
                    f"{second.path}: its times do not overlap those of {first.path}, and no signal of both "
                    "tells how far apart their clocks are; log one signal with both"
                )
            return f"{second.path.name} and {first.path.name} are taken to have one clock; no signal tells"
        self._shifts[k] = shift.seconds
        return (
            f"{second.path.name}: its clock was moved by {shift.seconds:+.6g} s to that of "
            f"{first.path.name}, where {shift.signals[1]!r} agrees with {shift.signals[0]!r} (correlation "
            f"{shift.correlation:.3f}); if one follows the other late, that delay cannot be told from it"
        )


def clock_shift(
    time: FloatArray, signals: Mapping[str, FloatArray], other: FloatArray, others: Mapping[str, FloatArray]
) -> Shift | None:
    """Estimate the offset between two loggers' clocks by the two signals that correlate best.

    Args:
        time: Times of the first logger [s], shape (n,).
        signals: Its columns, each of shape (n,).
        other: Times of the second logger [s], shape (m,).
        others: Its columns, each of shape (m,).

    Returns:
        The shift, or None if no pair of signals tells it.
    """
    step = max(float(np.median(np.diff(time))), float(np.median(np.diff(other))))
    step = max(step, (np.ptp(time) + np.ptp(other)) / _GRID)
    grids = [t[0] + step * np.arange(int(np.ptp(t) / step) + 1) for t in (time, other)]
    best: Shift | None = None
    for name, values in signals.items():
        for second, theirs in others.items():
            a, b = np.interp(grids[0], time, values), np.interp(grids[1], other, theirs)
            if min(np.ptp(a), np.ptp(b)) == 0 or not np.isfinite([a.sum(), b.sum()]).all():
                continue
            found = _lag(a, b)
            if found is not None and (best is None or abs(found[1]) > abs(best.correlation)):
                seconds = float(grids[0][0] - grids[1][0] + found[0] * step)
                best = Shift(seconds, found[1], (name, second))
    return best


def held_or_between(time: FloatArray, source: FloatArray, values: FloatArray, held: bool) -> FloatArray:
    """Values at other times: of a command the last one given, of a measured signal along a line."""
    if not held:
        return np.asarray(np.interp(time, source, values))
    last = np.searchsorted(source, time + 1e-3 * np.median(np.diff(source)), side="right") - 1
    return np.asarray(values[np.clip(last, 0, len(source) - 1)])


def _lag(a: FloatArray, b: FloatArray) -> tuple[float, float] | None:
    """Steps by which ``b`` is to be moved on to lie over ``a``, and the correlation then."""
    a, b = a - a.mean(), b - b.mean()
    length = min(len(a), len(b))
    product = correlate(a, b, mode="full", method="fft")
    ones = correlate(np.ones(len(a)), np.ones(len(b)), mode="full", method="fft")
    power_a = correlate(a**2, np.ones(len(b)), mode="full", method="fft")
    power_b = correlate(np.ones(len(a)), b**2, mode="full", method="fft")
    enough = ones > 0.5 * length
    with np.errstate(invalid="ignore", divide="ignore"):
        r = np.where(enough, product / np.sqrt(np.maximum(power_a * power_b, 1e-300)), 0.0)
    size = np.abs(r)
    k = int(size.argmax())
    if size[k] < ALIKE or not 0 < k < len(r) - 1:
        return None
    low, high = k, k
    while low > 0 and size[low] > 0.5 * size[k] and r[low] * r[k] > 0:
        low -= 1
    while high < len(r) - 1 and size[high] > 0.5 * size[k] and r[high] * r[k] > 0:
        high += 1
    if max(size[:low].max(initial=0.0), size[high + 1 :].max(initial=0.0)) > DISTINCT * size[k]:
        return None
    bend = size[k - 1] - 2 * size[k] + size[k + 1]
    part = 0.5 * (size[k - 1] - size[k + 1]) / bend if bend < 0 else 0.0
    return k + part - (len(b) - 1), float(r[k])
