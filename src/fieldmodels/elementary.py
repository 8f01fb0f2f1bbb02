"""Sine, cosine, exponential and hyperbolic tangent, which the compiler turns into vector instructions.

``math.sin`` is a call for each number; these are plain arithmetic, and go through the lanes of a loop side by
side. They differ from ``math`` by less than 1e-15 of the value: sine and cosine for arguments up to 1e6, the
exponential from -700 to 700, beyond which it stays as it is there. Polynomials interpolate them.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba.core import types
from numba.core.extending import overload

from fieldmodels.compiled import allocation_free_inlined as inlined

ROUNDING = 1.5 * 2.0**52
"""Added to a number and taken off again, it leaves the nearest integer."""
# Pi and log(2) in parts, the first ones of 33 bits: their products with integers up to a million are exact.
PI_1, PI_2, PI_3 = 3.1415926534682512, 1.2154201012607932e-10, 4.044532497591901e-21
LOG2_1, LOG2_2 = 0.6931471804855391, 7.440617110012397e-11
STEEPEST = 700.0
NEAR = 0.785
"""Just less than an eighth of a turn [rad]."""


@inlined
def sine(x: float) -> float:
    """The sine of an angle [rad]."""
    half_turns = rounded(x * (1.0 / PI_1))
    return _sine_near(x, half_turns, half_turns)


@inlined
def cosine(x: float) -> float:
    """The cosine of an angle [rad]: the sine a quarter of a turn on."""
    half_turns = rounded(x * (1.0 / PI_1) + 0.5)
    return _sine_near(x, half_turns - 0.5, half_turns)


@inlined
def sine_and_cosine(x: float) -> tuple[float, float]:
    """Both of an angle [rad], twice as fast as ``math`` within an eighth of a turn; ``math``'s beyond."""
    if abs(x) > NEAR:
        return math.sin(x), math.cos(x)
    return sine_and_cosine_near(x)


@inlined
def sine_and_cosine_near(x: float) -> tuple[float, float]:
    """Both of an angle of at most ``NEAR`` [rad], without a branch."""
    # Fdlibm's polynomials, in terms that don't wait for each other.
    z = x * x
    z2 = z * z
    s = -1.66666666666666324348e-01 + z * 8.33333333332248946124e-03
    s += z2 * (-1.98412698298579493134e-04 + z * 2.75573137070700676789e-06)
    s += z2 * z2 * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)
    c = 4.16666666666666019037e-02 + z * -1.38888888888741095749e-03
    c += z2 * (2.48015872894767294178e-05 + z * -2.75573143513906633035e-07)
    c += z2 * z2 * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11)
    return x + x * z * s, (1.0 - 0.5 * z) + z2 * c


@inlined
def exponential(x: float) -> float:
    """``exp(x)``."""
    x = min(max(x, -STEEPEST), STEEPEST)
    doublings = rounded(x * (1.0 / LOG2_1))
    r = (x - doublings * LOG2_1) - doublings * LOG2_2
    tail = 2.7620088445409746e-07 + r * 2.510038549551032e-08
    tail = 2.7557268459997064e-06 + r * tail
    tail = 2.4801521295954376e-05 + r * tail
    tail = 1.9841269863053618e-04 + r * tail
    tail = 1.3888888917213717e-03 + r * tail
    tail = 8.333333333330062e-03 + r * tail
    tail = 4.166666666662413e-02 + r * tail
    tail = 1.6666666666666669e-01 + r * tail
    tail = 0.5 + r * tail
    return (1.0 + (r + r * r * tail)) * power_of_two(doublings)


@inlined
def hyperbolic_tangent(x: float) -> float:
    """``tanh(x)``, to 1e-15 of one."""
    return 1.0 - 2.0 / (exponential(2.0 * x) + 1.0)


@inlined
def _sine_near(x: float, shift: float, half_turns: float) -> float:
    """The sine of what is left of ``x`` after ``shift`` half turns; negative after an odd number of them."""
    r = ((x - shift * PI_1) - shift * PI_2) - shift * PI_3
    z = r * r
    tail = -7.643969031052769e-13 + z * 2.731428986122616e-15
    tail = 1.6058977272815506e-10 + z * tail
    tail = -2.5052107616384595e-08 + z * tail
    tail = 2.755731921915843e-06 + z * tail
    tail = -1.9841269841254955e-04 + z * tail
    tail = 8.333333333333316e-03 + z * tail
    tail = -1.6666666666666666e-01 + z * tail
    return one_by_parity(half_turns) * (r + r * z * tail)


@inlined
def rounded(x: float) -> float:
    """The nearest integer to a number below 2^51, the even one of two."""
    return (x + ROUNDING) - ROUNDING


def only(x: Any) -> Any:
    """A number itself; of a tuple that holds one, that one."""
    return x[0] if isinstance(x, tuple) else x


@overload(only, strict=False)
def _only(x: Any) -> Any:
    return (lambda x: x[0]) if isinstance(x, types.BaseTuple) else (lambda x: x)


@inlined
def one_by_parity(whole: float) -> float:
    """1 for an even integer below 2^51, -1 for an odd one, by its last bit."""
    last = np.float64(whole + ROUNDING).view(np.int64) << np.int64(63)
    return np.int64(last | np.float64(1.0).view(np.int64)).view(np.float64)


@inlined
def power_of_two(exponent: float) -> float:
    """Two to the power of an integer between -1022 and 1023, by its bits."""
    bits = np.float64(exponent + (ROUNDING + 1023.0)).view(np.int64) << np.int64(52)
    return np.int64(bits).view(np.float64)
