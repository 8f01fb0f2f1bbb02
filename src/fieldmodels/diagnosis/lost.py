"""Samples that a sensor has lost and shows as the last one again.

Prediction errors hardly reveal them, and a delay would imitate them; the values themselves do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.phrases import sensor_of
from fieldmodels.model import Model
from fieldmodels.recording import Recording

FEWEST = 8
"""Lost samples from which on it is said."""
LONGEST = 8
"""Samples in a row from which on a signal rests: chance hardly loses so many."""
IRREGULAR = 0.4
"""Standard deviation over mean of the samples between two losses; by chance it is 1, of a slow sensor 0."""
FINE = 1e-6
"""Of a usual change: changes that differ by less are the same, as those of a coarse sensor are."""


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
                f"{sensor_of(name)} repeats its last value in {100 * share:.2g} % of the samples, "
                "which were lost and are interpolated here"
            )
            for r in (*train, *test):
                lost = _held(r[name])
                mended[id(r)] = _interpolated(mended[id(r)], name, lost, output.angle)
    return [mended[id(r)] for r in train], [mended[id(r)] for r in test], tuple(said)


def _is_fine(values: FloatArray) -> bool:
    """Whether a sensor is recorded so finely that it repeats nothing by chance: hardly two changes agree."""
    changes = np.abs(np.diff(values))
    changes = changes[changes > 0.0]
    if not np.isfinite(values).all() or 2 * len(changes) < len(values):
        return False
    return len(np.unique(np.round(changes / (FINE * np.median(changes))))) > 0.9 * len(changes)


def _held(values: FloatArray) -> NDArray[np.bool_]:
    """Which samples show the last value again, briefly and at irregular times, shape (n,)."""
    held = np.append(False, values[1:] == values[:-1])
    held &= (values != np.max(values)) & (values != np.min(values))  # where a sensor saturates, perhaps
    edges = np.flatnonzero(np.diff(np.concatenate([[0], held, [0]])))
    begun, ended = edges[::2], edges[1::2]
    between = np.diff(begun)
    certain = held.sum() >= FEWEST and _is_fine(values)
    brief = np.max(ended - begun, initial=0) < LONGEST
    irregular = len(between) >= FEWEST // 2 and between.std() > IRREGULAR * between.mean()
    return held if certain and brief and irregular else np.zeros(len(values), dtype=np.bool_)


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
