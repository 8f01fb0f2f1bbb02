"""What sensors add to what they show: noise of many kinds, each of the same variance where it has one."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np
from scipy.signal import lfilter

from fieldmodels.arrays import FloatArray

SLOW = 50
"""Correlation time of noise that wanders [samples]."""


def _white(n: int, rng: np.random.Generator) -> FloatArray:
    return rng.standard_normal(n)


def _autoregressive(n: int, rng: np.random.Generator) -> FloatArray:
    decay = math.exp(-1.0 / SLOW)
    drive = math.sqrt(1.0 - decay**2) * rng.standard_normal(n)
    drive[0] = rng.standard_normal()
    return np.asarray(math.sqrt(0.5) * (rng.standard_normal(n) + lfilter([1.0], [1.0, -decay], drive)))


def _walk(n: int, rng: np.random.Generator) -> FloatArray:
    return np.asarray(rng.standard_normal(n) + np.cumsum(rng.standard_normal(n)) * 0.7 / math.sqrt(SLOW))


def _pink(n: int, rng: np.random.Generator) -> FloatArray:
    spectrum = np.fft.rfft(rng.standard_normal(n))
    frequencies = np.maximum(np.arange(len(spectrum)), 1.0)
    noise = np.fft.irfft(spectrum / np.sqrt(frequencies), n)
    return np.asarray(noise / noise.std())


def _heavy(n: int, rng: np.random.Generator) -> FloatArray:
    return np.asarray(rng.standard_t(3.0, n) / math.sqrt(3.0))


def _bursting(n: int, rng: np.random.Generator) -> FloatArray:
    level = np.ones(n)
    for begin in rng.integers(0, n, max(n // 1000, 1)):
        level[begin : begin + 20] = 8.0
    return np.asarray(level * rng.standard_normal(n))


NOISES: Mapping[str, Callable[[int, np.random.Generator], FloatArray]] = {
    "white": _white,
    "autoregressive": _autoregressive,
    "random_walk": _walk,
    "pink": _pink,
    "heavy_tailed": _heavy,
    "bursting": _bursting,
    "quantised": _white,
    "float32": _white,
}
"""Kinds of noise; what is quantised or rounded to 32 bits has white noise before."""
WANDERING = "autoregressive", "random_walk", "pink"
"""Those whose zero wanders, so that it is no mistake to say so."""


def noise(kind: str, deviations: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
    """Noise of sensors, shape (n, sensors)."""
    return np.column_stack([deviation * NOISES[kind](n, rng) for deviation in deviations])
