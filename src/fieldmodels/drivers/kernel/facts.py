"""What the kernels of a machine are composed from: its functions, and where its numbers stand."""

from __future__ import annotations

import hashlib
from collections import namedtuple
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

from fieldmodels.compiled import allocation_free, allocation_free_inlined, fingerprint
from fieldmodels.drivers.compilable import compilable, with_helpers
from fieldmodels.drivers.declaration import Declaration, Force, param_names
from fieldmodels.drivers.methods import TITLES, check_methods, methods_of
from fieldmodels.effects.curves import SIZE, Curve

NONE = -1
"""In the place of a number of a state, an input or an output that there is not."""
Factor = tuple[Literal["time", "state", "input"], int, bool]
"""Of a curve's variable: what it reads, the number of that, and whether only its size counts."""


@dataclass(frozen=True)
class CurveAt:
    """A curve and where it acts.

    Attributes:
        place: ``force``, ``sensor`` or ``parameter``.
        index: Number of the force, output or parameter; ``NONE`` for a state on which no force acts.
        state: Number of the state that has the signal's name, or ``NONE``.
        start: Its first number in a row of curves.
        stop: Behind its last one.
        head: How many of them come before its values.
        over: Its variables, one or two, as factors.
    """

    place: str
    index: int
    state: int
    start: int
    stop: int
    head: int
    over: tuple[tuple[Factor, ...], ...]


@dataclass(frozen=True)
class Facts:
    """A machine as its kernels know it.

    Attributes:
        name: Its name.
        states: Names of its states.
        inputs: Of its inputs. Kernels of a machine without any have one that is always 0.
        outputs: Of its outputs.
        parameters: Of its base parameters and own effects' numbers.
        position: Number of the state that is each force's position, or ``NONE``.
        velocity: Number of the state that is each force's velocity.
        load: Number of the input that loads each force's friction, or ``NONE``.
        inertia: What each force is divided by: the number of a parameter, a method's name, or ``NONE`` for 1.
        couplings: What else a force accelerates: its number, that of the state, and the rate by a unit of
            force, as an inertia.
        by_state: The methods among these that take the state, too.
        shown: Number of the state that each output is, where the machine does not observe itself.
        own: Number of the output that shows each state, or ``NONE``.
        rate: Number of the output whose rate each state is, or ``NONE``.
        rate_state: Number of the state whose rate each state is, or ``NONE``.
        curves: Curves but those of commands.
        commanded: First number of each input's curve in a row of curves, and behind its last; equal if none.
        lanes: How many windows go side by side.
        functions: The machine's own functions by what kernels call them.
        compiles: Whether Numba compiles them; else all runs as plain Python.
    """

    name: str
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    parameters: tuple[str, ...]
    position: tuple[int, ...]
    velocity: tuple[int, ...]
    load: tuple[int, ...]
    inertia: tuple[int | str, ...]
    couplings: tuple[tuple[int, int, int | str], ...]
    by_state: frozenset[str]
    shown: tuple[int, ...]
    own: tuple[int, ...]
    rate: tuple[int, ...]
    rate_state: tuple[int, ...]
    curves: tuple[CurveAt, ...]
    commanded: tuple[tuple[int, int], ...]
    lanes: int
    functions: dict[str, Any] = field(compare=False, repr=False)
    compiles: bool = True

    @property
    def inlined(self) -> Callable[..., Any]:
        """Compiles a part that is taken into what calls it."""
        return allocation_free_inlined if self.compiles else _as_it_is

    @property
    def block(self) -> Callable[..., Any]:
        """Compiles a part that is called."""
        return allocation_free if self.compiles else _as_it_is

    def kernel(self, function: Any) -> Any:
        """Compile what Python calls, under a name of this machine's, by which it is kept on disk."""
        function.__qualname__ = f"{function.__name__}_{self.title}"
        return self.block(function)

    @cached_property
    def title(self) -> str:
        """A name that no other machine has: it tells all that its kernels depend on."""
        functions = [f"{own} {fingerprint(function)}" for own, function in sorted(self.functions.items())]
        digest = hashlib.sha256("\n".join([repr(self), *functions]).encode()).hexdigest()[:20]
        return f"{self.name}_{digest}"

    @property
    def stepped(self) -> bool:
        """Whether the machine says its states a time later, not their rates."""
        return "advance" in self.functions

    @property
    def coupled(self) -> bool:
        """Whether what holds one velocity may move another on which a force acts."""
        return len(self.velocity) > 1 and bool(self.couplings)

    def named(self, role: str) -> Any:
        """The named tuple of states, inputs or parameters that the machine's functions are handed."""
        names = {"state": self.states, "input": self.inputs, "p": self.parameters}[role]
        return namedtuple(TITLES[role], names)

    def at(self, *places: str) -> list[CurveAt]:
        """The curves at some places."""
        return [c for c in self.curves if c.place in places]


