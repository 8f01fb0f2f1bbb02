"""What a machine declares: numbers, signals, forces and stock effects, checked, and named for its drivers."""

from __future__ import annotations

import inspect
import math
from collections import namedtuple
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any, ClassVar, Literal, Self

import numpy as np

from fieldmodels.arrays import FloatArray, IntArray
from fieldmodels.effects.curves import SIZE, Curve
from fieldmodels.effects.forces import PLACED
from fieldmodels.effects.stock import Names, Sizes, Stock
from fieldmodels.model import Effect, ForceDirection, Model, ModelError, Parameter
from fieldmodels.names import did_you_mean
from fieldmodels.recording import Recording
from fieldmodels.recording.units import canonical, simplified

Hold = Literal["held", "interpolated"]
"""What an input does between samples."""


class Number:
    """A number of a machine, as it is declared; see ``number``."""

    def __init__(self, **declared: Any) -> None:
        self.declared = declared

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def parameter(self) -> Parameter:
        """The base parameter that it declares."""
        return Parameter(self.name, **self.declared)


def number(
    unit: str,
    nominal: float,
    lower: float | None = None,
    upper: float | None = None,
    *,
    scale: float = 0.0,
    source: str = "assumed",
    starts: tuple[float, ...] = (),
    refitted: bool = True,
) -> Any:
    """Declare a number of a machine: a base parameter under the name of the class attribute.

    Args:
        unit: Its unit.
        nominal: Its value in the nominal simulation.
        lower: Smallest allowed value.
        upper: Largest allowed value.
        scale: A change that matters; by default a tenth of the nominal value, or of the range.
        source: Where the value comes from.
        starts: Values from which a fit tries to start.
        refitted: False for a number that is known: a diagnosis keeps it, and it needs no limits.

    Raises:
        ModelError: If a number that is refitted has no limits.
    """
    if not refitted:
        lower, upper = (-math.inf if lower is None else lower), (math.inf if upper is None else upper)
    if lower is None or upper is None:
        raise ModelError(
            f"number({unit!r}, {nominal:g}) is refitted by a diagnosis and needs its lowest and highest "
            f"value: number({unit!r}, {nominal:g}, lowest, highest); or say refitted=False"
        )
    change = scale or 0.1 * abs(nominal) or 0.1 * min(upper - lower, 1.0)
    return Number(
        unit=unit, nominal=nominal, lower=lower, upper=upper, scale=change, source=source, starts=starts,
        refitted=refitted,
    )  # fmt: skip


@dataclass(frozen=True)
class Force:
    """A generalised force on a velocity of a machine, where stock forces act.

    Attributes:
        velocity: Name of the state whose rate it changes.
        position: Name of the state that is its integral; empty if the machine has none.
        unit: Unit of the force; by default that of the velocity's rate.
        inertia: Name of the base parameter that it is divided by, or of a method ``(self, p)`` or ``(self,
            state, p)``; empty for one.
        name: Name of the force in effects; by default "force" in N, "torque" in N m, else "rate".
        input: Name of the input that loads the friction, if there is one; by default the first.
        also: Other velocities that it accelerates, where masses are coupled (a trolley and what hangs from
            it): each with the name of a number or of such a method, its rate by a unit of force.
    """

    velocity: str
    position: str = ""
    unit: str = ""
    inertia: str = ""
    name: str = ""
    input: str = ""
    also: Mapping[str, str] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        """Name the force by its unit."""
        known = {"N": "force", "N m": "torque"}
        object.__setattr__(self, "name", self.name or known.get(canonical(self.unit), "rate"))


