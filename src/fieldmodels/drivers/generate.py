"""Compiled drivers of a machine: a module written from its declaration.

The module's name holds a hash of its text and of the machine's own functions with all that they call, so
two machines of one name in one process do not meet; its kernels are kept on disk like any other.
"""

from __future__ import annotations

import hashlib
import inspect
import re
import sys
import warnings
from collections import namedtuple
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import jinja2
import numba
import numpy as np
from numba.core import types

from fieldmodels.compiled import fingerprint, inlined
from fieldmodels.compiled.text import run_text
from fieldmodels.contract import ModelWarning
from fieldmodels.drivers.declaration import Declaration, named, param_names, params_of
from fieldmodels.drivers.duals import DUAL
from fieldmodels.effects import sensors
from fieldmodels.effects.curves import SIZE, Curve

HERE = Path(__file__).parent
LANES = 16
"""Windows that go side by side: a few vectors of the processor, whose arithmetic overlaps."""
EQUATIONS = "equations.py.j2"
"""What every driver begins with: the machine's equations with the stock effects, and single steps."""
METHODS = {"derivative": "derivative", "step": "advance", "observe": "observe", "pace": "fastest"}
"""A machine's methods, and what drivers call them."""
JIT = (
    "from fieldmodels.compiled import allocation_free, compiled\n"
    "from fieldmodels.compiled import allocation_free_inlined as inlined\n"
    "from fieldmodels.drivers.duals import numbers_1, numbers_2, numbers_3, numbers_4\n"
)
TEXTS: dict[tuple[str, int, str], str] = {}
"""Texts of drivers by template and declaration; a diagnosis puts the same curves on a machine many times."""
AS_IT_IS = (
    "def compiled(f):\n    return f\n\n\nallocation_free = inlined = compiled\n"
    "numbers_1 = numbers_2 = numbers_3 = numbers_4 = compiled\n"
)


def driver_module(machine: Declaration, template: str, lanes: int = LANES) -> ModuleType:
    """The module of a driver, to be compiled when it is first called.

    Args:
        machine: The machine.
        template: File name of the driver's template.
        lanes: How many windows go side by side.
    """
    functions = {own: inlined(function) for own, function in _functions(machine).items()}
    return _module(driver_text(machine, template, lanes), machine.name, functions)


def plain_module(machine: Declaration, template: str) -> ModuleType | None:
    """The same, run as it is, with a warning, if Numba cannot compile the machine; None if it can."""
    functions = _functions(machine)
    trouble = _uncompilable(machine, functions)
    if not trouble:
        return None
    warnings.warn(
        f"model {machine.name!r}: Numba cannot compile it, so it runs about a thousand times slower; "
        f"use plain arithmetic and math in it: {trouble}",
        ModelWarning,
        stacklevel=2,
    )
    return _module(driver_text(machine, template).replace(JIT, AS_IT_IS), machine.name, functions)


def _functions(machine: Declaration) -> dict[str, Any]:
    """A machine's own functions by the names under which drivers call them."""
    functions = {own: getattr(type(machine), name) for name, own in METHODS.items() if _has(machine, name)}
    return functions | {f"inertia_{f.inertia}": getattr(type(machine), f.inertia) for f in _methods(machine)}


def driver_text(machine: Declaration, template: str, lanes: int = LANES) -> str:
    """Source of a driver for a machine."""
    declaration = _declaration(machine)
    key = template, lanes, repr(declaration)
    if key not in TEXTS:
        TEXTS[key] = re.sub(r"\n{4,}", "\n\n\n", _read_template(template).render(lanes=lanes, **declaration))
    return TEXTS[key]


@cache
def _read_template(template: str) -> jinja2.Template:
    """The template of a driver, which takes Jinja a tenth of a second to read."""
    env = jinja2.Environment(trim_blocks=True, undefined=jinja2.StrictUndefined, autoescape=False)
    return env.from_string("".join((HERE / f).read_text(encoding="utf-8") for f in (EQUATIONS, template)))


def _module(text: str, name: str, functions: dict[str, Any]) -> ModuleType:
    """Run the text as a module that has the machine's functions."""
    parts = [text, *(f"{own} {fingerprint(function)}" for own, function in sorted(functions.items()))]
    digest = hashlib.sha256("\n".join(parts).encode()).hexdigest()[:20]
    title = f"fieldgym_driver_{re.sub(r'[^0-9A-Za-z_]', '_', name)}_{digest}"
    if title in sys.modules:
        return sys.modules[title]
    module = ModuleType(title)
    vars(module).update(functions)
    sys.modules[title] = module  # kernels that are loaded from the disk look it up
    run_text(text, f"<driver of {name}, {digest}>", vars(module))
    return module


