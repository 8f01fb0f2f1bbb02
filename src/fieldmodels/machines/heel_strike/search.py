"""Many gain sets on the same walks: the search behind tuned gains and the dissertation's sweeps.

The walks are recorded once; then every set of gains estimates them, side by side in vector registers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled
from fieldmodels.drivers.stepped import Stepped
from fieldmodels.machines.heel_strike.parameters import Leg, Noise, Regimes
from fieldmodels.machines.heel_strike.strides import Strides
from fieldmodels.model import ModelError


@dataclass(frozen=True)
class Walks:
    """Recorded walks, laid end to end, on which gains are scored.

    Attributes:
        leg: The nominal leg.
        envelope: Samples of a stride's early phase.
        gyro: Gyro samples of all strides [rad/s], shape (n,).
        samples: Samples of each stride, shape (strides,).
        walk: Number of the walk that each stride belongs to, shape (strides,).
        theta: True angle at each closing strike [rad], shape (strides,).
        height: Error of the geometry's angle there [rad], shape (strides,).
        features: Features of the reference filter before each stride, shape (strides, 6).
        levels: Regime of each stride (process, floor, collision; 0 low, 1 high), shape (strides, 3).
        estimator_mm: Signed errors [mm] of the estimators that need no gains, shape (strides, 5), columns
            as in ``ESTIMATORS``.
    """

    leg: Leg
    envelope: int
    gyro: FloatArray
    samples: NDArray[np.int64]
    walk: NDArray[np.int64]
    theta: FloatArray
    height: FloatArray
    features: FloatArray
    levels: NDArray[np.int64]
    estimator_mm: FloatArray

    def __len__(self) -> int:
        """Number of strides."""
        return len(self.samples)

    @property
    def regime(self) -> NDArray[np.int64]:
        """Regime number of each stride, 4 * process + 2 * floor + collision, shape (strides,)."""
        return np.asarray(self.levels @ np.array([4, 2, 1]))


def record_walks(
    rngs: Sequence[np.random.Generator],
    strides: int,
    leg: Leg | None = None,
    noise: Noise | Regimes | None = None,
    reality: ArrayLike | None = None,
    *,
    bank: bool = False,
    tuned_reset: float = 1.0,
    stock: Stepped | None = None,
) -> Walks:
    """Record one walk for each generator.

    A walk is the same as that of a ``Strides`` seeded by the same generator.

    Args:
        rngs: One generator a walk.
        strides: Strides of each walk.
        leg: The nominal leg.
        noise: Stationary noise or hidden regimes.
        reality: As for ``Strides``.
        bank: True also runs the interacting-multiple-model bank.
        tuned_reset: Share of the geometry in the tuned Ranger's reset.
        stock: Stock effects around a walker.

    Raises:
        ModelError: If a leg falls.
    """
    parts: list[tuple[NDArray[np.generic], ...]] = []
    walker = Strides(1, leg, noise, reality, bank=bank, tuned_reset=tuned_reset, stock=stock)
    for number, rng in enumerate(rngs):
        walker.seed(0, rng)
        for _ in range(strides):
            features = walker.features
            result = walker.advance((1.0, 1.0, 0.1, 2 / 3 / walker.leg.step), traces=True)
            if result.fallen[0]:
                raise ModelError(
                    f"walk {number}: the leg fell; lower the process noise or raise the push-off"
                )
            assert result.traces is not None
            trace = result.traces[0]
            parts.append(
                (
                    trace[:, 3],
                    result.samples,
                    np.array([number]),
                    trace[-1:, 1],
                    walker.walkers["geometry"] - trace[-1:, 1],
                    features,
                    result.levels,
                    result.signed_mm,
                )
            )
    columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
    envelope = max(1, round(walker.regimes.envelope / walker.leg.step))
    return Walks(walker.leg, envelope, *columns)


def stride_errors(
    walks: Walks, gains: ArrayLike, rows: ArrayLike | None = None, cromer: bool = True
) -> FloatArray:
    """Signed error of the model-based estimator (2.14) on every stride, for many sets of gains.

    Args:
        walks: The recorded walks.
        gains: S_MS early, S_MS late, S_HR, S_FD [1/s]; shape (sets, 4), or (sets, rows, 4) for gains that
            change from stride to stride.
        rows: With three-dimensional gains, the row that holds in each stride, shape (strides,):
            ``walks.regime`` for eight rows (gains given the regime), or omitted for one row a stride.
        cromer: True integrates by (2.14), False by (2.9).

    Returns:
        Estimated minus true foot height at each closing strike, before the reset [mm], shape
        (sets, strides).

    Raises:
        ModelError: If the shapes do not fit.
    """
    table = np.asarray(gains, dtype=np.float64)
    if table.ndim == 2 and rows is None:
        table, index = table[:, None, :], np.zeros(len(walks), dtype=np.int64)
    else:
        index = np.arange(len(walks)) if rows is None else np.asarray(rows, dtype=np.int64)
    if table.ndim != 3 or table.shape[2] != 4:
        raise ModelError(f"gains must have shape (sets, 4) or (sets, rows, 4), not {table.shape}")
    if index.shape != (len(walks),) or index.min() < 0 or index.max() >= table.shape[1]:
        raise ModelError(f"rows must name one of {table.shape[1]} rows for each of {len(walks)} strides")
    leg = walks.leg
    result = np.empty((len(walks), len(table)))
    _stride_errors(
        walks.gyro,
        walks.samples,
        walks.walk,
        walks.theta,
        walks.height,
        np.ascontiguousarray(table.transpose(1, 2, 0)),
        index,
        leg.step,
        leg.gravity / leg.length,
        leg.speed,
        leg.push_off,
        walks.envelope,
        cromer,
        result,
    )
    return result.T * (1000 * leg.step_length)


def score_gains(
    walks: Walks,
    gains: ArrayLike,
    rows: ArrayLike | None = None,
    cromer: bool = True,
    floor_added: bool = False,
) -> FloatArray:
    """Mean absolute error [mm] of each set of gains, shape (sets,); arguments as ``stride_errors``.

    ``floor_added`` adds the floor's height error to the score, as section 2.4.5 words it.
    """
    errors = stride_errors(walks, gains, rows, cromer)
    if floor_added:
        errors = errors + walks.height * 1000 * walks.leg.step_length
    return np.asarray(np.abs(errors).mean(axis=1))


@compiled
def _stride_errors(
    gyro: FloatArray,
    samples: NDArray[np.int64],
    walk: NDArray[np.int64],
    truth: FloatArray,
    height: FloatArray,
    gains: FloatArray,
    rows: NDArray[np.int64],
    step: float,
    stiffness: float,
    speed: float,
    share: float,
    envelope: int,
    cromer: bool,
    result: FloatArray,
) -> None:
    """Run (2.14) with all sets of gains over all strides; ``gains`` has shape (rows, 4, sets)."""
    sets = gains.shape[2]
    theta = np.zeros(sets)
    omega = np.zeros(sets)
    model = np.empty(sets)
    sensor = np.empty(sets)
    position = 0
    for s in range(len(samples)):
        first = s == 0 or walk[s] != walk[s - 1]
        gain = gains[rows[s]]
        for g in range(sets):
            if first:
                theta[g] = 0.0
                omega[g] = speed
            else:
                theta[g] += gain[2, g] * (truth[s - 1] + height[s - 1] - theta[g])
                omega[g] -= share * (omega[g] - np.copysign(speed, omega[g]))
        for n in range(1, samples[s] + 1):
            if n == 1 or n == envelope + 1:
                phase = 0 if n == 1 else 1
                for g in range(sets):
                    model[g] = -(1.0 - gain[phase, g]) * stiffness * step
                    sensor[g] = gain[phase, g] * gain[3, g] * step
            measured = gyro[position]
            position += 1
            for g in range(sets):
                # Sine by its series, 1e-12 within a leg's swing: vector registers have no sine.
                x = min(max(theta[g], -1.5), 1.5)
                y = x * x
                sine = x * (
                    1.0
                    + y * (-1 / 6 + y * (1 / 120 + y * (-1 / 5040 + y * (1 / 362880 - y * (1 / 39916800)))))
                )
                faster = omega[g] + model[g] * sine + sensor[g] * (measured - omega[g])
                theta[g] += (faster if cromer else omega[g]) * step
                omega[g] = faster
        for g in range(sets):
            result[s, g] = theta[g] - truth[s]
