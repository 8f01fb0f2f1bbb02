"""Equation (4) as A x = F, linear in the 22 unknowns, and what noise in the sensors does to it.

Every entry of A and F is a feature y of the measured signals times a constant: [A | F] = sum over TERMS of
coefficient * y. Features are the signals themselves, but for two: the mass is multiplied by the measured
specific force d(R^-1 g) - d(r''), and products of rates stand for the gyroscopic term d(w x I w).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled, inlined
from fieldmodels.machines.excitation.parameters import (
    CG,
    DAMPING,
    EQUATIONS,
    INERTIA,
    MASS,
    MODES,
    STIFFNESS,
    UNKNOWNS,
)
from fieldmodels.machines.excitation.vectors import Vector

POSITION, VELOCITY, ACCELERATION = 0, 3, 6
ANGLE, RATE, TURNING = 9, 12, 15
FORCE, TORQUE = 18, 21
SIGNALS = 24
"""Signals of one mode, components x, y, z in frame II (vehicle): dr, dr', dr'', then the rotation vector
dtheta, the angular velocity w and acceleration w', then dF and dN of the arm's base."""

Y_SPECIFIC, Y_VELOCITY, Y_POSITION, Y_TURNING, Y_PRODUCT, Y_SQUARE = 0, 3, 6, 9, 12, 15
Y_RATE, Y_ANGLE, Y_FORCE, Y_TORQUE = 18, 21, 24, 27
FEATURES = 30
"""Features of one mode: specific force, dr', dr, w', (wy wz, wx wz, wx wy), (wx^2, wy^2, wz^2), w, dtheta,
dF, dN."""


def _terms() -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], FloatArray]:
    target = UNKNOWNS
    ix, iy, iz, ixz, iyz, ixy = range(INERTIA, INERTIA + 6)
    ax, ay, az = range(Y_TURNING, Y_TURNING + 3)
    yz, xz, xy = range(Y_PRODUCT, Y_PRODUCT + 3)
    xx, yy, zz = range(Y_SQUARE, Y_SQUARE + 3)
    found: list[tuple[int, int, int, float]] = []
    for i in range(3):
        found += [
            (i, MASS, Y_SPECIFIC + i, 1.0),
            (i, DAMPING + i, Y_VELOCITY + i, -1.0),
            (i, STIFFNESS + i, Y_POSITION + i, -1.0),
            (i, target, Y_FORCE + i, 1.0),
            (3 + i, DAMPING + 3 + i, Y_RATE + i, -1.0),
            (3 + i, STIFFNESS + 3 + i, Y_ANGLE + i, -1.0),
            (3 + i, target, Y_TORQUE + i, 1.0),
        ]
        j, k = (i + 1) % 3, (i + 2) % 3
        found += [(3 + i, CG + j, Y_FORCE + k, -1.0), (3 + i, CG + k, Y_FORCE + j, 1.0)]
    # -(I w' + w x I w), written out for the elements of the tensor.
    inertial = (
        ((ix, ax, 1), (iz, yz, 1), (iy, yz, -1), (ixz, az, 1), (ixz, xy, 1), (iyz, yy, 1), (iyz, zz, -1),
         (ixy, ay, 1), (ixy, xz, -1)),
        ((iy, ay, 1), (ix, xz, 1), (iz, xz, -1), (ixy, ax, 1), (ixy, yz, 1), (ixz, zz, 1), (ixz, xx, -1),
         (iyz, az, 1), (iyz, xy, -1)),
        ((iz, az, 1), (iy, xy, 1), (ix, xy, -1), (ixz, ax, 1), (ixz, yz, -1), (iyz, ay, 1), (iyz, xz, 1),
         (ixy, xx, 1), (ixy, yy, -1)),
    )  # fmt: skip
    found += [(3 + i, column, y, -float(s)) for i, own in enumerate(inertial) for column, y, s in own]
    row, column, feature, coefficient = zip(*found, strict=True)
    return np.array(row), np.array(column), np.array(feature), np.array(coefficient)


TERMS = _terms()
"""Row (0 to 5), column (22 is F), feature and coefficient of every term of one mode, in four arrays."""


PLAIN = np.array(
    [
        (feature + i, signal + i)
        for feature, signal in (
            (Y_VELOCITY, VELOCITY), (Y_POSITION, POSITION), (Y_TURNING, TURNING), (Y_ANGLE, ANGLE),
            (Y_FORCE, FORCE), (Y_TORQUE, TORQUE),
        )
        for i in range(3)
    ]
)  # fmt: skip
"""Features that are a signal: their numbers, and the signal's."""
SMALL = 0.04
"""Squares of angles [rad2] below which few terms of a series are exact to the 15th digit, and far faster."""


