"""Several rates, and several files of one run, on one clock.

Stamps of one logger are never moved against each other. Where the clocks of two files are shown to be two, or
a channel that both recorded tells so, the shift between them is proposed, to be confirmed like a sign. That a
response follows its command late is no evidence: that is a delay, which the user may be after.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import correlate

from fieldmodels.arrays import FloatArray
from fieldmodels.recording.bench import EPOCH, Channel
from fieldmodels.recording.data import RecordingError
from fieldmodels.recording.tables import Table
from fieldmodels.recording.units import factor
from fieldmodels.recording.words import meanings, without_unit

ALIKE = 0.8
"""Least correlation at which signals of two loggers tell how far apart their clocks are, if these are two."""
DISTINCT = 0.95
"""Largest correlation at another shift, as a share of the best; a periodic motion fits at many."""
LONGEST_DELAY = 2.0
"""Time [s] up to which a signal may follow another one late; the longest delay that is sought."""
INNER = 0.95
"""Share of the rows, those of least difference, in which one channel recorded twice must be the same: where
it steps, rows that were taken at other times differ."""
WHITE = 0.4
"""Least variance of the change of such a difference from row to row, by twice its own: 1 for white noise,
less where linear interpolation smooths it, next to nothing for the error of a lag."""
EXACT = 1e-3
"""Difference by the spread that rounding and interpolation explain."""
PIECES = 8
"""Parts of a record, each of which tells by itself how far apart two clocks are: they drift."""
DRIFT = 0.01
"""Largest difference of two clocks' rates; beyond it the signals are not the same."""
CLEAR = 5.0
"""Standard errors from which on a drift is one."""
_GRID = 1 << 15  # points of the common grid
_TRIED = 8  # columns of each file


@dataclass(frozen=True)
class Shift:
    """How far apart the clocks of two files are.

    Attributes:
        seconds: To be added to the second one's times, once they are multiplied by ``gain``.
        why: What shows it.
        told: Whether a delay can still be told: one channel, that both recorded, has shown it.
        gain: Seconds of the first one in a second of the second one; 1 if no drift is told.
    """

    seconds: float
    why: str
    told: bool
    gain: float = 1.0


