"""Samples that a sensor or its logger has lost, told from the numbers: spikes, drop-outs, stuck values.

What a machine does leaves a trace in the rows beside it; what is lost does not. So a sample is held against
the rows beside it: Gaussian noise misleads none of these tests, noise as heavy as Student's t with three
degrees of freedom is a spike once in some 16,000 rows. What may be real is kept: a coarse sensor repeats, a
machine rests, a force hits for one row (what shows no state has no spikes), and a response follows a pulse.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fieldmodels.arrays import BoolArray, FloatArray, IntArray

FACTOR = 10.0
"""Times the largest step beside it by which a sample must leave and come back."""
BESIDE = 8
"""Rows on either side of it that tell how large steps are."""
BEYOND = 10.0
"""Times the range of all other rows, up to which a sample may follow a command that leaves and returns."""
HELD = 8
"""Rows in which a sensor that never repeats shows one value, from which on it is stuck."""
SELDOM = 0.01
"""Share of rows that repeat the last value, or leave and come back, up to which a sensor never does so."""
LONGEST = 0.1
"""Share of all rows up to which a stretch of one value is a drop-out."""
MOVED = 0.1
"""Of its range, which another sensor passes while a machine moves."""
LEAP = 1.5
"""Times the largest step elsewhere that a sensor leaps which has shown one value meanwhile."""
NOISY = 1 / 3
"""Share of rows at which a signal turns back, from which on noise moves it: of white noise it is 2/3."""
COARSE = 0.2
"""Share of repeated stamps above which the clock is taken to be coarse."""
GAP = 5.0
"""Usual time steps from which on the row before is not beside this one."""

SPIKE, DROP_OUT, STUCK, STALE, EMPTY = "spikes", "drop-outs", "stuck", "repeated", "empty"


@dataclass(frozen=True)
class Sensor:
    """One sensor's column.

    Attributes:
        values: What it shows, in any unit, shape (n,).
        time: Of its rows, in any unit, shape (n,).
        episode: Number of each row's episode, shape (n,).
        inert: Whether it shows a state, such as a position or a speed, which cannot leap and come back.
        turn: Of an angle that may jump by it, in the unit of the values; 0 for other signals.
    """

    values: FloatArray
    time: FloatArray
    episode: FloatArray
    inert: bool
    turn: float = 0.0


def lost_in(
    sensors: Mapping[str, Sensor], commands: Sequence[FloatArray], together: bool
) -> dict[str, dict[str, IntArray]]:
    """Rows of samples that each sensor has lost, by what became of them.

    Args:
        sensors: By name.
        commands: On the same rows, each of shape (n,).
        together: Whether all sensors are on the same rows, too; what others show then tells whether a machine
            moves.

    Returns:
        Of each sensor that has lost some, ascending rows by ``SPIKE``, ``DROP_OUT``, ``STUCK``, ``STALE`` and
        ``EMPTY`` (which is no number).
    """
    stale = _stale([*sensors.values()], commands) if together else np.zeros(0, dtype=np.int64)
    found = {}
    for name, sensor in sensors.items():
        others = [s.values for n, s in sensors.items() if n != name] if together else []
        there = np.flatnonzero(np.isfinite(sensor.values))
        kinds = {EMPTY: [np.flatnonzero(~np.isfinite(sensor.values))], STALE: [stale]}
        if len(there) > 2 * BESIDE:
            for kind, begin, end in _found(_Rows.of(sensor, there, commands, others)):
                kinds.setdefault(kind, []).append(there[begin:end])
        joined = {kind: np.sort(np.concatenate(rows)) for kind, rows in kinds.items()}
        found[name] = {kind: rows for kind, rows in joined.items() if len(rows)}
    return {name: kinds for name, kinds in found.items() if kinds}


def rows_read_once(
    columns: Sequence[FloatArray], time: FloatArray, episode: FloatArray | None = None
) -> IntArray:
    """Rows without those that a file holds again, stamp and all, as a logger writes that sends a block twice.

    Args:
        columns: All that were read, each of shape (n,).
        time: The stamps, shape (n,). Where many are equal the clock is coarse, and a machine may rest.
        episode: Numbers of the rows' episodes, if they have any: a clock may begin anew where they rise.

    Returns:
        Ascending rows, shape (kept,).
    """
    rows, after = np.arange(len(time)), time[1:] > time[:-1]
    anew = False if episode is None else episode[1:] > episode[:-1]
    if np.all(after | anew) or np.mean(time[1:] == time[:-1]) > COARSE:
        return rows
    first = np.unique(time, return_index=True, return_inverse=True)
    before = first[1][first[2].ravel()]
    again = np.logical_and.reduce([(v == v[before]) | (np.isnan(v) & np.isnan(v[before])) for v in columns])
    again &= before != rows
    return rows if again.mean() > COARSE else np.flatnonzero(~again)  # two copies of a log are two runs


def held_over(command: FloatArray) -> FloatArray:
    """A command that stays as it was where it is no number, shape (n,)."""
    there = np.flatnonzero(np.isfinite(command))
    last = np.searchsorted(there, np.arange(len(command)), side="right") - 1
    return np.asarray(command[there[np.maximum(last, 0)]])


def filled(sensor: Sensor, lost: BoolArray) -> FloatArray:
    """A sensor's column with lost samples put between the others, at values that it has shown, shape (n,).

    They count nowhere; so none of them may look finer than the sensor is.

    Args:
        sensor: Its column.
        lost: Which samples are lost, shape (n,).
    """
    result, shown = sensor.values.copy(), np.unique(sensor.values[~lost])
    edges = np.flatnonzero(np.diff(sensor.episode)) + 1
    for rows in np.split(np.arange(len(result)), edges):
        gone, known = rows[lost[rows]], rows[~lost[rows]]
        if not len(gone) or not len(known):
            continue
        others = sensor.values[known]
        between = np.interp(gone, known, np.unwrap(others, period=sensor.turn) if sensor.turn else others)
        if sensor.turn:  # within the turns that it has shown
            between -= sensor.turn * np.round((between - 0.5 * (shown[0] + shown[-1])) / sensor.turn)
        above = np.clip(np.searchsorted(shown, between), 1, len(shown) - 1) if len(shown) > 1 else 0
        low, high = shown[above - 1], shown[above]
        result[gone] = np.where(between - low < high - between, low, high)
    return result


def _stale(sensors: Sequence[Sensor], commands: Sequence[FloatArray]) -> IntArray:
    """Rows in which a logger wrote all of the last one again, though noise would have told them apart.

    None where chance, or a machine at rest, may have repeated them.
    """
    if not sensors or len(sensors[0].values) <= 2 * BESIDE:
        return np.zeros(0, dtype=np.int64)
    columns = [*(s.values for s in sensors), *commands]
    again = np.logical_and.reduce([v[1:] == v[:-1] for v in columns])
    seldom = 0 < again.sum() <= SELDOM * len(again)
    noisy = [s.values for s in sensors if seldom and _turning(s.values).mean() > NOISY]
    if not noisy:
        return np.zeros(0, dtype=np.int64)
    repeating = [np.mean((v[1:] == v[:-1])[~again]) for v in noisy]
    by_chance = len(again) * float(np.prod(np.maximum(repeating, 1.0 / len(again))))
    return np.flatnonzero(again) + 1 if by_chance < SELDOM else np.zeros(0, dtype=np.int64)


@dataclass(frozen=True)
class _Rows:
    """The rows of a sensor that hold a number, what is usual there, and what else was recorded.

    Attributes:
        values: The sensor's, an angle's without jumps by whole turns, shape (n,).
        inert: As of ``Sensor``.
        commands: Each of shape (n,).
        others: What other sensors show, each of shape (n,).
        step: Sizes of its steps from row to row, NaN where rows are not beside each other, shape (n - 1,).
        usual: Median of those that are not zero.
    """

    values: FloatArray
    inert: bool
    commands: Sequence[FloatArray]
    others: Sequence[FloatArray]
    step: FloatArray
    usual: float

    @classmethod
    def of(
        cls,
        sensor: Sensor,
        there: IntArray,
        commands: Sequence[FloatArray],
        others: Sequence[FloatArray],
    ) -> _Rows:
        rows = slice(None) if len(there) == len(sensor.values) else there  # without copies of a whole log
        values, time, episode = sensor.values[rows], sensor.time[rows], sensor.episode[rows]
        step = np.abs(np.diff(values))
        if sensor.turn and step.max() > 0.5 * sensor.turn:
            values = np.unwrap(values, period=sensor.turn)
            step = np.abs(np.diff(values))
        passed = np.diff(time)
        step[(passed > GAP * np.median(passed)) | (episode[1:] != episode[:-1])] = np.nan
        moving = step[step > 0.0]
        usual = float(np.median(moving, overwrite_input=True)) if len(moving) else 0.0
        return cls(values, sensor.inert, [c[rows] for c in commands], [o[rows] for o in others], step, usual)

    @cached_property
    def spans(self) -> list[float]:
        """Ranges of the commands and of the others."""
        known = (x[np.isfinite(x)] for x in (*self.commands, *self.others))
        return [float(np.ptp(x)) if len(x) else 0.0 for x in known]


def _found(rows: _Rows) -> Iterator[tuple[str, int, int]]:
    """What is lost: its kind, its first row and its end."""
    values, n = rows.values, len(rows.values)
    same = np.concatenate([[False], rows.step == 0.0, [False]])  # as the row before
    begins, ends = np.flatnonzero(~same[:-1] & same[1:]), np.flatnonzero(same[:-1] & ~same[1:]) + 1
    lasting = ends - begins
    long = lasting >= HELD
    held = int(lasting[long].sum())
    repeats = float((lasting[~long] - 1).sum()) / max(n - held, 1)
    never = repeats <= SELDOM and held < 0.5 * n
    runs = (lasting > 2) & (lasting <= LONGEST * n)
    begins_tried, ends_tried, height = _far(rows, begins[runs], ends[runs])
    taken = np.zeros(n, dtype=np.bool_)
    for begin, end in zip(begins_tried, ends_tried, strict=True):
        taken[begin:end] = True
    if 0 < taken.sum() <= max(SELDOM * n, 3) or (never and taken.sum() <= LONGEST * n):
        rest = float(np.ptp(values[~taken]))
        lost = np.zeros(n, dtype=np.bool_)
        for k in np.argsort(-height, kind="stable"):
            begin, end = int(begins_tried[k]), int(ends_tried[k])
            if lost[begin:end].any() or not _comes_back(rows, begin, end, float(height[k]), taken):
                continue
            stopped = never and end - begin > 2
            follows = rows.inert and height[k] <= BEYOND * rest and _pulsed(rows, begin, end)
            if stopped or (rows.inert and not follows):
                lost[begin:end] = True
                yield (SPIKE if end - begin <= 2 else DROP_OUT), begin, end
        taken = lost
    if never and long.any():
        extremes = values.min(), values.max()
        steps = np.where(taken[1:] | taken[:-1], 0.0, np.nan_to_num(rows.step))
        largest = np.argpartition(-steps, 2)[:3]
        largest = largest[np.argsort(-steps[largest])]
        noisy = _turning(values).sum() > NOISY * (n - held)
        for k in np.flatnonzero(long):
            begin, end = int(begins[k]), int(ends[k])
            if taken[begin:end].any() or values[begin] in extremes:
                continue
            elsewhere = next((steps[i] for i in largest if i not in (begin - 1, end - 1)), 0.0)
            if begin > 0 and rows.step[begin - 1] > LEAP * elsewhere:
                yield DROP_OUT, begin, end
            elif (end < n and rows.step[end - 1] > LEAP * elsewhere) or noisy or _moves(rows, begin, end):
                yield STUCK, begin + 1, end


def _turning(values: FloatArray) -> BoolArray:
    """Where a signal turns back from one step to the next, shape (n - 2,)."""
    return np.asarray(np.diff(values[:-1]) * np.diff(values[1:]) < 0.0)


def _far(rows: _Rows, begins: IntArray, ends: IntArray) -> tuple[IntArray, IntArray, FloatArray]:
    """First row, end and height of what leaves its neighbours by far: one row, two, or rows of one value."""
    n, least, found = len(rows.values), FACTOR * rows.usual, []
    leaps = np.flatnonzero(rows.step > least) + 1
    for first, last in ((leaps, leaps + 1), (leaps, leaps + 2), (begins, ends)):
        whole = (first > 0) & (last < n)
        height = _left(rows.values, first[whole], last[whole])
        far = height > least
        found.append((first[whole][far], last[whole][far], height[far]))
    starts, stops, heights = (np.concatenate(part) for part in zip(*found, strict=True))
    return starts, stops, heights


def _left(values: FloatArray, begins: IntArray, ends: IntArray) -> FloatArray:
    """How far samples, all of one value or at most two, leave what is before and after them; 0 if between."""
    first, last, before, after = values[begins], values[ends - 1], values[begins - 1], values[ends]
    above = np.minimum(first, last) - np.maximum(before, after)
    below = np.minimum(before, after) - np.maximum(first, last)
    return np.asarray(np.maximum(np.maximum(above, below), 0.0))


def _comes_back(rows: _Rows, begin: int, end: int, height: float, taken: BoolArray) -> bool:
    """Whether samples leave what is beside them by far more than that moves, and come back to it."""
    before = np.arange(max(begin - 2 * BESIDE, 0), begin)
    after = np.arange(end, min(end + 2 * BESIDE, len(rows.values)))
    if np.isnan(rows.step[max(begin - 1, 0) : end]).any():
        return False
    before, after = before[~taken[before]][-BESIDE:], after[~taken[after]][:BESIDE]
    if min(len(before), len(after)) < 3:
        return False
    steps = np.concatenate([np.abs(np.diff(rows.values[side])) for side in (before, after)])
    step = max(float(steps.max()), rows.usual)
    apart = abs(float(rows.values[after[0]] - rows.values[before[-1]]))
    return height > FACTOR * step and apart <= max(height / FACTOR, (after[0] - before[-1]) * step)


def _pulsed(rows: _Rows, begin: int, end: int) -> bool:
    """Whether a command leaves and comes back at the same time, which a response may follow."""
    near = slice(max(begin - BESIDE, 0), end)
    return any(
        np.ptp(c[near]) > MOVED * span and abs(c[near][-1] - c[near][0]) < 0.5 * np.ptp(c[near])
        for c, span in zip(rows.commands, rows.spans, strict=False)
    )


def _moves(rows: _Rows, begin: int, end: int) -> bool:
    """Whether another sensor moves meanwhile."""
    spans = rows.spans[len(rows.commands) :]
    return any(np.ptp(o[begin:end]) > MOVED * span > 0.0 for o, span in zip(rows.others, spans, strict=True))
