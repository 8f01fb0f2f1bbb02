"""One hash of what a compiled function is made of: its code, what it reaches, the constants it reads."""

import dis
import enum
import functools
import hashlib
import sys
import types
from collections.abc import Callable, Iterator
from typing import Any
from weakref import WeakKeyDictionary

import numba
import numpy as np
from numba.core.dispatcher import Dispatcher

# Their functions are identified by name: Numba brings its own implementation of each.
LIBRARIES = frozenset({"numba", "numpy", "scipy", *sys.stdlib_module_names})
ADDED: dict[str, str] = {}
"""Editions of what this project has added to functions of libraries, by their names."""

_LOAD_GLOBAL, _EXTENDED_ARG = dis.opmap["LOAD_GLOBAL"], dis.opmap["EXTENDED_ARG"]
_LOAD_CONSTANT = frozenset(dis.hasconst)


class UnknownConstantError(TypeError):
    """A function reads a global whose value has no fingerprint."""


class _Part:
    """One function: the hash of what is its own, and the functions that it reaches directly."""

    def __init__(self, function: Any):
        self.reached: list[Any] = []
        plain = getattr(function, "py_func", function)
        names = frozenset(_names(plain.__code__))
        described = [
            f"{plain.__module__}.{plain.__qualname__}",
            repr(sorted(getattr(function, "targetoptions", {}).items())),
            self._code(plain.__code__),
            self._value(plain.__defaults__),
            self._value(sorted((plain.__kwdefaults__ or {}).items())),
        ]
        for name, cell in zip(plain.__code__.co_freevars, plain.__closure__ or (), strict=True):
            described.append(f"{name}={self._value(cell.cell_contents)}")
        # An attribute may have the name of a global that the function does not read.
        for name in sorted(globals_read(plain.__code__) & plain.__globals__.keys()):
            try:
                described.append(f"{name}={self._value(plain.__globals__[name], names)}")
            except UnknownConstantError as error:
                raise UnknownConstantError(
                    f"{plain.__module__}.{plain.__qualname__} reads '{name}', {error}"
                ) from None
        self.digest = hashlib.sha256("\n".join(described).encode()).digest()

    def _code(self, code: types.CodeType) -> str:
        """Instructions with what they load, without line numbers, comments and docstrings.

        A docstring is a constant that no instruction loads. From Python 3.14 on it shifts the others' places,
        so that a constant stands here at each instruction that loads it, in place of its number.
        """
        steps = [
            (operation, self._constant(code.co_consts[argument]) if operation in _LOAD_CONSTANT else argument)
            for operation, argument in _instructions(code)
        ]
        return repr((steps, code.co_names, code.co_varnames, code.co_freevars))

    def _constant(self, value: Any) -> str:
        return self._code(value) if isinstance(value, types.CodeType) else self._value(value)

    def _value(self, value: Any, names: frozenset[str] = frozenset(), seen: tuple[Any, ...] = ()) -> str:
        if isinstance(value, Dispatcher | types.FunctionType):
            return self._function(value)
        if isinstance(value, types.ModuleType):
            return self._module(value, names, seen)
        if value is None or value is ... or isinstance(value, bool | int | float | complex | str | bytes):
            return f"{_name(type(value))} {value!r}"
        if isinstance(value, slice):  # a constant of code from Python 3.14 on
            return f"slice {self._value((value.start, value.stop, value.step))}"
        if isinstance(value, tuple | list):
            inside = ", ".join(self._value(item) for item in value)
            fields = getattr(type(value), "_fields", "")
            return f"{_name(type(value))}{fields}({inside})"
        if isinstance(value, frozenset):
            return f"frozenset({sorted(self._value(item) for item in value)})"
        if isinstance(value, np.ndarray):
            content = hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()
            return f"array {value.dtype!r} {value.shape} {value.strides} {content}"
        if isinstance(value, np.generic):
            return f"{value.dtype!r} {value.tobytes().hex()}"
        if isinstance(value, enum.Enum):
            return f"{_name(type(value))}.{value.name} {self._value(value.value)}"
        if isinstance(value, np.dtype):
            return f"dtype {value!r}"
        if isinstance(value, numba.types.Type) and (described := describe_type(value)) is not None:
            return f"type {described}"
        if isinstance(value, type):
            return self._type(value)
        if _library(value):
            added = ADDED.get(value.__name__, "")
            return f"library {getattr(value, '__module__', '')}.{value.__name__}{added}"
        raise UnknownConstantError(f"of {type(value)}: it has no fingerprint")

    def _function(self, function: Any) -> str:
        plain = getattr(function, "py_func", function)
        if not _library(plain):
            self.reached.append(function)
        return f"function {plain.__module__}.{plain.__qualname__}"

    def _module(self, module: types.ModuleType, names: frozenset[str], seen: tuple[Any, ...]) -> str:
        """The name of a library; of any other module what the function may read of it."""
        if module in seen or module.__name__.partition(".")[0] in LIBRARIES:
            added = [f"{name} {ADDED[name]}" for name in sorted(names & ADDED.keys())]
            return f"module {module.__name__} {added}" if added else f"module {module.__name__}"
        read = sorted(names & vars(module).keys())
        inside = [f"{name}={self._value(vars(module)[name], names, (*seen, module))}" for name in read]
        return f"module {module.__name__} {inside}"

    def _type(self, value: type) -> str:
        if issubclass(value, enum.Enum):
            return f"{_name(value)} {[self._value(member) for member in value]}"
        if issubclass(value, tuple) and hasattr(value, "_fields"):
            defaults = getattr(value, "_field_defaults", {})
            return f"{_name(value)} {value._fields} {self._value(sorted(defaults.items()))}"
        if _library(value) or value.__module__ == "builtins" or issubclass(value, BaseException):
            return _name(value)
        raise UnknownConstantError(f"the class {_name(value)}: it has no fingerprint")


