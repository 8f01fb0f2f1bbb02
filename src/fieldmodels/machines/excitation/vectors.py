"""Vectors of three components as kernels take them, in registers."""

from __future__ import annotations

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import allocation_free_inlined, inlined

Vector = tuple[float, float, float]
"""Components x, y, z."""
ZERO: Vector = (0.0, 0.0, 0.0)


@allocation_free_inlined
def vector_at(values: FloatArray, first: int) -> Vector:
    """Three numbers of an array."""
    return values[first], values[first + 1], values[first + 2]


@allocation_free_inlined
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
    """Solve [[a d e] [d b f] [e f c]] u = y with diagonal (a, b, c), well conditioned, by its cofactors.

    One division, and little that has to wait for something else: twice as fast as an elimination.
    """
    a, b, c = diagonal
    aa, ad, ae = b * c - f * f, e * f - d * c, d * f - b * e
    bb, bf, cc = a * c - e * e, d * e - a * f, a * b - d * d
    share = 1.0 / (a * aa + d * ad + e * ae)
    return (
        (aa * y[0] + ad * y[1] + ae * y[2]) * share,
        (ad * y[0] + bb * y[1] + bf * y[2]) * share,
        (ae * y[0] + bf * y[1] + cc * y[2]) * share,
    )
