"""Where the torque that the nominal leg leaves over has spectral peaks: starts for a periodic force."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.recording import Recording

BLOCK = 0.05
"""Time over which the gyro is averaged before it is differentiated [s]."""
RANGE = (0.1, 6.0)
"""Frequencies searched [Hz]."""
PEAKS = 4


def torque_peaks(recordings: Sequence[Recording], stiffness: float) -> tuple[float, ...]:
    """Frequencies [Hz] of the highest peaks in the spectrum of the torque left over, highest first.

    Args:
        recordings: The measured data.
        stiffness: g/L of the nominal leg [1/s2].
    """
    parts = [_leftover_torque(r, stiffness) for r in recordings]
    size = 4 * max(len(part) for part in parts)
    if size == 0:
        return (1.0,)
    power = sum(np.abs(np.fft.rfft(part, size)) ** 2 for part in parts)
    frequencies = np.fft.rfftfreq(size, BLOCK)
    power = np.where((frequencies >= RANGE[0]) & (frequencies <= RANGE[1]), power, 0.0)
    apart = 2 / (BLOCK * max(len(part) for part in parts))
    result: list[float] = []
    for i in np.argsort(-power):
        if all(abs(frequencies[i] - f) > apart for f in result):
            result.append(float(frequencies[i]))
        if len(result) == PEAKS:
            break
    return tuple(result)


def _leftover_torque(recording: Recording, stiffness: float) -> FloatArray:
    """Leftover torque [rad/s2] by blocks, less what constants and friction explain; 0 where unknown."""
    count = max(2, round(BLOCK / recording.step))
    blocks = len(recording) // count
    if blocks < 8:
        return np.zeros(0)

    def averaged(values: FloatArray) -> FloatArray:
        return np.asarray(values[: blocks * count].reshape(blocks, count).mean(axis=1))

    gyro, struck = recording["gyro"], recording["strike"] > 0.5
    turned = np.cumsum(gyro) * recording.step
    latest = np.maximum.accumulate(np.where(struck, np.arange(len(gyro)), 0))
    theta = averaged(recording["strike_angle"] + turned - turned[latest])
    omega = averaged(gyro)
    since = averaged(np.asarray((np.arange(len(gyro)) - latest) * recording.step, dtype=np.float64))
    episode = averaged(recording.episode.astype(np.float64))
    length = count * recording.step
    torque = (omega[2:] - omega[:-2]) / (2 * length) + stiffness * np.sin(theta[1:-1])
    # Not across a push-off, nor while the collision noise is fresh.
    keep = (since[2:] > since[1:-1]) & (since[:-2] > 2 * length) & (episode[2:] == episode[:-2])
    result = np.zeros(blocks)
    if keep.sum() < 8:
        return result
    speed, angle = omega[1:-1][keep], theta[1:-1][keep]
    known = np.column_stack([np.ones_like(speed), speed, np.sign(speed), angle])
    result[1:-1][keep] = torque[keep] - known @ np.linalg.lstsq(known, torque[keep], rcond=None)[0]
    return result
