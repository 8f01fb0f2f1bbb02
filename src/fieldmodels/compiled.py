"""The one way in which this project compiles a kernel."""

from collections.abc import Callable
from typing import ParamSpec, TypeVar, cast

import numba

P = ParamSpec("P")
R = TypeVar("R")


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a kernel with Numba, cached on disk, releasing the interpreter lock.

    Strict IEEE arithmetic (no ``fastmath``): equal inputs give equal bits in any batch size.
    """
    return cast(Callable[P, R], numba.njit(cache=True, nogil=True, error_model="numpy")(function))


def inlined(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a small helper that is always inlined by LLVM into the kernels that call it."""
    return cast(
        Callable[P, R], numba.njit(cache=True, nogil=True, error_model="numpy", forceinline=True)(function)
    )
