"""Runs of the experiment, for a batch of parameter vectors: what the sensors would show."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled, inlined
from fieldmodels.machines.excitation.dynamics import STATE, VEHICLE, advance_mode
from fieldmodels.machines.excitation.regression import (
    ACCELERATION,
    ANGLE,
    FORCE,
    RATE,
    SIGNALS,
    gravity_change,
)

LAG = VEHICLE
ACCELEROMETER_BIAS = VEHICLE + 1
ACCELEROMETER_GAIN = VEHICLE + 4
INCLINOMETER_BIAS = VEHICLE + 5
INCLINOMETER_DELAY = VEHICLE + 7
FORCE_TORQUE_GAIN = VEHICLE + 8
PARAMETERS = VEHICLE + 9
"""Length of a parameter vector of ``ExcitationModel``."""

OUTPUTS = 11
"""Accelerometer x, y, z; pitch, roll; force x, y, z; torque x, y, z."""


@inlined
def fill_between(motion: FloatArray, step: float, fine: FloatArray) -> None:
    """Refine f, f', f'' by the quintic that meets all three at both ends of each interval.

    Args:
        motion: Shape (n, 3), ``step`` apart [s].
        step: Sampling interval [s].
        fine: Receives the motion, shape ((n - 1) * parts + 1, 3).
    """
    intervals = len(motion) - 1
    parts = (len(fine) - 1) // intervals
    for i in range(intervals):
        p0, v0, a0 = motion[i, 0], motion[i, 1] * step, motion[i, 2] * step * step
        p1, v1, a1 = motion[i + 1, 0], motion[i + 1, 1] * step, motion[i + 1, 2] * step * step
        # What is left of angle, speed and acceleration at the end beyond the parabola of the beginning.
        dp = p1 - p0 - v0 - 0.5 * a0
        dv = v1 - v0 - a0
        da = a1 - a0
        c3 = 10.0 * dp - 4.0 * dv + 0.5 * da
        c4 = -15.0 * dp + 7.0 * dv - da
        c5 = 6.0 * dp - 3.0 * dv + 0.5 * da
        fine[i * parts] = motion[i]
        for k in range(1, parts):
            s = k / parts
            s2 = s * s
            fine[i * parts + k, 0] = p0 + s * (v0 + s * (0.5 * a0 + s * (c3 + s * (c4 + s * c5))))
            fine[i * parts + k, 1] = (v0 + s * a0 + s2 * (3 * c3 + s * (4 * c4 + s * 5 * c5))) / step
            fine[i * parts + k, 2] = (a0 + s * (6 * c3 + s * (12 * c4 + s * 20 * c5))) / (step * step)
    fine[-1] = motion[-1]


@inlined
def lag_motion(fine: FloatArray, step: float, time_constant: float, lagged: FloatArray) -> None:
    """First-order lag of f, f' and f'' alike, exact for commands that are linear over a step.

    Args:
        fine: Commanded motion, shape (n, 3).
        step: Time between its rows [s].
        time_constant: Lag [s].
        lagged: Receives the arm's motion, shape (n, 3); it starts at rest where the command starts.
    """
    ratio = time_constant / step
    kept = math.exp(-1.0 / ratio)
    late = 1.0 - (1.0 - kept) * ratio
    early = (1.0 - kept) * ratio - kept
    lagged[0, 0], lagged[0, 1], lagged[0, 2] = fine[0, 0], 0.0, 0.0
    for i in range(1, len(fine)):
        for k in range(3):
            lagged[i, k] = kept * lagged[i - 1, k] + early * fine[i - 1, k] + late * fine[i, k]


@inlined
def tilt_before(signals: FloatArray, n: int, axis: int, delay: float, step: float) -> float:
    """Tilt a delay before sample ``n``, by the cubic through angles and rates; zero before the run."""
    position = n - delay / step
    whole = math.floor(position)
    if whole < 0:
        return 0.0
    s = position - whole
    value: float = signals[whole, ANGLE + axis]
    if s > 0.0:
        p1 = signals[whole + 1, ANGLE + axis]
        v0, v1 = signals[whole, RATE + axis] * step, signals[whole + 1, RATE + axis] * step
        d = p1 - value
        value += s * (v0 + s * (3.0 * d - 2.0 * v0 - v1 + s * (v0 + v1 - 2.0 * d)))
    return value


@compiled
def simulate_runs(
    parameters: FloatArray,
    bounds: NDArray[np.int64],
    modes: NDArray[np.int64],
    times: FloatArray,
    motion: FloatArray,
    arm: FloatArray,
    step: float,
    substeps: int,
    result: FloatArray,
) -> None:
    """Simulate every run from rest.

    Args:
        parameters: Vectors of ``ExcitationModel``, shape (batch, 38).
        bounds: First sample and end of each run, shape (runs, 2).
        modes: Axis of each run, 0 to 2, shape (runs,).
        times: Time of each run's first sample [s], shape (runs,).
        motion: Commanded f, f', f'' of every sample, shape (n, 3).
        arm: ``Arm.row()``, shape (5,).
        step: Sampling interval [s].
        substeps: Integration steps within it.
        result: Receives what the sensors show without noise, shape (batch, n, 11).
    """
    longest = 0
    for r in range(len(bounds)):
        longest = max(longest, bounds[r, 1] - bounds[r, 0])
    state = np.empty(STATE)
    signals = np.empty((longest, SIGNALS))
    commanded = np.empty(((longest - 1) * substeps + 1, 3))
    lagged = np.empty_like(commanded)
    gravity = arm[4]
    for r in range(len(bounds)):
        first, count = bounds[r, 0], bounds[r, 1] - bounds[r, 0]
        if count < 2:
            result[:, first : first + count] = 0.0
            continue
        fine = commanded[: (count - 1) * substeps + 1]
        late = lagged[: len(fine)]
        fill_between(motion[first : first + count], step, fine)
        for p in range(len(parameters)):
            q = parameters[p]
            arm_motion = fine
            if q[LAG] > 1e-9:
                lag_motion(fine, step / substeps, q[LAG], late)
                arm_motion = late
            state[:] = 0.0
            signals[0] = 0.0
            advance_mode(
                q[:VEHICLE], arm, modes[r], arm_motion, fine[0, 0], step, substeps, times[r], state,
                signals[1:count],
            )  # fmt: skip
            for n in range(count):
                s = signals[n]
                out = result[p, first + n]
                gx, gy, gz = gravity_change(s[ANGLE], s[ANGLE + 1], s[ANGLE + 2], gravity)
                gain = q[ACCELEROMETER_GAIN]
                out[0] = gain * (s[ACCELERATION] - gx) + q[ACCELEROMETER_BIAS]
                out[1] = gain * (s[ACCELERATION + 1] - gy) + q[ACCELEROMETER_BIAS + 1]
                out[2] = gain * (s[ACCELERATION + 2] - gz) + q[ACCELEROMETER_BIAS + 2]
                for k in range(2):
                    tilt = tilt_before(signals, n, k, q[INCLINOMETER_DELAY], step)
                    out[3 + k] = tilt + q[INCLINOMETER_BIAS + k]
                for k in range(6):
                    out[5 + k] = q[FORCE_TORQUE_GAIN] * s[FORCE + k]