def _has(machine: Declaration, name: str) -> bool:
    return getattr(type(machine), name, None) is not None


def _methods(machine: Declaration) -> Iterator[Any]:
    """Forces whose inertia is a method of the machine."""
    names = {p.name for p in machine.parameters}
    return (f for f in machine.forces if f.inertia and f.inertia not in names)


def _uncompilable(machine: Declaration, functions: dict[str, Any]) -> str:
    """Why Numba cannot compile a machine's functions; empty if it can."""
    state = named("State", [x.name for x in machine.states], [0.0] * len(machine.states))
    given = named("Input", [x.name for x in type(machine).inputs], [0.0] * len(machine.inputs))
    p = named("Params", param_names(machine), params_of(machine, machine.nominal))
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


def carries_derivatives(machine: Declaration) -> bool:
    """Whether Numba can compile a machine's own functions for dual numbers."""
    p = _duals("Params", param_names(machine))
    state = _duals("State", [x.name for x in machine.states])
    given = _duals("Input", [x.name for x in type(machine).inputs]) if machine.inputs else types.none
    arguments = {
        "derivative": (types.none, state, given, p),
        "advance": (types.none, state, given, p, DUAL),
        "observe": (types.none, state, p),
    }
    for own, function in _functions(machine).items():
        try:
            kernel: Any = inlined(function)
            kernel.compile(arguments.get(own, (types.none, p)))
        except Exception:  # Numba raises many kinds, and some are no NumbaError
            return False
    return True


def _duals(title: str, names: list[str]) -> Any:
    """The type of a named tuple of dual numbers."""
    make: Any = namedtuple
    tuples: Any = types.NamedUniTuple
    return tuples(DUAL, len(names), make(title, names))


def curve_places(machine: Declaration) -> list[tuple[Curve, int, int]]:
    """Every curve with the beginning and end of its numbers in a row of curves, actuators' first by input."""
    curves = [e for e in machine.stock if isinstance(e, Curve)]
    place, result = 0, []
    for c in curves:
        result.append((c, place, place + c.length))
        place += c.length
    return result


def _declaration(machine: Declaration) -> dict[str, Any]:
    """What templates are filled with."""
    states = [s.name for s in machine.states]
    inputs = [s.name for s in type(machine).inputs]  # an instance may read them from other columns
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
        "clipping": sensors.ROW.column("clipping_limit"),
        "quantisation": sensors.ROW.column("quantisation_step"),
        "sensor_numbers": len(sensors.ROW),
        "observed_states": [states.index(o) if o in states else -1 for o in outputs],
        "inertia_methods": sorted({f.inertia for f in _methods(machine)}),
    }


def _inertia(name: str, params: list[str]) -> str:
    if not name:
        return "1.0"
    return f"p.{name}" if name in params else f"inertia_{name}(None, p)"


def _start(machine: Declaration, i: int) -> dict[str, Any]:
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


def _curve(machine: Declaration, c: Curve, start: int, stop: int) -> dict[str, Any]:
    """A curve as the templates take it: where it acts, and the call that gives its value."""
    states = [s.name for s in machine.states]
    inputs = [s.name for s in machine.inputs]
    outputs = [s.name for s in machine.outputs]
    names = {name: f"u{i}" for i, name in enumerate(inputs)} | {n: f"s{i}" for i, n in enumerate(states)}
    names["time"] = "t"
    names |= {f"{SIZE}{name}": f"abs({word})" for name, word in names.items()}
    words = [" * ".join(names[word.strip()] for word in over.split("*")) for over in c.over]
    call = f"curve_{'on_curve' if len(words) == 1 else 'on_table'}({', '.join(words)}, crv[{start}:{stop}])"
    velocities = [f.velocity for f in machine.forces]
    places = {"actuator": inputs, "force": velocities, "sensor": outputs, "parameter": param_names(machine)}
    place = next(p for p in ("actuator", "force", "sensor", "parameter") if p == c.where)
    return {
        "place": place,
        "index": places[place].index(c.signal) if c.signal in places[place] else -1,
        "state": states.index(c.signal) if c.signal in states else -1,
        "start": start,
        "stop": stop,
        "head": 2 * len(c.over),
        "call": call,
        "sensed": states.index(c.signal) if place == "sensor" and c.signal in states else None,
        "call_at_start": call.replace("(t,", "(clock,"),
    }