class JoinedTable(Table):
    """The columns of several files of one run, each with its own clock, in seconds."""

    def __init__(self, tables: Sequence[Table], channels: Sequence[Channel]) -> None:
        names = [name for table in tables for name in table.header]
        self.path, self._tables = tables[0].path, list(tables)
        self._places: dict[str, tuple[int, str]] = {}
        self._units = [channel.unit or "s" for channel in channels]
        self._worth = [factor(c.unit or "s", "s") * c.gain for c in channels]
        units: dict[str, str] = {}
        marks: dict[str, str] = {}
        for k, (table, channel) in enumerate(zip(tables, channels, strict=True)):
            new = {n: n if names.count(n) == 1 else f"{n} ({table.path.stem})" for n in table.header}
            for name in table.header:
                self._places[new[name]] = k, name
                marks[new[name]] = new[table.clocks.get(name) or channel.column]
                if name in table.units:
                    units[new[name]] = table.units[name]
            units[new[channel.column]] = "s"
        self.header, self.units, self.clocks = tuple(self._places), units, marks

    def read(self, names: Sequence[str], rows: int | None = None) -> dict[str, FloatArray]:
        """Read columns of all files; times in seconds, as they are stamped."""
        result = {}
        for name in names:
            k, inner = self._places[name]
            result[name] = self._tables[k].read([inner], rows)[inner]
            if self.clocks[name] == name:
                result[name] = self._worth[k] * result[name]
        return result

    def place(self, rows: Sequence[int], column: str) -> str:
        """Where some rows of a column are, in its own file."""
        k, inner = self._places[column]
        return f"{self._tables[k].place(rows, inner)} of {self._tables[k].path.name}"

    def numbers(self) -> tuple[str, ...]:
        """Columns of numbers and times."""
        return tuple(name for name, (k, inner) in self._places.items() if inner in self._tables[k].numbers())

    def other_clocks(self, clock: str) -> tuple[str, ...]:
        """The clocks of the other files."""
        return tuple(c for c in dict.fromkeys(self.clocks.values()) if c != clock)

    def file_of(self, name: str) -> str:
        """Name of the file that a column is from."""
        return self._tables[self._places[name][0]].path.name

    def shift(self, clock: str, other: str, requested: bool = False) -> Shift | None:
        """How far apart two files' clocks are, if anything shows that they are two; None if nothing does.

        Args:
            clock: The first one's column.
            other: The second one's.
            requested: Whether to take the clocks for two, and what correlates best for simultaneous.

        Raises:
            RecordingError: If the clocks have no time in common and no signals tell how far apart they are.
        """
        first, second = self[clock], self[other]
        two = self._two(clock, other, first, second)
        if (drifting := self._drifting(clock, other)) is not None:
            return drifting
        found = [
            (one, name, twin)
            for name, values in self._signals(clock)
            for twin, theirs in self._signals(other)
            if (one := _agreement(first, values, second, theirs)) is not None
        ]
        kept = [f for f in found if f[0].same and self._one_channel(*f[1:])]
        kept = kept or [f for f in found if f[0].same and (two or abs(f[0].seconds) > LONGEST_DELAY)]
        kept = kept or [f for f in found if two or requested]
        if not kept:
            if two and not _overlap(first, second):
                raise RecordingError(
                    f"{self.file_of(other)}: {two}, and no signal tells how far apart its clock and that of "
                    f"{self.file_of(clock)} are; log one signal with both, or declare it as "
                    f"'t2={other}-3.2:s' if it is 3.2 s ahead"
                )
            return None
        one, name, twin = max(kept, key=lambda f: abs(f[0].correlation))
        step = max(float(np.median(np.diff(first))), float(np.median(np.diff(second))))
        if abs(one.seconds) < step and not requested:
            return None
        told = one.same and self._one_channel(name, twin)
        shown = two or ("both recorded one signal" if told or not requested else "as requested")
        why = f"{shown}: {twin!r} agrees with {name!r} then (correlation {one.correlation:.3f})"
        untold = "" if told else "; no delay can be told from such a shift"
        return Shift(round(one.seconds, 6), why + untold, told)

    def _drifting(self, clock: str, other: str) -> Shift | None:
        """What a channel that both recorded tells of clocks that run at different rates; None for none."""
        first, second = self[clock], self[other]
        for name, values in self._signals(clock):
            for twin, theirs in self._signals(other):
                if self._alike(name, twin) and (found := _drift(first, values, second, theirs)):
                    gain, seconds, error = found
                    why = (
                        f"both recorded one signal, and the clocks drift: {twin!r} agrees with {name!r} "
                        f"where the second one is {paced(gain)} (+- {1e6 * error:.1f})"
                    )
                    return Shift(seconds, why, True, gain)
        return None

    def _signals(self, clock: str) -> list[tuple[str, FloatArray]]:
        """The first columns of a file."""
        names = [n for n in self.numbers() if self.clocks[n] == clock and n != clock][:_TRIED]
        return [(name, self[name]) for name in names]

    def _one_channel(self, name: str, twin: str) -> bool:
        """Whether two names are of one signal, and not of a command and what answers it."""
        both = meanings(self._places[name][1]) & meanings(self._places[twin][1])
        return self._alike(name, twin) or "command" in both or "measured" in both

    def _alike(self, name: str, twin: str) -> bool:
        """Whether two columns have one name, but for units."""
        this, that = (without_unit(self._places[n][1])[0].lower() for n in (name, twin))
        return this == that

    def _two(self, clock: str, other: str, first: FloatArray, second: FloatArray) -> str:
        """What shows that two clocks are two; empty if nothing does."""
        units = [self._units[self._places[name][0]] for name in (clock, other)]
        if (first[0] > EPOCH) != (second[0] > EPOCH):
            return "one clock counts from 1970 and the other does not"
        if not _overlap(first, second):
            return "their times do not overlap"
        return f"one clock is in {units[0]}, the other in {units[1]}" if units[0] != units[1] else ""


def paced(gain: float) -> str:
    """How fast a clock goes by the seconds of the first one in a second of it."""
    return f"{'slow' if gain > 1 else 'fast'} by {1e6 * abs(gain - 1):.1f} ppm"


@dataclass(frozen=True)
class _Agreement:
    """How signals of two clocks agree best: by which shift of the second, and whether they are the same."""

    seconds: float
    correlation: float
    same: bool


def _overlap(first: FloatArray, second: FloatArray) -> bool:
    return bool(first[0] <= second[-1] and second[0] <= first[-1])