@inlined
def turned_series(square: float) -> tuple[float, float]:
    """``turned_shares`` of a small angle."""
    # Products with constants: a division takes as long as five of them.
    fourth = square * square
    s = 1.0 / 120.0 - square * (1.0 / 5040.0) + fourth * (1.0 / 362880.0)
    s = 1.0 - square * (1.0 / 6.0) + fourth * s
    c = 1.0 / 720.0 - square * (1.0 / 40320.0) + fourth * (1.0 / 3628800.0)
    return s, 0.5 - square * (1.0 / 24.0) + fourth * c


@inlined
def turned_shares(square: float) -> tuple[float, float]:
    """Sin(t) / t and (1 - cos(t)) / t^2 of the square of an angle t [rad2]."""
    if square < SMALL:
        return turned_series(square)
    angle = math.sqrt(square)
    return math.sin(angle) / angle, (1.0 - math.cos(angle)) / square


@inlined
def turned_gravity(x: float, y: float, z: float, s: float, c: float, gravity: float) -> Vector:
    """``gravity_change`` with its ``turned_shares``."""
    # R^-1 g = g - s theta x g + c theta x (theta x g), with g = (0, 0, -gravity).
    return (
        gravity * (s * y - c * x * z),
        gravity * (-s * x - c * y * z),
        gravity * c * (x * x + y * y),
    )


@inlined
def gravity_change(x: float, y: float, z: float, gravity: float) -> Vector:
    """d(R^-1 g) in frame II for a rotation vector from the rest pose, in which II is level [m/s2]."""
    s, c = turned_shares(x * x + y * y + z * z)
    return turned_gravity(x, y, z, s, c, gravity)


@inlined
def fill_features(signals: FloatArray, variances: FloatArray, gravity: float, y: FloatArray) -> None:
    """Features of one sample of one mode.

    Args:
        signals: Measured signals, shape (24,).
        variances: Variance of the white noise on each, shape (24,): what it adds to the squares of rates on
            average is taken off, so that noise does not shift a feature. Zeros: exact features.
        gravity: Acceleration of free fall [m/s2].
        y: Receives the features, shape (30,).
    """
    gx, gy, gz = gravity_change(signals[ANGLE], signals[ANGLE + 1], signals[ANGLE + 2], gravity)
    y[Y_SPECIFIC] = gx - signals[ACCELERATION]
    y[Y_SPECIFIC + 1] = gy - signals[ACCELERATION + 1]
    y[Y_SPECIFIC + 2] = gz - signals[ACCELERATION + 2]
    for n in range(len(PLAIN)):
        y[PLAIN[n, 0]] = signals[PLAIN[n, 1]]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        y[Y_PRODUCT + i] = signals[RATE + j] * signals[RATE + k]
        y[Y_SQUARE + i] = signals[RATE + i] * signals[RATE + i] - variances[RATE + i]
        y[Y_RATE + i] = signals[RATE + i]


