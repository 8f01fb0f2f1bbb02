"""How the errors on recorded walks change with the gains of each stride: tangents, then the adjoint."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled
from fieldmodels.elementary import sine_and_cosine
from fieldmodels.machines.heel_strike.estimators import observer_step, reset
from fieldmodels.machines.heel_strike.leg import push_off
from fieldmodels.machines.heel_strike.search import Walks
from fieldmodels.model import ModelError

ANGLE, SPEED, EARLY, LATE, SHARE = range(5)
"""What an angle at a strike depends on: angle and speed at the strike before, and three gains."""


def stride_slopes(walks: Walks, gains: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Signed error of (2.14) on every stride, and its derivatives within the stride.

    Args:
        walks: The recorded walks.
        gains: S_MS early, S_MS late, S_HR, S_FD [1/s] of each stride, shape (strides, 4).

    Returns:
        Errors as ``stride_errors`` gives them [mm], shape (strides,); and the derivatives of estimated angle
        and speed at the closing strike by those at the strike before and by the first three gains, shape
        (strides, 2, 5) [rad, rad/s].

    Raises:
        ModelError: If the gains have another shape.
    """
    table = np.ascontiguousarray(gains, dtype=np.float64)
    if table.shape != (len(walks), 4):
        raise ModelError(f"gains must have shape ({len(walks)}, 4), not {table.shape}")
    leg = walks.leg
    errors, slopes = np.empty(len(walks)), np.empty((len(walks), 2, 5))
    _stride_slopes(
        walks.gyro, walks.samples, walks.walk, walks.theta, walks.height, table, leg.step,
        leg.gravity / leg.length, leg.speed, leg.push_off, walks.envelope, errors, slopes,
    )  # fmt: skip
    return errors * (1000 * leg.step_length), slopes


def loss_slopes(walks: Walks, slopes: FloatArray, by_error: FloatArray) -> FloatArray:
    """Derivatives of a sum of losses by every stride's gains, effects on later strides included.

    Args:
        walks: The recorded walks.
        slopes: What `stride_slopes` gave.
        by_error: Derivative of each stride's loss by its signed error [1/mm], shape (strides,).

    Returns:
        Derivatives by S_MS early, S_MS late and S_HR, shape (strides, 3).
    """
    result = np.empty((len(walks), 3))
    _adjoint(walks.walk, slopes, by_error * (1000 * walks.leg.step_length), result)
    return result


@compiled
def _stride_slopes(
    gyro: FloatArray, samples: NDArray[np.int64], walk: NDArray[np.int64], truth: FloatArray,
    height: FloatArray, gains: FloatArray, step: float, stiffness: float, speed: float, share: float,
    envelope: int, errors: FloatArray, slopes: FloatArray,
) -> None:  # fmt: skip
    """Run (2.14) with its tangents over all strides; derivatives by the angle before its reset."""
    by_angle, by_speed = np.empty(5), np.empty(5)
    theta, omega, position = 0.0, speed, 0
    for s in range(len(samples)):
        by_angle[:], by_speed[:] = 0.0, 0.0
        if s == 0 or walk[s] != walk[s - 1]:
            theta, omega = 0.0, speed
        else:
            geometry = truth[s - 1] + height[s - 1]
            by_angle[ANGLE], by_angle[SHARE] = 1.0 - gains[s, 2], geometry - theta
            by_speed[SPEED] = 1.0 - share
            theta = reset(theta, geometry, gains[s, 2])
            omega = push_off(omega, speed, share)
        for n in range(1, samples[s] + 1):
            phase = 0 if n <= envelope else 1
            ratio, decay, measured = gains[s, phase], gains[s, 3], gyro[position]
            position += 1
            pull, turn = -stiffness * math.sin(theta), -stiffness * math.cos(theta)
            for k in range(5):
                by_speed[k] += ((1.0 - ratio) * turn * by_angle[k] - ratio * decay * by_speed[k]) * step
            by_speed[EARLY + phase] += (decay * (measured - omega) - pull) * step
            for k in range(5):
                by_angle[k] += by_speed[k] * step
            sine = sine_and_cosine(theta)[0]
            theta, omega = observer_step(theta, sine, omega, measured, step, stiffness, ratio, decay, True)
        errors[s] = theta - truth[s]
        slopes[s, 0], slopes[s, 1] = by_angle, by_speed


@compiled
def _adjoint(walk: NDArray[np.int64], slopes: FloatArray, by_angle: FloatArray, result: FloatArray) -> None:
    """Carry a loss back from each strike to the one before; ``by_angle`` is each strike's own part."""
    later_angle, later_speed = 0.0, 0.0
    for s in range(len(walk) - 1, -1, -1):
        if s == len(walk) - 1 or walk[s] != walk[s + 1]:
            later_angle, later_speed = 0.0, 0.0
        angle, speed = by_angle[s] + later_angle, later_speed
        for k in range(3):
            result[s, k] = angle * slopes[s, 0, EARLY + k] + speed * slopes[s, 1, EARLY + k]
        later_angle = angle * slopes[s, 0, ANGLE] + speed * slopes[s, 1, ANGLE]
        later_speed = angle * slopes[s, 0, SPEED] + speed * slopes[s, 1, SPEED]
