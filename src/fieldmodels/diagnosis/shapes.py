"""The curves themselves: lookup tables, products, known functions and waves of a variable."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.phrases import CONSTANT
from fieldmodels.drivers.variables import CHANGE, MEMORY, PLAY, direction_of

Place = Literal["force", "sensor", "parameter", "odds"]
Signals = Mapping[str, tuple[str, FloatArray]]
QUANTILES = tuple(np.linspace(0.01, 0.99, 8))  # of the variable, where a curve's knots are
ENDS = (0.0, 0.05, 0.95, 1.0)  # the same of a curve that only bends where the variable is extreme
OF_PARAMETER = (0.01, 0.25, 0.5, 0.75, 0.99)  # the same for a parameter, which is one for a window
FINE = 129  # points of a known function
BEYOND = 1.5  # times the largest value, or the range, that was seen, up to which curves go on
MULTIPLIED = 7  # signals whose products are tried
LINES = (CHANGE, MEMORY, PLAY)  # variables to which a force is proportional, if it depends on them at all
NO_FACTORS = ("time", CHANGE, "rate of ")


def _step(x: FloatArray) -> FloatArray:
    """The sign; over a small range, since nothing reverses at once."""
    return np.asarray(np.tanh(x / 0.02))


def _power(exponent: float) -> Callable[[FloatArray], FloatArray]:
    """A power of the size, with the sign."""
    return lambda x: np.asarray(np.sign(x) * np.abs(x) ** exponent)


FUNCTIONS: Mapping[str, tuple[Callable[[FloatArray], FloatArray], ...]] = {
    CONSTANT: (np.ones_like,),
    "in proportion": (np.array,),
    "sign": (_step,),
    "sign and constant": (_step, np.ones_like),
    "size": (np.abs,),
    "on the positive side": (lambda x: np.maximum(x, 0.0),),
    "on the negative side": (lambda x: np.minimum(x, 0.0),),
    "square": (np.square,),
    "root with sign": (_power(0.5),),
    "power 1.5 with sign": (_power(1.5),),
    "square with sign": (_power(2.0),),
    "cube": (_power(3.0),),
    "fifth power": (_power(5.0),),
}
"""Functions that are common in machines, of a variable over its largest size."""
OF_ANGLES: Mapping[str, tuple[Callable[[FloatArray], FloatArray], ...]] = {"once a turn": (np.sin, np.cos)}
"""The same of an angle [rad]."""


@dataclass(frozen=True)
class Curve:
    """A curve that may be missing.

    Attributes:
        place: What it adds to.
        target: The output, base parameter or direction of motion that it adds to; empty for the only force.
            Of a "share of" a direction the values are parts of how fast the machine moves that way.
        over: The variable.
        over_unit: Its unit.
        unit: Of the curve's values.
        values: Columns on the segments of every window, shape (windows, segments, columns); of a parameter's
            curve on the windows, shape (windows, columns).
        knots: Values of the variable at which the curve is given, shape (points,).
        shapes: Each column's value there, shape (points, columns).
        formula: What it is called if it is no table but a known function of the variable.
        tried: Of how many of its kind it is the best.
        period: Of a wave, in units of the variable; 0 for any other.
    """

    place: Place
    target: str
    over: str
    over_unit: str
    unit: str
    values: FloatArray
    knots: FloatArray
    shapes: FloatArray
    formula: str = ""
    tried: int = 1
    period: float = 0.0

    @property
    def direction(self) -> str:
        """What it depends on and where it acts, in a few words."""
        return direction_of(self.place, self.target, self.over)


def tables(signals: Signals) -> Iterator[Curve]:
    """Lookup tables of every signal."""
    for name, (unit, values) in signals.items():
        if name.startswith(LINES) or " times " in name:
            yield _line(name, unit, values)
            continue
        knots = np.unique(np.quantile(values, QUANTILES))
        if len(knots) >= 4:
            yield Curve("force", "", name, unit, "", _hats(values, knots), knots, np.eye(len(knots)))
            ends = np.quantile(values, ENDS)
            low, high = (ends[0], ends[-1]) if name == "time" else _wider(values)
            knots = np.unique([low, *ends, high])  # a command is at its largest for long
            yield Curve(
                "force", "", name, unit, "", _beyond(values, ends), knots, _beyond(knots, ends), "ends"
            )


def products(signals: Signals) -> Iterator[Curve]:
    """Products of pairs of signals; of a machine with many sensors only of its first ones."""
    moving = [n for n in signals if not n.startswith(NO_FACTORS)]
    for first, second in itertools.combinations(moving[:MULTIPLIED], 2):
        a, b = signals[first][1], signals[second][1]
        unit = f"{signals[first][0]} {signals[second][0]}"
        yield _line(f"{first} times {second}", unit, a * b)
        yield _line(f"{first} times size of {second}", unit, a * np.abs(b))
        yield _line(f"{second} times size of {first}", unit, np.abs(a) * b)


def fading(name: str, signals: Signals) -> Curve:
    """A signal times the time: a gain that grows or fades."""
    unit, values = signals[name]
    return _line(f"{name} times time", f"{unit} s", values * signals["time"][1])


def window_tables(signals: Signals) -> Iterator[Curve]:
    """Tables and lines of the mean and of the size of every signal in a window."""
    for name, (unit, values) in signals.items():
        if name.startswith(CHANGE):
            continue
        sizes = {name: values.mean(axis=1)}
        if name != "time":
            sizes[f"size of {name}"] = np.sqrt(np.mean(values**2, axis=1))
        for over, size in sizes.items():
            knots = np.unique(np.quantile(size, OF_PARAMETER))
            if len(knots) >= 4:
                middle = float(size.mean())
                line = (knots - middle)[:, None]
                yield Curve("parameter", "", over, unit, "", (size - middle)[:, None], knots, line)
                yield Curve("parameter", "", over, unit, "", _hats(size, knots), knots, np.eye(len(knots)))


def _line(over: str, unit: str, values: FloatArray) -> Curve:
    """A force proportional to one quantity."""
    largest = BEYOND * float(np.abs(values).max())
    knots = np.linspace(-largest, largest, 9)
    return Curve("force", "", over, unit, "", values[:, :, None], knots, knots[:, None])


def known_functions(curve: Curve, values: FloatArray) -> Iterator[Curve]:
    """Functions that are common in machines, over the variable of a table.

    Args:
        curve: The table.
        values: Of its variable, shape (windows, segments).
    """
    if curve.shapes.shape[1] == 1 or curve.place == "parameter" or curve.over == "time" or curve.formula:
        return
    size = float(np.abs(values).max())
    knots = np.linspace(*_wider(values), FINE)
    scaled = {name: (size, 0.0, terms) for name, terms in FUNCTIONS.items()}
    if curve.over_unit == "rad":
        scaled |= {name: (1.0, 2.0 * np.pi, terms) for name, terms in OF_ANGLES.items()}
    for name, (unit, period, terms) in scaled.items():
        yield replace(
            curve,
            knots=knots,
            values=np.stack([f(values / unit) for f in terms], axis=-1),
            shapes=np.stack([f(knots / unit) for f in terms], axis=-1),
            formula=name,
            period=period,
        )


def is_table(curve: Curve) -> bool:
    """Whether it is a table that may go on along a line beyond its knots.

    One over time may not, and no parameter's: a mass must not fall below zero.
    """
    several = curve.shapes.shape[1] > 1 and not curve.formula
    return several and curve.place != "parameter" and curve.over != "time"


def along_a_line(knots: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Knots with one more at either end, and values there, which go on as between the outer two.

    Args:
        knots: The knots.
        values: Columns at the knots, shape (points, columns).
    """
    low, high = _wider(knots)
    first = (low - knots[0]) / (knots[1] - knots[0]) * (values[1] - values[0])
    last = (high - knots[-1]) / (knots[-1] - knots[-2]) * (values[-1] - values[-2])
    return np.array([low, *knots, high]), np.vstack([values[0] + first, values, values[-1] + last])


def _wider(values: FloatArray) -> tuple[float, float]:
    """From where to where curves of a variable go on, by what was seen of it."""
    further = 0.5 * (BEYOND - 1.0) * float(np.ptp(values))
    return float(values.min()) - further, float(values.max()) + further


def wave(x: FloatArray, count: float) -> FloatArray:
    """Sine and cosine of so many cycles from zero to one, shape (..., 2)."""
    return np.stack([np.sin(2 * np.pi * count * x), np.cos(2 * np.pi * count * x)], axis=-1)


def _hats(values: FloatArray, knots: FloatArray) -> FloatArray:
    """Piecewise-linear hat functions at the knots, constant beyond the outer ones; shape (..., knots)."""
    eye = np.eye(len(knots))
    return np.stack([np.interp(values, knots, eye[k]) for k in range(len(knots))], axis=-1)


def _beyond(values: FloatArray, ends: FloatArray) -> FloatArray:
    """By how much values lie beyond the inner two of four ends, shape (..., 2)."""
    return np.stack([np.minimum(values - ends[1], 0.0), np.maximum(values - ends[2], 0.0)], axis=-1)
