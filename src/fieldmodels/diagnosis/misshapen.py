"""Names whose shape need not be theirs: drag by the power 1.5 of a speed is nearly that by its square."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.candidates import Candidate
from fieldmodels.diagnosis.curves import SAME_SINE, Curves, Scored
from fieldmodels.diagnosis.held_out import held_out_loss
from fieldmodels.diagnosis.linearisation import stacked
from fieldmodels.diagnosis.phrases import CONSTANT
from fieldmodels.diagnosis.selection import indistinguishable
from fieldmodels.diagnosis.shapes import Curve

NEAR = 0.5
"""Sine between what a name and a table change, below which the table's variable may be the name's."""


def misshapen(beside: Curves, kept: Candidate) -> Mapping[str, Scored]:
    """Named effects for which another known function of their variable does as well.

    A table pays for eight values where a name pays for one, so that a name may stand for a shape that is near
    its own. Here each name gives way to its own function, and that is compared with the others, all of them to
    first order and beside what else is named. It is passed over where it has several parameters, is no known
    function of a variable, or is a constant.

    Args:
        beside: The curves beside the names.
        kept: The names.

    Returns:
        Of each such name the best function that is not its own.
    """
    result, blocks = {}, beside.problem.blocks
    for name in kept.effects:
        for curve, own in _shapes(beside, kept, name):
            rest = _without(beside, kept, name)
            judged = beside.judge(rest, beside.functions([curve]))
            mine = next((s for s in judged if s.curve.formula == own.formula), None)
            others = (s for s in judged if s is not mine and s.curve.shapes.shape[1] == 1)
            best = next(others, None)
            if mine and best and indistinguishable(mine.candidate, best.candidate, blocks, beside.options):
                result[name] = best
    return result


def _shapes(beside: Curves, kept: Candidate, name: str) -> Iterator[tuple[Curve, Curve]]:
    """A table over a name's variable with the known function that a name is; none if it is none."""
    own = _own(beside, kept, name)
    if own.sum() != 1:
        return
    moved = stacked(kept.fit.jacobian[:, :, own])
    best: tuple[float, Curve, Curve] | None = None
    for table in beside.all:
        if table.place not in ("force", "sensor") or table.formula or not _near(beside, table, moved):
            continue
        for function in beside.functions([table]):
            if function.shapes.shape[1] == 1 and function.formula != CONSTANT:
                sine = _sine(moved, stacked(beside.response(function)))
                if sine < min(SAME_SINE, best[0] if best else 1.0):
                    best = sine, table, function
    if best:
        yield best[1:]


def _near(beside: Curves, table: Curve, moved: FloatArray) -> bool:
    return _sine(moved, stacked(beside.response(table))) < NEAR


def _own(beside: Curves, kept: Candidate, name: str) -> NDArray[np.bool_]:
    place = beside.problem.model.slice_of(name)
    return np.asarray((kept.fit.free >= place.start) & (kept.fit.free < place.stop) & kept.fit.active)


def _without(beside: Curves, kept: Candidate, name: str) -> Candidate:
    """The names but one, to first order: its part of what is simulated is an error again."""
    fitted, problem, own = kept.fit, beside.problem, _own(beside, kept, name)
    slope = problem.coordinates(fitted.free).slope(fitted.parameters[fitted.free])[own]
    neutral = np.array([p.nominal for p in problem.model.all_parameters])[fitted.free[own]]
    change = (fitted.parameters[fitted.free[own]] - neutral) / slope
    rest = replace(
        fitted,
        residual=fitted.residual + fitted.jacobian[:, :, own] @ change,
        active=fitted.active & ~own,
    )
    left = tuple(one for one in kept.effects if one != name)
    loss = held_out_loss(rest, problem.folds)
    return replace(kept, effects=left, fit=rest, loss=loss, size=kept.size - 1)


def _sine(column: FloatArray, others: FloatArray) -> float:
    """Of the angle between a column and a span."""
    left, size, _ = np.linalg.svd(others, full_matrices=False)
    left = left[:, size > 1e-6 * size[0]]
    along = float(np.sum((left.T @ column) ** 2)) / max(float(np.sum(column**2)), 1e-300)
    return float(np.sqrt(max(1.0 - along, 0.0)))
