"""What the sensors make of the motion: white noise on every signal, and which signals there are.

Accelerometer: dr'' in frame II, and dr', dr by integration. Inclinometer: the rotation dtheta, and w, w' by
differentiation. Force/torque sensor: dF, dN of the arm's base, turned from the arm's frame IV to frame II by
the known f. The source corrupts "sensor data"; taken as each of the 24 signals having white noise of its own,
since an inclinometer's white noise, differentiated twice, would be hundreds of times the signal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import inlined
from fieldmodels.machines.excitation.dynamics import SUBSTEPS, simulate
from fieldmodels.machines.excitation.motion import CONSTANT, DECISION, arm_motion
from fieldmodels.machines.excitation.parameters import (
    CG,
    DAMPING,
    DURATION,
    EQUATIONS,
    INERTIA,
    MODES,
    ROWS,
    SAMPLE,
    SAMPLES,
    STIFFNESS,
    UNKNOWNS,
    Arm,
    SensorNoise,
)
from fieldmodels.machines.excitation.regression import SIGNALS
from fieldmodels.streams import symmetric


@dataclass(frozen=True)
class Variant:
    """Which equations an experiment has, and which unknowns it looks for; the others count as known.

    Attributes:
        rows: Equations in use, shape (18,).
        unknowns: Unknowns that are estimated, shape (22,).
    """

    rows: NDArray[np.bool_]
    unknowns: NDArray[np.bool_]


def _variant(rows: list[int], unknowns: list[int]) -> Variant:
    use, seek = np.zeros(ROWS, dtype=np.bool_), np.zeros(UNKNOWNS, dtype=np.bool_)
    use[rows], seek[unknowns] = True, True
    return Variant(use, seek)


FULL = _variant(list(range(ROWS)), list(range(UNKNOWNS)))
TABLE2 = _variant([EQUATIONS * 0 + 3], [INERTIA, CG + 1, CG + 2, DAMPING + 3, STIFFNESS + 3])
"""Table II: no accelerometer, rotations about x only: the moment about x of the first mode, five unknowns."""


@inlined
def corrupt(
    signals: FloatArray,
    maxima: FloatArray,
    fraction: float,
    key: np.uint64,
    counter: int,
    measured: FloatArray,
) -> None:
    """Measure one sample of one mode.

    Args:
        signals: True signals, shape (24,).
        maxima: Maximum sensed value of each, shape (24,).
        fraction: Share of the maximum that the noise reaches.
        key: Stream of the noise; the draws do not depend on the signals.
        counter: First of 24 draws.
        measured: Receives the measured signals, shape (24,).
    """
    for i in range(SIGNALS):
        measured[i] = signals[i] + fraction * maxima[i] * symmetric(key, counter + i)


@inlined
def first_draw(sample: int, mode: int) -> int:
    """Counter of the first of the 24 draws for one sample of one mode, counted from the run's beginning."""
    return (sample * MODES + mode) * SIGNALS


@inlined
def mean_draw(key: np.uint64, samples: int) -> float:
    """Mean of the standard draws behind the noise of the latest sample, in (-1, 1); 0 before the first.

    It depends on neither motion nor estimate: equal for all who met the same noise.

    Args:
        key: Stream of the noise.
        samples: Samples so far.

    Returns:
        Mean over all modes and signals.
    """
    total, count = 0.0, MODES * SIGNALS
    if samples > 0:
        first = first_draw(samples - 1, 0)
        for i in range(count):
            total += symmetric(key, first + i)
        total /= count
    return total


def full_scale(vehicle: FloatArray, arm: Arm | None = None, *, per_mode: bool = False) -> FloatArray:
    """Maximum sensed values under the constant excitation (24), shape (3, 24).

    Args:
        vehicle: The 22 unknowns.
        arm: The arm (default: the source's).
        per_mode: See ``SensorNoise``.
    """
    motion, _ = arm_motion(
        np.tile(CONSTANT, (round(DURATION / DECISION), 1)), math.inf, per_decision=SAMPLES * SUBSTEPS
    )
    maxima = np.abs(simulate(vehicle, motion, (arm or Arm()).row(), SAMPLE)[0]).max(axis=1)
    if not per_mode:
        maxima = np.broadcast_to(maxima.max(axis=0), (MODES, SIGNALS))
    return np.array(maxima)


def variances(maxima: FloatArray, fraction: FloatArray | float) -> FloatArray:
    """Variances of uniform noise up to a share of the maxima, of the maxima's shape."""
    return np.asarray((fraction * maxima) ** 2 / 3.0)


def measure(
    signals: FloatArray, maxima: FloatArray, noise: SensorNoise, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Measure whole runs of all modes.

    Args:
        signals: True signals, shape (3, samples, 24).
        maxima: Full scale, shape (3, 24); ignored for ``running_max``.
        noise: The sensors' noise.
        rng: Source of all randomness.

    Returns:
        Measured signals, shape (3, samples, 24), and the variance of each one's noise, the same shape.
    """
    if noise.kind == "running_max":
        scale = np.maximum.accumulate(np.abs(signals), axis=1)
        if not noise.per_mode:
            scale = np.broadcast_to(scale.max(axis=0), scale.shape)
    else:
        scale = np.broadcast_to(maxima[:, None, :], signals.shape)
    draws = rng.uniform(-1.0, 1.0, signals.shape)
    return signals + noise.fraction * scale * draws, variances(scale, noise.fraction)
