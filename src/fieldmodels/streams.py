"""Random numbers inside kernels: one 64-bit key a stream, one counter a draw.

A draw depends on nothing but its key and its counter (splitmix64, Steele, Lea and Flood 2014), so that
every noise is the same whatever is estimated, switched on, or batched beside it.
"""

from __future__ import annotations

import math

import numpy as np

from fieldmodels.arrays import FloatArray, IntArray
from fieldmodels.compiled import allocation_free, inlined

GAMMA = np.uint64(0x9E3779B97F4A7C15)
_M1 = np.uint64(0xBF58476D1CE4E5B9)
_M2 = np.uint64(0x94D049BB133111EB)
_TO_UNIT = 2.0**-53
CENTRAL = 0.425
"""How far from the middle the normal quantile's central part reaches."""


def drawn_key(rng: np.random.Generator) -> np.uint64:
    """A key: one draw of 64 bits, which the usual generator gives raw in a seventh of the time."""
    bits = rng.bit_generator
    if type(bits) is np.random.PCG64:
        return np.uint64(bits.random_raw())
    return rng.integers(0, 2**64, dtype=np.uint64)


@inlined
def mixed(z: np.uint64) -> np.uint64:
    """Splitmix64's finaliser: scramble 64 bits."""
    z = (z ^ (z >> np.uint64(30))) * _M1
    z = (z ^ (z >> np.uint64(27))) * _M2
    return z ^ (z >> np.uint64(31))


@inlined
def uniform(key: np.uint64, counter: int) -> float:
    """Draw from the open interval (0, 1)."""
    bits = mixed(key + (np.uint64(counter) + np.uint64(1)) * GAMMA)
    return (float(bits >> np.uint64(11)) + 0.5) * _TO_UNIT


@inlined
def symmetric(key: np.uint64, counter: int) -> float:
    """Draw from (-1, 1)."""
    return 2.0 * uniform(key, counter) - 1.0


@inlined
def gaussian(key: np.uint64, counter: int) -> float:
    """Draw from the standard normal distribution, by its inverse."""
    return normal_quantile(uniform(key, counter))


@allocation_free
def draw_gaussians(key: np.uint64, first: int, out: FloatArray, flat: FloatArray, outer: IntArray) -> None:
    """``gaussian`` of the counters from ``first`` on, side by side; ``flat`` and ``outer`` are overwritten.

    All have the same shape (draws,). Those outside of the quantile's central part are gathered first: a
    branch for each draw would be guessed wrong too often.
    """
    count = 0
    for k in range(len(out)):
        flat[k] = uniform(key, first + k)
        out[k] = central_quantile(flat[k] - 0.5)
    for k in range(len(out)):
        outer[count] = k
        count += 1 if abs(flat[k] - 0.5) > CENTRAL else 0
    for j in range(count):
        out[outer[j]] = normal_quantile(flat[outer[j]])


@inlined
def polynomial(coefficients: tuple[float, ...], x: float) -> float:
    """Evaluate a polynomial, highest power first (Horner)."""
    result = 0.0
    for coefficient in coefficients:
        result = result * x + coefficient
    return result


@inlined
def normal_quantile(p: float) -> float:
    """Inverse of the standard normal distribution: Wichura's algorithm AS 241 (PPND16, 1988)."""
    q = p - 0.5
    if abs(q) <= CENTRAL:
        return central_quantile(q)
    r = math.sqrt(-math.log(p if q < 0 else 1.0 - p))
    if r <= 5.0:
        value = polynomial(_C, r - 1.6) / polynomial(_D, r - 1.6)
    else:
        value = polynomial(_E, r - 5.0) / polynomial(_F, r - 5.0)
    return -value if q < 0 else value


@inlined
def central_quantile(q: float) -> float:
    """``normal_quantile(0.5 + q)`` for at most ``CENTRAL`` to each side, without a branch."""
    r = 0.180625 - q * q
    return q * polynomial(_A, r) / polynomial(_B, r)


_A = (
    2509.0809287301226727, 33430.575583588128105, 67265.770927008700853, 45921.953931549871457,
    13731.693765509461125, 1971.5909503065514427, 133.14166789178437745, 3.387132872796366608,
)  # fmt: skip
_B = (
    5226.495278852545925, 28729.085735721942674, 39307.89580009271061, 21213.794301586595867,
    5394.1960214247511077, 687.1870074920579083, 42.313330701600911252, 1.0,
)  # fmt: skip
_C = (
    7.7454501427834140764e-4, 0.0227238449892691845833, 0.24178072517745061177, 1.27045825245236838258,
    3.64784832476320460504, 5.7694972214606914055, 4.6303378461565452959, 1.42343711074968357734,
)  # fmt: skip
_D = (
    1.05075007164441684324e-9, 5.475938084995344946e-4, 0.0151986665636164571966, 0.14810397642748007459,
    0.68976733498510000455, 1.6763848301838038494, 2.05319162663775882187, 1.0,
)  # fmt: skip
_E = (
    2.01033439929228813265e-7, 2.71155556874348757815e-5, 0.0012426609473880784386, 0.026532189526576123093,
    0.29656057182850489123, 1.7848265399172913358, 5.4637849111641143699, 6.6579046435011037772,
)  # fmt: skip
_F = (
    2.04426310338993978564e-15, 1.4215117583164458887e-7, 1.8463183175100546818e-5, 7.868691311456132591e-4,
    0.0148753612908506148525, 0.13692988092273580531, 0.59983220655588793769, 1.0,
)  # fmt: skip