def _agreement(
    time: FloatArray, values: FloatArray, other: FloatArray, theirs: FloatArray
) -> _Agreement | None:
    """At which shift two signals agree, each of shape (n,) or (m,) with its times [s]; None if at none."""
    step, grids, (a, b) = _gridded(time, values, other, theirs)
    if min(np.ptp(a), np.ptp(b)) == 0 or not np.isfinite([a.sum(), b.sum()]).all():
        return None
    found = _lag(a, b)
    if found is None:
        return None
    seconds = float(grids[0][0] - grids[1][0] + found[0] * step)
    inside = (grids[0] >= other[0] + seconds) & (grids[0] <= other[-1] + seconds)
    return _Agreement(
        seconds, found[1], _same(a[inside], np.interp(grids[0][inside] - seconds, other, theirs))
    )


def _gridded(
    time: FloatArray, values: FloatArray, other: FloatArray, theirs: FloatArray
) -> tuple[float, list[FloatArray], list[FloatArray]]:
    """Two signals at even times of their own clocks: the common step [s], the times and the values."""
    step = max(float(np.median(np.diff(time))), float(np.median(np.diff(other))))
    step = max(step, (np.ptp(time) + np.ptp(other)) / _GRID)
    grids = [t[0] + step * np.arange(int(np.ptp(t) / step) + 1) for t in (time, other)]
    return step, grids, [np.interp(grids[0], time, values), np.interp(grids[1], other, theirs)]


def _drift(
    time: FloatArray, values: FloatArray, other: FloatArray, theirs: FloatArray
) -> tuple[float, float, float] | None:
    """How one signal on two clocks shows that they run at different rates; None if it does not.

    Where pieces of the second record lie in the first one gives a line, from which least squares go on.

    Returns:
        Gain and offset [s] from the second clock to the first, and the standard error of the gain.
    """
    from scipy.stats import theilslopes  # slow to import

    step, grids, (a, b) = _gridded(time, values, other, theirs)
    if not np.isfinite([a.sum(), b.sum()]).all():
        return None
    pieces = np.array_split(np.arange(len(b)), PIECES)
    moving = [rows for rows in pieces if len(rows) and np.ptp(b[rows]) > 0]
    placed = [(grids[1][rows[0]], found[0]) for rows in moving if (found := _lag(a, b[rows]))]
    if len(placed) <= PIECES // 2:
        return None
    begins, lags = np.array(placed).T
    line = theilslopes(grids[0][0] + step * lags, begins)
    rate, middle, start = 1.0 / line.slope, 0.5 * (time[0] + time[-1]), 0.0
    start = (middle - line.intercept) * rate  # the second clock's time then
    slopes = np.gradient(theirs, other)
    error = np.inf
    for _ in range(5):
        mapped = start + rate * (time - middle)
        inside = (mapped >= other[0]) & (mapped <= other[-1])
        since, there = time[inside] - middle, mapped[inside]
        if abs(rate - 1.0) > DRIFT or len(since) < len(a) // 4:
            return None
        seen = np.interp(there, other, theirs)
        steep = np.interp(there, other, slopes)
        columns = np.column_stack([steep, steep * since, seen, np.ones(len(seen))])
        solved = np.linalg.lstsq(columns, values[inside], rcond=None)[0]
        left = values[inside] - columns @ solved
        start, rate = start + solved[0] / solved[2], rate + solved[1] / solved[2]
        error = float(np.sqrt(np.var(left) * np.linalg.pinv(columns.T @ columns)[1, 1])) / abs(solved[2])
    told = abs(rate - 1.0) > CLEAR * error and abs(rate - 1.0) * np.ptp(time) > step
    if not told or not _same(values[inside], seen):
        return None
    gain = round(1.0 / rate, 9)
    return gain, round(float(middle - gain * start), 6), error


def _same(values: FloatArray, others: FloatArray) -> bool:
    """Whether two signals on one clock differ by a gain, an offset and noise alone."""
    columns = np.column_stack([others, np.ones(len(others))])
    left = values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0]
    inner = np.abs(left) <= np.quantile(np.abs(left), INNER)
    size, change = float(np.std(left[inner])), np.diff(left)[inner[1:] & inner[:-1]]
    return size < EXACT * float(np.std(values)) or float(np.std(change)) ** 2 > 2 * WHITE * size**2


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
