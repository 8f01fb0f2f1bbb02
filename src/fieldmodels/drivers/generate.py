"""Compiled drivers of a machine: a module written from its declaration, kept by a hash of all that it depends on.

The file's name holds a hash of the driver's text, of the machine's own functions and whatever they call, and of the
stock effects; so a changed equation is another file, and Numba's cache of the old one is never met.
"""

from __future__ import annotations

import hashlib
import importlib.util
import inspect
import re
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from functools import cache
from importlib.metadata import version
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import TYPE_CHECKING, Any

import jinja2
import numba
import numpy as np

from fieldmodels.contract import ModelWarning
from fieldmodels.effects.curves import Curve
from fieldmodels.files import write_text

if TYPE_CHECKING:
    from fieldmodels.machine import Machine

HERE = Path(__file__).parent
METHODS = {"derivative": "derivative", "step": "advance", "observe": "observe", "pace": "fastest"}
"""A machine's methods, and what drivers call them."""
JIT = "from fieldmodels.compiled import compiled, inlined\n"
AS_IT_IS = "def compiled(f):\n    return f\n\n\ninlined = compiled\n"


def driver_module(machine: Machine, template: str) -> ModuleType:
    """The module of a driver, compiled; or as it is, with a warning, if Numba cannot compile the machine.

    Args:
        machine: The machine.
        template: File name of the driver's template.
    """
    text = driver_text(machine, template)
    functions = {own: getattr(type(machine), name) for name, own in METHODS.items() if _has(machine, name)}
    functions |= {f"inertia_{f.inertia}": getattr(type(machine), f.inertia) for f in _methods(machine)}
    trouble = _uncompilable(machine, functions)
    if trouble:
        warnings.warn(
            f"model {machine.name!r}: Numba cannot compile it, so it runs about a thousand times slower; "
            f"use plain arithmetic and math in it: {trouble}",
            ModelWarning,
            stacklevel=2,
        )
        return _module(text.replace(JIT, AS_IT_IS), machine.name, functions)
    # Without a cache of their own: their types are those of one generated module.
    inline = numba.njit(nogil=True, error_model="numpy", forceinline=True)
    return _module(text, machine.name, {name: inline(function) for name, function in functions.items()})


def driver_text(machine: Machine, template: str) -> str:
    """Source of a driver for a machine."""
    env = jinja2.Environment(trim_blocks=True, undefined=jinja2.StrictUndefined, autoescape=False)  # noqa: S701
    source = (HERE / template).read_text(encoding="utf-8")
    rendered = env.from_string(source).render(**_declaration(machine))
    return re.sub(r"\n{4,}", "\n\n\n", rendered)


def fingerprint(function: Callable[..., Any]) -> str:
    """Everything that a function's result depends on: its code, its constants, and all that it calls."""
    seen: set[int] = set()
    return hashlib.sha256("\n".join(_parts(function, seen)).encode()).hexdigest()


def _parts(value: Any, seen: set[int]) -> Iterator[str]:
    value = getattr(value, "py_func", value)
    if not isinstance(value, FunctionType):
        yield value.tobytes().hex() if isinstance(value, np.ndarray) else repr(value)
        return
    if id(value) in seen:
        return
    seen.add(id(value))
    yield from _code(value.__code__)
    yield repr(value.__defaults__)
    for cell in value.__closure__ or ():
        yield from _parts(cell.cell_contents, seen)
    for name in sorted(_names(value.__code__)):
        found = value.__globals__.get(name)
        if found is not None and not isinstance(found, (ModuleType, type)):
            yield name
            yield from _parts(found, seen)


def _code(code: CodeType) -> Iterator[str]:
    yield code.co_code.hex()
    yield repr(code.co_names)
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _code(constant)
        else:
            yield repr(constant)


def _names(code: CodeType) -> set[str]:
    inner = (c for c in code.co_consts if isinstance(c, CodeType))
    return set(code.co_names).union(*(_names(c) for c in inner))