_parts: WeakKeyDictionary[Any, _Part] = WeakKeyDictionary()


def fingerprint(function: Callable[..., Any]) -> str:
    """A hash of all that a function is made of, whether it is compiled or not.

    It changes with the code of the function, with that of any function that it reaches, and with the value of
    any constant that one of them reads; not with comments, docstrings, line numbers or the place of a file.
    Nothing is imported and no file is read: whatever the function can reach lies in memory already.

    Args:
        function: A kernel or a plain function.

    Returns:
        64 hexadecimal digits.

    Raises:
        UnknownConstantError: If one of the functions reads a global of a kind whose content cannot be told.
    """
    found: dict[Any, _Part] = {}
    waiting: list[Any] = [function]
    while waiting:
        one = waiting.pop()
        if one not in found:
            if one not in _parts:
                _parts[one] = _Part(one)
            found[one] = _parts[one]
            waiting.extend(found[one].reached)
    digests = sorted(part.digest for part in found.values())
    return hashlib.sha256(found[function].digest + b"".join(digests)).hexdigest()


def describe_type(kind: Any) -> str | None:
    """A Numba type in words that name all of its content; None for one whose content cannot be told.

    The printed form of a named tuple lacks its fields: exchanging two of them would go unnoticed. A type that
    holds a function or a class stands for one object of this process.
    """
    if isinstance(kind, numba.types.BaseTuple):
        inside = [describe_type(one) for one in getattr(kind, "types", ())]
        owner: Any = getattr(kind, "instance_class", tuple)
        return None if None in inside else f"{_name(owner)}{getattr(owner, '_fields', '')}{inside}"
    of_this_process = numba.types.Callable | numba.types.FunctionType | numba.types.ClassInstanceType
    printed = str(kind)
    hidden_fields = "NamedTuple(" in printed or "NamedUniTuple(" in printed
    return None if hidden_fields or isinstance(kind, of_this_process) else printed


def _name(value: type) -> str:
    return f"{value.__module__}.{value.__qualname__}"


def _library(value: Any) -> bool:
    module = getattr(value, "__module__", None) or getattr(type(value), "__module__", "")
    return hasattr(value, "__name__") and str(module).partition(".")[0] in {*LIBRARIES, "builtins"}


def _names(code: types.CodeType) -> Iterator[str]:
    yield from code.co_names
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield from _names(constant)


def _instructions(code: types.CodeType) -> Iterator[tuple[int, int]]:
    """Operations and their arguments; ``dis`` tells the same, far slower than all else here."""
    high = 0
    for operation, low in zip(code.co_code[::2], code.co_code[1::2], strict=True):
        argument = high | low
        if operation == _EXTENDED_ARG:
            high = argument << 8
        else:
            yield operation, argument
            high = 0


@functools.cache
def globals_read(code: types.CodeType) -> frozenset[str]:
    """Names of the globals that a code loads."""
    read = {code.co_names[at >> 1] for operation, at in _instructions(code) if operation == _LOAD_GLOBAL}
    inner = (globals_read(c) for c in code.co_consts if isinstance(c, types.CodeType))
    return frozenset(read).union(*inner)
