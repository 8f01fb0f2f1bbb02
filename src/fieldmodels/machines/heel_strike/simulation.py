"""Prediction of the leg over windows of a recording, for a batch of parameter vectors."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled, inlined
from fieldmodels.elementary import sine_and_cosine
from fieldmodels.machines.heel_strike.leg import gyro_reading, leg_step, push_off, samples_late, speed_read

GYRO, ANGLE, CLOSURE, PUSH_OFF = range(4)
"""Outputs of a prediction, in the order of ``HeelStrikeModel.outputs``."""


class Walk(NamedTuple):
    """What is known of a recorded walk.

    Attributes:
        time: Sample times [s], shape (n,).
        strike: 1 at the first sample after each heel strike, shape (n,).
        disturbance: Additional torque per inertia [rad/s2], shape (n,), or empty.
        step: Sampling interval [s].
        gravity: Acceleration of free fall [m/s2].
        speed: Speed that the push-off aims at [rad/s].
        share: Share of the speed error that it removes.
        around: Samples over which the gyro is averaged before and after a strike.
    """

    time: FloatArray
    strike: FloatArray
    disturbance: FloatArray
    step: float
    gravity: float
    speed: float
    share: float
    around: int


@compiled
def simulate(
    plants: NDArray[Any],
    extended: NDArray[np.bool_],
    starts: NDArray[np.int64],
    states: FloatArray,
    lengths: NDArray[np.int64],
    walk: Walk,
    out: FloatArray,
) -> None:
    """Simulate every window: RK4 of (2.11), with the push-off at each marked strike.

    Args:
        plants: What leg and gyro truly are, shape (batch,), dtype ``PLANT``.
        extended: Whether a force effect of each is on, shape (batch,).
        starts: First sample of each window, shape (windows,).
        states: Angle [rad] and the gyro's reading [rad/s] there, shape (windows, 2).
        lengths: Samples of each window, shape (windows,).
        walk: What is known of the recording.
        out: Filled with gyro, angle, closure and push-off, shape (batch, windows, samples, 4); closure is
            only meant at strikes, push-off ``around`` samples after the window's first.
    """
    latest = 0
    for p in range(len(plants)):
        latest = max(latest, samples_late(plants[p], walk.step)[0])
    history = walk.around + latest + 2
    speeds = np.empty(history + out.shape[2])
    for p in range(len(plants)):
        for w in range(len(starts)):
            window = out[p, w, : lengths[w]]
            _predict(plants[p], extended[p], starts[w], states[w], walk, history, speeds, window)


@inlined
def reading_at(speeds: FloatArray, position: int, whole: int, part: float, time: float, plant: Any) -> float:
    """The gyro's reading at a position of the speeds so far; see ``gyro_reading``."""
    newer, older = speeds[position - whole], speeds[position - whole - 1]
    return gyro_reading(newer, older, part, time, plant)


@compiled
def _predict(
    plant: Any,
    extended: bool,
    start: int,
    state: FloatArray,
    walk: Walk,
    history: int,
    speeds: FloatArray,
    window: FloatArray,
) -> None:
    """Fill one window, shape (samples, 4); ``history`` speeds before its first are looked back at."""
    step, around = walk.step, walk.around
    time, strike, disturbance = walk.time[start:], walk.strike[start:], walk.disturbance[start:]
    stiffness = walk.gravity / plant.length
    whole, part = samples_late(plant, step)
    # Backward in time: what the gyro read before, and reads late.
    begun = speed_read(state[1], time[0], plant)
    theta, omega = state[0], begun
    speeds[history] = omega
    for j in range(history):
        sines, moment = sine_and_cosine(theta), time[0] - j * step
        theta, omega = leg_step(theta, omega, 0.0, sines, moment, -step, stiffness, plant, extended)
        speeds[history - j - 1] = omega
    before = 0.0
    for j in range(around):
        before += reading_at(speeds, history - j, whole, part, time[0] - j * step, plant) / around
    target = push_off(before, walk.speed, walk.share)
    theta, omega = state[0], begun
    opened, turned, after, torque = theta, 0.0, 0.0, 0.0
    for n in range(len(window)):
        if n > 0:
            if len(disturbance) > 0:
                torque = 0.5 * (disturbance[n - 1] + disturbance[n])
            sines, moment = sine_and_cosine(theta), time[n - 1]
            theta, omega = leg_step(theta, omega, torque, sines, moment, step, stiffness, plant, extended)
        speeds[history + n] = omega
        gyro = reading_at(speeds, history + n, whole, part, time[n], plant)
        if n > 0:
            turned += gyro * step
            if n <= around:
                after += gyro / around
        window[n, GYRO] = gyro
        window[n, ANGLE] = theta
        window[n, CLOSURE] = theta - opened - turned
        window[n, PUSH_OFF] = after - target
        if strike[n] > 0.5:
            omega = push_off(omega, walk.speed, walk.share)
            opened, turned = theta, 0.0
