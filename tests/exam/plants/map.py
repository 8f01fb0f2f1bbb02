"""A machine that settles between rows: each shows what one command leads to, by a line with an offset."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from scipy.signal import lfilter

from exam.plants.faults import Fault
from fieldmodels.arrays import FloatArray

NOISE, RANGE = 0.01, 1.0
"""Deviation of the sensor, and the largest command."""
Act = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]
"""(commands, responses, time as a share of the record) to responses, each of shape (n,)."""


@dataclass
class Stand:
    """A test stand.

    Attributes:
        gain: Response by command.
        offset: Response without one.
        listed: Values of listed effects.
        more: What is not listed, one after the other.
        quantum: Of the sensor; 0 for none.
    """

    gain: float
    offset: float
    listed: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    more: list[Act] = field(default_factory=list)
    quantum: float = 0.0


def respond(stand: Stand, commands: FloatArray, noise: FloatArray, step: float) -> FloatArray:
    """What the sensor shows of each command, shape (n,); ``noise`` likewise, ``step`` [s] between rows."""
    u, here = commands.astype(float), stand.listed
    if "actuator_play" in here:
        half, at = 0.5 * here["actuator_play"]["width"], float(u[0])
        for k, wanted in enumerate(commands):
            at = min(max(at, wanted - half), wanted + half)
            u[k] = at
    if "dead_zone" in here:
        width, centre = here["dead_zone"]["width"], here["dead_zone"]["centre"]
        u = np.where(u > centre + width, u - width, np.where(u < centre - width, u + width, centre))
    y = stand.gain * u + stand.offset
    if "curvature" in here:
        bend = here["curvature"]
        places = bend["low"] + (bend["high"] - bend["low"]) * np.arange(9) / 8.0
        y = y + np.interp(u, places, [0.0, *(bend[f"value_{k}"] for k in range(1, 8)), 0.0])
    for act in stand.more:
        y = act(commands, y, np.arange(len(y)) / len(y))
    y = np.minimum(y, here.get("upper_limit", {}).get("limit", math.inf))
    y = np.maximum(y, here.get("lower_limit", {}).get("limit", -math.inf))
    y = y + here.get("sensor_drift", {}).get("rate", 0.0) * step * np.arange(len(y)) + noise
    quantum = max(stand.quantum, here.get("sensor_quantisation", {}).get("step", 0.0))
    return np.asarray(quantum * np.round(y / quantum) if quantum > 0.0 else y)


def _unlisted(words: str, act: Callable[..., FloatArray], *shows: str) -> Fault[Stand, float]:
    """A fault out of a function of size, commands, responses and time as a share of the record."""
    return Fault(words, lambda stand, k, _scale, _rng: stand.more.append(partial(act, k)), shows=shows)


def _follow(values: FloatArray, keep: float) -> FloatArray:
    """A recent mean, from the first value on."""
    return np.asarray(lfilter([1.0 - keep], [1.0, -keep], values, zi=[keep * values[0]])[0])


DEVELOP = {
    "fading": _unlisted(
        "The gain falls while the record goes on.",
        lambda k, u, y, t: y - 0.05 * k * u * t,
        "parameter gain over time",
        "sensor response over command*time",
        "sensor response over response*time",
    ),
    "slow_settling": _unlisted(
        "Part of the last response is still there.",
        lambda k, _u, y, _t: y + math.tanh(0.05 * k) * (_follow(y, 0.5) - y),
        "sensor response over past of command",
        "sensor response over past of response",
    ),
    "knocked": _unlisted(
        "Halfway through somebody knocks against the sensor.",
        lambda k, _u, y, t: y + 0.02 * k * (t >= 0.5),
        "sensor response over time",
        "force over time",
        "parameter offset over time",
    ),
}
REPORT = {
    "swaying": _unlisted(
        "The stand sways five times in a record.",
        lambda k, _u, y, t: y + 0.02 * k * np.sin(10.0 * math.pi * t + 0.5),
        "sensor response over time",
        "force over time",
        "parameter offset over time",
    ),
    "creeping": _unlisted(
        "The offset creeps after the commands of the last twenty rows.",
        lambda k, u, y, _t: y + 0.1 * k * (_follow(u, 0.95) - u[0]),
        "sensor response over past of command",
        "parameter offset over past of command",
    ),
    "shaded": _unlisted(
        "A large command leaves less for the next one.",
        lambda k, u, y, _t: y - 0.02 * k * np.abs(np.append(u[0], u[:-1])),
        "sensor response over past of command",
        "parameter offset over past of command",
    ),
}
