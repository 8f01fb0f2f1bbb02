"""What these data would have shown: the smallest curve at each place that would have been found."""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.candidates import Candidate
from fieldmodels.diagnosis.curves import Curve, Curves
from fieldmodels.diagnosis.linearisation import stacked
from fieldmodels.diagnosis.result import Visible

SMALLEST = 1e-9  # of the largest information: below it a shape is absorbed by the free parameters


def visible(candidate: Candidate, curves: Curves) -> tuple[Visible, ...]:
    """The smallest curves that these data would have shown beside a fit, one a place.

    A curve's expected gain is half its squared response in units of the noise, free parameters and states
    projected out. Of a table's shapes half need less than stated and half need more; of the variables that
    were tried at a place the hardest one counts.

    Args:
        candidate: The fit.
        curves: What was tried beside it.
    """
    active = stacked(candidate.fit.jacobian[:, :, candidate.fit.active])
    basis = np.linalg.qr(active)[0]
    sizes: dict[tuple[str, str], Visible] = {}
    for curve in curves.all:
        if curve.formula or curve.shapes.shape[1] == 1:
            continue
        size = _size(curve, curves.response(curve), basis, curves.needed)
        key = curve.place, curve.target
        if np.isfinite(size) and (key not in sizes or size > sizes[key].size):
            sizes[key] = Visible(curve.place, curve.target, curve.over, size, curve.unit)
    return tuple(sizes.values())


def _size(curve: Curve, columns: FloatArray, basis: FloatArray, needed: float) -> float:
    """Root mean square of the curve, over the data, that brings the needed nats in the median shape."""
    flat = stacked(columns)
    own = flat - basis @ (basis.T @ flat)
    information = own.T @ own
    values = curve.values.reshape(-1, curve.values.shape[-1])
    weight = values.T @ values / len(values)
    gained = eigh(information, weight + 1e-12 * np.trace(weight) * np.eye(len(weight)), eigvals_only=True)
    seen = gained[gained > SMALLEST * gained.max()]
    return float(np.sqrt(2.0 * needed / np.median(seen))) if len(seen) and gained.max() > 0 else float("nan")
