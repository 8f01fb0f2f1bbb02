"""Samples that a sensor or its logger has lost, told from the numbers: spikes, drop-outs, stuck values.

What a machine does leaves a trace in the rows beside it; what is lost does not. So a sample is held against
the rows beside it: Gaussian noise misleads none of these tests, noise as heavy as Student's t with three
degrees of freedom is a spike once in some 16,000 rows. What may be real is kept: a coarse sensor repeats, a
machine rests, a force hits for one row (what shows no state has no spikes), and a response follows a pulse.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

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


def rows_read_once(columns: Sequence[FloatArray], time: FloatArray) -> IntArray:
    """Rows without those that a file holds again, stamp and all, as a logger writes that sends a block twice.

    Args:
        columns: All that were read, each of shape (n,).
        time: The stamps, shape (n,). Where many are equal the clock is coarse, and a machine may rest.

    Returns:
        Ascending rows, shape (kept,).
    """
    rows = np.arange(len(time))
    passed = np.diff(time)
    if np.all(passed > 0) or np.mean(passed == 0) > COARSE:
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
    noisy = [s.values for s in sensors if _turning(s.values).mean() > NOISY]
    if not 0 < again.sum() <= SELDOM * len(again) or not noisy:
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
        cls, sensor: Sensor, there: IntArray, commands: Sequence[FloatArray], others: Sequence[FloatArray]
    ) -> _Rows:
        values = sensor.values[there]
        values = np.unwrap(values, period=sensor.turn) if sensor.turn else values
        passed = np.diff(sensor.time[there])
        apart = (passed > GAP * np.median(passed)) | (np.diff(sensor.episode[there]) != 0)
        step = np.where(apart, np.nan, np.abs(np.diff(values)))
        moving = step[step > 0.0]
        return cls(
            values, sensor.inert, [c[there] for c in commands], [o[there] for o in others],
            step, float(np.median(moving)) if len(moving) else 0.0,
        )  # fmt: skip


def _found(rows: _Rows) -> Iterator[tuple[str, int, int]]:
    """What is lost: its kind, its first row and its end."""
    values, n = rows.values, len(rows.values)
    edges = np.flatnonzero(~(rows.step == 0.0)) + 1
    begins, ends = np.append(0, edges), np.append(edges, n)
    long = ends - begins >= HELD
    repeats = float((ends - begins - 1)[~long].sum()) / max(float((ends - begins)[~long].sum()), 1.0)
    never = repeats <= SELDOM and (ends - begins)[long].sum() < 0.5 * n
    runs = (ends - begins > 2) & (ends - begins <= LONGEST * n)
    left = _left(values, begins[runs], ends[runs])
    one, two = np.arange(1, n - 1), np.arange(1, n - 2)
    begins_tried = np.concatenate([one, two, begins[runs]])
    ends_tried = np.concatenate([one + 1, two + 2, ends[runs]])
    height = np.concatenate([_left(values, one, one + 1), _left(values, two, two + 2), left])
    far = np.flatnonzero(height > FACTOR * rows.usual)
    taken = np.zeros(n, dtype=np.bool_)
    for k in far:
        taken[begins_tried[k] : ends_tried[k]] = True
    if 0 < taken.sum() <= max(SELDOM * n, 3) or (never and taken.sum() <= LONGEST * n):
        rest = float(np.ptp(values[~taken]))
        lost = np.zeros(n, dtype=np.bool_)
        for k in far[np.argsort(-height[far], kind="stable")]:
            begin, end = int(begins_tried[k]), int(ends_tried[k])
            if lost[begin:end].any() or not _comes_back(rows, begin, end, float(height[k]), taken):
                continue
            stopped = never and end - begin > 2
            follows = rows.inert and height[k] <= BEYOND * rest and _pulsed(rows, begin, end)
            if stopped or (rows.inert and not follows):
                lost[begin:end] = True
                yield (SPIKE if end - begin <= 2 else DROP_OUT), begin, end
        taken = lost
    if never:
        for k in np.flatnonzero(long):
            begin, end = int(begins[k]), int(ends[k])
            extreme = values[begin] in (values.max(), values.min())
            if taken[begin:end].any() or extreme:
                continue
            elsewhere = rows.step[
                ~(taken[1:] | taken[:-1]) & ~np.isin(np.arange(n - 1), [begin - 1, end - 1])
            ]
            leap = LEAP * float(np.nanmax(elsewhere, initial=0.0))
            if begin > 0 and rows.step[begin - 1] > leap:
                yield DROP_OUT, begin, end
            elif (end < n and rows.step[end - 1] > leap) or _moves(rows, begin, end):
                yield STUCK, begin + 1, end


def _turning(values: FloatArray) -> BoolArray:
    """Where a signal turns back from one step to the next, shape (n - 2,)."""
    return np.asarray(np.diff(values[:-1]) * np.diff(values[1:]) < 0.0)


def _left(values: FloatArray, begins: IntArray, ends: IntArray) -> FloatArray:
    """How far samples, all of one value or at most two, leave what is before and after them; 0 if between."""
    if not len(begins):
        return np.zeros(0)
    inside = np.stack([values[begins], values[ends - 1]])
    around = np.stack([values[np.maximum(begins - 1, 0)], values[np.minimum(ends, len(values) - 1)]])
    whole = (begins > 0) & (ends < len(values))
    above, below = inside.min(axis=0) - around.max(axis=0), around.min(axis=0) - inside.max(axis=0)
    return np.where(whole, np.maximum(np.maximum(above, below), 0.0), 0.0)


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
        np.ptp(c[near]) > MOVED * np.ptp(c) and abs(c[near][-1] - c[near][0]) < 0.5 * np.ptp(c[near])
        for c in rows.commands
    )


def _moves(rows: _Rows, begin: int, end: int) -> bool:
    """Whether a sensor that never repeats would have moved: by its noise alone, or as another one does."""
    values = rows.values
    turns = _turning(values)
    outside = np.concatenate([turns[: max(begin - 1, 0)], turns[end:]])
    if len(outside) and outside.mean() > NOISY:
        return True
    return any(np.ptp(o[begin:end]) > MOVED * np.ptp(o) > 0.0 for o in rows.others)
