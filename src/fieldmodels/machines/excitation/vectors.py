"""Vectors of three components as kernels take them, in registers."""

from __future__ import annotations

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import inlined

Vector = tuple[float, float, float]
"""Components x, y, z."""
ZERO: Vector = (0.0, 0.0, 0.0)


@inlined
def vector_at(values: FloatArray, first: int) -> Vector:
    """Three numbers of an array."""
    return values[first], values[first + 1], values[first + 2]


@inlined
def copy_to(out: FloatArray, values: FloatArray) -> None:
    """Write values into an array as long; an assignment to a slice takes seconds to compile."""
    for i in range(len(out)):
        out[i] = values[i]


@inlined
def plus(a: Vector, factor: float, b: Vector) -> Vector:
    """A + factor b."""
    return a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]


@inlined
def minus(a: Vector, b: Vector) -> Vector:
    """A - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inlined
def dot(a: Vector, b: Vector) -> float:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def cross(a: Vector, b: Vector) -> Vector:
    """Vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def solve3(diagonal: Vector, d: float, e: float, f: float, y: Vector) -> Vector:
    """Solve [[a d e] [d b f] [e f c]] u = y with diagonal (a, b, c), positive definite, by L D L'."""
    l1, l2 = d / diagonal[0], e / diagonal[0]
    b1 = diagonal[1] - l1 * d
    f1 = f - l1 * e
    l3 = f1 / b1
    c1 = diagonal[2] - l2 * e - l3 * f1
    y1 = y[1] - l1 * y[0]
    z1 = y[2] - l2 * y[0] - l3 * y1
    uz = z1 / c1
    uy = y1 / b1 - l3 * uz
    ux = y[0] / diagonal[0] - l1 * uy - l2 * uz
    return ux, uy, uz
