"""A machine's own methods, looked at before they are compiled: each mistake is one message, with its line.

They are read, for names that do not exist on a way that is not taken; and run once as they are, for what they
return. What only some numbers bring about (a division by zero) is no mistake.
"""

from __future__ import annotations

import ast
import builtins
import dis
import inspect
import math
import textwrap
import traceback
import types
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from numbers import Number
from typing import Any

import numpy as np

from fieldmodels.drivers.declaration import Declaration, named, param_names, params_of, takes_state
from fieldmodels.model import ModelError
from fieldmodels.names import did_you_mean

TAKES = {
    "derivative": ("state", "input", "p"),
    "step": ("state", "input", "p", "dt"),
    "observe": ("state", "p"),
    "pace": ("p",),
}
"""What the methods are handed behind ``self``, which is None; an inertia is handed ``p``, or ``state, p``."""
CALLED = {"derivative": "derivative", "step": "advance", "observe": "observe", "pace": "fastest"}
"""What drivers call them."""
TITLES = {"state": "State", "input": "Input", "p": "Params"}
PLURALS = {"state": "states", "input": "inputs", "p": "declared numbers"}
TRIED = (0.0, 0.3)
"""States and inputs at which methods are run; the second where the first divides by zero, or the like."""
MISTAKES = (NameError, AttributeError, TypeError)
"""Errors that no numbers bring about."""


@dataclass(frozen=True)
class Method:
    """A method of a machine.

    Attributes:
        name: Its name.
        own: What drivers call it.
        owner: Class of the machine.
        function: What it is.
        known: Names behind each argument that has any: states, inputs, numbers.
        returns: Names of what it returns.
    """

    name: str
    own: str
    owner: type = field(compare=False)
    function: Any
    known: tuple[tuple[str, tuple[str, ...]], ...]
    returns: tuple[str, ...]

    @property
    def takes(self) -> tuple[str, ...]:
        """Its arguments behind ``self``."""
        if self.own.startswith("inertia_") and callable(self.function) and takes_state(self.function):
            return "state", "p"
        return TAKES.get(self.name, ("p",))

    @property
    def shipped(self) -> bool:
        """Whether it is the project's own, which its tests look at."""
        return str(getattr(self.function, "__module__", "")).startswith("fieldmodels.")

    def says(self, line: int, what: str) -> str:
        """A message about a line."""
        return f"{self.owner.__name__}.{self.name}, line {line}: {what}"

    @property
    def line(self) -> int:
        """Where it begins."""
        return int(self.function.__code__.co_firstlineno)

    def mistaken(self, result: Any) -> str:
        """What is wrong about what it returned; empty if nothing is."""
        if result is None:
            return f"returns nothing; {self._remedy()}"
        if isinstance(result, list) or (isinstance(result, np.ndarray) and result.ndim):
            kind = "a list" if isinstance(result, list) else "a NumPy array"
            return f"returns {kind}, where compiled equations return numbers; {self._remedy()}"
        if isinstance(result, tuple) and self.name not in ("derivative", "step", "observe"):
            return f"returns a tuple; {self._remedy()}"
        values = result if isinstance(result, tuple) else (result,)
        if len(values) != len(self.returns):
            return self.miscounted(len(values))
        for name, value in zip(self.returns, values, strict=True):
            if np.ndim(value) or not isinstance(value, Number | np.bool_ | np.ndarray):
                return f"returns {value!r} for {name}, not a number"
        return ""

    def miscounted(self, count: int) -> str:
        """What is wrong about returning so many numbers."""
        return f"returns {count} number{'s' * (count != 1)}, not {len(self.returns)}; {self._remedy()}"

    def _remedy(self) -> str:
        names = self.returns
        return {
            "derivative": f"return the states' rates: return {', '.join(f'rate_of_{n}' for n in names)}",
            "step": f"return the states a time dt later: return {', '.join(names)}",
            "observe": f"return the outputs: return {', '.join(names)}",
            "pace": "return the fastest mode [rad/s], one number",
        }.get(self.name, "return one number: the inertia, or a rate by a unit of force")


