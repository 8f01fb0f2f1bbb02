"""States that no sensor shows by name, from what ``observe`` and the equations tell of them.

At each start they are solved for by Gauss and Newton's method, with the smallest change that does it: first
so that the sensors would show what they have measured, then, for states that are not in that, so that what
they show would change as fast as it did.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fieldmodels.arrays import BoolArray, FloatArray, IntArray
from fieldmodels.drivers.declaration import Declaration, named, param_names, params_of
from fieldmodels.drivers.methods import TITLES, check_methods, methods_of

STEPS = 30
"""Of Gauss and Newton's, at most."""
SHARES = (1.0, 0.5, 0.25, 0.0625, 0.0039)
"""Of a step, tried until one brings what is shown nearer."""
SMALL = 1e-3
"""Step of a difference, in a state's size."""
SETTLED = 1e-3
"""Of what is measured: from a start that ends farther off, another one is tried."""
LEAST = 1e-8
"""Change of what is shown, in its size, by a state's size: what has less is not told."""

Shown = Callable[[FloatArray, IntArray], FloatArray]
"""What states, shape (n, states), would show at some of the starts, shape (n, wanted)."""


@dataclass(frozen=True)
class Measured:
    """What the sensors have measured at the starts.

    Attributes:
        outputs: Numbers of the machine's outputs that were measured, rising.
        values: Their values, shape (starts, outputs).
        slopes: How fast they change [1/s], of the same shape.
        inputs: Inputs of the machine, shape (starts, inputs).
    """

    outputs: list[int]
    values: FloatArray
    slopes: FloatArray
    inputs: FloatArray


def told(
    machine: Declaration, states: FloatArray, known: BoolArray, measured: Measured, step: float
) -> tuple[FloatArray, BoolArray]:
    """States at some starts, with those that the sensors tell in the place of guesses, and which are known.

    Args:
        machine: The machine, at whose nominal numbers they are told.
        states: What is known of them, and guesses of the others, shape (starts, states).
        known: Which of them are known by themselves, shape (states,).
        measured: What was measured there.
        step: Sampling interval [s].

    Raises:
        ModelError: For a mistake in one of the machine's own methods.
    """
    check_methods(machine)
    shown, rates = _equations(machine, measured, step)
    units = [s.unit for s in machine.states]
    sizes = _sizes(machine, measured)
    starts = [states]
    for unit in dict.fromkeys(u for u, k in zip(units, known, strict=True) if k):  # beside what is known
        alike = np.array([u == unit for u in units])
        beside = np.where(alike & ~known, states[:, alike & known].mean(axis=1, keepdims=True), states)
        starts.append(beside)
    states, found = _solved(shown, starts, ~known, measured.values, sizes)
    small = 0.1 * step

    def changing(at: FloatArray, rows: IntArray) -> FloatArray:
        ahead = small * rates(at, rows)
        return (shown(at + ahead, rows) - shown(at - ahead, rows)) / (2.0 * small)

    left = ~known & ~found
    if not left.any():
        return states, known | found
    states, moving = _solved(changing, [states], left, measured.slopes, sizes)
    return states, known | found | moving


def _sizes(machine: Declaration, measured: Measured) -> FloatArray:
    """How large each state may be: as an output of its unit, or 1, shape (states,)."""
    sizes = np.ones(len(machine.states))
    for i, state in enumerate(machine.states):
        alike = [k for k, o in enumerate(measured.outputs) if machine.outputs[o].unit == state.unit]
        sizes[i] = _rms(measured.values[:, alike].reshape(-1, 1))[0] if alike else 1.0
    return sizes


def _rms(columns: FloatArray) -> FloatArray:
    """Root mean square of what is known of each column; 1 where that is nothing, or 0."""
    known = np.isfinite(columns)
    squares = np.where(known, columns, 0.0) ** 2
    size = np.sqrt(squares.sum(axis=0) / np.maximum(known.sum(axis=0), 1))
    return np.where(size > 0.0, size, 1.0)


