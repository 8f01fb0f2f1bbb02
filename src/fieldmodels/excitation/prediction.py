"""What an excitation will teach: the very filter of the experiment, fed with the signals it should expect.

Section VI asks for "the expected observability metrics ... using the current measures of the unknown
parameters, the system dynamic model, the Kalman filter and the external excitation". A vehicle with the
estimated parameters is shaken by a candidate command; its noise-free features, and what noise would add to
their sums, join the sums measured so far; the filter reads its covariance from them as it will after the
next decision. One kernel, batched over experiments and candidates, over one or more decisions ahead.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fieldmodels.compiled import compiled, inlined
from fieldmodels.estimation.parameter_filter import METHODS, Terms, accumulate, accumulate_noise, estimate
from fieldmodels.excitation.dynamics import STATE, VEHICLE, advance_mode
from fieldmodels.excitation.motion import (
    AMPLITUDE,
    CONSTANT,
    DECISION,
    FREQUENCY,
    OFFSET,
    attainable,
    fill_motion,
    motion_at,
    phase_after,
)
from fieldmodels.excitation.parameters import (
    DAMPING,
    EQUATIONS,
    INERTIA,
    LIMITS,
    LOWER,
    MASS,
    MODES,
    PRIOR_MEAN,
    PRIOR_VARIANCE,
    SAMPLE,
    SAMPLES,
    UNKNOWNS,
    UPPER,
    Arm,
    Limits,
)
from fieldmodels.excitation.regression import FEATURES, SIGNALS, TERMS, add_feature_noise, fill_features
from fieldmodels.model import FloatArray, ModelError

SUBSTEPS = 1
"""Integration steps a sampling interval: a prediction needs no more (tested against the experiment's)."""

LEAST = 0.01
"""Mass, inertia, damping and stiffness of a predicted vehicle are at least this share of their range."""
PRODUCTS_MOST = 0.45
"""Largest |I_ij| / sqrt(I_ii I_jj) of a predicted vehicle: any three such make a positive-definite tensor."""


@dataclass(frozen=True)
class Situation:
    """What is known before a decision, in a batch of experiments; nothing of it is hidden from a robot.

    Attributes:
        mean: Estimates, shape (batch, 22).
        covariance: Their covariances, shape (batch, 22, 22).
        moments: The filter's sums of y y', shape (batch, 3, 30, 30).
        noise: Its sums of the features' noise, shape (batch, 3, 30, 30).
        samples: Number of samples in the sums, shape (batch,).
        command: Arm's command in force, shape (batch, 3).
        phase: Its phase [rad], shape (batch,).
        variances: Variance of the noise on each signal, shape (batch, 3, 24).
    """

    mean: FloatArray
    covariance: FloatArray
    moments: FloatArray
    noise: FloatArray
    samples: FloatArray
    command: FloatArray
    phase: FloatArray
    variances: FloatArray

    def __len__(self) -> int:
        """Number of experiments."""
        return len(self.mean)


@inlined
def make_physical(mean: FloatArray, lower: FloatArray, upper: FloatArray, vehicle: FloatArray) -> None:
    """The vehicle nearest to an estimate that can be simulated; its effects are off.

    Args:
        mean: The 22 estimates, of any value.
        lower: Ends of the prior's ranges, shape (22,).
        upper: The same.
        vehicle: Receives the vehicle, shape (29,).
    """
    vehicle[:] = 0.0
    for i in range(UNKNOWNS):
        least = lower[i]
        if i == MASS or INERTIA <= i < INERTIA + 3 or i >= DAMPING:
            least += LEAST * (upper[i] - lower[i])
        vehicle[i] = min(max(mean[i], least), upper[i])
    for k, (i, j) in enumerate(((0, 2), (1, 2), (0, 1))):
        most = PRODUCTS_MOST * math.sqrt(vehicle[INERTIA + i] * vehicle[INERTIA + j])
        product = INERTIA + 3 + k
        vehicle[product] = min(max(vehicle[product], -most), most)


@inlined
def fill_past(command: FloatArray, phase: float, motion: FloatArray) -> None:
    """The arm's motion up to now had its command been in force for a whole decision."""
    begin = phase - command[FREQUENCY] * DECISION
    count = len(motion) - 1
    for i in range(count + 1):
        motion[i, 0], motion[i, 1], motion[i, 2] = motion_at(
            command[AMPLITUDE], command[FREQUENCY], command[OFFSET], begin, 0.0, 0.0, 0.0,
            i * (DECISION / count),
        )  # fmt: skip


@compiled
def _predict(
    terms: Terms,
    arm: FloatArray,
    rest: float,
    acceleration: float,
    substeps: int,
    average: int,
    compensated: bool,
    active: NDArray[np.bool_],
    prior_mean: FloatArray,
    prior_deviation: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    vehicles: FloatArray,
    mean: FloatArray,
    covariance: FloatArray,
    moments: FloatArray,
    noise: FloatArray,
    samples: FloatArray,
    command: FloatArray,
    phase: FloatArray,
    variances: FloatArray,
    wanted: FloatArray,
    result: FloatArray,
) -> None:
    """Fill the covariances after each candidate; see ``Predictor.covariances``."""
    exact = np.zeros(SIGNALS)
    vehicle = np.empty(VEHICLE)
    motion = np.empty((SAMPLES * substeps + 1, 3))
    signals = np.empty((SAMPLES, SIGNALS))
    y = np.empty((SAMPLES, FEATURES))
    spread = np.empty((FEATURES, FEATURES))
    shaken = np.empty((MODES, STATE))
    state = np.empty((MODES, STATE))
    sums, noises = np.empty_like(moments[0]), np.empty_like(noise[0])
    before, after, believed = np.empty(3), np.empty(3), np.empty(UNKNOWNS)
    for b in range(len(mean)):
        make_physical(vehicles[b], lower, upper, vehicle)
        fill_past(command[b], phase[b], motion)
        shaken[:, :] = 0.0
        for mode in range(MODES):
            advance_mode(vehicle, arm, mode, motion, rest, SAMPLE, substeps, 0.0, shaken[mode], signals)
        for c in range(wanted.shape[1]):
            state[:, :] = shaken
            sums[:, :, :] = moments[b]
            noises[:, :, :] = noise[b]
            before[:] = command[b]
            angle = phase[b]
            for h in range(wanted.shape[2]):
                attainable(before, angle, wanted[b, c, h], acceleration, after)
                fill_motion(before, angle, after, motion)
                angle = phase_after(angle, before, after)
                before[:] = after
                for mode in range(MODES):
                    advance_mode(
                        vehicle, arm, mode, motion, rest, SAMPLE, substeps, 0.0, state[mode], signals
                    )
                    spread[:, :] = 0.0
                    for k in range(SAMPLES):
                        fill_features(signals[k], exact, arm[4], y[k])
                        add_feature_noise(signals[k], variances[b, mode], arm[4], spread)
                    accumulate(y, average, sums[mode])
                    # Measured features carry noise, which the filter's sums will hold on average.
                    accumulate_noise(spread, average, sums[mode])
                    accumulate_noise(spread, average, noises[mode])
            believed[:] = mean[b]
            result[b, c] = covariance[b]
            estimate(
                terms,
                sums,
                noises,
                samples[b] + wanted.shape[2] * SAMPLES / average,
                active,
                prior_mean,
                prior_deviation,
                compensated,
                1,
                believed,
                result[b, c],
            )


class Predictor:
    """Predicts the filter's next covariance for candidate commands."""

    def __init__(
        self,
        arm: Arm | None = None,
        limits: Limits = LIMITS["wide"],
        method: str = "compensated",
        *,
        active: ArrayLike | None = None,
        prior_mean: ArrayLike = PRIOR_MEAN,
        prior_variance: ArrayLike = PRIOR_VARIANCE,
        substeps: int = SUBSTEPS,
    ) -> None:
        """Say what experiment this is.

        Args:
            arm: The arm, which is known.
            limits: Of its motion.
            method: How the filter reads its sums, out of ``METHODS``.
            active: Which equations of a mode the filter uses, shape (6,); None uses all.
            prior_mean: Of the filter, shape (22,).
            prior_variance: The same; 0 holds an unknown at its mean.
            substeps: Integration steps a sampling interval.

        Raises:
            ModelError: If the method is unknown or a shape is wrong.
        """
        if method not in METHODS:
            raise ModelError(f"the method must be one of {', '.join(METHODS)}, not {method!r}")
        self._arm = (arm or Arm()).row()
        self._acceleration = limits.acceleration
        self._method = METHODS[method]
        self._substeps = substeps
        row, column, feature, coefficient = TERMS
        self._terms = Terms(row, column, feature, coefficient)
        self._active = np.ones(EQUATIONS, np.bool_) if active is None else np.array(active, np.bool_)
        self._mean = np.array(prior_mean, dtype=np.float64)
        self._deviation = np.sqrt(np.array(prior_variance, dtype=np.float64))
        if self._active.shape != (EQUATIONS,) or not (
            self._mean.shape == self._deviation.shape == (UNKNOWNS,)
        ):
            raise ModelError(f"active has {EQUATIONS} flags, the prior {UNKNOWNS} means and variances")

    def covariances(
        self, situation: Situation, commands: ArrayLike, vehicles: ArrayLike | None = None
    ) -> FloatArray:
        """Covariances that the filter is expected to have after each candidate.

        Args:
            situation: Before the decision.
            commands: Wanted amplitude [rad], frequency [rad/s] and offset [rad] of each decision ahead, for
                each candidate, shape (batch, candidates, decisions, 3).
            vehicles: Parameters of the vehicles to shake, shape (batch, 22); None takes the estimates. Only
                who is told the truth has others.

        Returns:
            After the last of these decisions, shape (batch, candidates, 22, 22).

        Raises:
            ModelError: If the commands have the wrong shape or are not finite.
        """
        wanted = np.ascontiguousarray(commands, dtype=np.float64)
        if wanted.ndim != 4 or len(wanted) != len(situation) or wanted.shape[3] != 3 or not wanted.shape[2]:
            raise ModelError(
                f"commands must have shape ({len(situation)}, candidates, decisions, 3), not {wanted.shape}"
            )
        if not np.isfinite(wanted).all():
            raise ModelError("commands must be finite")
        result = np.empty((*wanted.shape[:2], UNKNOWNS, UNKNOWNS))
        shaken = situation.mean if vehicles is None else np.ascontiguousarray(vehicles, dtype=np.float64)
        _predict(
            self._terms,
            self._arm,
            float(CONSTANT[OFFSET]),
            self._acceleration,
            self._substeps,
            self._method.average,
            self._method.compensated,
            self._active,
            self._mean,
            self._deviation,
            LOWER,
            UPPER,
            shaken,
            situation.mean,
            situation.covariance,
            situation.moments,
            situation.noise,
            situation.samples,
            situation.command,
            situation.phase,
            situation.variances,
            wanted,
            result,
        )
        return result
