"""How large and how fast measured signals are, and how noisy, whatever their pace."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.recording import Recording

ORDERS = (4, 8, 12)
"""Of the differences that tell noise: the more, the faster a motion may be beside the sampling."""
MOST_SAMPLES = 20
"""Over which a slope is taken, at most; and no more than a fiftieth of a recording."""
CLEAR = 20.0
"""Times the noise's variance that a signal's change over some samples must have, to be a slope."""
SLOPE_ERROR = 0.05
"""Of a signal's rate, that a slope may err by noise."""
PARABOLA = 0.5
"""Of the time in which a signal changes by its size: farther it is no parabola."""
MOST_AROUND = 200
"""Samples before and after, at most, so that a million take no second."""


def white_noise(values: FloatArray) -> float:
    """Standard deviation of white noise on a smooth signal, from its repeated differences.

    A difference of order k of white noise has the variance (2k choose k) sigma^2; of a smooth signal it is
    small, and of a fast one the smaller, the higher the order: the least of three is taken. Signals that only
    change by jumps of a coarse sensor give their root mean square instead of the median, which would be zero.
    """
    found = []
    for order in ORDERS:
        differences = np.diff(values, order)
        if len(differences):
            robust = 1.4826 * float(np.median(np.abs(differences)))
            size = robust or float(np.sqrt(np.mean(differences**2)))
            found.append(size / math.sqrt(math.comb(2 * order, order)))
    return min(found, default=0.0)


def rms(values: FloatArray) -> float:
    """Root mean square; 0 of nothing."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


def centred(recordings: Sequence[Recording], name: str) -> FloatArray:
    """A signal of all recordings that have it, about its mean in each."""
    found = [r[name] - r[name].mean() for r in recordings if name in r]
    return np.concatenate(found) if found else np.zeros(0)


def rate_size(recordings: Sequence[Recording], name: str, order: int = 1) -> float:
    """Root mean square of a signal's rate, or with ``order`` 2 of the rate of that; 0 if no recording has it.

    Changes are taken over as few samples as rise clearly above the noise, whose share is taken off.
    """
    squares, counts = [], []
    for recording in recordings:
        if name not in recording:
            continue
        noise = math.comb(2 * order, order) * white_noise(recording[name]) ** 2
        most = max(1, min(MOST_SAMPLES, len(recording) // 50))
        for span in range(1, most + 1):
            change = _changes(recording, name, span, order)
            power = float(np.mean(change**2)) if len(change) else 0.0
            if power > CLEAR * noise or span == most:
                break
        squares.append(max(power - noise, 0.1 * power) / (span * recording.step) ** (2 * order) * len(change))
        counts.append(len(change))
    return math.sqrt(sum(squares) / sum(counts)) if sum(counts) else 0.0


def pace(recordings: Sequence[Recording], name: str) -> float:
    """Time [s] in which a signal changes by its size; 0 if it does not change."""
    return rms(centred(recordings, name)) / (rate_size(recordings, name) or math.inf)


def _changes(recording: Recording, name: str, span: int, order: int) -> FloatArray:
    """Differences over some samples of one episode, of first or second order."""
    reach = order * span
    inside = recording.episode[reach:] == recording.episode[: len(recording) - reach]
    values = recording[name]
    for _ in range(order):
        values = values[span:] - values[:-span]
    return np.asarray(values[inside])


def slopes(recording: Recording, name: str, order: int) -> FloatArray:
    """Rate of a signal at each sample, or with ``order`` 2 the rate of that, shape (n,).

    It is that of a parabola through as few samples around it as tell it from noise, but no farther than the
    signal is one (Savitzky and Golay 1964).
    """
    from scipy.signal import savgol_filter  # half of the time that environments take to be imported

    farthest = min(PARABOLA * pace([recording], name) / recording.step, MOST_AROUND)
    widths = 2.0 * np.arange(1, max(int(farthest), 1) + 1) + 1.0
    variances = 12.0 / (widths * (widths**2 - 1.0))  # of a slope by least squares, and of a bend
    if order == 2:
        variances *= 60.0 / (widths**2 - 4.0)
    noise = white_noise(recording[name]) * np.sqrt(variances) / recording.step**order
    allowed = SLOPE_ERROR * rate_size([recording], name, order)
    reach = 1 + min(int(np.count_nonzero(noise > allowed)), len(widths) - 1)
    found = np.zeros(len(recording))
    for a, b in recording.bounds:
        width = 2 * min(reach, (b - a - 1) // 2) + 1
        if width >= 3:
            found[a:b] = savgol_filter(recording[name][a:b], width, 2, order, recording.step)
    return found
