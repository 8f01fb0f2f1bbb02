"""Prediction of the leg over windows of a recording, for a batch of parameter vectors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled, inlined
from fieldmodels.machines.heel_strike.truth import (
    DELAY,
    FREQUENCY,
    GAIN,
    HISTORY,
    LENGTH,
    VISCOUS,
    extended_step,
    offset,
    push_off,
    sensed,
    truth_step,
)

SIGNALS = 4


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
    result = np.full((len(parameters), len(starts), samples, SIGNALS), np.nan)
    speeds = np.empty(around + HISTORY + samples)
    for p in range(len(parameters)):
        reality = parameters[p]
        extended = False
        for i in range(VISCOUS, FREQUENCY):
            extended = extended or reality[i] != 0.0
        for w in range(len(starts)):
            k = starts[w]
            _predict(
                result[p, w, : lengths[w]], states[w], reality, extended, time[k:], strike[k:],
                disturbance[k:], step, gravity, speed, share, around, speeds,
            )  # fmt: skip
    return result


@compiled
def _predict(
    window: FloatArray,
    state: FloatArray,
    reality: FloatArray,
    extended: bool,
    time: FloatArray,
    strike: FloatArray,
    disturbance: FloatArray,
    step: float,
    gravity: float,
    speed: float,
    share: float,
    around: int,
    speeds: FloatArray,
) -> None:
    """Fill one window, shape (samples, 4); the other arrays begin at its first sample."""
    stiffness = gravity / reality[LENGTH]
    lag = reality[DELAY] / step
    history = around + HISTORY
    # Backward in time: what the gyro showed before, and shows late.
    start = (state[1] - offset(time[0], reality)) / reality[GAIN]
    theta, omega = state[0], start
    speeds[history] = omega
    for j in range(1, history + 1):
        if not extended:
            theta, omega = truth_step(theta, omega, 0.0, -step, stiffness)
        else:
            theta, omega = extended_step(
                theta, omega, 0.0, time[0] - (j - 1) * step, -step, stiffness, reality
            )
        speeds[history - j] = omega
    before = 0.0
    for j in range(around):
        before += sensed(at(speeds, history - j - lag), time[0] - j * step, reality) / around
    target = push_off(before, speed, share)
    theta, omega = state[0], start
    opened, turned, after, torque = theta, 0.0, 0.0, 0.0
    for n in range(len(window)):
        if n > 0:
            if len(disturbance) > 0:
                torque = 0.5 * (disturbance[n - 1] + disturbance[n])
            if not extended:
                theta, omega = truth_step(theta, omega, torque, step, stiffness)
            else:
                theta, omega = extended_step(theta, omega, torque, time[n - 1], step, stiffness, reality)
        speeds[history + n] = omega
        gyro = sensed(at(speeds, history + n - lag), time[n], reality)
        if n > 0:
            turned += gyro * step
            if n <= around:
                after += gyro / around
        window[n, 0] = gyro
        window[n, 1] = theta
        window[n, 2] = theta - opened - turned
        window[n, 3] = after - target
        if strike[n] > 0.5:
            omega = push_off(omega, speed, share)
            opened, turned = theta, 0.0


@inlined
def at(speeds: FloatArray, position: float) -> float:
    """Speed at a fractional sample, by linear interpolation."""
    whole = int(position)
    part = position - whole
    value: float = speeds[whole]
    if part > 0.0:
        value += part * (speeds[whole + 1] - value)
    return value