def methods_of(machine: Declaration) -> list[Method]:
    """A machine's own methods: how it moves, what is seen of it, inertias that are no number of it."""
    kind = type(machine)
    states = tuple(s.name for s in machine.states)
    inputs = tuple(s.name for s in kind.inputs)  # an instance may read them from other columns
    params = tuple(param_names(machine))
    known = (("state", states), ("input", inputs), ("p", params))
    returns = {"derivative": states, "step": states, "observe": tuple(s.name for s in machine.outputs)}
    names = {name: own for name, own in CALLED.items() if getattr(kind, name, None) is not None}
    inertias = {name for f in machine.forces for name in (f.inertia, *f.also.values())}
    inertias -= {"", *(p.name for p in machine.parameters)}
    names |= {name: f"inertia_{name}" for name in sorted(inertias)}
    return [
        Method(name, own, kind, _plain(getattr(kind, name)), known, returns.get(name, (name,)))
        for name, own in names.items()
    ]


def _plain(function: Any) -> Any:
    """What is behind a function that its author has compiled."""
    return getattr(function, "py_func", function)


_found: dict[Method, str] = {}
"""What was found before: a diagnosis puts many curves on one machine."""


def check_methods(machine: Declaration) -> None:
    """Look for mistakes in a machine's own methods.

    Raises:
        ModelError: For the first one, with class, method, line and remedy.
    """
    methods = methods_of(machine)
    states = [s.name for s in machine.states]
    unseen = [s.name for s in machine.outputs if s.name not in states]
    if unseen and not any(m.name == "observe" for m in methods):
        raise ModelError(
            f"{type(machine).__name__}: output {unseen[0]!r} is no state ({', '.join(states)}); give the "
            "machine observe(self, state, p), which returns the outputs"
        )
    for method in methods:
        if method.shipped:
            continue
        if method not in _found:
            _found[method] = next(_mistakes(method, params_of(machine, machine.nominal)), "")
        if _found[method]:
            raise ModelError(_found[method])


def _mistakes(method: Method, numbers: Sequence[float]) -> Iterator[str]:
    if not isinstance(method.function, types.FunctionType):
        place = f"{method.owner.__name__}.{method.name}"
        yield f"{place}: must be a function: def {method.name}({_listed(method)})"
        return
    yield from _wrong_arguments(method)
    yield from _unknown_globals(method)
    yield from _wrong_text(method)
    yield from _wrong_run(method, numbers)


def _listed(method: Method) -> str:
    return ", ".join(("self", *method.takes))


def _handed(method: Method) -> str:
    """What a method may take."""
    return f"({_listed(method)})" + " or (self, state, p)" * method.own.startswith("inertia_")


def _wrong_arguments(method: Method) -> Iterator[str]:
    """Arguments that are missing, too many, or in another order."""
    signature = inspect.signature(method.function)
    names = tuple(signature.parameters)
    try:
        signature.bind(*[None] * (1 + len(method.takes)))
    except TypeError:
        yield method.says(method.line, f"takes ({', '.join(names)}); it is handed {_handed(method)}")
        return
    if names[1:] != method.takes and sorted(names[1:]) == sorted(method.takes):
        yield method.says(method.line, f"its arguments come in the order ({_listed(method)})")


def _unknown_globals(method: Method) -> Iterator[str]:
    """Names that are nothing."""
    scope = method.function.__globals__
    for step in dis.get_instructions(method.function):
        if step.opname == "LOAD_GLOBAL" and step.argval not in scope and not hasattr(builtins, step.argval):
            line = step.positions.lineno if step.positions else None
            yield method.says(line or method.line, f"{step.argval!r} is not defined{_imported(step.argval)}")


def _imported(name: str) -> str:
    """What to import for a name that is missing."""
    modules = {"np": "import numpy as np", "math": "import math"}
    if name in modules:
        return f"; write {modules[name]} above the class"
    return f"; write import math above the class, and math.{name}" if hasattr(math, name) else ""


