"""The leg, the pendulum (2.11) by RK4 with its process torque, and the gyro that watches it.

What differs from the nominal leg stands in a plant (see ``declaration``). The walk of an environment and the
predictions of a diagnosis run these same steps; each keeps the past speeds in its own way.
"""

from __future__ import annotations

import math
from typing import Any

from fieldmodels.compiled import inlined

CREEP = 0.01
"""Speed below which dry friction fades smoothly [rad/s] (assumed: RK4 stays accurate at the turn)."""


@inlined
def effect_acceleration(omega: float, time: float, plant: Any) -> float:
    """What the force effects add to the angular acceleration [rad/s2]."""
    phase = 2 * math.pi * plant.periodic_force.frequency * time
    value: float = (
        plant.constant_force.acceleration
        - plant.viscous_friction.rate * omega
        - plant.coulomb_friction.acceleration * omega / math.sqrt(omega * omega + CREEP * CREEP)
        - plant.quadratic_drag.coefficient * omega * abs(omega)
        + plant.periodic_force.sine * math.sin(phase)
        + plant.periodic_force.cosine * math.cos(phase)
    )
    return value


@inlined
def sine_near(sine: float, cosine: float, change: float) -> float:
    """Sine of an angle a little further, by Taylor's series (error: change^5 / 120).

    The stages of a step lie a few milliradians apart, so one sine and one cosine serve all four. Neither
    half of its terms waits for the other.
    """
    square = change * change
    small = 0.5 * sine + change * ((1 / 6) * cosine) - square * ((1 / 24) * sine)
    return (sine + change * cosine) - square * small


@inlined
def leg_step(
    theta: float,
    omega: float,
    torque: float,
    sines: tuple[float, float],
    time: float,
    step: float,
    stiffness: float,
    plant: Any,
    extended: bool,
) -> tuple[float, float]:
    """One RK4 step of (2.11) with the torque held; returns angle and speed.

    Args:
        theta: Angle [rad].
        omega: Speed [rad/s].
        torque: Process torque per inertia [rad/s2].
        sines: Sine and cosine of the angle.
        time: Time at the step's beginning [s].
        step: Time step [s]; negative leads back.
        stiffness: g/L [1/s2].
        plant: What the leg truly is, dtype ``PLANT``.
        extended: False leaves the force effects out, as if all of them were off, which is faster.
    """
    half = 0.5 * step
    sine, cosine = sines
    a1 = torque - stiffness * sine
    if extended:
        a1 += effect_acceleration(omega, time, plant)
    change, v2 = half * omega, omega + half * a1
    a2 = torque - stiffness * sine_near(sine, cosine, change)
    if extended:
        a2 += effect_acceleration(v2, time + half, plant)
    change, v3 = half * v2, omega + half * a2
    a3 = torque - stiffness * sine_near(sine, cosine, change)
    if extended:
        a3 += effect_acceleration(v3, time + half, plant)
    change, v4 = step * v3, omega + step * a3
    a4 = torque - stiffness * sine_near(sine, cosine, change)
    if extended:
        a4 += effect_acceleration(v4, time + step, plant)
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
def samples_late(plant: Any, step: float) -> tuple[int, float]:
    """How late the gyro's readings are: whole samples, and the part of one beyond."""
    lag = plant.gyro_delay.delay / step
    whole = int(lag)
    return whole, lag - whole


@inlined
def offset(time: float, plant: Any) -> float:
    """What the gyro adds to a speed [rad/s]: bias, drift, and a bias that jumps."""
    value: float = plant.gyro_bias.rate + plant.gyro_drift.rate * time
    if time >= plant.parameter_step.time:
        value += plant.parameter_step.rate
    return value


@inlined
def gyro_reading(newer: float, older: float, part: float, time: float, plant: Any) -> float:
    """What the gyro reads, before noise and rounding [rad/s].

    Args:
        newer: Speed the whole number of samples ago that its delay holds [rad/s].
        older: Speed one sample before that.
        part: The part of a sample by which the delay is longer; speeds are linear between samples.
        time: Time of the reading [s].
        plant: What the gyro truly is, dtype ``PLANT``.
    """
    late = newer + part * (older - newer)
    value: float = plant.gyro_gain.gain * late + offset(time, plant)
    return value


@inlined
def speed_read(reading: float, time: float, plant: Any) -> float:
    """The speed that a reading without delay stands for [rad/s]: the gyro's faults undone."""
    value: float = (reading - offset(time, plant)) / plant.gyro_gain.gain
    return value


@inlined
def quantised(value: float, plant: Any) -> float:
    """Round to the gyro's resolution; 0 is infinitely fine."""
    quantum = plant.gyro_quantisation.step
    return quantum * math.floor(value / quantum + 0.5) if quantum > 0.0 else value
