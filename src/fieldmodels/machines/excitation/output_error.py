"""Output-error fit of the vehicle to whole runs: all 24 signals of all three modes."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from fieldmodels.arrays import FloatArray
from fieldmodels.estimation.inertia_projection import project
from fieldmodels.estimation.output_error import OutputError, fit_output_error
from fieldmodels.machines.excitation.dynamics import SUBSTEPS, simulate
from fieldmodels.machines.excitation.parameters import (
    DAMPING,
    INERTIA,
    LOWER,
    MASS,
    PRIOR_MEAN,
    PRIOR_VARIANCE,
    SAMPLE,
    UPPER,
    Arm,
)

_LEAST = 1e-3
"""Mass, damping and stiffness of a simulated vehicle are at least this share of their range."""
_LEAST_MOMENT = 1e-3
"""Least principal second moment of mass [kg m2] of a simulated vehicle."""
_SHARPEST = 0.02
"""A signal is nowhere taken for sharper than this share of its coarsest noise in the run: a running maximum
begins at nothing, and so does its noise, where only the integrator's own error is left."""


def nearest_vehicle(vehicle: FloatArray) -> FloatArray:
    """The nearest vehicle that can be built, shape (22,): positive where it must be, its inertia physical."""
    near = np.array(vehicle, dtype=np.float64)
    least = LOWER + _LEAST * (UPPER - LOWER)
    near[MASS] = max(near[MASS], least[MASS])
    near[DAMPING:] = np.maximum(near[DAMPING:], least[DAMPING:])
    tensor = slice(INERTIA, INERTIA + 6)
    near[tensor] = project(near[tensor], least=_LEAST_MOMENT)
    return near


def fit_vehicle(
    measured: FloatArray,
    variances: FloatArray,
    motion: FloatArray,
    start: ArrayLike,
    arm: Arm | None = None,
    substeps: int = SUBSTEPS,
) -> OutputError:
    """Fit the 22 unknowns to measured runs.

    Args:
        measured: Signals, shape (3, samples, 24).
        variances: Of each one's noise, of that shape.
        motion: The arm's motion, shape (samples * substeps + 1, 3).
        start: Where to begin, shape (22,): a filter's estimate.
        arm: The arm (default: the source's).
        substeps: Integration steps a sampling interval.

    Raises:
        ModelError: If shapes do not fit.
    """
    row = (arm or Arm()).row()
    floor = (_SHARPEST**2) * variances.max(axis=1, keepdims=True)
    return fit_output_error(
        lambda vehicles: simulate(vehicles, motion, row, SAMPLE, substeps),
        measured,
        np.maximum(np.maximum(variances, floor), 1e-18),
        PRIOR_MEAN,
        np.sqrt(PRIOR_VARIANCE),
        start,
        nearest_vehicle,
    )
