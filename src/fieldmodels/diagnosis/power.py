"""What these data would have shown: the smallest curve at each place that would have been found.

A curve is added to the residuals as it would change them: what the free parameters and the initial states
absorb of it taken out, and the errors weighed anew, since a curve that nobody sees counts as noise. Then the
whole decision is made as for the data themselves, with the curve in either direction. The size at which it
falls is where at least half of all noise would show the curve; stated is the size that nine of ten would
show, by the normal approximation to a likelihood ratio's non-central distribution (Wald 1943; Kay 1998,
section 6.5).
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np
from scipy.linalg import eigh

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.candidates import Candidate
from fieldmodels.diagnosis.curves import TRIED, Curves
from fieldmodels.diagnosis.held_out import held_out_loss
from fieldmodels.diagnosis.linearisation import reweighed, stacked
from fieldmodels.diagnosis.problem import Problem
from fieldmodels.diagnosis.result import Visible
from fieldmodels.diagnosis.shapes import Curve
from fieldmodels.diagnosis.whitening import covariance_whitener
from fieldmodels.recording.units import simplified

SMALLEST = 1e-9
"""Of the largest information: below it a shape is absorbed by the free parameters."""
POWER_QUANTILE = 1.2816
"""Of the normal distribution, for a curve that is found in nine of ten."""
GROWTH, TRIES = 1.3, 16
"""Ratio of the sizes that are tried, and how many."""


@dataclass(frozen=True)
class _Shape:
    """A curve of a certain shape, of one unit (root mean square over the data)."""

    curve: Curve
    added: FloatArray
    """What it adds to the errors that remain after a fit, shape (windows, features)."""
    least: float
    """Size at which it would bring the needed nats if no error changed its weight."""


def visible(candidate: Candidate, curves: Curves) -> tuple[Visible, ...]:
    """The smallest curves that these data would have shown beside a fit, one a place.

    Of the variables that were tried at a place the hardest one counts, in the median of its shapes.

    Args:
        candidate: The fit.
        curves: What was tried beside it.
    """
    found = []
    basis = np.linalg.qr(stacked(candidate.fit.jacobian[:, :, candidate.fit.active]))[0]
    tables = [c for c in curves.all if not c.formula and c.shapes.shape[1] > 1]
    for (place, target), group in groupby(sorted(tables, key=_place), _place):
        shapes = [s for s in (_median_shape(c, curves, basis) for c in group) if s is not None]
        if not shapes:
            continue
        hardest = max(shapes, key=lambda s: s.least)
        size = _smallest(hardest, candidate, curves)
        errors = _errors(curves.problem, size * hardest.added) if np.isfinite(size) else {}
        found.append(Visible(place, target, hardest.curve.over, size, simplified(hardest.curve.unit), errors))
    return tuple(found)


def _place(curve: Curve) -> tuple[str, str]:
    return curve.place, curve.target


def _median_shape(curve: Curve, curves: Curves, basis: FloatArray) -> _Shape | None:
    """The shape of a table that half of its shapes are easier to see than; None if all are absorbed."""
    columns = curves.response(curve)
    flat = stacked(columns)
    own = flat - basis @ (basis.T @ flat)
    information = own.T @ own
    values = curve.values.reshape(-1, curve.values.shape[-1])
    weight = values.T @ values / len(values)
    weight += 1e-12 * np.trace(weight) * np.eye(len(weight))
    gained, shapes = eigh(information, weight)
    seen = np.flatnonzero(gained > SMALLEST * gained.max())
    if not len(seen) or gained.max() <= 0:
        return None
    k = seen[(len(seen) - 1) // 2]  # eigenvalues rise, and shapes have unit size
    fitted = curves.fitted
    rows = (own @ shapes[:, k]).reshape(columns.shape[:2])[:, : len(fitted.whitener)]
    added = np.asarray(np.linalg.solve(fitted.whitener, rows.T).T, dtype=np.float64)
    if fitted.weight is not None:
        added = np.where(fitted.weight > 0, added / np.where(fitted.weight > 0, fitted.weight, 1.0), 0.0)
    return _Shape(curve, added, float(np.sqrt(2.0 * curves.needed / gained[k])))


def _smallest(shape: _Shape, candidate: Candidate, curves: Curves) -> float:
    """The smallest size at which nine of ten would be found; infinite if the data show none."""
    sizes = shape.least * GROWTH ** np.arange(TRIES)

    def both(k: int, shows: Callable[[_Trial], bool]) -> bool:
        return all(shows(_Trial(shape, sign * sizes[k], candidate, curves)) for sign in (1.0, -1.0))

    # What shows, shows if it is larger. Whether it also does beside zeros that wander takes most of the time.
    first = bisect_left(range(TRIES), True, key=lambda k: both(k, _Trial.convinces))
    found = next((k for k in range(first, TRIES) if both(k, _Trial.is_found)), None)
    if found is None:
        return float("inf")
    return float(sizes[found] * (1.0 + POWER_QUANTILE / np.sqrt(2.0 * curves.needed)))


class _Trial:
    """What a diagnosis would say if a curve of a size were in the data."""

    def __init__(self, shape: _Shape, size: float, candidate: Candidate, curves: Curves) -> None:
        problem = curves.problem
        moved = replace(candidate.fit, raw=candidate.fit.raw + size * shape.added)
        fitted = reweighed(problem, moved, covariance_whitener(problem, moved))
        self.candidate = replace(candidate, fit=fitted, loss=held_out_loss(fitted, problem.folds))
        self.curves, self.curve = curves.reweighed(fitted), shape.curve
        scored = next(iter(self.curves.judge(self.candidate, [shape.curve])), None)
        self.scored = None if problem.is_exact(moved.raw) else scored

    def convinces(self) -> bool:
        """Whether the curve brings enough nats, with the weights of either fit."""
        if self.scored is None:
            return False
        if self.curves.convinces(self.candidate, self.scored):
            return True
        own = self.curves.with_own_weights(self.candidate, self.scored)
        return own is not None and own[0].convinces(*own[1:])

    def is_found(self) -> bool:
        """Whether the data would call for it.

        Weights of its own count only if it is asked for them, as the best are by the weights of the fit.
        """
        if self.scored is None:
            return False
        if self.curves.convinces(self.candidate, self.scored):
            return self.curves.called_for(self.candidate, self.scored)
        asked = self.curves.judge(self.candidate, self.curves.all)[:TRIED]
        own = any(one.curve is self.curve for one in asked)
        return own and self.curves.called_for(self.candidate, self.scored)


def _errors(problem: Problem, added: FloatArray) -> dict[str, float]:
    """Root mean square by output."""
    outputs = problem.model.outputs
    return {
        outputs[j].name: float(np.sqrt(np.mean(added[:, problem.outputs == j] ** 2)))
        for j in np.unique(problem.outputs)
    }
