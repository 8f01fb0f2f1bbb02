"""What a machine's equations may write with NumPy for a number and Numba does not compile: ``np.clip``.

For single numbers Numba lacks ``clip``, ``where``, ``heaviside`` and ``math.fmod``, and its ``interp`` takes
memory, of which kernels have none.
"""

from __future__ import annotations

import hashlib
import math
from pathlib import Path
from typing import Any

import numpy as np
from numba.core import extending, types

from fieldmodels.compiled.fingerprint import ADDED

overload: Any = extending.overload
unliteral: Any = types.unliteral
EDITION = hashlib.sha256(Path(__file__).read_bytes()).hexdigest()[:12]


def _is_number(kind: Any) -> bool:
    return isinstance(unliteral(kind), types.Float | types.Integer | types.Boolean)


def _is_none(kind: Any) -> bool:
    return kind is None or isinstance(kind, types.NoneType)


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
            return float(x)
        if x <= xp[0]:
            return float(fp[0])
        if x >= xp[last]:
            return float(fp[last])
        low, high = 0, last
        while high - low > 1:
            middle = (low + high) // 2
            if xp[middle] <= x:
                low = middle
            else:
                high = middle
        return fp[low] + (x - xp[low]) * ((fp[low + 1] - fp[low]) / (xp[low + 1] - xp[low]))

    return between


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
