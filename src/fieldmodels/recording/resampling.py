"""Resampling of unevenly sampled recordings to the even grid that simulations need.

There are two indistinguishable kinds of file. Either samples were taken at uneven times, and the time stamps
are right; or they were taken evenly, and only the stamps jitter (a busy logger) or are coarse. The signals
decide: on the right times they are smoother. The noise level is preserved: a grid point takes the nearest
measured value, shifted along a cubic through its neighbours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled
from fieldmodels.model import Model
from fieldmodels.recording import Recording, RecordingError
from fieldmodels.recording.lost import COARSE

LONGEST_FILL = 5
"""A gap of more steps starts a new episode; a shorter one is filled."""
MOST_FILLED = 0.25
"""Largest share of rows that may be missing."""
MOST_JITTER = 0.6
"""Largest standard deviation of the time step, as a share of the step."""

_NEIGHBOURS = 8  # rows to which a local cubic is fitted
_EXAMINED = 20_000  # rows on which the two hypotheses are compared and the step is measured
_FINE = 16  # bins per step, in which stamps are counted
_BEAT = 5.0  # least height of the spectral line of even rows, relative to chance
_BLOCK = 100_000  # grid points at once


def evened(recording: Recording, model: Model | None) -> Recording:
    """Resample a recording to an even grid of its own usual step.

    Commands are held from row to row, so a grid step gets their mean over it; measured values are shifted as
    described above. Rows that repeat the row before are dropped; rows out of order by less than a step are
    sorted.

    Args:
        recording: Within an episode time may decrease by at most one step.
        model: Declares which signals are commands, and which are angles that may wrap; None takes every
            signal as measured.

    Returns:
        The recording on its grid, with a note of what was found and done; episodes are renumbered where gaps
        have split them.

    Raises:
        RecordingError: If too many rows are missing, or their times vary too much.
    """
    parts = [_ordered(recording.rows(slice(a, b))) for a, b in recording.bounds]
    dropped = len(recording) - sum(map(len, parts))
    steps = np.concatenate([np.diff(part.time) for part in parts])
    coarse = float(np.mean(steps <= 0)) > COARSE
    if coarse:  # the rows are the better clock
        slopes = [np.polyfit(np.arange(len(p)), p.time, 1)[0] for p in parts if len(p) > 1]
        step = float(np.average(slopes, weights=[len(p) for p in parts if len(p) > 1]))
        times = [part.time[0] + step * np.arange(len(part)) for part in parts]
    else:
        parts = [_merged(part) for part in parts]
        step, jitter = _usual([part.time for part in parts])
        if jitter > MOST_JITTER:
            raise RecordingError(
                f"{recording.source}: the time step varies by {100 * jitter:.0f} % (allowed: "
                f"{100 * MOST_JITTER:.0f} %); log at a steady rate, or interpolate the signals yourself"
            )
        follows = [_follow(part.time, step) for part in parts]
        names = [n for n in recording.signals if model is None or n in {s.name for s in model.outputs}]
        stamped = _roughness(parts, [p.time for p in parts], names, model)
        times = follows if _roughness(parts, follows, names, model) < stamped else [p.time for p in parts]
        coarse = times is follows
    pieces = [piece for part, t in zip(parts, times, strict=True) for piece in _split(part, t, step)]
    if not pieces:
        raise RecordingError(
            f"{recording.source}: no {_NEIGHBOURS} rows follow each other at the usual step of {step:.6g} s; "
            "log at a steady rate"
        )
    grids = [_resampled(part, t, step, model) for part, t in pieces]
    filled = 1.0 - sum(len(t) for _, t in pieces) / sum(len(g) for g in grids)
    if filled > MOST_FILLED:
        raise RecordingError(
            f"{recording.source}: {100 * filled:.0f} % of the rows are missing (allowed: "
            f"{100 * MOST_FILLED:.0f} %, at a step of {step:.6g} s); log at a steady rate"
        )
    gaps = len(grids) - len(parts)
    what = [
        f"{dropped} repeated row{'s' if dropped > 1 else ''} dropped" if dropped else "",
        "the rows are even and only their stamps wander, so rows are counted"
        if coarse
        else "the signals were interpolated",
        f"{100 * filled:.2g} % of the rows are missing and were filled" if filled > 0.0005 else "",
        ("1 long gap starts a new episode" if gaps == 1 else f"{gaps} long gaps start new episodes")
        if gaps
        else "",
    ]
    note = f"time steps are uneven; put on an even step of {step:.6g} s: {'; '.join(w for w in what if w)}"
    return Recording(
        time=np.concatenate([g.time for g in grids]),
        signals={n: np.concatenate([g[n] for g in grids]) for n in recording.signals},
        units=recording.units,
        episode=np.repeat(np.arange(len(grids)), [len(g) for g in grids]),
        source=recording.source,
        known=recording.known,
        notes=(*recording.notes, note),
        aligned=recording.aligned,
        lost={n: np.concatenate([g.lost[n] for g in grids]) for n in recording.lost},
    )


def _ordered(part: Recording) -> Recording:
    """Rows sorted by time, without exact repetitions of the row before."""
    part = part.rows(np.argsort(part.time, kind="stable"))
    columns = np.column_stack([part.time, *part.signals.values()])
    again = np.concatenate([[False], (columns[1:] == columns[:-1]).all(axis=1)])
    return part.rows(np.flatnonzero(~again)) if again.any() else part


def _merged(part: Recording) -> Recording:
    """One row per stamp: of several the last, which is the newest."""
    last = np.concatenate([np.diff(part.time) > 0, [True]])
    return part.rows(np.flatnonzero(last))


def _usual(times: Sequence[FloatArray]) -> tuple[float, float]:
    """Usual step, and the standard deviation of the steps that span no missing row, as a share of it.

    Even rows give a spectral line at one frequency even if stamps jitter and rows are missing: the highest
    line of the stamps near the median step. Without such a line it is the mean of the steps.
    """
    steps = np.concatenate([np.diff(t) for t in times])
    median = float(np.median(steps))
    near = steps[steps < 1.5 * median]
    longest = max(times, key=len)[:_EXAMINED]
    longest = longest[longest - longest[0] < 4 * len(longest) * median]  # a clock may leap by years
    bins = np.bincount(np.floor((longest - longest[0]) * (_FINE / median)).astype(np.int64))
    size = 1 << int(np.ceil(np.log2(4 * len(bins))))
    frequency = np.arange(size // 2 + 1) * (_FINE / median / size)
    line = np.abs(np.fft.rfft(bins, size)) / len(longest)
    line[(frequency < 0.7 / median) | (frequency > 1.4 / median)] = 0.0
    best = int(line.argmax())
    step = 1.0 / float(frequency[best]) if line[best] > _BEAT / np.sqrt(len(longest)) else float(near.mean())
    return step, float(near.std()) / step


@compiled
def _follow(time: FloatArray, step: float) -> FloatArray:
    """Even times estimated from jittering stamps: whole steps from a slowly tracking phase.

    Two rows never share a step: the earlier one moves back if the step before it is free, else the later
    one moves on.
    """
    count = np.zeros(len(time), dtype=np.int64)
    phase = time[0]
    for i in range(1, len(time)):
        count[i] = np.int64(np.round((time[i] - phase) / step))
        phase += 0.02 * (time[i] - phase - count[i] * step)
        if count[i] == count[i - 1] and i > 1 and count[i - 1] - 1 > count[i - 2]:
            count[i - 1] -= 1
        count[i] = max(count[i], count[i - 1] + 1)
    return np.asarray(time[0] + step * count)


def _roughness(
    parts: Sequence[Recording], times: Sequence[FloatArray], names: Sequence[str], model: Model | None
) -> float:
    """Median error of predicting rows from their neighbours, as the mean logarithm over signals."""
    errors: dict[str, list[FloatArray]] = {name: [] for name in names}
    half = _NEIGHBOURS // 2
    for part, time in zip(parts, times, strict=True):
        rows = np.arange(half, len(time) - half, max(1, len(time) * len(parts) // _EXAMINED))
        if not len(rows):
            continue
        around = rows[:, None] + np.r_[-half:0, 1 : half + 1]
        scale = time[around[:, -1]] - time[around[:, 0]]
        powers = ((time[around] - time[rows, None]) / scale[:, None])[:, :, None] ** np.arange(4)
        solver = np.linalg.pinv(powers)[:, 0]
        for name in names:
            values = _continuous(part[name], name, model)
            errors[name].append(values[rows] - np.einsum("rk,rk->r", solver, values[around]))
    spread = [float(np.median(np.abs(np.concatenate(e)))) for e in errors.values() if e]
    return float(np.mean([np.log(s) for s in spread if s > 0])) if any(s > 0 for s in spread) else 0.0


def _split(part: Recording, time: FloatArray, step: float) -> list[tuple[Recording, FloatArray]]:
    """Pieces between long gaps; pieces too short for a cubic are left out."""
    edges = np.flatnonzero(np.diff(time) > (LONGEST_FILL + 0.5) * step) + 1
    pieces = np.split(np.arange(len(time)), edges)
    return [(part.rows(rows), time[rows]) for rows in pieces if len(rows) >= _NEIGHBOURS]


def _resampled(part: Recording, time: FloatArray, step: float, model: Model | None) -> Recording:
    """One piece resampled to its even grid."""
    count = int(np.floor((time[-1] - time[0]) / step + 1e-6)) + 1
    grid = time[0] + step * np.arange(count)
    commands = {s.name for s in model.inputs} if model is not None else set()
    signals = {
        name: _held_mean(values, time, grid, step)
        if name in commands
        else _moved(_continuous(values, name, model), time, grid, step)
        for name, values in part.signals.items()
    }
    lost = {name: np.interp(grid, time, gone) > 0.5 for name, gone in part.lost.items()}
    return replace(part, time=grid, signals=signals, episode=np.zeros(count, dtype=np.int64), lost=lost)


def _continuous(values: FloatArray, name: str, model: Model | None) -> FloatArray:
    """An angle without jumps by whole turns."""
    angle = model is not None and any(s.angle for s in model.outputs if s.name == name)
    return np.unwrap(values) if angle else values


def _held_mean(values: FloatArray, time: FloatArray, grid: FloatArray, step: float) -> FloatArray:
    """Mean over each grid step of a signal that is held from row to row."""
    integral = np.concatenate([[0.0], np.cumsum(values[:-1] * np.diff(time))])
    ends = np.append(grid, grid[-1] + step)
    row = np.clip(np.searchsorted(time, ends + 1e-9 * step, side="right") - 1, 0, len(time) - 1)
    reached = integral[row] + values[row] * (ends - time[row])
    return np.asarray(np.diff(reached) / step)


def _moved(values: FloatArray, time: FloatArray, grid: FloatArray, step: float) -> FloatArray:
    """The nearest measured value to each grid point, shifted along a local cubic; in a gap, the cubic."""
    out = np.empty(len(grid))
    for start in range(0, len(grid), _BLOCK):
        at = grid[start : start + _BLOCK]
        right = np.clip(np.searchsorted(time, at), 1, len(time) - 1)
        nearest = np.where(at - time[right - 1] < time[right] - at, right - 1, right)
        first = np.clip(right - _NEIGHBOURS // 2, 0, len(time) - _NEIGHBOURS)
        rows = first[:, None] + np.arange(_NEIGHBOURS)
        powers = ((time[rows] - at[:, None]) / (_NEIGHBOURS * step))[:, :, None] ** np.arange(4)
        cubic = np.einsum("rik,rk->ri", np.linalg.pinv(powers), values[rows])
        away = (time[nearest] - at) / (_NEIGHBOURS * step)
        there = np.einsum("ri,ri->r", cubic, away[:, None] ** np.arange(4))
        measured = np.abs(time[nearest] - at) < 0.75 * step
        out[start : start + _BLOCK] = np.where(measured, values[nearest] + cubic[:, 0] - there, cubic[:, 0])
    return out
