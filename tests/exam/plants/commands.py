"""What machines are commanded: signals of peak one over a time that is counted in samples of a usual pace."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from fieldmodels.arrays import FloatArray

Rng = np.random.Generator


def waves(time: FloatArray, low: float, high: float, count: int, rng: Rng) -> FloatArray:
    """Sines of random phases between two frequencies [Hz], falling with the root of the frequency."""
    frequencies = np.geomspace(low, high, count) * rng.uniform(0.93, 1.07, count)
    phases = rng.uniform(0.0, 2.0 * math.pi, count)
    total = np.sin(2.0 * math.pi * np.outer(time, frequencies) + phases) @ (1.0 / np.sqrt(frequencies))
    return np.asarray(total / np.abs(total).max())


def held(time: FloatArray, shortest: float, longest: float, rng: Rng) -> FloatArray:
    """Levels, each held for a random time [s]."""
    result, now = np.empty(len(time)), float(time[0])
    while now <= time[-1]:
        until = now + rng.uniform(shortest, longest)
        result[(time >= now) & (time < until)] = rng.uniform(-1.0, 1.0)
        now = until
    return result


def _mixed(time: FloatArray, rng: Rng) -> FloatArray:
    total = 0.6 * waves(time, 0.1, 4.0, 11, rng) + 0.4 * held(time, 0.3, 1.5, rng)
    knots = np.linspace(time[0], time[-1], 13)
    total *= np.interp(time, knots, rng.permutation(np.linspace(0.1, 1.0, 13)))
    return np.asarray(total / np.abs(total).max())


def _binary(time: FloatArray, rng: Rng) -> FloatArray:
    return np.asarray(np.where(held(time, 0.1, 0.6, rng) > 0.0, 1.0, -1.0))


def _sweep(time: FloatArray, rng: Rng) -> FloatArray:
    share = (time - time[0]) / (time[-1] - time[0])
    turns = 0.1 * (time[-1] - time[0]) / math.log(40.0) * (40.0**share - 1.0)
    return np.asarray(np.sin(2.0 * math.pi * turns + rng.uniform(0.0, 2.0 * math.pi)))


def _sine(time: FloatArray, rng: Rng) -> FloatArray:
    return np.asarray(np.sin(2.0 * math.pi * rng.uniform(0.3, 1.5) * time))


def _one_step(time: FloatArray, rng: Rng) -> FloatArray:
    return np.asarray(np.where(time > time[0] + rng.uniform(0.1, 0.4) * (time[-1] - time[0]), 0.7, 0.0))


def _small(time: FloatArray, rng: Rng) -> FloatArray:
    return 0.03 * _mixed(time, rng)


def _slow(time: FloatArray, rng: Rng) -> FloatArray:
    return waves(time, 0.02, 0.08, 3, rng)


COMMANDS: Mapping[str, Callable[[FloatArray, Rng], FloatArray]] = {
    "mixed": _mixed,
    "steps": lambda time, rng: held(time, 0.3, 1.5, rng),
    "waves": lambda time, rng: waves(time, 0.1, 4.0, 11, rng),
    "binary": _binary,
    "sweep": _sweep,
    "sine": _sine,
    "one_step": _one_step,
    "small": _small,
    "slow": _slow,
}
"""By name: (times [s], source of randomness) to commands."""
POOR = ("binary", "sine", "one_step", "small", "slow")
"""Commands that excite a machine poorly."""


def path(time: FloatArray, rng: Rng) -> FloatArray:
    """A smooth path of peak one that begins at rest, now wide, now narrow."""
    total = waves(time, 0.15, 1.6, 8, rng) * np.minimum((time - time[0]) / 1.5, 1.0) ** 3
    knots = np.linspace(time[0], time[-1], 9)
    levels = rng.permutation(np.linspace(0.25, 1.0, 9))
    place = (time - time[0]) / (knots[1] - knots[0])
    k = np.minimum(place.astype(int), 7)
    share = 0.5 - 0.5 * np.cos(math.pi * (place - k))
    total *= levels[k] * (1.0 - share) + levels[k + 1] * share
    return np.asarray(total / np.abs(total).max())
