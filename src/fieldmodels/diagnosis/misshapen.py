"""Names whose shape need not be theirs: drag by the power 1.5 of a speed is nearly that by its square."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.candidates import Candidate
from fieldmodels.diagnosis.curves import SAME_SINE, Curves, Scored, beyond_span
from fieldmodels.diagnosis.held_out import held_out_loss
from fieldmodels.diagnosis.linearisation import projected, stacked
from fieldmodels.diagnosis.phrases import CONSTANT
from fieldmodels.diagnosis.selection import indistinguishable
from fieldmodels.diagnosis.shapes import Curve

NEAR = 0.5
"""Sine between what a name and a table change, below which the table's variable may be the name's."""
TOLD = 2.0
"""Times the sine between a name and its own function, by which another function must differ from it."""


@dataclass(frozen=True)
class Shape:
    """Another known function of a name's variable, which does as well.

    Attributes:
        scored: The function, beside what else is named.
        own: What the name's own function leaves.
        other: What this one leaves, both by weights of their own.
    """

    scored: Scored
    own: Candidate
    other: Candidate


def misshapen(beside: Curves, kept: Candidate) -> Mapping[str, Shape]:
    """Named effects for which another known function of their variable does as well, or better.

    A table pays for eight values where a name pays for one, so that a name can stand for a shape near its
    own. Here each name gives way to its own function, and that is compared with the others, to first order
    and beside what else is named. Effects of several parameters, those that are no known function of a
    variable, and constants are passed over.

    Args:
        beside: The curves beside the names.
        kept: The names.

    Returns:
        Of each such name the best function that is not its own.
    """
    result = {}
    for name in kept.effects:
        found = _variable(beside, kept, name)
        if found is None:
            continue
        formula, functions = found
        rest = _without(beside, kept, name)
        judged = beside.judge(rest, functions)
        mine = next((one for one in judged if one.curve.formula == formula), None)
        best = next((one for one in judged if one is not mine), None)
        if mine is None or best is None:
            continue
        sought = best.candidate.search - kept.search  # as one of all curves, which it is not
        if best.candidate.total - sought > kept.total + beside.options.same_gain:
            continue
        own, other = (_with_own_weights(beside, rest, one) for one in (mine, best))
        if indistinguishable(own, other, beside.problem.blocks, beside.options):
            result[name] = Shape(best, own, other)
    return result


def _variable(beside: Curves, kept: Candidate, name: str) -> tuple[str, list[Curve]] | None:
    """Which known function of a variable a name is, and that with the others; None if it is none."""
    own = _own(beside, kept, name)
    if own.sum() != 1:
        return None
    # A gain on one side alone is an asymmetry, where a mass or a gain is fitted, too.
    rest = stacked(kept.fit.jacobian[:, :, kept.fit.active & ~own])
    moved = beyond_span(stacked(kept.fit.jacobian[:, :, own]), rest)

    def off(curve: Curve) -> float:
        return _sine(moved, beyond_span(stacked(beside.response(curve)), rest))

    nearest, best = SAME_SINE, None
    for table in beside.all:
        if table.place not in ("force", "sensor") or table.formula:
            continue
        if off(table) > NEAR:
            continue
        functions = [f for f in beside.functions([table]) if f.shapes.shape[1] == 1]
        sines = [off(f) for f in functions]
        if sines and min(sines) < nearest:
            nearest, mine = min(sines), functions[sines.index(min(sines))]
            others = [f for f, sine in zip(functions, sines, strict=True) if sine > TOLD * nearest]
            best = mine.formula, [mine, *others]
    return None if best is None or best[0] == CONSTANT else best


def _own(beside: Curves, kept: Candidate, name: str) -> NDArray[np.bool_]:
    """Which free parameters are a name's, none of them at a bound."""
    place = beside.problem.model.slice_of(name)
    return np.asarray((kept.fit.free >= place.start) & (kept.fit.free < place.stop) & kept.fit.active)


def _without(beside: Curves, kept: Candidate, name: str) -> Candidate:
    """The names but one, to first order: its part of what is simulated is an error again."""
    fitted, problem, own = kept.fit, beside.problem, _own(beside, kept, name)
    free, values = fitted.free, fitted.parameters
    neutral = np.array([p.nominal for p in problem.model.all_parameters])
    change = (values - neutral)[free[own]] / problem.coordinates(free).slope(values[free])[own]
    rest = projected(
        problem,
        values,
        free[~own],
        fitted.whitener,
        fitted.states,
        fitted.raw + fitted.by_free[:, :, own] @ change,
        fitted.by_states,
        fitted.by_free[:, :, ~own],
    )
    left = tuple(one for one in kept.effects if one != name)
    loss = held_out_loss(rest, problem.folds)
    return replace(kept, effects=left, fit=rest, loss=loss, size=kept.size - 1)


def _with_own_weights(beside: Curves, rest: Candidate, scored: Scored) -> Candidate:
    """A function beside the rest, compared by the weights of the errors that it leaves itself.

    Those that a name leaves favour it, since what it lacks counts as noise.
    """
    own = beside.with_own_weights(rest, scored)
    return scored.candidate if own is None else replace(scored.candidate, loss=rest.loss - own[2].gain)


def _sine(column: FloatArray, others: FloatArray) -> float:
    """Of the angle between a column and a span."""
    beyond, whole = np.linalg.norm(beyond_span(column, others)), np.linalg.norm(column)
    return float(beyond / whole) if whole else 1.0