class Declaration(Model):
    """What drivers know of a machine; `fieldmodels.machine.Machine` says how one is declared.

    Attributes:
        forces: The velocities on which stock forces act; those that ``effects`` names need not be said again,
            unless they have a position, a unit or an inertia.
        hold: What an input does between samples: ``held``, or ``interpolated`` along a line.
        hold_said: Whether a user has said so; otherwise a diagnosis tries both.
        stock: The stock effects that were declared.
        sizes: Typical sizes for each of them.
        ahead: Whether an input shows in its own row, as in a map, instead of over the time after it.
        substeps: Least number of integration steps within a sampling interval.
    """

    substeps: int = 1

    forces: tuple[Force, ...] = ()
    hold: Hold = "held"
    hold_said: bool = False
    ahead: bool = False
    stock: tuple[Stock, ...] = ()
    numbers: ClassVar[tuple[Number, ...]] = ()
    own_effects: tuple[Effect | Stock, ...] = ()
    effects: tuple[Any, ...]
    derivative: ClassVar[Callable[..., Any] | None] = None
    step: ClassVar[Callable[..., Any] | None] = None
    observe: ClassVar[Callable[..., Any] | None] = None
    pace: ClassVar[Callable[..., Any] | None] = None
    horizons: tuple[float, ...] = ()

    def __init_subclass__(cls, **kwargs: Any) -> None:
        """Collect the declared numbers and effects.

        Raises:
            ModelError: If the machine says neither or both of ``derivative`` and ``step``.
        """
        super().__init_subclass__(**kwargs)
        found = {n.name: n for n in cls.numbers}
        found |= {value.name: value for value in vars(cls).values() if isinstance(value, Number)}
        cls.numbers = tuple(found.values())
        declared = vars(cls).get("effects")
        if isinstance(declared, tuple):
            cls.own_effects = declared
        if "name" not in vars(cls):
            cls.name = "".join(f"_{c.lower()}" if c.isupper() else c for c in cls.__name__).lstrip("_")

    def __init__(self, sizes: Sequence[Sizes] | None = None) -> None:
        """Declare parameters and effects.

        Args:
            sizes: Typical sizes for each stock effect; by default those of the declared nominal signals.

        Raises:
            ModelError: For a declaration that cannot be; the message says which.
        """
        self.windows_apart = self.pace is not None  # else it is that of some of the windows
        if (self.derivative is None) == (self.step is None):
            raise ModelError(f"{type(self).__name__}: give either derivative or step")
        if self.numbers or not hasattr(self, "parameters"):
            self.parameters = tuple(n.parameter() for n in self.numbers)
        self.stock = tuple(e for e in self.own_effects if isinstance(e, Stock))
        self.forces = self._forces()
        self._check()
        self.sizes = tuple(sizes or [Sizes()] * len(self.stock))
        by_stock = iter(self.sizes)
        self.effects = tuple(
            e.named(e.declare(self.names_of(e), next(by_stock))) if isinstance(e, Stock) else e
            for e in self.own_effects
        )
        pairs = zip(self.effects, self.own_effects, strict=True)
        self.stock_names = tuple(effect.name for effect, own in pairs if isinstance(own, Stock))
        if self.forces and not self.disturbance_unit:
            self.disturbance_unit = self._force_unit(self.forces[0])
        if len(self.forces) > 1:
            self.directions = tuple(
                ForceDirection(
                    f"{'force on' if f.unit or f.inertia else 'rate of'} {f.velocity}",
                    self._force_unit(f),
                    tuple(column),
                )
                for f, column in zip(self.forces, np.eye(len(self.forces)).tolist(), strict=True)
            )
        if not self.horizons:
            self.horizons = (0.1, 0.2, 0.4)
        self.rates = self._rates()

    def __getstate__(self) -> dict[str, Any]:
        """What is pickled: the declarations, not what was compiled of them."""
        return {key: value for key, value in vars(self).items() if key != "driver"}

    def with_effects(self, extra: Sequence[Stock]) -> Self:
        """The same machine with further stock effects."""
        own = {"effects": (*type(self).own_effects, *extra), "name": self.name}
        kind = type(type(self).__name__, (type(self),), own)
        result: Self = kind()
        result.hold = self.hold
        return result

    def _forces(self) -> tuple[Force, ...]:
        """The declared forces, one for each velocity that a stock force names, and for each other state.

        Something may act on the rate of any state, declared or not, but where it is a declared velocity.
        """
        pushing = [e for e in self.stock if (e.where if isinstance(e, Curve) else e.place) == "force"]
        named = dict.fromkeys([*(e.signal for e in pushing), *(s.name for s in self.states)])
        known = {name for f in self.forces for name in (f.velocity, f.position)}
        return (*self.forces, *(Force(name) for name in named if name not in known))

    def _rates(self) -> dict[str, str]:
        """States that are rates of outputs by the machine's equation, seen at two points of its own."""
        names = [s.name for s in self.states]
        shown = [s.name for s in self.outputs if s.name in names]
        points = np.random.default_rng(0).uniform(0.1, 0.9, (2, len(names))).tolist()
        slopes = [slopes_at(self, point) for point in points]
        if not all(slopes):
            return {}
        return {
            rate: output
            for output in shown
            for k, rate in enumerate(names)
            if rate not in {s.name for s in self.outputs}
            and all(s[names.index(output)] == point[k] for s, point in zip(slopes, points, strict=True))
        }

    def _check(self) -> None:
        """Whether all that is named exists.

        Raises:
            ModelError: If not.
        """
        states = [s.name for s in self.states]
        known = {
            "actuator": [s.name for s in self.inputs],
            "force": states,
            "sensor": [s.name for s in self.outputs],
            "change": [p.name for p in self.parameters],
        }
        for e in self.stock:
            choices = known.get(e.place, [name for names in known.values() for name in names])
            if e.signal not in choices:
                where = f"{self.name}: stock effect {e.name!r}"
                raise ModelError(
                    f"{where}: no {e.place} signal {e.signal!r}{did_you_mean(e.signal, choices)}"
                )
            if e.place == "force" and e.kind in PLACED and not self._force(e.signal).position:
                raise ModelError(
                    f"{self.name}: {e.kind!r} needs a position; declare forces = (Force({e.signal!r}, "
                    "position=...),), or leave it out: without=..."
                )
        for f in self.forces:
            for name in (f.velocity, *([f.position] if f.position else [])):
                if name not in states:
                    raise ModelError(f"{self.name}: no state {name!r}{did_you_mean(name, states)}")
            given = [s.name for s in type(self).inputs]  # an instance may read them from other columns
            if f.input and f.input not in given:
                raise ModelError(f"{self.name}: no input {f.input!r}{did_you_mean(f.input, given)}")
            for name in f.also:
                if name not in states or name == f.velocity:
                    others = [s for s in states if s != f.velocity]
                    raise ModelError(f"{self.name}: no other state {name!r}{did_you_mean(name, others)}")
            for name, what in (
                (f.inertia, "inertia"),
                *((share, "effect of a force") for share in f.also.values()),
            ):
                if name not in ("", *known["change"]) and not callable(getattr(self, name, None)):
                    raise ModelError(
                        f"{self.name}: no number or method {name!r} for an {what}"
                        f"{did_you_mean(name, known['change'])}"
                    )
        names = [e.name for e in self.own_effects]
        doubled = sorted({name for name in names if names.count(name) > 1})
        if doubled:
            raise ModelError(
                f"{self.name}: effect {doubled[0]!r} is declared twice; give one a prefix=, a curve a name="
            )

    def _force(self, velocity: str) -> Force:
        return next(f for f in self.forces if f.velocity == velocity)

    def _force_unit(self, f: Force) -> str:
        unit = next(s.unit for s in self.states if s.name == f.velocity)
        return f.unit or (f"{unit}^2" if unit.endswith("/s") else f"{unit}/s")

    def names_of(self, e: Stock) -> Names:
        """Names and units of what a stock effect acts on, and of a curve's variables."""
        names = self._acted_on(e)
        if not isinstance(e, Curve):
            return names
        units = {s.name: s.unit for s in (*self.inputs, *self.states, *self.outputs)} | {"time": "s"}
        factors = [[f.strip().removeprefix(SIZE) for f in over.split("*")] for over in e.over]
        return replace(
            names, over_units=tuple(simplified(" ".join(units.get(f, f) for f in found)) for found in factors)
        )

    def _acted_on(self, e: Stock) -> Names:
        units = {s.name: s.unit for s in (*self.inputs, *self.states, *self.outputs)}
        if e.place == "actuator" or (isinstance(e, Curve) and e.signal in {s.name for s in self.inputs}):
            return Names(force=e.signal, force_unit=units[e.signal])
        if e.place == "change" or e.signal not in units:
            unit = next(p.unit for p in self.parameters if p.name == e.signal)
            return Names(force=e.signal, force_unit=unit)
        if e.place == "force" or (isinstance(e, Curve) and any(f.velocity == e.signal for f in self.forces)):
            f = self._force(e.signal)
            unit = units[f.position] if f.position else "1"
            return Names(f.name, self._force_unit(f), f.position, unit, units[f.velocity])
        force = self.forces[0].name if self.forces else "force"
        unit = units[e.signal]
        return Names(force, unit, e.signal, unit, f"{unit}/s")

    def inertia_of(self, f: Force, state: Sequence[float] = ()) -> float:
        """What a force is divided by, at the nominal parameters and some state, by default all zeros."""
        if not f.inertia:
            return 1.0
        p = named("Params", param_names(self), params_of(self, self.nominal))
        if hasattr(p, f.inertia):
            return float(getattr(p, f.inertia))
        method = getattr(type(self), f.inertia)
        names = [s.name for s in self.states]
        at = [named("State", names, list(state) or [0.0] * len(names))] if takes_state(method) else []
        return float(method(None, *at, p))

    def speeds(self) -> list[float]:
        """A typical speed of each velocity on which forces act."""
        by_velocity = {
            e.signal: s.velocity for e, s in zip(self.stock, self.sizes, strict=True) if e.place == "force"
        }
        return [by_velocity.get(f.velocity, 1.0) for f in self.forces]

    def typical(self, output: str) -> tuple[float, float]:
        """A large command, and the typical size of an output.

        Args:
            output: Name of the output.
        """
        pairs = list(zip(self.stock, self.sizes, strict=True))
        commands = [s.high_forces[0] for e, s in pairs if e.place == "actuator"]
        sizes = [s.position for e, s in pairs if e.place == "sensor" and e.signal == output]
        return max(commands, default=1.0), max(sizes, default=1.0)

    def commands(self, recording: Recording, last: IntArray) -> FloatArray:
        """What drives the machine on every sample of a recording, shape (n, inputs).

        Args:
            recording: The measured data.
            last: Last sample of each sample's episode, shape (n,).
        """
        columns = [recording[s.name] for s in self.inputs] or [np.zeros(len(recording))]
        given = np.column_stack(columns).astype(np.float64)
        return given[np.minimum(np.arange(len(given)) + 1, last)] if self.ahead else given

    def held_as(self, hold: Hold) -> Self:
        """The same machine with inputs that are held or interpolated between samples."""
        result = copy(self)
        result.hold = hold
        result.__dict__.pop("driver", None)  # it runs the machine that it was made for
        return result

    def between(self, commands: FloatArray, refine: int) -> FloatArray:
        """Commands on a finer grid, held or interpolated as the machine's inputs are."""
        if self.hold == "held":
            return super().between(commands, refine)
        n = len(commands)
        at = np.minimum(np.arange(n * refine) / refine, n - 1)
        return np.column_stack([np.interp(at, np.arange(n), column) for column in commands.T])


