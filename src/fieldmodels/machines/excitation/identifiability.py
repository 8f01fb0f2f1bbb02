"""Which unknowns an experiment can tell: rank test (5)-(8), and bounds on each unknown's error.

Two bounds, both of Cramer and Rao, for the sensors' noise at the true unknowns:

* regression: each sample counts by its equation (4) alone. What the sensors measured enters with its noise
  (errors in variables), so an equation's noise is that of all its terms. No filter of A x = F beats it.
* trajectory: the motion is known to follow from the unknowns and the arm's motion, so that all samples tell
  of one trajectory. An output-error fit comes near it.

Beside them stands the prior: an error bound above the prior's is "prior only".
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled
from fieldmodels.machines.excitation.dynamics import SUBSTEPS, simulate
from fieldmodels.machines.excitation.parameters import (
    EQUATIONS,
    MODES,
    NAMES,
    PRIOR_VARIANCE,
    SAMPLE,
    UNKNOWNS,
    Arm,
    SensorNoise,
)
from fieldmodels.machines.excitation.regression import (
    FEATURES,
    TERMS,
    add_feature_noise,
    regressor,
)
from fieldmodels.machines.excitation.sensors import full_scale, variances

STEP = 1e-4
"""Step of a finite difference, in prior standard deviations."""


@dataclass(frozen=True)
class Identifiability:
    """What an experiment can tell of each of the 22 unknowns.

    Attributes:
        true: True values, shape (22,).
        singular: Singular values of the observability matrix (8), columns scaled by the prior, shape (22,).
        rank: Its rank, with numerical tolerance.
        lost: Share of each unknown in the directions that the rank test misses, 0 to 1, shape (22,).
        regression: Bound on the standard deviation from A x = F, without a prior, shape (22,).
        trajectory: Bound from the trajectory, shape (22,).
        with_prior: Bound from A x = F with the prior, shape (22,).
        prior: The prior's standard deviation, shape (22,).
    """

    true: FloatArray
    singular: FloatArray
    rank: int
    lost: FloatArray
    regression: FloatArray
    trajectory: FloatArray
    with_prior: FloatArray
    prior: FloatArray

    @property
    def prior_only(self) -> tuple[str, ...]:
        """Unknowns of which the measurements tell less than the prior does (in A x = F)."""
        return tuple(n for n, s, p in zip(NAMES, self.regression, self.prior, strict=True) if not s < p)

    def lines(self) -> list[str]:
        """The report as a Markdown table, errors in percent of the true value where it is not zero."""
        result = [
            "| unknown | true | A x = F | with prior | trajectory | prior |",
            "|---|---|---|---|---|---|",
        ]
        for i, name in enumerate(NAMES):
            size = abs(self.true[i])
            cells = []
            for bound in (self.regression[i], self.with_prior[i], self.trajectory[i], self.prior[i]):
                cells.append(f"{100 * bound / size:.3g} %" if size > 0 else f"{bound:.3g}")
            result.append(f"| {name} | {self.true[i]:g} | " + " | ".join(cells) + " |")
        return result


def rank_test(regressors: FloatArray, scale: FloatArray | None = None) -> tuple[FloatArray, int, FloatArray]:
    """Classical observability, eqs (5)-(8), for constant unknowns: F = 0, so Phi = I in (7).

    Args:
        regressors: H_k of each sample, shape (samples, rows, unknowns).
        scale: Typical size of each unknown, shape (unknowns,); default: the prior's standard deviation.

    Returns:
        Singular values of the scaled matrix (8); its rank; and of each unknown the share that lies in the
        null space (0: determined, 1: not seen at all).
    """
    size = np.sqrt(PRIOR_VARIANCE) if scale is None else scale
    stacked = regressors.reshape(-1, regressors.shape[-1]) * size
    # The triangular factor has the same singular values and is small.
    triangle = np.zeros((stacked.shape[1], stacked.shape[1]))
    factor = np.linalg.qr(stacked, mode="r")
    triangle[: len(factor)] = factor
    _, values, right = np.linalg.svd(triangle)
    tolerance = values[0] * max(stacked.shape) * np.finfo(np.float64).eps
    rank = int((values > tolerance).sum())
    return values, rank, np.sum(right[rank:] ** 2, axis=0)


@compiled
def _equation_noise(
    signals: FloatArray,
    noise: FloatArray,
    gravity: float,
    combination: FloatArray,
    result: FloatArray,
) -> None:
    """Covariance of the six equations of each sample of one mode, shape (samples, 6, 6)."""
    covariance = np.empty((FEATURES, FEATURES))
    for n in range(len(signals)):
        covariance[:] = 0.0
        add_feature_noise(signals[n], noise, gravity, covariance)
        result[n] = combination @ covariance @ combination.T


def equation_noise(
    signals: FloatArray, noise: FloatArray, unknowns: FloatArray, gravity: float
) -> FloatArray:
    """Covariance of A x - F of each sample and mode for noisy signals.

    Args:
        signals: Signals, shape (3, samples, 24).
        noise: Variances of their noise, shape (3, 24).
        unknowns: x, shape (22,).
        gravity: Acceleration of free fall [m/s2].

    Returns:
        Shape (samples, 3, 6, 6).
    """
    rows, columns, features, coefficients = TERMS
    extended = np.append(unknowns, -1.0)
    combination = np.zeros((EQUATIONS, FEATURES))
    np.add.at(combination, (rows, features), coefficients * extended[columns])
    result = np.empty((signals.shape[1], MODES, EQUATIONS, EQUATIONS))
    for mode in range(MODES):
        own = np.empty((signals.shape[1], EQUATIONS, EQUATIONS))
        _equation_noise(
            np.ascontiguousarray(signals[mode]), np.ascontiguousarray(noise[mode]), gravity, combination, own
        )
        result[:, mode] = own
    return result


def regression_information(
    signals: FloatArray, noise: FloatArray, unknowns: FloatArray, gravity: float
) -> FloatArray:
    """Fisher information of A x = F with noise in A and F, shape (22, 22)."""
    a, _ = regressor(signals.transpose(1, 0, 2), gravity)
    blocks = a.reshape(len(a), MODES, EQUATIONS, UNKNOWNS)
    weights = np.linalg.pinv(equation_noise(signals, noise, unknowns, gravity), hermitian=True)
    return np.asarray(np.einsum("nmiu,nmij,nmjv->uv", blocks, weights, blocks, optimize=True))


def trajectory_information(
    unknowns: FloatArray, motion: FloatArray, arm: Arm, noise: FloatArray
) -> FloatArray:
    """Fisher information of the whole trajectory, by central differences, shape (22, 22)."""
    change = STEP * np.sqrt(PRIOR_VARIANCE)
    vehicles = np.concatenate([unknowns + np.diag(change), unknowns - np.diag(change)])
    runs = simulate(vehicles, motion, arm.row(), SAMPLE)
    slopes = (runs[:UNKNOWNS] - runs[UNKNOWNS:]) / (2.0 * change)[:, None, None, None]
    weights = np.divide(1.0, noise, out=np.zeros_like(noise), where=noise > 0)
    scaled = (slopes * np.sqrt(weights)[:, None, :]).reshape(UNKNOWNS, -1)
    return np.asarray(scaled @ scaled.T)


def bound(information: FloatArray, prior: FloatArray | None = None) -> FloatArray:
    """Smallest standard deviations that an information allows, infinite where it has none, shape (22,).

    Args:
        information: Fisher information, shape (n, n).
        prior: Variances of the prior, shape (n,); default none.
    """
    size = np.sqrt(PRIOR_VARIANCE)
    scaled = information * np.outer(size, size)
    if prior is not None:
        scaled = scaled + np.diag(PRIOR_VARIANCE / prior)
    values, vectors = np.linalg.eigh(scaled)
    inverse = np.where(values > 1e-12 * values[-1], 1.0 / np.maximum(values, 1e-300), np.inf)
    with np.errstate(invalid="ignore"):
        variance = np.nansum(np.where(vectors**2 > 1e-12, vectors**2 * inverse, 0.0), axis=1)
    return np.asarray(size * np.sqrt(variance))


def identifiability(
    unknowns: FloatArray, motion: FloatArray, noise: SensorNoise | None = None, arm: Arm | None = None
) -> Identifiability:
    """Report what an arm's motion tells of a vehicle under ``full_scale`` noise.

    Args:
        unknowns: True values, shape (22,).
        motion: f, f', f'' at every substep, as ``dynamics.simulate`` takes them.
        noise: The sensors' noise (default: the source's).
        arm: The arm (default: the source's).
    """
    arm = arm or Arm()
    noise = noise or SensorNoise()
    spread = variances(full_scale(unknowns, arm, per_mode=noise.per_mode), noise.fraction)
    signals = simulate(unknowns, motion, arm.row(), SAMPLE, SUBSTEPS)[0]
    a, _ = regressor(signals.transpose(1, 0, 2), arm.gravity)
    singular, rank, lost = rank_test(a)
    information = regression_information(signals, spread, unknowns, arm.gravity)
    return Identifiability(
        true=np.array(unknowns),
        singular=singular,
        rank=rank,
        lost=lost,
        regression=bound(information),
        trajectory=bound(trajectory_information(unknowns, motion, arm, spread)),
        with_prior=bound(information, PRIOR_VARIANCE),
        prior=np.sqrt(PRIOR_VARIANCE),
    )