def _module(text: str, name: str, functions: dict[str, Any]) -> ModuleType:
    """Write the module where it does not stand yet, and run it with the machine's functions in it."""
    parts = [text, _stock_sources(), numba.__version__, version("llvmlite"), np.__version__]
    parts += [f"{own} {fingerprint(function)}" for own, function in sorted(functions.items())]
    digest = hashlib.sha256("\n".join(parts).encode()).hexdigest()[:20]
    title = f"fieldgym_driver_{re.sub(r'[^0-9A-Za-z_]', '_', name)}_{digest}"
    if title in sys.modules:
        return sys.modules[title]
    path = _folder() / f"{title}.py"
    if not path.is_file() or path.read_text(encoding="utf-8") != text:
        write_text(path, text)
    spec = importlib.util.spec_from_file_location(title, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    vars(module).update(functions)
    sys.modules[title] = module  # cached kernels look it up
    spec.loader.exec_module(module)
    return module


@cache
def _folder() -> Path:
    """Where generated modules are kept: beside the compiled kernels, or for this process only."""
    try:
        from fieldmodels.compiled import cache_folder
    except ImportError:
        return Path(tempfile.gettempdir()) / "fgdrv"
    return cache_folder() or Path(tempfile.mkdtemp(prefix="fieldgym-"))


@cache
def _stock_sources() -> str:
    """Hash of the sources that every driver inlines."""
    files = sorted((HERE.parent / "effects").glob("*.py"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()


def _has(machine: Machine, name: str) -> bool:
    return getattr(type(machine), name, None) is not None


def _methods(machine: Machine) -> Iterator[Any]:
    """Forces whose inertia is a method of the machine."""
    names = {p.name for p in machine.parameters}
    return (f for f in machine.forces if f.inertia and f.inertia not in names)


def _uncompilable(machine: Machine, functions: dict[str, Any]) -> str:
    """Why Numba cannot compile a machine's functions; empty if it can."""
    from collections import namedtuple

    state, given = (
        namedtuple(title, [s.name for s in signals])(*([0.0] * len(signals))) if signals else None
        for title, signals in (("State", machine.states), ("Input", machine.inputs))
    )
    names = param_names(machine)
    p = namedtuple("Params", names)(*params_of(machine, machine.nominal)) if names else None
    arguments = {
        "derivative": (None, state, given, p),
        "advance": (None, state, given, p, 0.01),
        "observe": (None, state, p),
    }
    for own, function in functions.items():
        with np.errstate(all="ignore"):
            try:
                numba.njit(function)(*arguments.get(own, (None, p)))
            except ZeroDivisionError:
                continue
            except Exception as error:  # Numba raises many kinds, and some are no NumbaError
                line = inspect.getsourcelines(function)[1] if hasattr(function, "__code__") else 0
                first = str(error).strip().splitlines()
                return f"{function.__name__} (line {line}): {first[-1] if first else type(error).__name__}"
    return ""


def param_names(machine: Machine) -> list[str]:
    """Names of ``p``: base parameters, then own effects' as ``effect_parameter``."""
    from fieldmodels.effects.stock import Stock

    own = [e for e in machine.own_effects if not isinstance(e, Stock)]
    return [p.name for p in machine.parameters] + [f"{e.name}_{p.name}" for e in own for p in e.parameters]


def param_indices(machine: Machine) -> list[int]:
    """Where the numbers of ``p`` stand in the parameter vector."""
    from fieldmodels.effects.stock import Stock

    own = [e for e in machine.own_effects if not isinstance(e, Stock)]
    return [machine.index(p.name) for p in machine.parameters] + [
        machine.index(f"{e.name}.{p.name}") for e in own for p in e.parameters
    ]


def params_of(machine: Machine, vector: Any) -> list[float]:
    """The numbers of ``p`` in a parameter vector."""
    return [float(vector[i]) for i in param_indices(machine)]


def curve_places(machine: Machine) -> list[tuple[Curve, int, int]]:
    """Every curve with the beginning and end of its numbers in a row of curves, actuators' first by input."""
    curves = [e for e in machine.stock if isinstance(e, Curve)]
    place, result = 0, []
    for c in curves:
        result.append((c, place, place + c.length))
        place += c.length
    return result


def _declaration(machine: Machine) -> dict[str, Any]:
    """What templates are filled with."""
    states = [s.name for s in machine.states]
    inputs = [s.name for s in machine.inputs]
    outputs = [s.name for s in machine.outputs]
    params = param_names(machine)
    forces = [
        {
            "velocity": states.index(f.velocity),
            "position": states.index(f.position) if f.position else -1,
            "input": inputs.index(f.input) if f.input else (0 if inputs else -1),
            "inertia": _inertia(f.inertia, params),
        }
        for f in machine.forces
    ]
    curves = [_curve(machine, c, start, stop) for c, start, stop in curve_places(machine)]
    spans = [[c for c in curves if c["place"] == "actuator" and c["index"] == i] for i in range(len(inputs))]
    return {
        "name": machine.name,
        "states": states,
        "inputs": inputs,
        "outputs": outputs,
        "params": params,
        "forces": forces,
        "curves": [c for c in curves if c["place"] != "actuator"],
        "actuator_curves": [(own[0]["start"], own[0]["stop"]) if own else (0, 0) for own in spans],
        "curves_of_parameters": any(c["place"] == "parameter" for c in curves),
        "start_states": [_start(machine, i) for i in range(len(states))],
        "stepped": _has(machine, "step"),
        "own_pace": _has(machine, "pace"),
        "own_observe": _has(machine, "observe"),
        "observed_states": [states.index(o) if o in states else -1 for o in outputs],
        "inertia_methods": sorted({f.inertia for f in _methods(machine)}),
    }


def _inertia(name: str, params: list[str]) -> str:
    if not name:
        return "1.0"
    return f"p.{name}" if name in params else f"inertia_{name}(None, p)"


def _start(machine: Machine, i: int) -> dict[str, Any]:
    """How the true state follows from what is measured at a window's start."""
    outputs = [s.name for s in machine.outputs]
    name = machine.states[i].name
    position = next((f.position for f in machine.forces if f.velocity == name and f.position), "")
    return {
        "state": i,
        "own": outputs.index(name) if name in outputs else None,
        "rate": outputs.index(position) if position in outputs else None,
        "rate_state": [s.name for s in machine.states].index(position) if position else None,
    }


def _curve(machine: Machine, c: Curve, start: int, stop: int) -> dict[str, Any]:
    """A curve as the templates take it: where it acts, and the call that gives its value."""
    states = [s.name for s in machine.states]
    inputs = [s.name for s in machine.inputs]
    outputs = [s.name for s in machine.outputs]
    names = {name: f"u{i}" for i, name in enumerate(inputs)} | {n: f"s{i}" for i, n in enumerate(states)}
    names["time"] = "t"
    words = [" * ".join(names[word.strip()] for word in over.split("*")) for over in c.over]
    call = f"K.{'on_curve' if len(words) == 1 else 'on_table'}({', '.join(words)}, crv[{start}:{stop}])"
    velocities = [f.velocity for f in machine.forces]
    places = {"actuator": inputs, "force": velocities, "sensor": outputs, "parameter": param_names(machine)}
    place = next(p for p in ("actuator", "force", "sensor", "parameter") if p == c.where)
    return {
        "place": place,
        "index": places[place].index(c.signal) if c.signal in places[place] else -1,
        "state": states.index(c.signal) if c.signal in states else -1,
        "start": start,
        "stop": stop,
        "values": 2 * len(c.over),
        "call": call,
        "sensed": states.index(c.signal) if place == "sensor" and c.signal in states else None,
        "call_at_start": call.replace("(t,", "(clock,"),
    }
