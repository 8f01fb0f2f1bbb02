"""What an excitation will teach: the very filter of the experiment, fed with the signals it should expect.

Section VI asks for "the expected observability metrics ... using the current measures of the unknown
parameters, the system dynamic model, the Kalman filter and the external excitation". A vehicle with the
estimated parameters is shaken by a candidate command; its noise-free features, and what noise would add to
their sums, join the sums measured so far; the filter reads its covariance from them as it will after the
next decision. One kernel, batched over experiments and candidates, over one or more decisions ahead.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled, inlined
from fieldmodels.estimation.parameter_filter import (
    METHODS,
    Pairs,
    Room,
    Terms,
    accumulate,
    accumulate_noise,
    estimate,
    pairs_of,
    room_for,
)
from fieldmodels.machines.excitation import lanes
from fieldmodels.machines.excitation.declaration import as_vehicles
from fieldmodels.machines.excitation.dynamics import GRAVITY, STATE
from fieldmodels.machines.excitation.lanes import advance_modes
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


class Known(NamedTuple):
    """A ``Situation`` as the kernel takes it."""

    mean: FloatArray
    covariance: FloatArray
    moments: FloatArray
    noise: FloatArray
    samples: FloatArray
    command: FloatArray
    phase: FloatArray
    variances: FloatArray


def make_physical(means: ArrayLike) -> FloatArray:
    """The vehicles nearest to estimates that can be simulated.

    Args:
        means: The 22 estimates, of any value, shape (batch, 22).

    Returns:
        Of that shape: within the prior's ranges, positive where they must be, their inertia physical.
    """
    least = LOWER.copy()
    positive = [MASS, *range(INERTIA, INERTIA + 3), *range(DAMPING, UNKNOWNS)]
    least[positive] += LEAST * (UPPER - LOWER)[positive]
    vehicles = np.clip(np.asarray(means, dtype=np.float64), least, UPPER)
    for k, (i, j) in enumerate(((0, 2), (1, 2), (0, 1))):
        most = PRODUCTS_MOST * np.sqrt(vehicles[:, INERTIA + i] * vehicles[:, INERTIA + j])
        product = vehicles[:, INERTIA + 3 + k]
        vehicles[:, INERTIA + 3 + k] = np.clip(product, -most, most)
    return vehicles


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


class Setup(NamedTuple):
    """What is the same in all predictions.

    Attributes:
        terms: Of the regressor.
        pairs: Of these.
        active: Equations in use, shape (3, 6).
        deviation: Of the prior, 0 for what is known, shape (22,).
        arm: ``Arm.row()``, shape (5,).
        acceleration: Largest |f''| of the arm [rad/s2].
        substeps: Integration steps a sampling interval.
        average: Neighbouring samples that the filter averages.
        compensated: Whether it compensates its bias.
        fraction: Share of the maximum sensed value that noise reaches.
        running: Whether noise follows the running maximum.
    """

    terms: Terms
    pairs: Pairs
    active: NDArray[np.bool_]
    deviation: FloatArray
    arm: FloatArray
    acceleration: float
    substeps: int
    average: int
    compensated: bool
    fraction: float
    running: bool


class Sums(NamedTuple):
    """What a candidate changes, kept in one place for all of them.

    Attributes:
        state: States of the modes, shape (3, 24).
        moments: Sums of y y', shape (3, 30, 30).
        noise: Sums of the features' noise, of that shape.
        variances: Of the noise on each signal, shape (3, 24).
        command: In force, shape (3,).
    """

    state: FloatArray
    moments: FloatArray
    noise: FloatArray
    variances: FloatArray
    command: FloatArray


class Buffers(NamedTuple):
    """Room for one decision.

    Attributes:
        motion: Of the one arm, shape (1, 80 * substeps + 1, 3).
        signals: Of the one vehicle, shape (1, 3, 80, 24).
        features: Of one mode, shape (80, 30).
        spread: Sum of their noise's covariances, shape (30, 30).
        exact: Variances of signals without noise, shape (24,): zeros.
        lanes: Of the modes side by side, dtype ``lanes.room_for(1)``, shape (1,).
    """

    motion: FloatArray
    signals: FloatArray
    features: FloatArray
    spread: FloatArray
    exact: FloatArray
    lanes: NDArray[Any]


@inlined
def _shake(vehicle: NDArray[Any], setup: Setup, state: FloatArray, buffers: Buffers) -> None:
    """Advance all modes, state of shape (1, 3, 24), by the decision whose motion is in the buffers."""
    advance_modes(
        vehicle, setup.arm, buffers.motion, CONSTANT[OFFSET], SAMPLE, setup.substeps, state, buffers.signals,
        buffers.lanes[0],
    )  # fmt: skip


@inlined
def raise_variances(signals: FloatArray, share: float, variances: FloatArray) -> None:
    """Let the noise follow the running maxima: a sensor is the same in all modes, and so is its maximum.

    Args:
        signals: Of the decision, whose own maxima count, shape (3, 80, 24).
        share: Variance of the noise over the square of the maximum.
        variances: Shape (3, 24), raised in place.
    """
    for i in range(SIGNALS):
        largest = 0.0
        for mode in range(MODES):
            largest = max(largest, variances[mode, i])
            for k in range(SAMPLES):
                largest = max(largest, share * signals[mode, k, i] ** 2)
        variances[:, i] = largest


@inlined
def add_decision(setup: Setup, sums: Sums, buffers: Buffers) -> None:
    """Add what the filter will have of the decision in the buffers to its sums."""
    gravity, y, spread = setup.arm[GRAVITY], buffers.features, buffers.spread
    if setup.running:
        raise_variances(buffers.signals[0], setup.fraction * setup.fraction / 3.0, sums.variances)
    for mode in range(MODES):
        spread[:, :] = 0.0
        for k in range(SAMPLES):
            fill_features(buffers.signals[0, mode, k], buffers.exact, gravity, y[k])
            add_feature_noise(buffers.signals[0, mode, k], sums.variances[mode], gravity, spread)
        accumulate(y, setup.average, sums.moments[mode])
        # Measured features carry noise, which the filter's sums will hold on average.
        accumulate_noise(spread, setup.average, sums.moments[mode])
        accumulate_noise(spread, setup.average, sums.noise[mode])


@inlined
def follow(
    vehicle: NDArray[Any],
    setup: Setup,
    wanted: FloatArray,
    phase: float,
    sums: Sums,
    after: FloatArray,
    buffers: Buffers,
) -> None:
    """Shake a vehicle by a candidate's commands, shape (decisions, 3), from a phase [rad] on."""
    for h in range(len(wanted)):
        attainable(sums.command, phase, wanted[h], setup.acceleration, after)
        fill_motion(sums.command, phase, after, buffers.motion[0])
        phase = phase_after(phase, sums.command, after)
        sums.command[:] = after
        _shake(vehicle, setup, sums.state, buffers)
        add_decision(setup, sums, buffers)


