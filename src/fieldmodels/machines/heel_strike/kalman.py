"""Extended Kalman filter of the leg, with the process torque and the collision noise as states.

Section 2.3.4 of the dissertation sets Kalman filters aside untried, since the noises are correlated in
time; here that correlation is modelled. State: angle, speed, process torque per inertia (first-order
Gauss-Markov), collision noise (AR(1), seen through the known envelope). A filter is a row of 14 numbers:
the mean (4), then the upper triangle of the covariance, row by row (10).
"""

from __future__ import annotations

import math

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import allocation_free_inlined, inlined

ROW = 14


@allocation_free_inlined
def middle(f: FloatArray, step: float) -> float:
    """Angle half a step on [rad], where ``predict`` needs sine and cosine."""
    value: float = f[0] + 0.5 * step * f[1]
    return value


@allocation_free_inlined
def predict(
    f: FloatArray,
    sines: tuple[float, float],
    step: float,
    stiffness: float,
    torque_memory: float,
    torque_variance: float,
    collision_memory: float,
    collision_variance: float,
) -> None:
    """Advance mean and covariance by one sample, in place.

    The pendulum moves by the leapfrog (second order: Euler-Cromer's lead of half a step is 1 mrad at
    1 rad/s). ``sines`` are sine and cosine of ``middle``, ``*_memory`` correlations of neighbouring samples,
    ``*_variance`` the driving variances.
    """
    half = 0.5 * step
    sine, cosine = sines
    omega = f[1] + step * (f[2] - stiffness * sine)
    # Jacobian of the map: rows of angle and speed; torque and collision are scalar recursions.
    w0 = -step * stiffness * cosine
    w1 = 1.0 + half * w0
    w2 = step
    t0 = 1.0 + half * w0
    t1 = half + half * w1
    t2 = half * step
    f[0] = middle(f, step) + half * omega
    f[1] = omega
    f[2] *= torque_memory
    f[3] *= collision_memory
    p00, p01, p02, p03 = f[4], f[5], f[6], f[7]
    p11, p12, p13 = f[8], f[9], f[10]
    p22, p23, p33 = f[11], f[12], f[13]
    # Rows of angle and speed of (Jacobian x P).
    a0 = t0 * p00 + t1 * p01 + t2 * p02
    a1 = t0 * p01 + t1 * p11 + t2 * p12
    a2 = t0 * p02 + t1 * p12 + t2 * p22
    a3 = t0 * p03 + t1 * p13 + t2 * p23
    b0 = w0 * p00 + w1 * p01 + w2 * p02
    b1 = w0 * p01 + w1 * p11 + w2 * p12
    b2 = w0 * p02 + w1 * p12 + w2 * p22
    b3 = w0 * p03 + w1 * p13 + w2 * p23
    f[4] = a0 * t0 + a1 * t1 + a2 * t2
    f[5] = a0 * w0 + a1 * w1 + a2 * w2
    f[6] = a2 * torque_memory
    f[7] = a3 * collision_memory
    f[8] = b0 * w0 + b1 * w1 + b2 * w2
    f[9] = b2 * torque_memory
    f[10] = b3 * collision_memory
    f[11] = p22 * torque_memory * torque_memory + torque_variance
    f[12] = p23 * torque_memory * collision_memory
    f[13] = p33 * collision_memory * collision_memory + collision_variance


@allocation_free_inlined
def correct(
    f: FloatArray, innovation: float, variance: float, h0: float, h1: float, h2: float, h3: float
) -> None:
    """Condition on a scalar measurement, in place; ``h`` is the covariance of state and measurement."""
    gain = innovation / variance
    f[0] += h0 * gain
    f[1] += h1 * gain
    f[2] += h2 * gain
    f[3] += h3 * gain
    inverse = 1.0 / variance
    f[4] -= h0 * h0 * inverse
    f[5] -= h0 * h1 * inverse
    f[6] -= h0 * h2 * inverse
    f[7] -= h0 * h3 * inverse
    f[8] -= h1 * h1 * inverse
    f[9] -= h1 * h2 * inverse
    f[10] -= h1 * h3 * inverse
    f[11] -= h2 * h2 * inverse
    f[12] -= h2 * h3 * inverse
    f[13] -= h3 * h3 * inverse


