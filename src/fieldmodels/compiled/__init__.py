"""The one way in which this project compiles a kernel, and where compiled kernels are kept."""

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

import numba

from fieldmodels.compiled.cache import KernelCache, in_peace
from fieldmodels.compiled.fingerprint import fingerprint
from fieldmodels.compiled.folder import cache_folder
from fieldmodels.compiled.memoising import MemoisingCompiler
from fieldmodels.compiled.part import compile_callee_to_ir

__all__ = ["allocation_free", "allocation_free_inlined", "cache_folder", "compiled", "fingerprint", "inlined"]

P = ParamSpec("P")
R = TypeVar("R")


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a kernel with Numba, cached on disk, releasing the interpreter lock.

    Strict IEEE arithmetic (no ``fastmath``): equal inputs give equal bits in any batch size.
    The cache lies in `cache_folder` and notices a change of anything that the kernel is made of.
    """
    return _compile(function)


def inlined(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a small helper that is always inlined by LLVM into the kernels that call it."""
    return _compile(function, forceinline=True)


def allocation_free(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a kernel as ``compiled`` does, without Numba's counting of references to arrays.

    A count is an atomic operation for every view of an array, even one that is only handed on: ten times the
    cost of a short loop's body. Such a kernel creates no array but views, and returns none.
    """
    return _compile(function, _nrt=False)


def allocation_free_inlined(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a small helper as ``inlined`` does, with the limits of ``allocation_free``."""
    return _compile(function, _nrt=False, forceinline=True)


def _compile(function: Callable[P, R], **options: bool) -> Callable[P, R]:
    settings: Any = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True, **options}
    # Said even where it is off: a kernel takes what it does not say from the one that calls it first.
    settings.setdefault("forceinline", False)
    kernel: Any = numba.njit(**settings, pipeline_class=MemoisingCompiler)(function)
    if hasattr(kernel, "py_func"):  # with NUMBA_DISABLE_JIT the plain function comes back
        kernel._cache = KernelCache(kernel)
        kernel.compile = in_peace(kernel.compile)
        compile_callee_to_ir(kernel, function, settings)
    return cast(Callable[P, R], kernel)
