"""Noise that wanders, for recordings whose simulation has white noise only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.signal import lfilter

from fieldmodels.recording import Recording


def wandering(
    recording: Recording, deviations: Mapping[str, float], share: float, correlation: float, seed: int
) -> Recording:
    """Add noise with a correlation time to signals; their white noise is to be smaller by as much.

    Args:
        recording: Of one episode, with ``sqrt(1 - share)`` of its white noise.
        deviations: Standard deviation of each signal's whole noise.
        share: Share of the variance that wanders.
        correlation: Correlation time [s].
        seed: Of the noise.
    """
    if share == 0.0:
        return recording
    rng = np.random.default_rng([seed, 1])
    decay = float(np.exp(-recording.step / correlation))
    signals = dict(recording.signals)
    for name, deviation in deviations.items():
        drive = np.sqrt(1.0 - decay**2) * rng.standard_normal(len(recording))
        drive[0] = rng.standard_normal()
        signals[name] = signals[name] + np.sqrt(share) * deviation * lfilter([1.0], [1.0, -decay], drive)
    return replace(recording, signals=signals)
