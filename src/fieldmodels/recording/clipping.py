"""Sensors that saturate, told from machines that rest, and counters that wrap around."""

from __future__ import annotations

import numpy as np

from fieldmodels.model import Model, Signal
from fieldmodels.recording.data import Recording

STUCK = 5
"""Consecutive rows at an extreme value that count as saturation, unless the signal is coarse."""
MOVING = 0.3
"""Of the usual change from row to row, at which a signal arrives where it saturates: what comes to rest slows
down. A sine that is cut at 0.97 of its height arrives at a third of its usual change."""
ARRIVAL = 3  # changes before it stays, whose mean is how fast it arrives
LONGER = 3
"""Times the longest stay at a value between, if it arrived as fast, that it stays where it saturates."""
COUNTED = 0.1
"""Share of the changes that are the smallest one, from which that is an encoder's count."""
STILL = 0.1
"""Of its range, within which another signal stands still."""
WRAP = 0.5
"""Of its range, by which a counter that wraps jumps; it moves much less otherwise."""
SMOOTH = 0.1
"""Of its range, that no change reaches but those jumps, nor any once they are taken out."""

BINS = 10
"""Parts of its range, through all of which a counter goes that wraps."""

_BLOCK = 1_000_000  # rows examined together


def saturated_rows(recording: Recording, signal: Signal, model: Model) -> int:
    """Longest run of rows at which a sensor seems to saturate; 0 for none.

    It stays at its largest or smallest value, and arrives there as fast as it moves otherwise; where a record
    begins with it, it leaves it so. What comes to rest slows down first, an encoder to single counts; a rate
    rests at zero, whichever way it comes there, and a counter begins there. A coarse sensor repeats its
    values anyhow, as does one whose frames are lost: either stays much longer where it saturates.

    Args:
        recording: With the signal, in SI units.
        signal: An output.
        model: Whose other signals tell whether the machine moves meanwhile.
    """
    values = recording[signal.name]
    changes = np.abs(np.diff(values))
    moving = changes[changes > 0.0]
    extreme = (values == values.max()) | (values == values.min())
    if extreme.all():
        return 0
    usual, finest = float(np.median(moving)), float(moving.min())
    count = finest if np.mean(moving < 1.01 * finest) > COUNTED else 0.0
    starts = recording.bounds[:, 0]
    new = np.append(True, changes > 0.0)
    new[starts] = True
    begins = np.flatnonzero(new)
    ends = np.append(begins[1:], len(values))
    lasting = LONGER * (ends - begins) >= STUCK  # shorter ones tell nothing
    begins, ends = begins[lasting], ends[lasting]
    first = np.isin(begins, starts)
    # The changes by which it leaves, or arrives.
    passed = np.where(first, ends - 1, np.maximum(begins - ARRIVAL, 0))
    until = np.where(first, np.minimum(ends - 1 + ARRIVAL, len(changes)), begins)
    travelled = np.concatenate([[0.0], np.cumsum(changes)])
    fast = travelled[until] - travelled[passed] > MOVING * usual * np.maximum(until - passed, 1)
    held = (ends - begins)[fast & ~first & ~extreme[begins]]
    least = max(STUCK, LONGER * int(held.max(initial=0)))
    longest = 0
    for k in np.flatnonzero(fast & extreme[begins] & (ends - begins >= least)):
        begin, end = int(begins[k]), int(ends[k])
        zero, of_rate = values[begin] == 0.0, signal.unit.endswith("/s")
        if first[k] and (zero or end in recording.bounds[:, 1]):
            continue
        counted = changes[passed[k] : until[k]].max() <= 1.5 * count
        may_rest = zero or (first[k] and not of_rate)
        if not counted and not (may_rest and _rests(recording, signal, model, slice(begin, end))):
            longest = max(longest, end - begin)
    return longest


def _rests(recording: Recording, signal: Signal, model: Model, rows: slice) -> bool:
    """Whether nothing else moves meanwhile; commands may, while a rate is zero (stiction, a dead zone)."""
    others = [s.name for s in model.outputs if s.name != signal.name]
    if not signal.unit.endswith("/s"):
        others += [s.name for s in model.inputs]
    present = [recording[name] for name in others if name in recording]
    return all(np.ptp(values[rows]) <= STILL * np.ptp(values) for values in present)


def wraps(recording: Recording, name: str) -> tuple[float, int, int] | None:
    """Whether a signal jumps from one end of its range to the other, as a counter or an angle that wraps.

    Args:
        recording: With the signal.
        name: The signal.

    Returns:
        The period by its jumps, how many they are and the row of the first; None if it does not wrap.
    """
    values, episode = recording[name], recording.episode
    span = float(np.ptp(values))
    changes = np.diff(values)
    changes[np.diff(episode) != 0] = 0.0
    jumps = np.flatnonzero(np.abs(changes) > WRAP * span)
    if not len(jumps):
        return None
    others = np.delete(changes, jumps)
    if not len(others) or np.abs(others).max() > SMOOTH * span or not others.any():
        return None
    # A jump is the period less the motion of that step, which is about that of the step before.
    before = np.where(jumps > 0, changes[jumps - 1], 0.0)
    before = np.where(np.abs(before) > WRAP * span, 0.0, before)
    periods = np.abs(changes[jumps] - before)
    period = float(np.median(periods))
    same = np.abs(periods - period).max() <= SMOOTH * span and abs(period - span) <= SMOOTH * span
    # A sensor whose zero jumps passes nowhere between; an angle near its end may not, either.
    between = bool(np.all(np.histogram(values, BINS)[0] > 0))
    turn = recording.units.get(name) == "rad" and abs(period / (2.0 * np.pi) - 1.0) <= SMOOTH
    return (period, len(jumps), int(jumps[0]) + 1) if same and (between or turn) else None
