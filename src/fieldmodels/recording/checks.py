"""Checks of measured data before anything is computed from them."""

from __future__ import annotations

from collections.abc import Mapping, Set

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.model import Model, Signal
from fieldmodels.recording import Recording
from fieldmodels.recording.clipping import saturated_rows, wraps
from fieldmodels.recording.data import GAP, MAX_JITTER
from fieldmodels.recording.evidence import DEGREES, clock_unit, magnitude, slope, spins, turns, without_sign
from fieldmodels.recording.tables import SHOWN, Problem
from fieldmodels.recording.units import STANDARD_GRAVITY, other_units
from fieldmodels.recording.windows import MIN_SAMPLES, longer_windows

REST = 0.1
"""Largest distance from 1 of the median of an accelerometer that is suspected to be in g."""
LEAST_COUNTED = 0.5
"""Smallest time step [s] that is suspected to be in a fraction of a second."""
LEAP = 5.5
"""A time step of more than this many usual ones is a jump, after which a new episode starts."""
COARSE = 0.2
"""Share of repeated stamps above which a clock is coarse."""
WRAPS = {0.065536: "65536:us", 65.536: "65536:ms", 4294.967296: "4294967296:us", 4294967.296: "4294967296:ms"}
"""Times [s] after which counters of 16 and 32 bits begin anew, and their periods."""
_BLOCK = 1_000_000  # rows examined together


def check_episodes(episode: FloatArray) -> list[Problem]:
    """Check that episode numbers are integers and that no episode is resumed later."""
    broken = np.flatnonzero(episode != np.round(episode))
    if len(broken):
        return [Problem(f"{episode[broken[0]]:g} is not an integer", "episode", int(broken[0]))]
    starts = np.concatenate([[0], np.flatnonzero(np.diff(episode)) + 1])
    seen: set[float] = set()
    for start in starts:
        if episode[start] in seen:
            message = f"episode {episode[start]:g} is taken up again; give each stretch a number of its own"
            return [Problem(message, "episode", int(start))]
        seen.add(episode[start])
    return []


def check_time(recording: Recording) -> list[Problem]:
    """Check that time is not constant, nor decreases by more than a step within an episode."""
    time, episode, median = recording.time, recording.episode, recording.step
    backward: list[int] = []
    for start in range(0, len(time) - 1, _BLOCK):  # in blocks, so that a long record needs no second array
        block = slice(start, start + _BLOCK + 1)
        inside = np.diff(episode[block]) == 0
        backward += (start + 1 + np.flatnonzero((np.diff(time[block]) < -max(median, 0.0)) & inside)).tolist()
    if len(backward) > len(time) // 2:
        return [Problem("time falls from row to row; sort the rows by time", row=backward[0])]
    if backward:
        return [_backward(time, row) for row in backward[:SHOWN]] + _more(backward, "such rows")
    if len(time) > 1 and np.ptp(time) == 0 and len(recording.bounds) < len(time):
        return [Problem(f"time stands still at {time[0]:.9g} s; is this the clock's column?")]
    return []


def clock_faults(recording: Recording) -> list[tuple[str, list[int]]]:
    """What a clock does that times do not do, each with the data rows; a coarse one stands still often."""
    steps = np.where(np.diff(recording.episode) == 0, np.diff(recording.time), recording.step)
    jumps = np.flatnonzero(steps > LEAP * recording.step) + 1
    still = np.flatnonzero(steps == 0) + 1
    most = f"jumps by up to {steps.max(initial=0.0):.4g} s"
    found = [("goes back", np.flatnonzero(steps < 0) + 1), (most, jumps)]
    found += [("stands still", still)] if len(still) < COARSE * len(steps) else []
    return [(what, rows.tolist()) for what, rows in found if len(rows)]


def is_even(recording: Recording) -> bool:
    """Whether time increases in steps that are even to one per cent, without a gap."""
    time, episode, median = recording.time, recording.episode, recording.step
    count, total, squares = 0, 0.0, 0.0
    for start in range(0, len(time) - 1, _BLOCK):
        block = slice(start, start + _BLOCK + 1)
        inside = np.diff(episode[block]) == 0
        steps = np.diff(time[block])[inside]
        if np.any((steps <= 0) | (steps > GAP * median)):
            return False
        count += len(steps)
        total += float((steps - median).sum())
        squares += float((steps - median) @ (steps - median))
    return count == 0 or squares / count - (total / count) ** 2 <= (MAX_JITTER * median) ** 2


def check_length(recording: Recording, horizon: float) -> list[Problem]:
    """Check that at least one window of the horizon fits, with enough samples in it."""
    step = recording.step
    longest = max(float(recording.time[b - 1] - recording.time[a]) for a, b in recording.bounds)
    unit = clock_unit(recording.time, horizon)[0] if step >= LEAST_COUNTED else "s"
    hint = "if the bench is so slow, state its clock as 't=t:s'"
    if unit != "s":
        hint = f"the time column looks like {unit}: declare it as 't=t:{unit}'; or {hint}"
    if not step * (MIN_SAMPLES - 1) <= horizon * (1 + 1e-9):
        remedy = (
            f"sample faster, or predict over longer times ({longer_windows(step)}); or take --machine map, "
            "if the machine settles from row to row"
        )
        how = f"; {hint}" if step >= LEAST_COUNTED else ""
        return [
            Problem(f"one row every {step:.6g} s is too coarse to predict over {horizon:g} s; {remedy}{how}")
        ]
    if longest < horizon * (1 - MAX_JITTER):
        unit = "episode" if len(recording.bounds) > 1 else "record"
        return [Problem(f"the longest {unit} lasts {longest:.6g} s, shorter than the {horizon:g} s "
                        "over which the model must predict; record for longer")]  # fmt: skip
    return []


