"""Compiled drivers of a machine: a module written from its declaration.

The module's name holds a hash of its text and of the machine's own functions with all that they call, so
two machines of one name in one process do not meet; its kernels are kept on disk like any other.
"""

from __future__ import annotations

import hashlib
import re
import sys
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import jinja2

from fieldmodels.compiled import fingerprint, inlined
from fieldmodels.compiled.text import run_text
from fieldmodels.drivers.compilable import compilable, with_helpers
from fieldmodels.drivers.declaration import Declaration, param_names
from fieldmodels.drivers.methods import check_methods, methods_of
from fieldmodels.effects import sensors
from fieldmodels.effects.curves import SIZE, Curve

HERE = Path(__file__).parent
LANES = 16
"""Windows that go side by side: a few vectors of the processor, whose arithmetic overlaps."""
EQUATIONS = "equations.py.j2"
"""What every driver begins with: the machine's equations with the stock effects, and single steps."""
JIT = (
    "from fieldmodels.compiled import allocation_free, compiled\n"
    "from fieldmodels.compiled import allocation_free_inlined as inlined\n"
)
TEXTS: dict[tuple[str, int, str], str] = {}
"""Texts of drivers by template and declaration; a diagnosis puts the same curves on a machine many times."""
AS_IT_IS = "def compiled(f):\n    return f\n\n\nallocation_free = inlined = compiled\n"


def driver_module(machine: Declaration, template: str, lanes: int = LANES) -> ModuleType:
    """The module of a driver, to be compiled when it is first called.

    What Numba cannot compile runs as it is, with a warning.

    Args:
        machine: The machine.
        template: File name of the driver's template.
        lanes: How many windows go side by side.

    Raises:
        ModelError: For a mistake in one of the machine's own methods.
    """
    check_methods(machine)
    methods, text = methods_of(machine), driver_text(machine, template, lanes)
    if compilable(machine):
        return _module(text, machine.name, {m.own: inlined(with_helpers(m.function)) for m in methods})
    plain = ModuleType(f"fieldgym_driver_{machine.name}")
    return _run(plain, text.replace(JIT, AS_IT_IS), {m.own: m.function for m in methods})


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
    sys.modules[title] = module  # kernels that are loaded from the disk look it up
    return _run(module, text, functions)


def _run(module: ModuleType, text: str, functions: dict[str, Any]) -> ModuleType:
    vars(module).update(functions)
    run_text(text, f"<{module.__name__}>", vars(module))
    return module


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
    by_state = {m.name for m in methods_of(machine) if m.own.startswith("inertia_") and "state" in m.takes}
    forces = [
        {
            "velocity": states.index(f.velocity),
            "position": states.index(f.position) if f.position else -1,
            "input": inputs.index(f.input) if f.input else (0 if inputs else -1),
            "inertia": _inertia(f.inertia, params, states, by_state),
            "by_state": bool(by_state & {f.inertia, *f.also.values()}),
            "also": [
                {"velocity": states.index(name), "share": _inertia(share, params, states, by_state)}
                for name, share in f.also.items()
            ],
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
        "coupled": len(forces) > 1 and any(f["also"] for f in forces),  # none moves what another holds
        "curves": [c for c in curves if c["place"] != "actuator"],
        "actuator_curves": [(own[0]["start"], own[0]["stop"]) if own else (0, 0) for own in spans],
        "curves_of_parameters": any(c["place"] == "parameter" for c in curves),
        "start_states": [_start(machine, i) for i in range(len(states))],
        "stepped": type(machine).step is not None,
        "own_pace": type(machine).pace is not None,
        "own_observe": type(machine).observe is not None,
        "clipping": sensors.ROW.column("clipping_limit"),
        "quantisation": sensors.ROW.column("quantisation_step"),
        "sensor_numbers": len(sensors.ROW),
        "observed_states": [states.index(o) if o in states else -1 for o in outputs],
        "inertia_methods": [m.name for m in methods_of(machine) if m.own == f"inertia_{m.name}"],
    }


def _inertia(name: str, params: list[str], states: list[str], by_state: set[str]) -> str:
    """What gives an inertia, or a rate by a unit of force, in equations; ``s0`` and so on are the states."""
    if not name:
        return "1.0"
    if name in params:
        return f"p.{name}"
    state = f"State({', '.join(f's{i}' for i in range(len(states)))},), " if name in by_state else ""
    return f"inertia_{name}(None, {state}p)"


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