@allocation_free_inlined
def update_gyro(f: FloatArray, gyro: float, envelope: float, variance: float) -> tuple[float, float]:
    """Update with a gyro sample: speed plus collision noise under its envelope, plus white noise.

    Returns:
        Innovation and its variance.
    """
    h0 = f[5] + envelope * f[7]
    h1 = f[8] + envelope * f[10]
    h2 = f[9] + envelope * f[12]
    h3 = f[10] + envelope * f[13]
    total = h1 + envelope * h3 + variance
    innovation = gyro - f[1] - envelope * f[3]
    correct(f, innovation, total, h0, h1, h2, h3)
    return innovation, total


@inlined
def update_angle(f: FloatArray, angle: float, variance: float) -> tuple[float, float]:
    """Update with the angle that the geometry gives at a heel strike.

    Returns:
        Innovation and its variance.
    """
    total = f[4] + variance
    innovation = angle - f[0]
    correct(f, innovation, total, f[4], f[5], f[6], f[7])
    return innovation, total


@inlined
def strike(f: FloatArray, speed: float, share: float, collision_variance: float) -> None:
    """Apply what a strike does: the push-off, known to the robot, and a collision noise that begins anew."""
    keep = 1.0 - share
    f[1] = keep * f[1] + share * math.copysign(speed, f[1])
    f[5] *= keep
    f[8] *= keep * keep
    f[9] *= keep
    f[3] = 0.0
    f[7] = 0.0
    f[10] = 0.0
    f[12] = 0.0
    f[13] = collision_variance


@inlined
def log_likelihood(innovation: float, variance: float) -> float:
    """Log density of an innovation, in nats."""
    return -0.5 * (innovation * innovation / variance + math.log(2.0 * math.pi * variance))


@inlined
def mix(bank: FloatArray, weights: FloatArray, transition: FloatArray) -> None:
    """Interacting-multiple-model step at a regime switch (Blom and Bar-Shalom 1988), in place.

    Args:
        bank: One filter a regime, shape (regimes, 14).
        weights: Probabilities of the regimes, shape (regimes,); becomes the predicted ones.
        transition: Probability of switching from row to column, shape (regimes, regimes).
    """
    count = len(weights)
    old = bank.copy()
    before = weights.copy()
    d = np.empty(4)
    for j in range(count):
        total = 0.0
        for i in range(count):
            total += transition[i, j] * before[i]
        weights[j] = total
        for r in range(ROW):
            bank[j, r] = 0.0
        for i in range(count):
            share = transition[i, j] * before[i] / total
            for r in range(ROW):
                bank[j, r] += share * old[i, r]
        for i in range(count):
            share = transition[i, j] * before[i] / total
            for r in range(4):
                d[r] = old[i, r] - bank[j, r]
            position = 4
            for r in range(4):
                for s in range(r, 4):
                    bank[j, position] += share * d[r] * d[s]
                    position += 1


@inlined
def reweight(weights: FloatArray, log_weights: FloatArray) -> None:
    """Turn accumulated log likelihoods into probabilities, in place, and start the sum again."""
    top = -np.inf
    for j in range(len(weights)):
        log_weights[j] += math.log(weights[j])
        top = max(top, log_weights[j])
    total = 0.0
    for j in range(len(weights)):
        weights[j] = math.exp(log_weights[j] - top)
        total += weights[j]
    for j in range(len(weights)):
        # The floor keeps a regime alive that the data have all but excluded.
        weights[j] = max(weights[j] / total, 1e-300)
        log_weights[j] = 0.0
