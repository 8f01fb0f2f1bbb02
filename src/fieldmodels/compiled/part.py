"""Kernels as parts of other kernels: compiled to LLVM's intermediate code and no further.

A kernel that another one calls ends up in that one's machine code. Made the way that Numba makes what Python
calls, it would be optimised, turned into machine code, wrapped for Python and written to disk on its own as
well: two thirds of the time that a first step on a new machine takes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
from numba.core import types
from numba.core.caching import NullCache
from numba.core.codegen import JITCodeLibrary

from fieldmodels.compiled.cache import refuse_array
from fieldmodels.compiled.memoising import MemoisingCompiler


class _NoEngine:
    """Stands where Numba tells the machine code of a function its constants: a part has none."""

    def set_env(self, *_: Any) -> None:
        """Leave it to the kernel that takes the part in; see ``KernelCache.save_overload``."""


class _PartLibrary(JITCodeLibrary):
    """Code that is only linked into other code."""

    codegen = _NoEngine()

    def get_pointer_to_function(self, _: str) -> int:
        self._ensure_finalized()
        return 0

    def _optimize_final_module(self) -> None:
        """The kernel that takes the part in is optimised as a whole."""

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


class _PartCompiler(MemoisingCompiler):
    def __init__(self, typing: Any, target: Any, _: Any, *others: Any):
        super().__init__(typing, target, _PartLibrary(target.codegen(), "part"), *others)


class _Unkept(NullCache):
    """No file of its own: what takes the part in has one."""

    def __init__(self, part: Any):
        self._part = part

    def save_overload(self, _: Any, data: Any) -> None:
        refuse_array(self._part, data)


def compile_callee_to_ir(kernel: Any, function: Callable[..., Any], settings: dict[str, Any]) -> None:
    """Let a kernel be a part where another one calls it, one version for any value of a constant argument."""
    jit: Any = numba.njit
    part = jit(**settings, no_cpython_wrapper=True, pipeline_class=_PartCompiler)(function)
    part._cache = _Unkept(part)

    def template(arguments: Any, named: Any) -> Any:
        plain = {name: types.unliteral(kind) for name, kind in dict(named).items()}
        return part.get_call_template(tuple(map(types.unliteral, arguments)), plain)

    kernel.get_call_template = template
    kernel.get_overload = part.get_overload