def _as_it_is(function: Any) -> Any:
    return function


def facts_of(machine: Declaration, lanes: int) -> Facts:
    """What kernels know of a machine.

    Args:
        machine: The machine.
        lanes: How many windows go side by side.

    Raises:
        ModelError: For a mistake in one of the machine's own methods.
    """
    check_methods(machine)
    compiles = compilable(machine)
    methods = methods_of(machine)
    states, outputs = (tuple(s.name for s in part) for part in (machine.states, machine.outputs))
    inputs = tuple(s.name for s in type(machine).inputs)  # an instance may read them from other columns
    parameters = tuple(param_names(machine))

    def factor(name: str) -> int | str:
        return parameters.index(name) if name in parameters else name or NONE

    positions = {f.velocity: f.position for f in machine.forces if f.position}
    rates = [positions.get(name, "") for name in states]
    curves = curve_places(machine)
    return Facts(
        name=machine.name,
        states=states,
        inputs=inputs,
        outputs=outputs,
        parameters=parameters,
        position=tuple(_place(f.position, states) for f in machine.forces),
        velocity=tuple(states.index(f.velocity) for f in machine.forces),
        load=tuple(_load(f, inputs) for f in machine.forces),
        inertia=tuple(factor(f.inertia) for f in machine.forces),
        couplings=tuple(
            (k, states.index(other), factor(share))
            for k, f in enumerate(machine.forces)
            for other, share in f.also.items()
        ),
        by_state=frozenset(m.name for m in methods if m.own.startswith("inertia_") and "state" in m.takes),
        shown=tuple(_place(name, states) for name in outputs),
        own=tuple(_place(name, outputs) for name in states),
        rate=tuple(_place(name, outputs) for name in rates),
        rate_state=tuple(_place(name, states) for name in rates),
        curves=tuple(_curve(machine, c, a, b) for c, a, b in curves if c.where != "actuator"),
        commanded=tuple(
            next(((a, b) for c, a, b in curves if c.where == "actuator" and c.signal == s.name), (0, 0))
            for s in machine.inputs
        )
        or ((0, 0),),
        lanes=lanes,
        functions={
            m.own: allocation_free_inlined(with_helpers(m.function)) if compiles else m.function
            for m in methods
        },
        compiles=compiles,
    )


def curve_places(machine: Declaration) -> list[tuple[Curve, int, int]]:
    """Every curve with the beginning and end of its numbers in a row of curves."""
    place, result = 0, []
    for c in (e for e in machine.stock if isinstance(e, Curve)):
        result.append((c, place, place + c.length))
        place += c.length
    return result


def _place(name: str, names: tuple[str, ...]) -> int:
    return names.index(name) if name in names else NONE


def _load(f: Force, inputs: tuple[str, ...]) -> int:
    return inputs.index(f.input) if f.input else (0 if inputs else NONE)


def _curve(machine: Declaration, c: Curve, start: int, stop: int) -> CurveAt:
    states, inputs, outputs = (
        tuple(s.name for s in part) for part in (machine.states, machine.inputs, machine.outputs)
    )

    def factor(word: str) -> Factor:
        name = word.strip()
        plain = name if name in (*states, *inputs, "time") else name.removeprefix(SIZE)
        if plain == "time":
            return "time", 0, plain != name
        of_state = plain in states
        return (
            ("state" if of_state else "input"),
            (states if of_state else inputs).index(plain),
            plain != name,
        )

    acted_on = {
        "force": tuple(f.velocity for f in machine.forces),
        "sensor": outputs,
        "parameter": tuple(param_names(machine)),
    }
    over = tuple(tuple(factor(word) for word in variable.split("*")) for variable in c.over)
    index, state = _place(c.signal, acted_on[c.where]), _place(c.signal, states)
    return CurveAt(c.where, index, state, start, stop, 2 * len(c.over), over)
