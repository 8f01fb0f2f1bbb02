"""Samples that a sensor has lost and shows as the last one again.

Prediction errors hardly reveal them, and a delay would imitate them; the values themselves do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.resolution import rounding
from fieldmodels.model import Model
from fieldmodels.recording import Recording

FEWEST = 8
"""Lost samples from which on it is said;"""
CHANCE = 10.0
"""and times as many as repeat by chance, since what is recorded is rounded."""
LONGEST = 4.0
"""Samples in a row that are lost, on average; what does not move at all rests for longer."""
IRREGULAR = 0.4
"""Standard deviation over mean of the samples between two losses; by chance it is 1, of a slow sensor 0."""


def lost_samples(
    model: Model, train: Sequence[Recording], test: Sequence[Recording]
) -> tuple[list[Recording], list[Recording], tuple[str, ...]]:
    """Recordings with lost samples interpolated, and what is said of each sensor that loses some.

    Not said of coarse sensors, of what repeats regularly (a sensor slower than the log) or rests, nor of
    events.

    Args:
        model: The model.
        train: Recordings for fits.
        test: Recordings for the gain.
    """
    said, mended = [], {id(r): r for r in (*train, *test)}
    for output in (o for o in model.outputs if not o.event):
        name = output.name
        if not all(name in r for r in train):
            continue
        held = np.concatenate([_held(r[name]) for r in train])
        if held.any():
            share = float(held.mean())
            said.append(
                f"{name} repeats its last value in {100 * share:.2g} % of the samples, which were lost and "
                "are interpolated here"
            )
            for r in (*train, *test):
                lost = _held(r[name])
                mended[id(r)] = _interpolated(mended[id(r)], name, lost, output.angle)
    return [mended[id(r)] for r in train], [mended[id(r)] for r in test], tuple(said)


def _by_chance(values: FloatArray) -> float:
    """How many samples repeat the last one by chance, for its rounding; all where half of them do anyhow."""
    changes = np.abs(np.diff(values))
    changes = changes[changes > 0.0]
    if not np.isfinite(values).all() or 2 * min(len(changes), len(np.unique(values))) < len(values):
        return float(len(values))
    return len(values) * rounding(values) / (2.0 * float(np.median(changes)))


def _held(values: FloatArray) -> NDArray[np.bool_]:
    """Which samples show the last value again, briefly and at irregular times, shape (n,)."""
    held = np.append(False, values[1:] == values[:-1])
    held &= (values != np.max(values)) & (values != np.min(values))  # where a sensor saturates, perhaps
    between = np.diff(np.flatnonzero(held & ~np.append(False, held[:-1])))
    certain = held.sum() > FEWEST + CHANCE * _by_chance(values)
    irregular = len(between) >= FEWEST // 2 and between.std() > IRREGULAR * between.mean()
    brief = held.sum() <= LONGEST * (len(between) + 1)  # else it rests
    return held if certain and irregular and brief else np.zeros(len(values), dtype=np.bool_)


def _interpolated(recording: Recording, name: str, lost: NDArray[np.bool_], angle: bool) -> Recording:
    """A recording with a sensor's lost samples between the others."""
    if not lost.any():
        return recording
    mended = recording[name].copy()
    for first, last in recording.bounds:
        here, gone = slice(first, last), lost[first:last]
        if gone.all():  # a run of a row or two
            continue
        time, values = recording.time[here], recording[name][here]
        known = np.unwrap(values[~gone]) if angle else values[~gone]
        between = np.interp(time[gone], time[~gone], known)
        if angle:  # near the last one shown, however often it has turned
            between -= 2.0 * np.pi * np.round((between - values[gone]) / (2.0 * np.pi))
        mended[here][gone] = between
    return replace(recording, signals={**recording.signals, name: mended})
