"""Runs of the experiment, for a batch of parameter vectors: what the sensors measure, without noise."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled, inlined
from fieldmodels.machines.excitation.dynamics import GRAVITY, STATE, advance_mode
from fieldmodels.machines.excitation.motion import lag_motion
from fieldmodels.machines.excitation.regression import ANGLE, FORCE, POSITION, SIGNALS
from fieldmodels.machines.excitation.sensor_effects import FORCES, OUTPUTS, TILT, accelerometer, late_turn


class Runs(NamedTuple):
    """Runs of one recording.

    Attributes:
        bounds: First sample and end of each run, shape (runs, 2).
        modes: Axis of each run, 0 to 2, shape (runs,).
        times: Time of each run's first sample [s], shape (runs,).
        motion: Commanded f, f', f'' of every sample, shape (n, 3).
        pushes: Force and torque on the vehicle at every sample, shape (n, 6), or (0, 6) for none.
        arm: ``Arm.row()``, shape (5,).
        step: Sampling interval [s].
        substeps: Integration steps within it.
    """

    bounds: NDArray[np.int64]
    modes: NDArray[np.int64]
    times: FloatArray
    motion: FloatArray
    pushes: FloatArray
    arm: FloatArray
    step: float
    substeps: int


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
def tilt_measured(signals: FloatArray, n: int, axis: int, delay: float, step: float) -> float:
    """Tilt a delay before sample ``n``; zero before the run."""
    position = n - delay / step
    whole = math.floor(position)
    if whole < 0:
        return 0.0
    share = position - whole
    if share > 0.0:
        return late_turn(signals[whole, ANGLE:], signals[whole + 1, ANGLE:], axis, share, step)[0]
    value: float = signals[whole, ANGLE + axis]
    return value


@inlined
def measure_run(q: Any, gravity: float, step: float, signals: FloatArray, out: FloatArray) -> None:
    """What the sensors measure of a run's true signals, and what none does, shape (samples, 15).

    See ``OUTPUTS``; then the deflection along x, y, z and the yaw.
    """
    for n in range(len(out)):
        s = signals[n]
        out[n, 0], out[n, 1], out[n, 2] = accelerometer(s, gravity, q)
        delay = q.inclinometer_delay.delay
        out[n, TILT] = tilt_measured(signals, n, 0, delay, step) + q.inclinometer_bias.pitch
        out[n, TILT + 1] = tilt_measured(signals, n, 1, delay, step) + q.inclinometer_bias.roll
        for k in range(SIGNALS - FORCE):
            out[n, FORCES + k] = q.force_torque_gain.gain * s[FORCE + k]
        for k in range(3):
            out[n, OUTPUTS + k] = s[POSITION + k]
        out[n, OUTPUTS + 3] = s[ANGLE + 2]


@compiled
def simulate_runs(vehicles: NDArray[Any], runs: Runs, result: FloatArray) -> None:
    """Simulate every run from rest.

    Args:
        vehicles: Numbers of vehicle, arm and sensors, shape (batch,), dtype ``ROW``.
        runs: The runs.
        result: Receives what ``measure_run`` says, without noise, shape (batch, n, 15).
    """
    longest = 0
    for r in range(len(runs.bounds)):
        longest = max(longest, runs.bounds[r, 1] - runs.bounds[r, 0])
    step, substeps = runs.step, runs.substeps
    state = np.empty(STATE)
    signals = np.empty((longest, SIGNALS))
    commanded = np.empty(((longest - 1) * substeps + 1, 3))
    lagged = np.empty_like(commanded)
    for r in range(len(runs.bounds)):
        first, count = runs.bounds[r, 0], runs.bounds[r, 1] - runs.bounds[r, 0]
        if count < 2:
            result[:, first : first + count] = 0.0
            continue
        fine = commanded[: (count - 1) * substeps + 1]
        late = lagged[: len(fine)]
        fill_between(runs.motion[first : first + count], step, fine)
        for p in range(len(vehicles)):
            q = vehicles[p]
            moved = fine
            if q.actuator_lag.time_constant > 0.0:
                late[0, 0], late[0, 1], late[0, 2] = fine[0, 0], 0.0, 0.0
                lag_motion(fine, step / substeps, q.actuator_lag.time_constant, late)
                moved = late
            state[:] = 0.0
            signals[0] = 0.0
            advance_mode(
                q, runs.arm, runs.modes[r], moved, fine[0, 0], step, substeps, runs.times[r], state,
                signals[1:count], runs.pushes[first : first + count] if len(runs.pushes) > 0 else runs.pushes,
            )  # fmt: skip
            measure_run(q, runs.arm[GRAVITY], step, signals, result[p, first : first + count])
