"""Curves: a piecewise-linear function that a machine's model lacks, neutral where all its values are zero.

A curve of one signal has ``knots`` values, equally spaced from ``low`` to ``high``, and goes on at its last
value beyond, or begins anew after each ``period``. A table of two signals is the same over a grid, bilinear
in between. It acts on an actuator's command, a force, a sensor, or a base parameter.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import allocation_free_inlined as inlined
from fieldmodels.effects.stock import LARGE, Declare, Names, Sizes, Stock
from fieldmodels.model import Effect, ModelError, Parameter, Where

KNOTS = 8
GRID = 4
SIZE = "size_of_"
"""Before a factor of a variable that counts by its size: ``velocity*size_of_position``."""
WHERE: dict[str, Where] = {
    "actuator": "actuator",
    "force": "force",
    "sensor": "sensor",
    "parameter": "change",
}


@dataclass(frozen=True)
class Curve(Stock):
    """A curve of signals at a place of a machine, before sizes are known.

    Attributes:
        where: ``actuator``, ``force``, ``sensor`` or ``parameter``.
        over: What it is a function of: names of states, inputs or ``time``; a product of two is written
            ``speed*command``. One for a curve, two for a table.
        knots: Values along each of them.
    """

    where: str = ""
    over: tuple[str, ...] = ()
    knots: int = KNOTS

    @property
    def length(self) -> int:
        """Numbers in its row: low and high of each variable, the period of a single one, then the values."""
        return (3 if len(self.over) == 1 else 4) + int(self.knots ** len(self.over))


def curve(
    place: str, signal: str, over: str | tuple[str, str] | None = None, knots: int = 0, name: str = ""
) -> tuple[Curve, ...]:
    """A curve (or, of two signals, a table) as an effect.

    Args:
        place: ``actuator``, ``force``, ``sensor`` or ``parameter``.
        signal: The input, velocity, output or base parameter to which it adds.
        over: What it is a function of; by default the signal itself. A command has passed its gain and bias
            there, a sensor's value is the true one.
        knots: Values along each variable; by default 8 for a curve and 4 for a table.
        name: Of the effect; by default ``<signal>_curve``, or ``<signal>_over_<variables>``.

    Raises:
        ModelError: For an unknown place, too few knots, or an actuator's curve of anything but its command.
    """
    if place not in WHERE:
        raise ModelError(f"a curve's place is {', '.join(WHERE)}, not {place!r}")
    variables = (over or signal,) if not isinstance(over, tuple) else over
    if len(variables) > 2:
        raise ModelError("a curve is a function of one signal, or of two")
    if place == "parameter" and over is None:
        raise ModelError(f"say what parameter {signal!r} is a curve of: over='time', or a signal")
    if place == "actuator" and variables != (signal,):
        raise ModelError(
            f"an actuator's curve is one of its command {signal!r}; a force may depend on others"
        )
    count = knots or (KNOTS if len(variables) == 1 else GRID)
    if count < 2:
        raise ModelError(f"a curve needs at least two knots, not {count}")
    own = variables == (signal,)
    title = name or (
        f"{signal}_curve" if own else f"{signal}_over_{'_and_'.join(variables)}".replace("*", "_")
    )
    return (
        Curve(
            "curve",
            title,
            "curve",
            signal,
            _declare(place, signal, variables, count),
            place,
            variables,
            count,
        ),
    )


def _declare(place: str, signal: str, over: tuple[str, ...], knots: int) -> Declare:
    def declare(names: Names, s: Sizes) -> Effect:
        ranges = []
        for k, variable in enumerate(over):
            tag = "" if len(over) == 1 else f"_{k + 1}"
            low, high = s.ranges[k] if s.ranges else (-1.0, 1.0)
            share = 0.1 * (high - low)
            unit = names.over_units[k] if names.over_units else variable
            ranges += [
                Parameter(f"low{tag}", unit, low, -LARGE, LARGE, share, refitted=False),
                Parameter(f"high{tag}", unit, high, -LARGE, LARGE, share, refitted=False),
            ]
            if len(over) == 1:
                ranges.append(Parameter("period", unit, 0.0, 0.0, LARGE, share, refitted=False))
        size = 0.1 * s.force
        values = [
            Parameter(
                f"value_{i + 1}", names.force_unit, 0.0, -LARGE, LARGE, 0.5 * size, starts=(size,), knot=True
            )
            for i in range(knots ** len(over))
        ]
        variables = " and ".join(over)
        return Effect(
            name="curve",
            cause=f"Something that the simulation lacks adds to the {signal}: a curve of {variables}.",
            where=WHERE[place],
            parameters=(*ranges, *values),
            equation=f"{signal} + curve({', '.join(over)})",
        )

    return declare


@inlined
def on_curve(x: float, row: FloatArray) -> float:
    """A curve's value: linear between its knots, constant beyond; or anew after each period."""
    low, high, period, last = row[0], row[1], row[2], len(row) - 4
    if period > 0.0:
        x -= period * math.floor((x - low) / period)
    at = min(max((x - low) / (high - low) * last, 0.0), float(last))
    k = min(math.floor(at), last - 1)
    return float(row[3 + k] + (at - k) * (row[4 + k] - row[3 + k]))


@inlined
def on_table(x: float, y: float, row: FloatArray) -> float:
    """A table's value: bilinear between its knots, constant beyond."""
    count = int(math.sqrt(len(row) - 4.0) + 0.5)
    last = count - 1
    at = min(max((x - row[0]) / (row[1] - row[0]) * last, 0.0), float(last))
    across = min(max((y - row[2]) / (row[3] - row[2]) * last, 0.0), float(last))
    i, j = min(math.floor(at), last - 1), min(math.floor(across), last - 1)
    a, b = at - i, across - j
    near = row[4 + i * count + j] + b * (row[5 + i * count + j] - row[4 + i * count + j])
    far = row[4 + (i + 1) * count + j]
    far += b * (row[5 + (i + 1) * count + j] - far)
    return float(near + a * (far - near))
