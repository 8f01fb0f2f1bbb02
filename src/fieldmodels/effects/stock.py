"""What every stock effect is made of: names and units of what it acts on, typical sizes, a row of numbers.

A stock effect is written once and applied to any machine by naming the machine's signals. Its parameters
stand in a *row*, one row for each place of a machine where stock effects act (an input, a force, an
output), in the order of the place's `Layout`. An effect that a machine does not declare keeps its neutral
values there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import allocation_free_inlined as inlined
from fieldmodels.compiled.text import run_text
from fieldmodels.model import Effect, ModelError, Parameter, Where
from fieldmodels.names import did_you_mean

LARGE = 1e12
"""A bound that no bench reaches, in any unit of the library."""
WIDTHS = 0.003, 30.0
"""Narrowest and widest that data can tell from nothing and from everything, in the size of their signal."""
NO_LIMIT = 1e9
"""A saturation or rate limit from this on means none."""


@dataclass(frozen=True)
class Names:
    """Names and units of what a stock effect acts on.

    Attributes:
        force: Name of the generalised force or of the input.
        force_unit: Its unit.
        position: Name of the generalised position or of the output; empty if the machine has none.
        position_unit: Its unit.
        velocity_unit: Unit of the position's rate.
        over_units: Units of a curve's variables; empty for other effects.
    """

    force: str = "force"
    force_unit: str = "N"
    position: str = "position"
    position_unit: str = "m"
    velocity_unit: str = "m/s"
    over_units: tuple[str, ...] = ()


@dataclass(frozen=True)
class Sizes:
    """Typical sizes, from which fits take their steps and starts.

    Attributes:
        force: Root mean square of the force, in its unit.
        high_forces: Sizes that 0.5, 3, 10 and 30 % of the commands exceed.
        rate: Largest rate of the command from one sample to the next, in its unit a second.
        position: Root mean square of the position about its mean.
        velocity: Root mean square of the velocity.
        duration: Length of the longest recording [s].
        step: Sampling interval [s].
        frequencies: Where a periodic force is sought [Hz].
        ranges: From where to where each variable of a curve goes; by default one to either side of 0.
        measured: Whether data gave these sizes: then widths keep to what such data can tell.
    """

    force: float = 1.0
    high_forces: tuple[float, ...] = (2.0, 1.5, 1.0, 0.5)
    rate: float = 100.0
    position: float = 1.0
    velocity: float = 1.0
    duration: float = 30.0
    step: float = 0.01
    frequencies: tuple[float, ...] = (1.0,)
    ranges: tuple[tuple[float, float], ...] = ()
    measured: bool = False


Declare = Callable[[Names, Sizes], Effect]


class Layout:
    """How a place's numbers stand in an array row: in the order of a named tuple, whose defaults are neutral.

    Attributes:
        kind: The named tuple.
        names: Fields of the named tuple, ``effect_parameter``.
        neutral: Values that switch everything off, shape (len(names),).
        unpack: Makes the named tuple from an array row, in compiled code.
    """

    def __init__(self, kind: Any) -> None:
        self.kind = kind
        self.names: tuple[str, ...] = kind._fields
        self.neutral: FloatArray = np.array([kind._field_defaults[name] for name in self.names])
        entries = ", ".join(f"r[{k}]" for k in range(len(self.names)))
        scope: dict[str, Any] = {"kind": kind, "__name__": kind.__module__}
        run_text(
            f"def unpack(r):\n    return kind({entries})\n",
            f"<unpack of {kind.__module__}.{kind.__name__}>",
            scope,
        )
        self.unpack: Callable[[FloatArray], Any] = inlined(scope["unpack"])

    def __len__(self) -> int:
        """Length of the row."""
        return len(self.names)

    def slots(self, kind: str) -> list[int]:
        """Where a stock effect's numbers stand, in the order of its parameters."""
        return [k for k, name in enumerate(self.names) if name.startswith(f"{kind}_")]

    def column(self, name: str) -> int:
        """Where one number stands."""
        return self.names.index(name)


