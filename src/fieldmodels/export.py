"""A machine with its effects as one Python file that needs NumPy alone.

The file holds the very functions that simulate here, gathered from the kernel of the machine's windows
through all that it calls, without the compiler: what runs there is what ran here, only slower.
"""

from __future__ import annotations

import ast
import builtins
import inspect
import math
import pprint
import textwrap
import types
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.drivers.declaration import Declaration
from fieldmodels.drivers.kernel.compose import kernels_of
from fieldmodels.drivers.kernel.episodes import Sets
from fieldmodels.drivers.kernel.windows import Fineness, Log, Room, Spans, room_of
from fieldmodels.drivers.windows import FAST, Rows
from fieldmodels.files import write_text
from fieldmodels.model import Model, ModelError

SHELL = Path(__file__).parent / "export_shell.py.txt"
LIBRARIES = {"math": math, "np": np}
PLAIN = (bool, int, float, str, type(None))


def write_model(model: Model, vector: FloatArray, path: Path) -> None:
    """Write a machine as a Python file that simulates it with NumPy alone.

    Args:
        model: The machine, its curves among its effects; see ``Diagnosis.simulation``.
        vector: Its whole parameter vector.
        path: The file.

    Raises:
        ModelError: If the model is no machine, or reads its inputs from measured columns.
    """
    if not isinstance(model, Declaration):
        raise ModelError(
            f"model {model.name!r} has kernels of its own; only machines (rig, pendulum, own ones) can be "
            "exported"
        )
    if getattr(model, "driven_by_measured", False):
        raise ModelError(f"model {model.name!r} is driven by measured signals, which no command gives")
    write_text(path, source_of_model(model, vector))


def source_of_model(machine: Declaration, vector: FloatArray) -> str:
    """The text of the file that ``write_model`` writes."""
    kernels = kernels_of(machine, 1)
    rows = Rows(machine)
    facts = {
        "NAME": machine.name,
        "STATES": [s.name for s in machine.states],
        "INPUTS": [s.name for s in machine.inputs],
        "OUTPUTS": [s.name for s in machine.outputs],
        "AHEAD": machine.ahead,
        "INTERPOLATED": machine.hold == "interpolated",
        "PARAMETERS": {name: float(value) for name, value in zip(machine.names, vector, strict=True)},
        "FASTEST": [FAST * speed for speed in machine.speeds()],
        "SUBSTEPS": machine.substeps,
        "FORCES": len(machine.forces),
        # Of no samples: where that makes a length 0, it is the number of samples.
        "ROOM": [(a.shape, a.dtype.name) for a in room_of(kernels.facts, 0, 0)],
        "BASE": rows.base.tolist(),
        "CURVES": rows.curves.tolist(),
        "NEUTRAL": rows.neutral.tolist(),
        "SOURCES": {place: (own.shape, own.ravel().tolist()) for place, own in rows.sources.items()},
    }
    gathered = _Gathered(facts)
    gathered.add("simulate_windows", kernels.simulate)
    for value in (Sets, Log, Spans, Fineness, Room):
        gathered.add(value.__name__, value)
    numbers = "\n".join(
        f"{name} = {pprint.pformat(v, width=100, sort_dicts=False)}" for name, v in facts.items()
    )
    active = ", ".join(e.name for e in machine.effects if _acts(machine, e.name, vector))
    head, _, body = SHELL.read_text(encoding="utf-8").partition("# FACTS\n")
    for field, words in {
        "{name}": machine.name,
        "{effects}": active or "no effect",
        "{inputs}": ", ".join(f'"{s.name}": {s.name}' for s in machine.inputs),
        "{start}": ", ".join(f'"{s.name}": 0.0' for s in machine.states),
        "{rows}": "" if machine.inputs else ", rows=1000",
    }.items():
        head = head.replace(field, words)
    main = 'if __name__ == "__main__":\n    main(*sys.argv[1:])\n'
    return f"{head}{numbers}\n\n{body}\n\n{gathered.text()}\n\n{main}"


def _acts(machine: Declaration, effect: str, vector: FloatArray) -> bool:
    part = machine.slice_of(effect)
    return bool(np.any(vector[part] != machine.nominal[part]))


def _is_plain(value: Any) -> bool:
    """Whether a value's text is the value."""
    return isinstance(value, PLAIN) or (isinstance(value, tuple) and all(_is_plain(v) for v in value))