def suspicions(
    recording: Recording,
    model: Model | None,
    stated: Set[str] = frozenset(),
    columns: Mapping[str, str] | None = None,
) -> list[str]:
    """Return reasons to think that a column is in another unit than stated, or is dead.

    Args:
        recording: As it was read.
        model: Whose signals are doubted; None for the clock alone.
        stated: Signals whose unit the user or the file has stated: their magnitude alone raises no doubt.
        columns: Signal to the file's name of its column, where that differs.
    """
    found, columns = [], columns or {}
    if model is None:
        step = recording.step
        if step >= 1 and step == round(step):
            found.append(
                f"column 't' advances by {step:g} a row; if it is in milliseconds, declare it as 't=t:ms'"
            )
        return found
    signals = [s for s in (*model.inputs, *model.outputs) if s.name in recording]
    for one, other in (magnitude(recording, model, s.name) for s in model.inputs if s.name in recording):
        if one:
            found.append(f"column {one!r} {without_sign(other)}")
    for signal in signals:
        values, own = recording[signal.name], columns.get(signal.name, signal.name)
        span = float(np.ptp(values))
        large = signal.angle and span > DEGREES and signal.name not in stated
        if large and not spins(values) and not turns(model, recording, signal.name):
            found.append(
                f"column {signal.name!r} spans {span:.4g}, as radians {span / (2 * np.pi):.1f} turns; "
                f"if it is in degrees, declare it as '{signal.name}={own}:deg'"
            )
        if span == 0 and len(values) > MIN_SAMPLES and signal in model.outputs:
            found.append(f"column {signal.name!r} never changes; is the sensor connected?")
        if signal in model.outputs and not signal.event:
            if rows := saturated_rows(recording, signal, model):
                found.append(
                    f"column {signal.name!r} stays at its extreme values for up to {rows} rows at a time; if "
                    "the sensor saturates there, leave these rows out and start new episodes"
                )
            if signal.name not in model.wrapped_outputs and (wrap := wraps(recording, signal.name)):
                found.append(_wrapped(signal, *wrap))
        if (
            signal.name not in stated
            and signal.unit == "m/s^2"
            and abs((usual := float(np.median(np.abs(values)))) - 1.0) < REST
            and np.abs(values).max() < STANDARD_GRAVITY
        ):
            found.append(
                f"column {signal.name!r} is usually {usual:.2f}, a tenth of gravity; if it is in g, "
                f"declare it as '{signal.name}={own}:g'"
            )
        for rate in signals:
            if rate.unit == f"{signal.unit}/s":
                found += _wrong_scale(recording, signal, rate, columns)
    return found


def _wrapped(signal: Signal, period: float, jumps: int, row: int) -> str:
    times = "once" if jumps == 1 else f"{jumps} times"
    return (
        f"column {signal.name!r} jumps {times} by about {period:.4g} {signal.unit}, first {row} rows after "
        "the first one, as a counter or an angle that wraps around does; declare its period in the file's "
        f"own numbers, such as '{signal.name}=NAME%360:deg' for an angle in degrees, or "
        f"'{signal.name}=0.00153398*NAME%4096:rad' for 4096 counts a turn, and it is unwrapped"
    )


def _more(rows: list[int], what: str) -> list[Problem]:
    return [Problem(f"and {len(rows) - SHOWN} more {what}")] if len(rows) > SHOWN else []


def _backward(time: FloatArray, row: int) -> Problem:
    restart = time[row] <= time[0] + 0.01 * (time[row - 1] - time[0])
    fall = time[row - 1] - time[row]
    wrap = next((text for period, text in WRAPS.items() if abs(fall / period - 1) < 0.01), "")
    remedy = (
        f"a counter that begins anew? declare its period, as 't=COLUMN%{wrap}'"
        if wrap
        else "a new run? number the runs in a column 'episode'"
        if restart
        else "sort the rows by time, and drop repeated ones"
    )
    return Problem(f"t = {time[row]:.9g} s does not come after {time[row - 1]:.9g} s; {remedy}", row=row)


def _wrong_scale(
    recording: Recording, position: Signal, rate: Signal, columns: Mapping[str, str]
) -> list[str]:
    """Compare a signal's changes with its measured rate: their ratio reveals a wrong unit."""
    rows = slice(0, _BLOCK)
    steps = np.diff(recording.time[rows])
    ratio = slope(recording[position.name][rows], recording[rate.name][rows], steps, recording.episode[rows])
    if not ratio > 0:
        return []
    for wrong, value, other in ((position, ratio, rate), (rate, 1 / ratio, position)):
        for unit, scale in other_units(wrong.unit).items():
            if abs(value * scale - 1) < 0.1:
                how = (
                    f"it changes {value:.3g} times as fast as {other.name!r} says"
                    if wrong is position
                    else f"it is {value:.3g} times the rate of {other.name!r}"
                )
                clock = "; or is t in ms?" if scale == 1e-3 and wrong is rate else ""
                return [
                    f"column {wrong.name!r} looks as if it were in {unit}: {how}; declare it as "
                    f"'{wrong.name}={columns.get(wrong.name, wrong.name)}:{unit}'{clock}"
                ]
    return []
