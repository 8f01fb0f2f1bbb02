"""What a machine's equations may write with NumPy for a number, as roboticists do: ``np.clip``, ``np.sin``.

Numba knows most of it for floats, and none for the dual numbers that carry derivatives; for single numbers it
lacks ``clip``, ``where``, ``heaviside`` and ``math.fmod``, and its ``interp`` takes memory, of which kernels
have none. All are written here by what both kinds of numbers know. At a corner, the derivative is that of the
branch taken.
"""

from __future__ import annotations

import hashlib
import math
import operator
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numba.core import extending, types

from fieldmodels.compiled.fingerprint import ADDED
from fieldmodels.drivers.duals import DualType
from fieldmodels.elementary import value_of

overload: Any = extending.overload
unliteral: Any = types.unliteral
EDITION = hashlib.sha256(Path(__file__).read_bytes()).hexdigest()[:12]
PLAIN = {
    "sin": math.sin, "cos": math.cos, "tan": math.tan, "arcsin": math.asin, "arccos": math.acos,
    "arctan": math.atan, "sinh": math.sinh, "cosh": math.cosh, "tanh": math.tanh, "arcsinh": math.asinh,
    "arccosh": math.acosh, "arctanh": math.atanh, "exp": math.exp, "expm1": math.expm1, "log": math.log,
    "log2": math.log2, "log10": math.log10, "log1p": math.log1p, "sqrt": math.sqrt, "abs": abs, "fabs": abs,
    "radians": math.radians, "deg2rad": math.radians, "degrees": math.degrees, "rad2deg": math.degrees,
    "negative": operator.neg,
}  # fmt: skip
"""Functions of a number by NumPy's names."""
OF_TWO = {
    "arctan2": math.atan2, "hypot": math.hypot, "copysign": math.copysign, "power": operator.pow,
    "maximum": max, "minimum": min, "mod": operator.mod, "remainder": operator.mod,
    "add": operator.add, "subtract": operator.sub, "multiply": operator.mul, "divide": operator.truediv,
}  # fmt: skip
"""Functions of two."""
FLAT = ("sign", "floor", "ceil", "trunc", "rint", "isfinite", "isnan", "isinf")
"""Functions of the value alone: they have no slope."""


def _is_number(kind: Any) -> bool:
    return isinstance(unliteral(kind), types.Float | types.Integer | types.Boolean | DualType)


def _is_none(kind: Any) -> bool:
    return kind is None or isinstance(kind, types.NoneType)


def _plain(function: Any) -> Callable[..., Any]:
    return lambda x: (lambda x: function(x)) if isinstance(x, DualType) else None


def _of_two(function: Any) -> Callable[..., Any]:
    def chosen(x: Any, y: Any) -> Any:
        either = isinstance(x, DualType) or isinstance(y, DualType)
        return (lambda x, y: function(x, y)) if either and _is_number(x) and _is_number(y) else None

    return chosen


def _flat(function: Any) -> Callable[..., Any]:
    return lambda x: (lambda x: function(value_of(x))) if isinstance(x, DualType) else None


def _square(x: Any) -> Any:
    return (lambda x: x * x) if isinstance(x, DualType) else None


def _fmod(x: Any, y: Any) -> Any:
    if _is_number(x) and _is_number(y):
        return lambda x, y: math.copysign(abs(x) % abs(y), x)
    return None


def _clip(a: Any, a_min: Any, a_max: Any) -> Any:
    if not all(_is_number(kind) or _is_none(kind) for kind in (a, a_min, a_max)) or _is_none(a):
        return None
    if _is_none(a_min):
        return None if _is_none(a_max) else lambda a, a_min, a_max: min(a, a_max)  # noqa: ARG005
    if _is_none(a_max):
        return lambda a, a_min, a_max: max(a, a_min)  # noqa: ARG005
    return lambda a, a_min, a_max: min(max(a, a_min), a_max)


def _where(condition: Any, x: Any, y: Any) -> Any:
    if _is_number(condition) and _is_number(x) and _is_number(y):
        return lambda condition, x, y: x if condition else y
    return None


def _heaviside(x1: Any, x2: Any) -> Any:
    if _is_number(x1) and _is_number(x2):
        return lambda x1, x2: 0.0 if x1 < 0.0 else (1.0 if x1 > 0.0 else x2)
    return None


def _interp(x: Any, xp: Any, fp: Any) -> Any:
    """Between the points of a table, which stays at its ends' values beyond them."""
    tables = all(isinstance(kind, types.Array | types.UniTuple) for kind in (xp, fp))
    if not (_is_number(x) and tables):
        return None

    def between(x: Any, xp: Any, fp: Any) -> Any:
        last = len(xp) - 1
        if x != x:
            return x + 0.0
        if x <= xp[0]:
            return fp[0] + 0.0 * x
        if x >= xp[last]:
            return fp[last] + 0.0 * x
        low, high = 0, last
        while high - low > 1:
            middle = (low + high) // 2
            if xp[middle] <= x:
                low = middle
            else:
                high = middle
        return fp[low] + (x - xp[low]) * ((fp[low + 1] - fp[low]) / (xp[low + 1] - xp[low]))

    return between


for _names, _chosen in ((PLAIN, _plain), (OF_TWO, _of_two)):
    for _name, _function in _names.items():
        overload(getattr(np, _name), strict=False)(_chosen(_function))
for _name in FLAT:
    overload(getattr(np, _name), strict=False)(_flat(getattr(np, _name)))
overload(np.square, strict=False)(_square)
for _word, _written in (
    (np.clip, _clip),
    (np.where, _where),
    (np.heaviside, _heaviside),
    (np.interp, _interp),
    (np.fmod, _fmod),
    (math.fmod, _fmod),
):
    overload(_word, strict=False)(_written)
    ADDED[_word.__name__] = EDITION