class _Gathered:
    """Functions with all that they reach, each under a name of its own."""

    def __init__(self, taken: Iterable[str]) -> None:
        """Begin, with names that are taken."""
        self.names: dict[int, str] = {}
        self.taken: set[str] = {
            *taken,
            *dir(builtins),
            *LIBRARIES,
            "namedtuple",
            "simulate",
            "main",
            "sys",
            "_rows",
        }
        self.constants: list[str] = []
        self.functions: list[str] = []
        self.kept: list[Any] = []  # so that no identity is used twice

    def text(self) -> str:
        """All of it as Python."""
        return "\n".join(self.constants) + "\n\n\n" + "\n\n\n".join(self.functions) + "\n"

    def add(self, name: str, value: Any) -> str:
        """Take a value in, if it is not there; its name in the file.

        Raises:
            ModelError: For a value of a kind that no file can hold.
        """
        value = getattr(value, "py_func", value)
        if isinstance(value, types.ModuleType) or getattr(builtins, name, None) is value:
            return name
        key = id(value) if not isinstance(value, PLAIN) else hash((name, repr(value)))
        if key in self.names:
            return self.names[key]
        own = name if name not in self.taken else f"{name}_{len(self.taken)}"
        self.taken.add(own)
        self.names[key] = own
        self.kept.append(value)
        if isinstance(value, types.FunctionType):
            self.functions.append(self._function(value, own))
        elif isinstance(value, type) and issubclass(value, tuple) and hasattr(value, "_fields"):
            self.constants.append(f"{own} = namedtuple({value.__name__!r}, {list(value._fields)!r})")
        elif isinstance(value, np.ndarray):
            self.constants.append(f"{own} = np.array({value.tolist()!r}, dtype={str(value.dtype)!r})")
        elif _is_plain(value):
            self.constants.append(f"{own} = {value!r}".replace("inf", "np.inf").replace("nan", "np.nan"))
        elif getattr(value, "__module__", None) in ("math", "numpy"):
            self.constants.append(f"from {value.__module__} import {value.__name__} as {own}")
        else:
            raise ModelError(
                f"{name!r} of {type(value)} cannot be written into a file; use numbers and functions"
            )
        return own

    def _function(self, function: types.FunctionType, name: str) -> str:
        """A function's text without its decorators and hints, what it reaches taken in and renamed."""
        node = ast.parse(_source(function)).body[0]
        assert isinstance(node, ast.FunctionDef)
        inside = {n.id for n in ast.walk(node) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
        inside |= {a.arg for a in ast.walk(node) if isinstance(a, ast.arg)}
        closure = inspect.getclosurevars(function).nonlocals
        scope: Mapping[str, Any] = {**function.__globals__, **closure}
        node.name, node.decorator_list, node.returns = name, [], None
        for part in ast.walk(node):
            if isinstance(part, ast.arg):
                part.annotation = None
        read = {n.id for n in ast.walk(node) if isinstance(n, ast.Name)} - inside
        taken = {self.add(name, scope[name]) for name in read & scope.keys()}
        taken |= {self.add(*found) for part in ast.walk(node) if (found := _of_module(part, scope, inside))}
        return ast.unparse(_Renamed(self, scope, inside, inside & taken).visit(node))


@cache
def _source(function: types.FunctionType) -> str:
    try:
        return textwrap.dedent(inspect.getsource(function))
    except OSError as error:
        raise ModelError(f"{function.__qualname__}: its source cannot be read ({error})") from None


def _of_module(node: ast.AST, scope: Mapping[str, Any], inside: set[str]) -> tuple[str, Any] | None:
    """Name and value of what a part of a function reads of a module that is no library."""
    if not (isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)) or node.value.id in inside:
        return None
    module = scope.get(node.value.id)
    if not isinstance(module, types.ModuleType) or module in LIBRARIES.values():
        return None
    return node.attr, getattr(module, node.attr)


class _Renamed(ast.NodeTransformer):
    """Puts a file's names in the place of those that a function reads."""

    def __init__(
        self, gathered: _Gathered, scope: Mapping[str, Any], inside: set[str], taken: set[str]
    ) -> None:
        self.gathered, self.scope, self.inside, self.taken = gathered, scope, inside, taken

    def visit_Name(self, node: ast.Name) -> ast.Name:
        """A global by its name in the file; a local one that would hide it, by another."""
        if node.id in self.taken:
            node.id += "_"
        elif node.id not in self.inside and node.id in self.scope:
            node.id = self.gathered.add(node.id, self.scope[node.id])
        return node

    def visit_arg(self, node: ast.arg) -> ast.arg:
        """An argument that would hide a global, by another name."""
        if node.arg in self.taken:
            node.arg += "_"
        return node

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        """What is read of a module that is no library."""
        if found := _of_module(node, self.scope, self.inside):
            return ast.Name(self.gathered.add(*found), node.ctx)
        base = node.value
        library = (
            self.scope.get(base.id) if isinstance(base, ast.Name) and base.id not in self.inside else None
        )
        for name, one in LIBRARIES.items():
            if library is one and isinstance(base, ast.Name):
                base.id = name
                return node
        return self.generic_visit(node)
