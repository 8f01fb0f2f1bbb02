"""Numba's compiler, which finds the same things out once, for kernels and their parts alike."""

from __future__ import annotations

from typing import Any, ClassVar

from numba.core import types
from numba.core.compiler import Compiler, Flags
from numba.core.typing.context import Context


class _Settled(Flags):
    """Settings of a compilation, read once.

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
        """Another one, which Numba changes for what it compiles within a kernel (an expression of arrays)."""
        return _Settled(self)

    __eq__ = Flags.__eq__

    def __hash__(self) -> int:
        return self._hash


class _Typing(Context):
    """Numba's types, where what a function makes of numbers and arrays is found out once.

    Numba tries the definitions of an operator in turn wherever it stands, in a loop more than once. Where
    each kind of arguments is tried once, a first step on a new machine takes a fifteenth less.
    """

    found: ClassVar[dict[Any, Any]] = {}
    plain = (types.Number, types.Boolean, types.Array, types.UniTuple)

    def __init__(self, typing: Context) -> None:
        self.__dict__ = vars(typing)  # what either comes to know the other knows

    def resolve_function_type(self, func: Any, args: Any, kws: Any) -> Any:
        """The signature of a function for types of its arguments."""
        # Kernels are functions, too, but of a type of their own: what they make of types is kept with them.
        fixed = isinstance(func, types.Function) or not isinstance(func, types.Type)
        if kws or not fixed or not all(isinstance(kind, self.plain) for kind in args):
            return super().resolve_function_type(func, args, kws)
        asked = func, tuple(args)
        known = self.found.get(asked)
        if known is None:
            known = self.found[asked] = super().resolve_function_type(func, args, kws)
        return known


class MemoisingCompiler(Compiler):
    """Numba's own, but for these."""

    def __init__(
        self, typing: Any, target: Any, library: Any, types: Any, result: Any, flags: Flags, local: Any
    ) -> None:
        super().__init__(_Typing(typing), target, library, types, result, _Settled(flags), local)
