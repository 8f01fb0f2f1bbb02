"""The truth: the pendulum (2.11) by RK4 with its process torque, and the gyro that watches it.

A reality is a parameter vector of ``HeelStrikeModel`` (the positions below). Where its effects are off
the branch that computes them is not taken.
"""

from __future__ import annotations

import math

from fieldmodels.compiled import inlined
from fieldmodels.model import FloatArray

LENGTH = 0
VISCOUS = 1
COULOMB = 2
DRAG = 3
CONSTANT = 4
AMPLITUDE, FREQUENCY, PHASE = 5, 6, 7
BIAS = 8
DRIFT = 9
GAIN = 10
DELAY = 11
QUANTUM = 12
STEP_RATE, STEP_TIME = 13, 14
PARAMETERS = 15
COGGING, TEETH = 15, 16
HIDDEN = 17
"""A kernel's vector: the model's parameters, then cogging, which the model does not list (for exams)."""

CREEP = 0.01
"""Speed below which dry friction fades smoothly [rad/s] (assumed: RK4 stays accurate at the turn)."""
HISTORY = 16
"""Past speeds kept for the gyro's delay: more than the longest delay, 20 ms, at 2 ms a sample."""


@inlined
def effect_acceleration(theta: float, omega: float, time: float, reality: FloatArray) -> float:
    """What the force effects add to the angular acceleration [rad/s2]."""
    value: float = (
        reality[CONSTANT]
        - reality[VISCOUS] * omega
        - reality[COULOMB] * omega / math.sqrt(omega * omega + CREEP * CREEP)
        - reality[DRAG] * omega * abs(omega)
        + reality[AMPLITUDE] * math.sin(2 * math.pi * reality[FREQUENCY] * time + reality[PHASE])
    )
    if len(reality) > COGGING:
        value += reality[COGGING] * math.sin(reality[TEETH] * theta)
    return value


@inlined
def acceleration(
    theta: float,
    omega: float,
    torque: float,
    time: float,
    stiffness: float,
    extended: bool,
    reality: FloatArray,
) -> float:
    """Angular acceleration [rad/s2], eq (2.11); ``stiffness`` is g/L, ``torque`` the process torque."""
    value = -stiffness * math.sin(theta) + torque
    if extended:
        value += effect_acceleration(theta, omega, time, reality)
    return value


@inlined
def truth_step(
    theta: float,
    omega: float,
    torque: float,
    time: float,
    step: float,
    stiffness: float,
    extended: bool,
    reality: FloatArray,
) -> tuple[float, float]:
    """One RK4 step of (2.11) with the torque held; returns angle and speed."""
    half = 0.5 * step
    a1 = acceleration(theta, omega, torque, time, stiffness, extended, reality)
    v2 = omega + half * a1
    a2 = acceleration(theta + half * omega, v2, torque, time + half, stiffness, extended, reality)
    v3 = omega + half * a2
    a3 = acceleration(theta + half * v2, v3, torque, time + half, stiffness, extended, reality)
    v4 = omega + step * a3
    a4 = acceleration(theta + step * v3, v4, torque, time + step, stiffness, extended, reality)
    sixth = step / 6.0
    return (
        theta + sixth * (omega + 2.0 * v2 + 2.0 * v3 + v4),
        omega + sixth * (a1 + 2.0 * a2 + 2.0 * a3 + a4),
    )


@inlined
def push_off(omega: float, speed: float, share: float) -> float:
    """Speed after a strike: the push-off removes a share of the speed error (keeps the energy bounded)."""
    return omega - share * (omega - math.copysign(speed, omega))


@inlined
def delayed(history: FloatArray, sample: int, delay: float, step: float) -> float:
    """Speed a delay ago [rad/s], by linear interpolation between the samples kept in a ring."""
    lag = delay / step
    whole = int(lag)
    part = lag - whole
    newer: float = history[(sample - whole) % HISTORY]
    older: float = history[(sample - whole - 1) % HISTORY]
    return newer + part * (older - newer)


@inlined
def sensed(omega: float, time: float, reality: FloatArray) -> float:
    """What the gyro makes of a speed, without noise: gain, bias, drift, and a bias that jumps."""
    value: float = reality[GAIN] * omega + reality[BIAS] + reality[DRIFT] * time
    if time >= reality[STEP_TIME]:
        value += reality[STEP_RATE]
    return value


@inlined
def quantised(value: float, quantum: float) -> float:
    """Round to the gyro's resolution; 0 is infinitely fine."""
    return quantum * math.floor(value / quantum + 0.5) if quantum > 0.0 else value
