"""What must hold of measured data before anything is computed from them."""

from __future__ import annotations

import numpy as np

from fieldmodels.model import FloatArray, Model
from fieldmodels.recording import Recording
from fieldmodels.table_files import SHOWN, Problem

MAX_JITTER = 0.01
"""Largest standard deviation of the time step, as a fraction of its median, that counts as even."""
GAP = 1.5
"""A time step of more than this many medians is a gap."""
MAX_ANGLE_SPAN = 20.0
"""An angle that spans more radians than this (three turns) is suspected to be in degrees."""
MIN_SAMPLES = 4
"""Fewest samples in which a window can be predicted."""

_BLOCK = 1_000_000  # rows looked at together
_SCALES = {180 / np.pi: "degrees", 1000.0: "millimetres", 100.0: "centimetres"}


def check_episodes(episode: FloatArray) -> list[Problem]:
    """Check that episode numbers are integers and that no episode is taken up again."""
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
    """Check that time does not stand still, nor fall by more than a step within an episode."""
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
    looks_ms = step >= 0.5 and (MIN_SAMPLES - 1) * step / 1000 <= horizon
    hint = "; the time column looks like milliseconds: declare it as 't=t:ms'" if looks_ms else ""
    if not step * (MIN_SAMPLES - 1) <= horizon * (1 + 1e-9):
        message = (
            f"one row every {step:.6g} s is too coarse to predict over {horizon:g} s; sample faster{hint}"
        )
        return [Problem(message)]
    if longest < horizon * (1 - MAX_JITTER):
        unit = "episode" if len(recording.bounds) > 1 else "record"
        return [Problem(f"the longest {unit} lasts {longest:.6g} s, shorter than the {horizon:g} s "
                        "over which the model must predict; record for longer")]  # fmt: skip
    return []


def suspicions(recording: Recording, model: Model | None) -> list[str]:
    """Return reasons to think that a column is in another unit than stated, or is dead."""
    found = []
    if model is None:
        step = recording.step
        if step >= 1 and step == round(step):
            found.append(
                f"column 't' advances by {step:g} a row; if it is in milliseconds, declare it as 't=t:ms'"
            )
        return found
    for signal in model.outputs:
        if signal.name not in recording:
            continue
        values = recording[signal.name]
        span = float(np.ptp(values))
        if signal.angle and span > MAX_ANGLE_SPAN:
            found.append(
                f"column {signal.name!r} spans {span:.4g}, as radians {span / (2 * np.pi):.1f} turns; "
                f"if it is in degrees, declare it as '{signal.name}={signal.name}:deg'"
            )
        if span == 0 and len(values) > MIN_SAMPLES:
            found.append(f"column {signal.name!r} never changes; is the sensor connected?")
        for rate in model.outputs:
            if rate.name in recording and rate.unit == f"{signal.unit}/s":
                found += _wrong_scale(recording, signal.name, rate.name)
    return found


def _more(rows: list[int], what: str) -> list[Problem]:
    return [Problem(f"and {len(rows) - SHOWN} more {what}")] if len(rows) > SHOWN else []


def _backward(time: FloatArray, row: int) -> Problem:
    restart = time[row] <= time[0] + 0.01 * (time[row - 1] - time[0])
    remedy = (
        "a new run? number the runs in a column 'episode'"
        if restart
        else "sort the rows by time, and drop repeated ones"
    )
    return Problem(f"t = {time[row]:.9g} s does not come after {time[row - 1]:.9g} s; {remedy}", row=row)


def _wrong_scale(recording: Recording, position: str, velocity: str) -> list[str]:
    """Compare a signal's differences with its measured rate: their ratio tells a wrong unit."""
    part = slice(_BLOCK)
    inside = np.diff(recording.episode[part]) == 0
    slope = (np.diff(recording[position][part]) / np.diff(recording.time[part]))[inside]
    measured = recording[velocity][part]
    rate = (0.5 * (measured[1:] + measured[:-1]))[inside]
    product, power = float(slope @ rate), float(rate @ rate)
    if not product > 0:
        return []
    correlation = product / np.sqrt(power * float(slope @ slope))
    ratio = product / power
    for scale, name in _SCALES.items():
        for wrong, value in ((position, ratio), (velocity, 1 / ratio)):
            if correlation > 0.8 and abs(value / scale - 1) < 0.1:
                other = velocity if wrong == position else position
                return [
                    f"column {wrong!r} looks like {name}: it changes {value:.3g} times as fast "
                    f"as {other!r} says; declare its unit"
                ]
    return []