def slopes_at(machine: Declaration, point: Sequence[float], command: float = 0.5) -> list[float]:
    """Rates of all states at one point, for one value of every command; none of a machine of steps."""
    own: Any = type(machine).derivative
    if own is None:
        return []
    given = [s.name for s in type(machine).inputs]
    effects = [e for e in machine.own_effects if not isinstance(e, Stock)]
    numbers = [p.nominal for p in (*machine.parameters, *(p for e in effects for p in e.parameters))]
    p = named("Params", param_names(machine), numbers)
    given_now = named("Input", given, [command] * len(given))
    state = named("State", [s.name for s in machine.states], list(point))
    try:
        return [float(rate) for rate in np.atleast_1d(own(None, state, given_now, p))]
    except Exception:  # a root of less than nothing, or what only a compiler understands
        return []


def takes_state(method: Callable[..., Any]) -> bool:
    """Whether an inertia, or a rate by a unit of force, takes ``(self, state, p)``, not ``(self, p)``."""
    return len(inspect.signature(method).parameters) == 3


def named(title: str, names: list[str], values: list[float]) -> Any:
    """A named tuple; None for one without fields, which Numba does not know."""
    return _kind(title, tuple(names))(*values) if names else None


@cache
def _kind(title: str, names: tuple[str, ...]) -> Any:
    """The type of such tuples, which takes longer to make than equations to evaluate."""
    make: Any = namedtuple
    return make(title, names)


def param_names(machine: Declaration) -> list[str]:
    """Names of ``p``: base parameters, then own effects' as ``effect_parameter``."""
    own = [e for e in machine.own_effects if not isinstance(e, Stock)]
    return [p.name for p in machine.parameters] + [f"{e.name}_{p.name}" for e in own for p in e.parameters]


def param_indices(machine: Declaration) -> list[int]:
    """Where the numbers of ``p`` stand in the parameter vector."""
    own = [e for e in machine.own_effects if not isinstance(e, Stock)]
    return [machine.index(p.name) for p in machine.parameters] + [
        machine.index(f"{e.name}.{p.name}") for e in own for p in e.parameters
    ]


def params_of(machine: Declaration, vector: Any) -> list[float]:
    """The numbers of ``p`` in a parameter vector."""
    return [float(vector[i]) for i in param_indices(machine)]