@compiled
def _predict(
    setup: Setup,
    situation: Known,
    vehicles: NDArray[Any],
    wanted: FloatArray,
    room: Room,
    lane_room: NDArray[Any],
    covariances: FloatArray,
    grams: FloatArray,
) -> None:
    """Fill covariances and grams after each candidate; see ``Predictor.outlook``."""
    buffers = Buffers(
        np.empty((1, SAMPLES * setup.substeps + 1, 3)),
        np.empty((1, MODES, SAMPLES, SIGNALS)),
        np.empty((SAMPLES, FEATURES)),
        np.empty((FEATURES, FEATURES)),
        np.zeros(SIGNALS),
        lane_room,
    )
    sums = Sums(
        np.empty((1, MODES, STATE)),
        np.empty_like(situation.moments[0]),
        np.empty_like(situation.noise[0]),
        np.empty((MODES, SIGNALS)),
        np.empty(3),
    )
    flat_moments, flat_noise = sums.moments.reshape((MODES, -1)), sums.noise.reshape((MODES, -1))
    shaken, after, believed = np.empty((1, MODES, STATE)), np.empty(3), np.empty(UNKNOWNS)
    for b in range(len(situation.mean)):
        fill_past(situation.command[b], situation.phase[b], buffers.motion[0])
        shaken[:, :, :] = 0.0
        _shake(vehicles[b : b + 1], setup, shaken, buffers)
        samples = situation.samples[b] + wanted.shape[2] * SAMPLES / setup.average
        for c in range(wanted.shape[1]):
            sums.state[:, :, :] = shaken
            sums.moments[:, :, :] = situation.moments[b]
            sums.noise[:, :, :] = situation.noise[b]
            sums.variances[:, :] = situation.variances[b]
            sums.command[:] = situation.command[b]
            follow(vehicles[b : b + 1], setup, wanted[b, c], situation.phase[b], sums, after, buffers)
            grams[b, c] = 0.0
            for mode in range(MODES):
                add_gram(setup.terms, setup.active[mode], setup.deviation, sums.moments[mode], grams[b, c])
            believed[:] = situation.mean[b]
            covariances[b, c] = situation.covariance[b]
            estimate(
                setup.pairs, flat_moments, flat_noise, samples, setup.active, situation.mean[b],
                setup.deviation, setup.compensated, 1, believed, covariances[b, c], room,
            )  # fmt: skip


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
        noise = noise or SensorNoise()
        self._setup = Setup(
            terms=Terms(*TERMS),
            pairs=pairs_of(Terms(*TERMS)),
            active=variant.rows.reshape(MODES, EQUATIONS),
            deviation=np.sqrt(np.where(variant.unknowns, PRIOR_VARIANCE, 0.0)),
            arm=(arm or Arm()).row(),
            acceleration=limits.acceleration,
            substeps=substeps,
            average=METHODS[method].average,
            compensated=METHODS[method].compensated,
            fraction=noise.fraction,
            running=noise.kind == "running_max",
        )

    def outlook(
        self, situation: Situation, commands: ArrayLike, vehicles: ArrayLike | None = None
    ) -> Outlook:
        """What the filter is expected to know after each candidate.

        Args:
            situation: Before the decision.
            commands: Wanted amplitude [rad], frequency [rad/s] and offset [rad] of each decision ahead, for
                each candidate, shape (batch, candidates, decisions, 3).
            vehicles: Parameters of the vehicles to shake, shape (batch, 22); None takes the estimates. Only
                who is given the truth has others.

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
        known = Known(**{name: getattr(situation, name) for name in Known._fields})
        shaken = as_vehicles(make_physical(situation.mean if vehicles is None else vehicles))
        room = room_for(UNKNOWNS, EQUATIONS)
        _predict(
            self._setup,
            known,
            shaken,
            wanted,
            room,
            np.empty(1, lanes.room_for(1)),
            result.covariance,
            result.gram,
        )
        return result
