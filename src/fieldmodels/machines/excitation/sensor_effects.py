"""What the sensors' effects make of true signals: one description for predicted runs and running experiments.

Integrals of the accelerometer are zeroed at rest: its bias reaches dr'' alone, its gain dr' and dr too. What
the inclinometer measures late or biased, its derivatives hold late too.
"""

from __future__ import annotations

import math
from typing import Any

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import inlined
from fieldmodels.drivers.stepped import Signals, show, slope_shown
from fieldmodels.effects.sensors import unpack
from fieldmodels.machines.excitation.parameters import SAMPLE
from fieldmodels.machines.excitation.regression import (
    ACCELERATION,
    ANGLE,
    FORCE,
    POSITION,
    RATE,
    SIGNALS,
    TURNING,
    VELOCITY,
    gravity_change,
)
from fieldmodels.machines.excitation.vectors import Vector, copy_to

OUTPUTS = 11
"""Accelerometer x, y, z; pitch, roll; force x, y, z; torque x, y, z."""
TILT, FORCES = 3, 5
"""Where these begin among the outputs."""
TURNS = 9
"""Signals that come from the inclinometer: dtheta, w, w'."""
HISTORY = 41
"""Samples that a delayed inclinometer needs, the latest last: 0.2 s and one."""


@inlined
def accelerometer(s: FloatArray, gravity: float, q: Any) -> Vector:
    """Specific force that the accelerometer measures, less that at rest [m/s2].

    Args:
        s: True signals of a sample, shape (24,).
        gravity: Acceleration of free fall [m/s2].
        q: The vehicle and its effects, dtype ``ROW``.
    """
    gx, gy, gz = gravity_change(s[ANGLE], s[ANGLE + 1], s[ANGLE + 2], gravity)
    gain, bias = q.accelerometer_gain.gain, q.accelerometer_bias
    return (
        gain * (s[ACCELERATION] - gx) + bias.x,
        gain * (s[ACCELERATION + 1] - gy) + bias.y,
        gain * (s[ACCELERATION + 2] - gz) + bias.z,
    )


@inlined
def between(p0: float, v0: float, p1: float, v1: float, share: float) -> tuple[float, float]:
    """The cubic through two samples and their slopes, these per sample: value and slope at a share."""
    d = p1 - p0
    second, third = 3.0 * d - 2.0 * v0 - v1, v0 + v1 - 2.0 * d
    value = p0 + share * (v0 + share * (second + share * third))
    return value, v0 + share * (2.0 * second + 3.0 * share * third)


@inlined
def late_turn(then: FloatArray, after: FloatArray, axis: int, share: float, step: float) -> Vector:
    """Rotation, its rate and w' about an axis between two samples, by cubics through angles, rates and w'.

    Args:
        then: dtheta, w, w' of a sample, shape (9,).
        after: The same of the next one.
        axis: 0 pitch, 1 roll, 2 yaw.
        share: Share of the way from one to the other.
        step: Time between them [s].
    """
    angle, _ = between(then[axis], step * then[3 + axis], after[axis], step * after[3 + axis], share)
    rate, slope = between(
        then[3 + axis], step * then[6 + axis], after[3 + axis], step * after[6 + axis], share
    )
    return angle, rate, slope / step


@inlined
def delay_inclinometer(signals: FloatArray, before: FloatArray, q: Any) -> None:
    """Let the inclinometer's signals come late, in place.

    Args:
        signals: Of consecutive samples, shape (samples, 24).
        before: True dtheta, w, w' before them, the latest last, shape (41, 9).
        q: The vehicle and its effects.
    """
    late = q.inclinometer_delay.delay / SAMPLE
    # From the end, so that earlier samples are still true when they are read.
    for n in range(len(signals) - 1, -1, -1):
        whole = math.floor(n - late)
        share = n - late - whole
        then = before[HISTORY + whole] if whole < 0 else signals[whole, ANGLE : ANGLE + TURNS]
        after = before[HISTORY + whole + 1] if whole < -1 else signals[whole + 1, ANGLE : ANGLE + TURNS]
        for axis in range(3):
            angle, rate, turning = late_turn(then, after, axis, share, SAMPLE)
            signals[n, ANGLE + axis], signals[n, RATE + axis], signals[n, TURNING + axis] = (
                angle,
                rate,
                turning,
            )


@inlined
def measure_raw(q: Any, gravity: float, history: FloatArray, signals: FloatArray) -> None:
    """Turn a decision's true signals into what sensors with effects measure, in place.

    Args:
        q: The vehicle and its effects, dtype ``ROW``.
        gravity: Acceleration of free fall [m/s2].
        history: Latest true dtheta, w, w' before the decision, shape (41, 9); receives those at its end.
        signals: Shape (samples, 24), at least 41 samples; dr'' becomes the specific force.
    """
    before = history.copy()
    for n in range(len(history)):
        copy_to(history[n], signals[len(signals) - len(history) + n, ANGLE : ANGLE + TURNS])
    for n in range(len(signals)):
        s = signals[n]
        s[ACCELERATION], s[ACCELERATION + 1], s[ACCELERATION + 2] = accelerometer(s, gravity, q)
    if q.inclinometer_delay.delay > 0.0:
        delay_inclinometer(signals, before, q)
    for n in range(len(signals)):
        s = signals[n]
        s[ANGLE] += q.inclinometer_bias.pitch
        s[ANGLE + 1] += q.inclinometer_bias.roll
        for k in range(POSITION, ACCELERATION):
            s[k] *= q.accelerometer_gain.gain
        for k in range(FORCE, SIGNALS):
            s[k] *= q.force_torque_gain.gain


@inlined
def show_raw(sensors: Signals, b: int, mode: int, time: float, signals: FloatArray) -> None:
    """Let stock effects act on what the sensors measure of a decision, in place.

    An accelerometer's gain reaches its integrals dr', dr too, as a gain of the machine's own does; an
    inclinometer's derivatives w, w' are taken by its slope.

    Args:
        sensors: Stock effects of the outputs of all modes.
        b: The experiment.
        mode: The mode.
        time: When the decision began [s].
        signals: Shape (samples, 24).
    """
    first = mode * OUTPUTS
    for n in range(len(signals)):
        s, now = signals[n], time + (n + 1) * SAMPLE
        for axis in range(3):
            k = first + axis
            s[ACCELERATION + axis] = show(sensors, b, k, s[ACCELERATION + axis], now, SAMPLE)
            gain = unpack(sensors.rows[b, k]).gain_gain
            s[VELOCITY + axis] *= gain
            s[POSITION + axis] *= gain
        for axis in range(2):
            k, true = first + TILT + axis, s[ANGLE + axis]
            s[ANGLE + axis] = show(sensors, b, k, true, now, SAMPLE)
            steep = slope_shown(sensors, b, k, true)
            s[RATE + axis] *= steep
            s[TURNING + axis] *= steep
        for i in range(SIGNALS - FORCE):
            s[FORCE + i] = show(sensors, b, first + FORCES + i, s[FORCE + i], now, SAMPLE)


@inlined
def compensate(gravity: float, signals: FloatArray) -> None:
    """Take gravity's share out of the specific force, by the tilt that is measured, in place."""
    for n in range(len(signals)):
        s = signals[n]
        gx, gy, gz = gravity_change(s[ANGLE], s[ANGLE + 1], s[ANGLE + 2], gravity)
        s[ACCELERATION] += gx
        s[ACCELERATION + 1] += gy
        s[ACCELERATION + 2] += gz
