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

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled, inlined
from fieldmodels.estimation.parameter_filter import METHODS, Terms, accumulate, accumulate_noise, estimate
from fieldmodels.machines.excitation.dynamics import STATE, VEHICLE, advance_mode
from fieldmodels.machines.excitation.motion import (
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
from fieldmodels.machines.excitation.parameters import (
    DAMPING,
    EQUATIONS,
    INERTIA,
    LIMITS,
    LOWER,
    MASS,
    MODES,
    PRIOR_VARIANCE,
    SAMPLE,
    SAMPLES,
    UNKNOWNS,
    UPPER,
    Arm,
    Limits,
    SensorNoise,
)
from fieldmodels.machines.excitation.regression import (
    FEATURES,
    SIGNALS,
    TERMS,
    add_feature_noise,
    fill_features,
)
from fieldmodels.machines.excitation.sensors import FULL, Variant
from fieldmodels.model import ModelError

SUBSTEPS = 1
"""Integration steps a sampling interval: a prediction needs no more (tested against the experiment's)."""

LEAST = 0.001
"""Mass, inertia, damping and stiffness of a predicted vehicle are at least this share of their range."""
PRODUCTS_MOST = 0.45
"""Largest |I_ij| / sqrt(I_ii I_jj) of a predicted vehicle: any three such make a positive-definite tensor."""


@dataclass(frozen=True)
class Situation:
    """What is known before a decision, in a batch of experiments; nothing of it is hidden from a robot.

    Attributes:
        mean: Estimates, shape (batch, 22).
        covariance: Their covariances, shape (batch, 22, 22).
        moments: The filter's sums of y y', shape (batch, 3, 30, 30), upper triangles.
        noise: Its sums of the features' noise, of that shape.
        samples: Number of samples in the sums, shape (batch,).
        command: Arm's command in force, shape (batch, 3).
        phase: Its phase [rad], shape (batch,).
        variances: Of the noise on each signal, as it is now, shape (batch, 3, 24).
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


@dataclass(frozen=True)
class Outlook:
    """What candidates are expected to lead to.

    Attributes:
        covariance: Of the filter, shape (batch, candidates, 22, 22).
        gram: A'A of all that will have been sensed, noise included, columns in units of the prior's
            deviations, shape (batch, candidates, 22, 22).
    """

    covariance: FloatArray
    gram: FloatArray


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


@inlined
def add_gram(
    terms: Terms, active: NDArray[np.bool_], deviation: FloatArray, moments: FloatArray, gram: FloatArray
) -> None:
    """Add A'A of one mode, in units of the prior's deviations, from its sums of y y'."""
    for a in range(len(terms.row)):
        for b in range(len(terms.row)):
            i, j = terms.column[a], terms.column[b]
            if i < UNKNOWNS and j < UNKNOWNS and terms.row[a] == terms.row[b] and active[terms.row[a]]:
                low = min(terms.feature[a], terms.feature[b])
                high = max(terms.feature[a], terms.feature[b])
                scale = deviation[i] * deviation[j] * terms.coefficient[a] * terms.coefficient[b]
                gram[i, j] += scale * moments[low, high]


@compiled
def _shake(
    vehicle: FloatArray,
    arm: FloatArray,
    motion: FloatArray,
    rest: float,
    substeps: int,
    state: FloatArray,
    signals: FloatArray,
) -> None:
    """Advance all modes by one decision, in place of ``state``, shape (3, 24); see ``advance_mode``."""
    for mode in range(MODES):
        advance_mode(vehicle, arm, mode, motion, rest, SAMPLE, substeps, 0.0, state[mode], signals[mode])


@compiled
def _predict(
    terms: Terms,
    arm: FloatArray,
    rest: float,
    acceleration: float,
    substeps: int,
    average: int,
    compensated: bool,
    fraction: float,
    running: bool,
    active: NDArray[np.bool_],
    deviation: FloatArray,
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
    covariances: FloatArray,
    grams: FloatArray,
) -> None:
    """Fill covariances and grams after each candidate; see ``Predictor.outlook``."""
    exact = np.zeros(SIGNALS)
    share = fraction * fraction / 3.0  # of a square: the variance of noise up to that fraction
    vehicle = np.empty(VEHICLE)
    motion = np.empty((SAMPLES * substeps + 1, 3))
    signals = np.empty((MODES, SAMPLES, SIGNALS))
    y = np.empty((SAMPLES, FEATURES))
    spread = np.empty((FEATURES, FEATURES))
    shaken = np.empty((MODES, STATE))
    state = np.empty((MODES, STATE))
    variance = np.empty((MODES, SIGNALS))
    sums, noises = np.empty_like(moments[0]), np.empty_like(noise[0])
    before, after, believed = np.empty(3), np.empty(3), np.empty(UNKNOWNS)
    for b in range(len(mean)):
        make_physical(vehicles[b], lower, upper, vehicle)
        fill_past(command[b], phase[b], motion)
        shaken[:, :] = 0.0
        _shake(vehicle, arm, motion, rest, substeps, shaken, signals)
        for c in range(wanted.shape[1]):
            state[:, :] = shaken
            sums[:, :, :] = moments[b]
            noises[:, :, :] = noise[b]
            variance[:, :] = variances[b]
            before[:] = command[b]
            angle = phase[b]
            for h in range(wanted.shape[2]):
                attainable(before, angle, wanted[b, c, h], acceleration, after)
                fill_motion(before, angle, after, motion)
                angle = phase_after(angle, before, after)
                before[:] = after
                _shake(vehicle, arm, motion, rest, substeps, state, signals)
                if running:
                    # A sensor is the same in all modes, and so is its maximum; the decision's own counts.
                    for i in range(SIGNALS):
                        largest = 0.0
                        for mode in range(MODES):
                            largest = max(largest, variance[mode, i])
                            for k in range(SAMPLES):
                                largest = max(largest, share * signals[mode, k, i] ** 2)
                        variance[:, i] = largest
                for mode in range(MODES):
                    spread[:, :] = 0.0
                    for k in range(SAMPLES):
                        fill_features(signals[mode, k], exact, arm[4], y[k])
                        add_feature_noise(signals[mode, k], variance[mode], arm[4], spread)
                    accumulate(y, average, sums[mode])
                    # Measured features carry noise, which the filter's sums will hold on average.
                    accumulate_noise(spread, average, sums[mode])
                    accumulate_noise(spread, average, noises[mode])
            grams[b, c] = 0.0
            for mode in range(MODES):
                add_gram(terms, active[mode], deviation, sums[mode], grams[b, c])
            believed[:] = mean[b]
            covariances[b, c] = covariance[b]
            estimate(
                terms,
                sums,
                noises,
                samples[b] + wanted.shape[2] * SAMPLES / average,
                active,
                mean[b],
                deviation,
                compensated,
                1,
                believed,
                covariances[b, c],
            )


class Predictor:
    """Predicts what the filter will know after candidate commands."""

    def __init__(
        self,
        arm: Arm | None = None,
        limits: Limits = LIMITS["wide"],
        noise: SensorNoise | None = None,
        method: str = "compensated",
        variant: Variant = FULL,
        substeps: int = SUBSTEPS,
    ) -> None:
        """Say what experiment this is.

        Args:
            arm: The arm, which is known.
            limits: Of its motion.
            noise: Of the sensors.
            method: How the filter reads its sums, out of ``METHODS``.
            variant: Equations in use and unknowns that are estimated.
            substeps: Integration steps a sampling interval.

        Raises:
            ModelError: If the method is unknown.
        """
        if method not in METHODS:
            raise ModelError(f"the method must be one of {', '.join(METHODS)}, not {method!r}")
        self._arm = (arm or Arm()).row()
        self._acceleration = limits.acceleration
        self._noise = noise or SensorNoise()
        self._method = METHODS[method]
        self._substeps = substeps
        row, column, feature, coefficient = TERMS
        self._terms = Terms(row, column, feature, coefficient)
        self._active = variant.rows.reshape(MODES, EQUATIONS)
        self._deviation = np.sqrt(np.where(variant.unknowns, PRIOR_VARIANCE, 0.0))

    def outlook(
        self, situation: Situation, commands: ArrayLike, vehicles: ArrayLike | None = None
    ) -> Outlook:
        """What the filter is expected to know after each candidate.

        Args:
            situation: Before the decision.
            commands: Wanted amplitude [rad], frequency [rad/s] and offset [rad] of each decision ahead, for
                each candidate, shape (batch, candidates, decisions, 3).
            vehicles: Parameters of the vehicles to shake, shape (batch, 22); None takes the estimates. Only
                who is told the truth has others.

        Returns:
            After the last of these decisions.

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
        shape = (*wanted.shape[:2], UNKNOWNS, UNKNOWNS)
        result = Outlook(np.empty(shape), np.empty(shape))
        _predict(
            self._terms,
            self._arm,
            float(CONSTANT[OFFSET]),
            self._acceleration,
            self._substeps,
            self._method.average,
            self._method.compensated,
            self._noise.fraction,
            self._noise.kind == "running_max",
            self._active,
            self._deviation,
            LOWER,
            UPPER,
            situation.mean if vehicles is None else np.ascontiguousarray(vehicles, dtype=np.float64),
            situation.mean,
            situation.covariance,
            situation.moments,
            situation.noise,
            situation.samples,
            situation.command,
            situation.phase,
            situation.variances,
            wanted,
            result.covariance,
            result.gram,
        )
        return result