def _equations(machine: Declaration, measured: Measured, step: float) -> tuple[Shown, Shown]:
    """What the sensors show of states, and the states' rates; not a number where there is none."""
    methods = {m.own: m.function for m in methods_of(machine)}
    p = named(TITLES["p"], param_names(machine), params_of(machine, machine.nominal))
    names = [s.name for s in machine.states]
    given = [s.name for s in type(machine).inputs]
    inputs = [named(TITLES["input"], given, row[: len(given)]) for row in measured.inputs.tolist()]
    positions = [names.index(s.name) if s.name in names else -1 for s in machine.outputs]

    def called(call: Callable[..., object], at: FloatArray, rows: IntArray, count: int) -> FloatArray:
        result = np.full((len(at), count), np.nan)
        with np.errstate(all="ignore"):
            for k, (values, row) in enumerate(zip(at.tolist(), rows.tolist(), strict=True)):
                try:
                    result[k] = call(named(TITLES["state"], names, values), inputs[row])
                except (ArithmeticError, ValueError):  # a root of less than nothing, a sine above one
                    continue
        return result

    def shown(at: FloatArray, rows: IntArray) -> FloatArray:
        if "observe" not in methods:
            return at[:, [positions[o] for o in measured.outputs]]
        own = methods["observe"]
        return called(lambda s, _: own(None, s, p), at, rows, len(machine.outputs))[:, measured.outputs]

    def rates(at: FloatArray, rows: IntArray) -> FloatArray:
        if "advance" in methods:
            own = methods["advance"]
            return (called(lambda s, u: own(None, s, u, p, step), at, rows, len(names)) - at) / step
        own = methods["derivative"]
        return called(lambda s, u: own(None, s, u, p), at, rows, len(names))

    return shown, rates


def _solved(
    shown: Shown, starts: list[FloatArray], free: BoolArray, wanted: FloatArray, sizes: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """States that show what is wanted, from the best of some starts, and which of them show at all.

    Args:
        shown: What states show.
        starts: Where it begins, each (n, states); another one where those before it fail.
        free: Which states may change.
        wanted: Shape (n, wanted).
        sizes: How large each state may be.
    """
    scale = _rms(wanted)
    best, left, seen = starts[0].copy(), np.full(len(wanted), np.inf), np.zeros(len(free), dtype=np.bool_)
    for start in starts:
        poor = np.flatnonzero(~(left < SETTLED))
        if len(poor):
            _follow(shown, best, left, seen, start[poor], poor, free, wanted, scale, sizes)
    return best, seen


def _follow(
    shown: Shown, best: FloatArray, left: FloatArray, seen: BoolArray, at: FloatArray, rows: IntArray,
    free: BoolArray, wanted: FloatArray, scale: FloatArray, sizes: FloatArray,
) -> None:  # fmt: skip
    """Go from some states to what shows what is wanted; what is better than the best takes its place."""
    at, which = at.copy(), np.flatnonzero(free)

    def off(some: FloatArray, of: IntArray) -> FloatArray:
        return np.where(np.isfinite(wanted[of]), (shown(some, of) - wanted[of]) / scale, 0.0)

    error = off(at, rows)
    size = _size(error)
    going = np.isfinite(size)
    for _ in range(STEPS):
        on = np.flatnonzero(going)
        if not len(on):
            break
        slopes = np.zeros((len(on), wanted.shape[1], len(which)))
        for k, j in enumerate(which):
            moved = SMALL * sizes[j] * np.eye(at.shape[1])[j]
            change = off(at[on] + moved, rows[on]) - off(at[on] - moved, rows[on])
            slopes[:, :, k] = np.where(np.isfinite(change), change, 0.0) / (2.0 * SMALL)
        seen[which] |= (np.abs(slopes) > LEAST).any(axis=(0, 1))
        step = -np.einsum("nki,ni->nk", np.linalg.pinv(slopes, rcond=LEAST), error[on])
        better = np.zeros(len(on), dtype=np.bool_)
        for share in SHARES:
            worse = np.flatnonzero(~better)
            if not len(worse):
                break
            tried = at[on[worse]]
            tried[:, which] += share * step[worse] * sizes[which]
            there = off(tried, rows[on[worse]])
            nearer = _size(there) < (1.0 - 1e-9) * size[on[worse]]
            taken = on[worse[nearer]]
            at[taken], error[taken], size[taken] = tried[nearer], there[nearer], _size(there[nearer])
            better[worse[nearer]] = True
        going[on] = better & (size[on] > 1e-12)
    nearer = ~(left[rows] <= size)
    best[rows[nearer]], left[rows[nearer]] = at[nearer], size[nearer]


def _size(error: FloatArray) -> FloatArray:
    """Root mean square of each row; infinite where it has no number."""
    size = np.sqrt(np.mean(error**2, axis=1))
    return np.where(np.isfinite(size), size, np.inf)
