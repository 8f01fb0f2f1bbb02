"""Whether Numba can compile a machine's own methods, and what it lacks where it cannot."""

from __future__ import annotations

import re
import types as python_types
import warnings
from collections import namedtuple
from pathlib import Path
from typing import Any

import numpy as np
from numba.core import types

from fieldmodels.compiled import allocation_free_inlined
from fieldmodels.compiled.fingerprint import fingerprint, globals_read
from fieldmodels.contract import ModelWarning
from fieldmodels.drivers import numpy_words as numpy_words  # what equations may write with NumPy
from fieldmodels.drivers.declaration import Declaration
from fieldmodels.drivers.methods import TITLES, Method, methods_of
from fieldmodels.model import ModelError

NO_CONSTANT = r"it reads \1 (\2), which is no constant; make it numbers, a tuple or a NumPy array"
PHRASES = {
    r"assigned to variable '(\w+)' in globals": (r"it reads \1, a list; make it a tuple or a NumPy array"),
    r"^NRT required|^(?:array|zeros|ones|empty|full|eye|asarray|linspace|hash)\b|list\(|array\(": (
        "it makes a list, a dictionary or an array, for which compiled equations have no memory; write its "
        "numbers out"
    ),
    r"unicode|Literal\[str\]|f-strings|format": "it makes a text; leave it out",
    r"^exception_match|SETUP_FINALLY": "it catches an exception; ask for the condition instead",
    r"IMPORT_NAME": "it imports something; import it above the class",
    r"STORE_GLOBAL": "it changes a global variable; what must be remembered is a state",
    r"yield in a closure": "it holds a generator (... for ... in ...); write a loop",
    r"NumPy function 'numpy\.(\w+)'": r"Numba does not know np.\1 of a number; write it with math",
    r"attribute '(\w+)' of type Module\(<module '(math|numpy\b[\w.]*)'": r"Numba does not know \2.\1",
    r"attribute '(\w+)' of type Module\(<module '([\w.]+)'": (
        r"it calls \2.\1, which is not compiled; decorate that with numba.njit"
    ),
    r"'(\w+)': Cannot determine Numba type of <class 'function'>": (
        r"it calls \1, which is not compiled; decorate that with numba.njit"
    ),
    r"'(\w+)': Cannot determine Numba type of <class '(?:\w+\.)*(\w+)'>": NO_CONSTANT,
    r"reads '(\w+)', of <class '(?:\w+\.)*(\w+)'>": NO_CONSTANT,
    r"context manager": "it holds a with statement; leave it out",
    r"^(\w+\(.*\))$": r"Numba does not know \1",
}
"""What Numba's messages say, by what they contain, in words."""


def compilable(machine: Declaration) -> bool:
    """Whether Numba can compile a machine's own methods; what it lacks is said once, in a warning.

    Raises:
        ModelError: If one returns something else on a way that it has not been seen to take.
    """
    return not [m for m in methods_of(machine) if not m.shipped and _lacks(m)]


_found: dict[Method, str] = {}


def _lacks(method: Method) -> str:
    """What Numba lacks to compile a method; empty if nothing."""
    if method not in _found:
        _found[method] = lack = _tried(method)
        if lack:
            warnings.warn(
                f"Numba cannot compile it, so it runs as plain Python, a thousand times slower: {lack}",
                ModelWarning,
                stacklevel=6,
            )
    return _found[method]


def _tried(method: Method) -> str:
    arguments, function = _arguments(method), with_helpers(method.function)
    try:
        kernel: Any = allocation_free_inlined(function)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # it is said below what cannot be kept on the disk
            kernel.compile(arguments)
        fingerprint(function)
        (compiled,) = kernel.overloads.values()
    except Exception as error:  # Numba raises many kinds, and some are no NumbaError
        text = re.sub(r"\x1b\[\d*m", "", str(error))  # Numba's colours, where colorama is installed
        if "unify return type" in text:
            wrong = "returns different counts of numbers on different ways through it"
            raise ModelError(method.says(method.line, wrong)) from error
        return method.says(_line(text, method), in_words(text))
    if wrong := method.mistaken(_like(compiled.signature.return_type)):
        raise ModelError(method.says(method.line, f"on one way through it, {wrong}"))
    return ""


def _like(kind: Any) -> Any:
    """A value of the kind that is returned; None of what may be nothing."""
    if isinstance(kind, types.NoneType | types.Optional):
        return None
    if isinstance(kind, types.BaseTuple):
        return tuple(_like(one) for one in getattr(kind, "types", ()))
    if isinstance(kind, types.List):
        return []
    return np.zeros(1) if isinstance(kind, types.Array) else 1.0


def in_words(text: str) -> str:
    """What Numba lacks, from its message."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    main = next((line for line in lines if not line.startswith("Failed in")), "")
    if main.startswith("No implementation"):
        main = next(line for line in lines if line.startswith(">>> "))[4:]
    for pattern, words in PHRASES.items():
        if found := re.search(pattern, main):
            return _kinds_in_words(found.expand(words))
    return main or "it holds something that Numba does not know"


def _kinds_in_words(text: str) -> str:
    """Numba's types by what they are."""
    text = re.sub(r"(Uni)?Tuple\(.*\)(?=[,)])", "tuple", text)
    return re.sub(r"Literal\[int\]\((-?\d+)\)|\b(?:float64|int64)\b", lambda m: m[1] or "number", text)


def _line(text: str, method: Method) -> int:
    """The line of the method's file that Numba's message names."""
    file = re.escape(Path(method.function.__code__.co_filename).name)
    found = re.search(file + r'"?,? (?:line |\()(\d+)', text)
    return int(found[1]) if found else method.line


def _arguments(method: Method) -> tuple[Any, ...]:
    """Types of what a method is handed."""
    known = dict(method.known)
    make: Any = namedtuple
    tuples: Any = types.NamedUniTuple
    return types.none, *(
        types.float64
        if role == "dt"
        else tuples(types.float64, len(known[role]), make(TITLES[role], known[role]))
        if known[role] or role == "p"
        else types.none
        for role in method.takes
    )


def with_helpers(function: Any, made: dict[Any, Any] | None = None) -> Any:
    """A method whose helpers, plain functions of its author's beside it, are compiled with it.

    Args:
        function: The method, or a helper.
        made: What the helpers that were seen have become.
    """
    made = {} if made is None else made
    scope = function.__globals__
    own = {
        name: scope[name]
        for name in globals_read(function.__code__)
        if isinstance(scope.get(name), python_types.FunctionType)
        and scope[name].__module__.partition(".")[0] not in ("fieldmodels", "numpy", "numba", "scipy")
    }
    if not own:
        return function
    for helper in own.values():
        if helper not in made:
            made[helper] = helper  # one that calls itself stays as it is
            made[helper] = allocation_free_inlined(with_helpers(helper, made))
    result = python_types.FunctionType(
        function.__code__,
        {**scope, **{name: made[helper] for name, helper in own.items()}},
        function.__name__,
        function.__defaults__,
        function.__closure__,
    )
    result.__kwdefaults__ = function.__kwdefaults__
    result.__module__, result.__qualname__ = function.__module__, function.__qualname__
    return result
