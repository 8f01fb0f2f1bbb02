"""The truth: the pendulum (2.11) by RK4 with its process torque, and the gyro that watches it.

A reality is a parameter vector of ``HeelStrikeModel`` (the positions below). Where its effects are off
the branch that computes them is not taken.
"""

from __future__ import annotations

import math

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import inlined

LENGTH = 0
VISCOUS = 1
COULOMB = 2
DRAG = 3
CONSTANT = 4
SINE, COSINE, FREQUENCY = 5, 6, 7
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
    phase = 2 * math.pi * reality[FREQUENCY] * time
    value: float = (
        reality[CONSTANT]
        - reality[VISCOUS] * omega
        - reality[COULOMB] * omega / math.sqrt(omega * omega + CREEP * CREEP)
        - reality[DRAG] * omega * abs(omega)
        + reality[SINE] * math.sin(phase)
        + reality[COSINE] * math.cos(phase)
    )
    if len(reality) > COGGING:
        value += reality[COGGING] * math.sin(reality[TEETH] * theta)
    return value


@inlined
def sine_near(sine: float, cosine: float, change: float) -> float:
    """Sine of an angle a little further, by Taylor's series (error: change^5 / 120).

    The stages of a step lie a few milliradians apart, so one sine and one cosine serve all four.
    """
    return sine + change * (
        cosine - change * (sine + change * (cosine - change * sine * 0.25) * (1 / 3)) * 0.5
    )


@inlined
def truth_step(
    theta: float, omega: float, torque: float, step: float, stiffness: float
) -> tuple[float, float]:
    """One RK4 step of (2.11) with the torque held; returns angle and speed.

    Args:
        theta: Angle [rad].
        omega: Speed [rad/s].
        torque: Process torque per inertia [rad/s2].
        step: Time step [s].
        stiffness: g/L [1/s2].
    """
    half = 0.5 * step
    sine, cosine = math.sin(theta), math.cos(theta)
    a1 = torque - stiffness * sine
    v2 = omega + half * a1
    a2 = torque - stiffness * sine_near(sine, cosine, half * omega)
    v3 = omega + half * a2
    a3 = torque - stiffness * sine_near(sine, cosine, half * v2)
    v4 = omega + step * a3
    a4 = torque - stiffness * sine_near(sine, cosine, step * v3)
    sixth = step / 6.0
    return (
        theta + sixth * (omega + 2.0 * v2 + 2.0 * v3 + v4),
        omega + sixth * (a1 + 2.0 * a2 + 2.0 * a3 + a4),
    )


@inlined
def extended_step(
    theta: float,
    omega: float,
    torque: float,
    time: float,
    step: float,
    stiffness: float,
    reality: FloatArray,
) -> tuple[float, float]:
    """The same step with the force effects of a reality; with all of them off, the same bits."""
    half = 0.5 * step
    sine, cosine = math.sin(theta), math.cos(theta)
    a1 = torque - stiffness * sine + effect_acceleration(theta, omega, time, reality)
    change, v2 = half * omega, omega + half * a1
    angle = theta + change
    a2 = (
        torque
        - stiffness * sine_near(sine, cosine, change)
        + effect_acceleration(angle, v2, time + half, reality)
    )
    change, v3 = half * v2, omega + half * a2
    angle = theta + change
    a3 = (
        torque
        - stiffness * sine_near(sine, cosine, change)
        + effect_acceleration(angle, v3, time + half, reality)
    )
    change, v4 = step * v3, omega + step * a3
    angle = theta + change
    a4 = (
        torque
        - stiffness * sine_near(sine, cosine, change)
        + effect_acceleration(angle, v4, time + step, reality)
    )
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
def offset(time: float, reality: FloatArray) -> float:
    """What the gyro adds to a speed [rad/s]: bias, drift, and a bias that jumps."""
    value: float = reality[BIAS] + reality[DRIFT] * time
    if time >= reality[STEP_TIME]:
        value += reality[STEP_RATE]
    return value


@inlined
def sensed(omega: float, time: float, reality: FloatArray) -> float:
    """What the gyro makes of a speed, without noise."""
    value: float = reality[GAIN] * omega + offset(time, reality)
    return value


@inlined
def quantised(value: float, quantum: float) -> float:
    """Round to the gyro's resolution; 0 is infinitely fine."""
    return quantum * math.floor(value / quantum + 0.5) if quantum > 0.0 else value