@dataclass(frozen=True)
class Stock:
    """A stock effect at a place of a machine, before its sizes are known.

    Attributes:
        kind: Which one, by its name in the library.
        name: Its name in the machine.
        place: ``actuator``, ``force``, ``sensor``, ``change`` or ``curve``.
        signal: Name of the input, force or output (of ``change``, of the parameter) that it acts on.
        declare: Makes the effect for names and sizes.
    """

    kind: str
    name: str
    place: str
    signal: str
    declare: Declare

    def named(self, declared: Effect) -> Effect:
        """What was declared, with the machine's name for it and for what it may equal."""
        prefix = self.name.removesuffix(self.kind)
        parameters = []
        for p in declared.parameters:
            low, high = (one and prefix + one for one in p.reduces_to)
            parameters.append(replace(p, reduces_to=(low, high)))
        return replace(declared, name=self.name, parameters=tuple(parameters))


def choose(
    library: dict[str, Declare],
    place: str,
    signal: str,
    only: Sequence[str],
    without: Sequence[str],
    prefix: str,
) -> tuple[Stock, ...]:
    """Some stock effects of a place's library.

    Raises:
        ModelError: For a kind that the library does not have.
    """
    only, without = ((one,) if isinstance(one, str) else tuple(one) for one in (only, without))
    for kind in (*only, *without):
        if kind not in library:
            raise ModelError(f"no stock effect {kind!r} for a {place}{did_you_mean(kind, library)}")
    kinds = [kind for kind in (only or library) if kind not in without]
    return tuple(Stock(kind, f"{prefix}{kind}", place, signal, library[kind]) for kind in kinds)


def effect(name: str, where: Where, cause: str, equation: str, *parameters: Parameter) -> Effect:
    """An effect, its parameters last."""
    return Effect(name=name, cause=cause, where=where, parameters=parameters, equation=equation)


def positive(name: str, unit: str, size: float) -> Parameter:
    """A size from 0, sought from a typical one."""
    return Parameter(name, unit, 0.0, 0.0, LARGE, 0.5 * size, starts=(size,))


def signed(name: str, unit: str, size: float) -> Parameter:
    """A number about 0, sought from a typical size."""
    return Parameter(name, unit, 0.0, -LARGE, LARGE, 0.5 * size, starts=(size,))


def span(
    name: str, unit: str, size: float, *shares: float, sizes: Sizes, reduces_to: tuple[str, str] = ("", "")
) -> Parameter:
    """A width that shapes an effect but does not switch it: sought from several shares of a size.

    Args:
        name: Name of the width.
        unit: Its unit.
        size: Typical size of the signal that it is a width of.
        shares: Shares of that size from which it is sought.
        sizes: Whether data gave the size; then it keeps within ``WIDTHS`` of it.
        reduces_to: Stock effects that its owner equals where it is narrow, and where it is wide.
    """
    starts = tuple(float(size * share) for share in shares)
    least, most = (WIDTHS[0] * size, WIDTHS[1] * size) if sizes.measured else (1e-9, LARGE)
    least, most = min(least, 1.0), max(most, 1.0)  # 1 where the effect is off, whatever the size
    return Parameter(name, unit, 1.0, least, most, 0.5 * starts[0], starts=starts, reduces_to=reduces_to)


def late(name: str, s: Sizes, upper: float) -> Parameter:
    """A delay or lag [s], sought from half a sample on.

    Args:
        name: Its name.
        s: Typical sizes: without data it may have any length.
        upper: The longest that is sought [s]; of slower samples the longest in hundredths of a sample.
    """
    starts = tuple(s.step * k for k in (0.5, 3.0, 10.0))
    longest = upper * max(1.0, 100.0 * s.step) if s.measured else LARGE
    return Parameter(name, "s", 0.0, 0.0, longest, s.step, starts=starts)