def _wrong_text(method: Method) -> Iterator[str]:
    """What the source shows on all ways through it, taken or not."""
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(method.function))).body[0]
    except (OSError, SyntaxError):  # typed in, or a lambda amid something else
        return
    if not isinstance(tree, ast.FunctionDef):
        return
    nodes = list(_inside(tree))
    bound = {node.id for node in nodes if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)}
    arguments = dict(
        zip(inspect.signature(method.function).parameters, ("self", *method.takes), strict=False)
    )
    for node in nodes:
        line = method.line + getattr(node, "lineno", 1) - 1
        if isinstance(node, ast.Return) and (wrong := _wrong_return(method, node.value)):
            yield method.says(line, wrong)
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            role = arguments.get(node.value.id) if node.value.id not in bound else None
            if role and (wrong := _wrong_name(method, role, node.value.id, node.attr)):
                yield method.says(line, wrong)


def _inside(tree: ast.AST) -> Iterator[ast.AST]:
    """Nodes of a function in the order of its lines, without those of functions within it."""
    for node in ast.iter_child_nodes(tree):
        if not isinstance(node, ast.FunctionDef | ast.Lambda | ast.arguments):
            yield node
            yield from _inside(node)


def _wrong_return(method: Method, value: ast.expr | None) -> str:
    if value is None or (isinstance(value, ast.Constant) and value.value is None):
        return method.mistaken(None)
    if isinstance(value, ast.List):
        return method.mistaken([])
    if isinstance(value, ast.Tuple) and not any(isinstance(part, ast.Starred) for part in value.elts):
        return method.miscounted(len(value.elts)) if len(value.elts) != len(method.returns) else ""
    return ""


def _wrong_name(method: Method, role: str, argument: str, name: str) -> str:
    """What is wrong about reading a name of an argument."""
    known = dict(method.known)
    elsewhere = next((other for other, names in method.known if name in names and other != role), "")
    if role == "self":
        return f"{argument}.{name}: self is None in compiled equations; {_instead(method, name, elsewhere)}"
    if role not in known or name in known[role] or hasattr(tuple, name) or name in ("_fields", "_replace"):
        return ""
    if elsewhere:
        hint = f"; {name!r} is one of the {PLURALS[elsewhere]}: {elsewhere}.{name}"
    else:
        close = did_you_mean(name, known[role])
        hint = close if "mean" in close else ""
    there = f"are {', '.join(known[role])}" if known[role] else "are none"
    return f"there is no {argument}.{name}; the {PLURALS[role]} {there}{hint}"


def _instead(method: Method, name: str, elsewhere: str) -> str:
    """What to write in place of a name of ``self``."""
    if elsewhere:
        return f"write {elsewhere}.{name}"
    if callable(getattr(method.owner, name, None)):
        return f"write {name} as a function outside of the class"
    return f"declare {name} = number(...) and write p.{name}, or write {name} = ... outside of the class"


def _wrong_run(method: Method, numbers: Sequence[float]) -> Iterator[str]:
    """What comes of running it as it is."""
    for size in TRIED:
        try:
            with np.errstate(all="ignore"):
                result = method.function(None, *arguments_of(method, numbers, size))
        except MISTAKES as error:
            yield method.says(_line_of(error, method), _told(method, error))
            return
        except Exception:  # of these numbers
            continue
        if wrong := method.mistaken(result):
            yield method.says(method.line, wrong)
        return


def arguments_of(method: Method, numbers: Sequence[float], size: float) -> list[Any]:
    """What a method is handed behind ``self``, with all states and inputs of one size."""
    values = {role: [size] * len(names) for role, names in method.known} | {"p": list(numbers)}
    known = dict(method.known)
    return [0.01 if r == "dt" else named(TITLES[r], list(known[r]), values[r]) for r in method.takes]


def _told(method: Method, error: Exception) -> str:
    """An error in words."""
    role = next((r for r, title in TITLES.items() if type(getattr(error, "obj", None)).__name__ == title), "")
    if isinstance(error, AttributeError) and role:
        return _wrong_name(method, role, role, str(error.name)) or str(error)
    why = "; self is None in compiled equations" if getattr(error, "obj", error) is None else ""
    return f"{type(error).__name__}: {error}{why}"


def _line_of(error: Exception, method: Method) -> int:
    frames = traceback.extract_tb(error.__traceback__)
    lines = [f.lineno for f in frames if f.filename == method.function.__code__.co_filename and f.lineno]
    return lines[-1] if lines else method.line
