"""The dissertation's two estimators of the leg's angle, one sample at a time."""

from __future__ import annotations

from fieldmodels.compiled import inlined


@inlined
def ranger_step(theta: float, before: float, gyro: float, step: float) -> float:
    """Ranger's estimator, eq (2.2): integrate the gyro by the trapezoidal rule; returns the angle."""
    return theta + 0.5 * (gyro + before) * step


@inlined
def observer_step(
    theta: float,
    sine: float,
    omega: float,
    gyro: float,
    step: float,
    stiffness: float,
    sensor: float,
    decay: float,
    cromer: bool,
) -> tuple[float, float]:
    """The model-based estimator; returns angle and speed.

    Args:
        theta: Estimated angle [rad].
        sine: Its sine.
        omega: Estimated speed [rad/s].
        gyro: The gyro's new sample [rad/s].
        step: Sampling interval [s].
        stiffness: g/L of the model [1/s2].
        sensor: Model-sensor ratio S_MS.
        decay: Filter decay S_FD [1/s].
        cromer: True for Euler-Cromer, eq (2.14); False for Euler, eq (2.9).
    """
    faster = omega + ((1.0 - sensor) * (-stiffness * sine) + sensor * decay * (gyro - omega)) * step
    return theta + (faster if cromer else omega) * step, faster


@inlined
def reset(theta: float, geometry: float, share: float) -> float:
    """Heel-strike reset, eq (2.10); eq (2.3) with a share of 0.1."""
    return (1.0 - share) * theta + share * geometry