@inlined
def add_feature_noise(
    signals: FloatArray, variances: FloatArray, gravity: float, covariance: FloatArray
) -> None:
    """Add the covariance of one sample's features to a sum, in place.

    The features' noise is that of the signals, to first order: gravity's share of the specific force goes
    with the angles, and products of rates with the rates (whose measured squares are taken as they are, so
    that the noise of a product is overstated by the product of two variances).

    Args:
        signals: Measured signals, shape (24,).
        variances: Variance of the white noise on each, shape (24,).
        gravity: Acceleration of free fall [m/s2].
        covariance: Sum so far, shape (30, 30), symmetric.
    """
    for i in range(3):
        covariance[Y_SPECIFIC + i, Y_SPECIFIC + i] += variances[ACCELERATION + i]
    for n in range(len(PLAIN)):
        k = PLAIN[n, 0]
        covariance[k, k] += variances[PLAIN[n, 1]]
    # Slopes of d(R^-1 g) with respect to the angles, to second order in these.
    x, y, z = 0.5 * signals[ANGLE], 0.5 * signals[ANGLE + 1], 0.5 * signals[ANGLE + 2]
    slope = ((-z, 1.0, -x), (-1.0, -z, -y), (2.0 * x, 2.0 * y, 0.0))
    for i in range(3):
        for k in range(3):
            turned = gravity * slope[i][k] * variances[ANGLE + k]
            covariance[Y_SPECIFIC + i, Y_ANGLE + k] += turned
            covariance[Y_ANGLE + k, Y_SPECIFIC + i] += turned
            for j in range(3):
                covariance[Y_SPECIFIC + i, Y_SPECIFIC + j] += gravity * slope[j][k] * turned
    for r in range(3):
        # Slopes of the rate, the products and the squares with respect to the r-th rate.
        variance, rate = variances[RATE + r], signals[RATE + r]
        p, q = (r + 1) % 3, (r + 2) % 3
        rows = (Y_RATE + r, Y_PRODUCT + p, Y_PRODUCT + q, Y_SQUARE + r)
        slopes = (1.0, signals[RATE + q], signals[RATE + p], 2.0 * rate)
        for m in range(4):
            for n in range(4):
                covariance[rows[m], rows[n]] += slopes[m] * slopes[n] * variance


@compiled
def fill_regressor(
    signals: FloatArray,
    variances: FloatArray,
    gravity: float,
    rows: NDArray[np.int64],
    columns: NDArray[np.int64],
    which: NDArray[np.int64],
    coefficients: FloatArray,
    a: FloatArray,
    f: FloatArray,
) -> None:
    """Fill A and F of samples; see ``regressor``."""
    y = np.empty(FEATURES)
    for n in range(len(signals)):
        for mode in range(MODES):
            fill_features(signals[n, mode], variances[mode], gravity, y)
            for t in range(len(rows)):
                row = mode * EQUATIONS + rows[t]
                if columns[t] == UNKNOWNS:
                    f[n, row] += coefficients[t] * y[which[t]]
                else:
                    a[n, row, columns[t]] += coefficients[t] * y[which[t]]


def regressor(
    signals: FloatArray, gravity: float = 9.81, variances: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """A and F of eq (4) in the form of section IV, three modes stacked.

    Args:
        signals: Signals of all modes, shape (samples, 3, 24).
        gravity: Acceleration of free fall [m/s2].
        variances: Variances of the signals' noise, shape (3, 24) (see ``fill_features``); default none.

    Returns:
        A of shape (samples, 18, 22) and F of shape (samples, 18); A x = F for noise-free signals.
    """
    signals = np.ascontiguousarray(signals, dtype=np.float64)
    a = np.zeros((len(signals), MODES * EQUATIONS, UNKNOWNS))
    f = np.zeros((len(signals), MODES * EQUATIONS))
    noise = np.zeros((MODES, SIGNALS)) if variances is None else np.ascontiguousarray(variances)
    fill_regressor(signals, noise, gravity, *TERMS, a, f)
    return a, f
