"""Prediction of the leg over windows of a recording, for a batch of parameter vectors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fieldmodels.compiled import compiled, inlined
from fieldmodels.heel_strike.truth import BIAS, DELAY, HISTORY, LENGTH, push_off, sensed, truth_step
from fieldmodels.model import FloatArray

SIGNALS = 4


@inlined
def at(speeds: FloatArray, position: float) -> float:
    """Speed at a fractional sample, by linear interpolation."""
    whole = int(position)
    part = position - whole
    value: float = speeds[whole]
    if part > 0.0:
        value += part * (speeds[whole + 1] - value)
    return value


@compiled
def simulate(
    parameters: FloatArray,
    starts: NDArray[np.int64],
    lengths: NDArray[np.int64],
    states: FloatArray,
    time: FloatArray,
    strike: FloatArray,
    disturbance: FloatArray,
    samples: int,
    step: float,
    gravity: float,
    speed: float,
    share: float,
    around: int,
) -> FloatArray:
    """Simulate every window: RK4 of (2.11), with the push-off at each marked strike.

    Returns:
        Gyro, angle, closure and push-off, shape (batch, windows, samples, 4); closure is only meant at
        strikes, push-off ``around`` samples after the window's first.
    """
    batch, windows = len(parameters), len(starts)
    result = np.full((batch, windows, samples, SIGNALS), np.nan)
    history = around + HISTORY
    speeds = np.empty(history + samples)
    forced = len(disturbance) > 0
    for p in range(batch):
        reality = parameters[p]
        stiffness = gravity / reality[LENGTH]
        lag = reality[DELAY] / step
        extended = False
        for i in range(1, BIAS):
            extended = extended or reality[i] != 0.0
        for w in range(windows):
            k = starts[w]
            theta, omega = states[w, 0], states[w, 1]
            # Backward in time: what the gyro showed before, and shows late.
            speeds[history] = omega
            for j in range(1, history + 1):
                theta, omega = truth_step(
                    theta, omega, 0.0, time[k] - (j - 1) * step, -step, stiffness, extended, reality
                )
                speeds[history - j] = omega
            before = 0.0
            for j in range(around):
                before += sensed(at(speeds, history - j - lag), time[k] - j * step, reality) / around
            theta, omega = states[w, 0], states[w, 1]
            opened, turned, after = theta, 0.0, 0.0
            for n in range(lengths[w]):
                if n > 0:
                    force = 0.5 * (disturbance[k + n - 1] + disturbance[k + n]) if forced else 0.0
                    theta, omega = truth_step(
                        theta, omega, force, time[k + n - 1], step, stiffness, extended, reality
                    )
                speeds[history + n] = omega
                gyro = sensed(at(speeds, history + n - lag), time[k + n], reality)
                if n > 0:
                    turned += gyro * step
                if 0 < n <= around:
                    after += gyro / around
                result[p, w, n, 0] = gyro
                result[p, w, n, 1] = theta
                result[p, w, n, 2] = theta - opened - turned
                result[p, w, n, 3] = after - push_off(before, speed, share)
                if strike[k + n] > 0.5:
                    omega = push_off(omega, speed, share)
                    opened, turned = theta, 0.0
    return result
