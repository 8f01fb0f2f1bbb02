"""Vehicles that are shaken decision by decision: dynamics, sensors, filters and bits in one place.

What environments and evaluations work with.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import allocation_free, compiled, inlined
from fieldmodels.declared import any_on, as_rows
from fieldmodels.drivers.stepped import Channels, Stepped
from fieldmodels.estimation.parameter_filter import ParameterFilters, Terms
from fieldmodels.information import fast_bits
from fieldmodels.machines.excitation.declaration import EFFECTS, NUMBERS, ROW, with_effects
from fieldmodels.machines.excitation.dynamics import STATE, SUBSTEPS
from fieldmodels.machines.excitation.kernel import BASE, Around, Experiments, advance, room_for, shake
from fieldmodels.machines.excitation.model import ExcitationModel
from fieldmodels.machines.excitation.motion import AMPLITUDE, CONSTANT, DECISION, FREQUENCY, OFFSET
from fieldmodels.machines.excitation.parameters import (
    CG,
    DAMPING,
    DURATION,
    INERTIA,
    LIMITS,
    LOWER,
    MASS,
    MODES,
    PRESETS,
    PRIOR_MEAN,
    PRIOR_VARIANCE,
    RUNNING,
    SAMPLE,
    SAMPLES,
    UNKNOWNS,
    UPPER,
    VEHICLE,
    Arm,
    Rules,
)
from fieldmodels.machines.excitation.regression import FEATURES, SIGNALS, TERMS
from fieldmodels.machines.excitation.sensor_effects import HISTORY, TURNS
from fieldmodels.machines.excitation.sensors import (
    FULL,
    TABLE2,
    Variant,
    variances,
)
from fieldmodels.model import ModelError
from fieldmodels.settings import kernel_rows
from fieldmodels.streams import drawn_key
from fieldmodels.threads import run_rows

CHANNELS = Channels(
    commands=("arm_angle",),
    observed=tuple(s.name for s in ExcitationModel.outputs) * MODES,
    without="the arm turns about one axis a run",
    prompt=("acceleration_x", "acceleration_y", "acceleration_z", "pitch", "roll"),
)
"""Where stock effects can act on an experiment: the angle that sinusoids command, the sensors of each run."""
FINEST = SAMPLE / SUBSTEPS
"""Time between the commanded angles on which stock effects act [s]; sensors sense each ``SAMPLE``."""

VARIANTS: Mapping[str, Variant] = {"full": FULL, "table2": TABLE2}


@inlined
def error_percent(mean: FloatArray, truth: FloatArray, counted: NDArray[np.bool_]) -> tuple[float, float]:
    """Average |error| in percent of the true values, as Table I, and of the prior's ranges.

    Args:
        mean: Estimates, shape (22,).
        truth: True values, of that shape.
        counted: Which parameters count, shape (22,); in percent of the true values, those that are not zero.
    """
    average, normalised, used, all_used = 0.0, 0.0, 0, 0
    for k in range(len(mean)):
        if counted[k]:
            error = 100.0 * abs(mean[k] - truth[k])
            normalised += error / (UPPER[k] - LOWER[k])
            all_used += 1
            if truth[k] != 0.0:
                average += error / abs(truth[k])
                used += 1
    return average / max(used, 1), normalised / max(all_used, 1)


@compiled
def error_percents(mean: FloatArray, truth: FloatArray, counted: NDArray[np.bool_]) -> FloatArray:
    """``error_percent`` of each row, shape (2, batch); mean and truth of shape (batch, 22)."""
    percents = np.empty((2, len(mean)))
    for i in range(len(mean)):
        percents[0, i], percents[1, i] = error_percent(mean[i], truth[i], counted)
    return percents


@allocation_free
def fill_information(
    covariance: FloatArray, estimated: NDArray[np.bool_], rules: NDArray[Any], information: FloatArray
) -> None:
    """Information about each parameter [bits], shape (batch, 22); 0 where it is not estimated."""
    for i in range(len(covariance)):
        for k in range(len(estimated)):
            information[i, k] = 0.0
            if estimated[k]:
                deviation = math.sqrt(covariance[i, k, k])
                information[i, k] = fast_bits(deviation, UPPER[k] - LOWER[k], rules[i].bits)


def information_of(covariance: FloatArray, estimated: NDArray[np.bool_], rules: NDArray[Any]) -> FloatArray:
    """``fill_information`` in an array of its own."""
    information = np.empty(covariance.shape[:2])
    fill_information(covariance, estimated, rules, information)
    return information


FACTORS = 19
"""Independent factors of a drawn vehicle: mass, its distribution (3), lever arms (3), suspension (12)."""


def drawn_around(vehicle: FloatArray, spread: float, factors: FloatArray) -> FloatArray:
    """A vehicle near another one: a physical body, whatever is drawn.

    Mass, lever arms, damping and stiffness are multiplied by factors from [1 - spread, 1 + spread], and so
    are the second moments of the mass along x, y and z, which keeps the inertia that of a body.

    Args:
        vehicle: The 22 unknowns, and effects, which stay as they are.
        spread: At most 1.
        factors: Where in that range each is, from -1 to 1, shape (``FACTORS``,).
    """
    factors = 1.0 + spread * factors
    new = np.array(vehicle, dtype=np.float64)
    new[MASS] *= factors[0]
    new[CG:DAMPING] *= factors[4:7]
    new[DAMPING:UNKNOWNS] *= factors[7:]
    xx, yy, zz, xz, yz, xy = new[INERTIA:CG]
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    moments = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    stretch = np.sqrt(factors[1:4])
    moments = stretch[:, None] * moments * stretch
    inertia = np.trace(moments) * np.eye(3) - moments
    new[INERTIA:CG] = inertia[[0, 1, 2, 0, 1, 0], [0, 1, 2, 2, 2, 1]]
    return new


class Shaken(NamedTuple):
    """Where the experiments stand after a decision; arrays are copies.

    Attributes:
        mean: Estimates of the chosen filter, shape (batch, 22).
        covariance: Their covariances, shape (batch, 22, 22).
        bits: Information about each parameter [bits], by ``information.fast``, shape (batch, 22); 0 where it
            is not estimated.
        mean_naive: Estimates of the naive filter, shape (batch, 22).
        covariance_naive: What it takes for their covariances, shape (batch, 22, 22).
        bits_naive: What it takes for its information [bits], shape (batch, 22).
        moments: The chosen filter's sums of y y', shape (batch, 3, 30, 30), upper triangles.
        noise: Its sums of the covariance of the noise in y, of that shape.
        samples: Samples in these sums, shape (batch,).
        command: Amplitude [rad], frequency [rad/s] and offset [rad] in force, shape (batch, 3).
        phase: Phase of the arm [rad], shape (batch,).
        base: Measured dr, dr', dtheta, w at the latest sample, shape (batch, 3, 12).
        variances: Of the noise of each signal at the latest sample, shape (batch, 3, 24).
        motion: f, f', f'' at the samples of the decision and at its beginning, shape (batch, 81, 3); None
            unless asked for.
        bodies: True dr and dtheta at the samples, shape (batch, 3, 80, 6); None unless asked for.
    """

    mean: FloatArray
    covariance: FloatArray
    bits: FloatArray
    mean_naive: FloatArray
    covariance_naive: FloatArray
    bits_naive: FloatArray
    moments: FloatArray
    noise: FloatArray
    samples: FloatArray
    command: FloatArray
    phase: FloatArray
    base: FloatArray
    variances: FloatArray
    motion: FloatArray | None = None
    bodies: FloatArray | None = None


@lru_cache(maxsize=16)
def _full_scale(vehicle: tuple[float, ...], arm: Arm, rules: np.dtype[Any]) -> FloatArray:
    """``sensors.full_scale`` by the kernel that takes the steps, so that a first step compiles no other."""
    own = np.zeros(1, rules)
    own["acceleration"] = math.inf
    experiment = Experiments(
        vehicles=as_rows(with_effects(np.array(vehicle))[None], ROW),
        sensing=np.zeros(1, dtype=np.bool_),
        keys=np.zeros(1, dtype=np.uint64),
        counts=np.zeros(1, dtype=np.int64),
        command=CONSTANT[None].copy(),
        phase=np.zeros(1),
        states=np.zeros((1, MODES, STATE)),
        maxima=np.zeros((1, MODES, SIGNALS)),
        base=np.zeros((1, MODES, BASE)),
        arm_motion=np.zeros((1, 3)),
        history=np.zeros((1, MODES, 0, TURNS)),
    )
    signals, motion = np.empty((1, MODES, SAMPLES, SIGNALS)), np.empty((0, SAMPLES + 1, 3))
    maxima, room = np.zeros(SIGNALS), np.empty(1, room_for(1))
    for _ in range(round(DURATION / DECISION)):
        advance(experiment, own, arm.row(), None, CONSTANT[None].copy(), signals, motion, room)
        np.maximum(maxima, np.abs(signals[0]).max(axis=(0, 1)), out=maxima)
    return np.tile(maxima, (MODES, 1))


def kernel_rules(rules: Rules, arm: Arm, batch: int, nominal: ArrayLike | None = None) -> NDArray[Any]:
    """Rules as the kernel reads them, shape (batch,).

    Args:
        rules: What is shaken, sensed and estimated.
        arm: The arm.
        batch: Number of experiments.
        nominal: The nominal vehicle, shape (22,); None takes the rules' preset.
    """
    vehicle = np.array(PRESETS[rules.preset] if nominal is None else nominal, dtype=np.float64)
    limits = LIMITS[rules.limits]
    ends = np.array([(0.0, limits.amplitude), limits.frequency, limits.offset])
    derived = {
        "acceleration": limits.acceleration,
        "least": ends[:, 0],
        "most": ends[:, 1],
        "nominal": vehicle,
        "full_scale": np.zeros((MODES, SIGNALS)),
    }
    rows = kernel_rows(rules, batch, derived)
    rows["full_scale"] = _full_scale(tuple(vehicle.tolist()), arm, rows.dtype)
    return rows


def _checked(vehicle: ArrayLike) -> FloatArray:
    """A vehicle's whole vector, from that or the 22 unknowns."""
    vector = np.asarray(vehicle, dtype=np.float64)
    if vector.shape not in ((UNKNOWNS,), NUMBERS.shape) or not np.isfinite(vector).all():
        raise ModelError(
            f"a vehicle has {UNKNOWNS} or {len(NUMBERS)} finite numbers, not shape {vector.shape}"
        )
    return with_effects(vector)


class Shakers:
    """A batch of experiments, each three runs side by side, advanced decision by decision.

    Truth and the draws of the noise depend on an experiment's seed alone, never on the commands or on its
    neighbours in the batch: equal seeds give every agent the same vehicle and the same draws.

    Attributes:
        rules: What is shaken, sensed and estimated.
        truth: The 22 true values of every experiment, shape (batch, 22).
        estimated: Which of them are estimated, shape (22,).
        ranges: Smallest and largest command of each, each of shape (batch, 3).
        nominal: The 22 nominal values of each, those of its preset, shape (batch, 22).
        arm: The arm.
        threads: On which the rows advance, side by side; in one where there are stock effects.
    """

    threads = 1

    def __init__(
        self,
        batch: int,
        rules: Rules | None = None,
        vehicle: ArrayLike | None = None,
        *,
        possible: ArrayLike | None = None,
        nominal: ArrayLike | None = None,
        arm: Arm | None = None,
        stock: Stepped | None = None,
    ) -> None:
        """Make experiments; restart each before the first decision.

        Args:
            batch: Number of experiments.
            rules: What is shaken, sensed and estimated.
            vehicle: What the vehicles truly are: the 22 unknowns, or the whole vector of ``ExcitationModel``
                with the effects of vehicle, arm and sensors, 38 numbers; None takes the rules' preset.
            possible: Whole vectors as extreme as ``set_reality`` will give, shape (k, n); None for none.
            nominal: The nominal vehicle: fixes the sensors' full scale, and the unknowns that a variant takes
                for known, shape (22,); None takes the rules' preset.
            arm: The arm (default: the source's).
            stock: Stock effects around them, by ``CHANNELS``, stepped by ``FINEST``.

        Raises:
            ModelError: If a shape is wrong or a number is out of range.
        """
        if batch < 1:
            raise ModelError(f"a batch needs at least one experiment, not {batch}")
        self.rules = rules or Rules()
        center = _checked(PRESETS[self.rules.preset] if vehicle is None else vehicle)
        self._centers = np.tile(center, (batch, 1))
        self._sensing = any_on(self._centers, VEHICLE, EFFECTS, "sensor")
        self._odd = any_on(self._centers, VEHICLE, EFFECTS).any().item()
        self.stock = stock
        remembering = bool(self._sensing.any()) or (stock is not None and stock.senses)
        if possible is not None:
            ends = np.asarray(possible, dtype=np.float64)
            remembering = remembering or bool(any_on(ends, VEHICLE, EFFECTS, "sensor").any())
        self.arm = arm or Arm()
        variant = VARIANTS[self.rules.variant]
        self.estimated = variant.unknowns.copy()
        self._arm = self.arm.row()
        self._records = kernel_rules(self.rules, self.arm, batch, nominal)
        self.ranges: tuple[FloatArray, FloatArray] = (self._records["least"], self._records["most"])
        self.nominal: FloatArray = self._records["nominal"]
        self._fractions = self._records["noise_fraction"][:, None, None]
        self._estimator = self.rules.estimator
        row, column, feature, coefficient = TERMS
        self._filters = ParameterFilters(
            batch,
            Terms(row, column, feature, coefficient),
            self._prior_means([0])[0],
            np.where(self.estimated, np.sqrt(PRIOR_VARIANCE), 0.0),
            modes=MODES,
            methods=tuple(dict.fromkeys((self._estimator, "naive"))),
            active=variant.rows,
        )
        self._vehicles = np.zeros((batch, len(NUMBERS)))
        self._keys = np.zeros(batch, dtype=np.uint64)
        self._factors = np.zeros((batch, FACTORS))
        self._counts = np.full(batch, -1, dtype=np.int64)
        self._command = np.zeros((batch, 3))
        self._phase = np.zeros(batch)
        self._states = np.zeros((batch, MODES, STATE))
        self._maxima = np.zeros((batch, MODES, SIGNALS))
        self._base = np.zeros((batch, MODES, BASE))
        self._arm_motion = np.zeros((batch, 3))
        self._begun = np.zeros((batch, UNKNOWNS))
        self._around: Around | None = None
        if stock is not None:
            given = np.zeros((batch, 3))
            stock.kept |= {"given": given, "begun": self._begun}
            self._around = Around(stock.actuators, stock.sensors, given, stock.senses)
        self._history = np.zeros((batch, MODES, HISTORY if remembering else 0, TURNS))
        self._sensed = (
            np.empty((batch, MODES, SAMPLES, SIGNALS)),
            np.empty((batch, MODES, SAMPLES, FEATURES)),
            np.empty((batch, MODES, FEATURES, FEATURES)),
        )
        self._experiments = Experiments(
            vehicles=as_rows(self._vehicles, ROW),
            **{name: getattr(self, f"_{name}") for name in Experiments._fields if name != "vehicles"},
        )

    def __len__(self) -> int:
        """Number of experiments."""
        return len(self._counts)

    @property
    def truth(self) -> FloatArray:
        """The 22 true values of every experiment (privileged), shape (batch, 22); a copy."""
        return self._vehicles[:, :UNKNOWNS].copy()

    @property
    def bits(self) -> FloatArray:
        """Information about each parameter by the chosen filter [bits], shape (batch, 22)."""
        return information_of(self._filters.covariance[self._estimator], self.estimated, self._records)

    @property
    def streams(self) -> tuple[NDArray[np.uint64], NDArray[np.int64]]:
        """Keys of the noise and samples so far, each of shape (batch,); see ``sensors.mean_draw``."""
        return self._keys, self._counts

    def restart(self, which: Iterable[int], rngs: Iterable[np.random.Generator]) -> None:
        """Begin several experiments anew, each from its own generator: at rest, the arm in eq (24)."""
        rows = list(which)
        for i, rng in zip(rows, rngs, strict=True):
            self.seed(i, rng)
        self.begin(rows)

    def set_reality(self, rows: list[int], vectors: FloatArray) -> None:
        """Give some vehicles, before their next experiment, other parameters; shape (len(rows), n)."""
        self._centers[rows] = vectors
        self._sensing[rows] = any_on(vectors, VEHICLE, EFFECTS, "sensor")
        self._odd = any_on(self._centers, VEHICLE, EFFECTS).any().item()

    def set_rules(self, i: int, rules: Rules) -> None:
        """Give an experiment, before it begins again, other rules; estimator and variant stay."""
        self._records[i] = kernel_rules(rules, self.arm, 1)[0]
        self._filters.restart([i], self._prior_means([i]))

    def _prior_means(self, rows: list[int]) -> FloatArray:
        """What the filters of some experiments take for the prior's mean, shape (len(rows), 22)."""
        return np.where(self.estimated, PRIOR_MEAN, self._records["nominal"][rows])

    def seed(self, i: int, rng: np.random.Generator) -> None:
        """Draw the key of experiment ``i``'s noise and its vehicle's factors; ``begin`` then starts it."""
        self._keys[i] = drawn_key(rng)
        self._factors[i] = rng.uniform(-1.0, 1.0, FACTORS)

    def begin(self, rows: list[int]) -> None:
        """Begin several experiments that have been seeded: at rest, the arm in eq (24)."""
        for i in rows:
            spread = float(self._records["truth_spread"][i])
            # Without a spread the preset stays as it is, to the bit; what counts as known is known.
            free = self.estimated if spread > 0.0 else np.zeros(UNKNOWNS, dtype=np.bool_)
            drawn = drawn_around(self._centers[i], spread, self._factors[i])
            self._vehicles[i] = self._centers[i]
            self._vehicles[i, :UNKNOWNS][free] = drawn[:UNKNOWNS][free]
        self._counts[rows] = 0
        self._command[rows] = CONSTANT
        self._phase[rows] = 0.0
        self._states[rows] = 0.0
        records = self._records[rows]
        running = (records["noise"] == RUNNING)[:, None, None]
        self._maxima[rows] = np.where(running, 0.0, records["full_scale"])
        self._base[rows] = 0.0
        # A lagging arm is behind its command already: (24) begins at its largest speed, unaccelerated.
        rate = CONSTANT[AMPLITUDE] * CONSTANT[FREQUENCY]
        lag = as_rows(self._centers[rows], ROW)["actuator_lag"]["time_constant"]
        self._arm_motion[rows] = 0.0
        self._arm_motion[rows, 0] = CONSTANT[OFFSET] - lag * rate
        self._arm_motion[rows, 1] = rate
        self._history[rows] = 0.0
        self._filters.restart(rows)
        self._begun[rows] = self._vehicles[rows, :UNKNOWNS]
        if self.stock is not None:
            self.stock.begin(rows)
            self.stock.shown(np.zeros((len(rows), len(CHANNELS.observed))), rows)  # zeroed at rest
            self._change(rows, 0.0, self.stock)

    def _change(self, rows: Sequence[int], duration: float, stock: Stepped) -> None:
        """Let the unknowns of some vehicles be what they are over the time that comes [s]."""
        if stock.moves:
            change = stock.change(rows, duration) - stock.unchanged(rows)
            self._vehicles[rows, :UNKNOWNS] = self._begun[rows] + change[:, :UNKNOWNS]

    def advance(self, commands: ArrayLike, traces: bool = False) -> Shaken:
        """Shake every vehicle for one decision of 0.4 s in each of its three runs, and estimate.

        Args:
            commands: Wanted amplitude [rad], frequency [rad/s] and offset [rad], shape (batch, 3): clipped to
                the limits, then followed as far as the arm's acceleration allows.
            traces: True also returns the motion of arm and bodies.

        Raises:
            ModelError: If the commands have the wrong shape or are not finite, or an experiment was never
                started.
        """
        batch = len(self)
        wanted = np.asarray(commands, dtype=np.float64)
        if wanted.shape != (batch, 3) or not np.isfinite(wanted).all():
            raise ModelError(f"commands must be finite and have shape ({batch}, 3), not {wanted.shape}")
        if self._counts.min() < 0:
            raise ModelError("restart every experiment before the first decision")
        traced = batch if traces else 0
        motion, bodies = np.empty((traced, SAMPLES + 1, 3)), np.empty((traced, MODES, SAMPLES, 6))
        clipped = np.minimum(np.maximum(wanted, self.ranges[0]), self.ranges[1])
        if self.stock is not None:
            self.stock.clock[:] = self._counts * SAMPLE
            self._change(range(batch), DECISION, self.stock)
        around = self._around
        self._filters.threads = self.threads
        run_rows(
            self.threads if around is None else 1, batch, shake, self._experiments, self._records,
            self._arm, around, self._odd, clipped, *self._sensed, motion, bodies, whole=(2,),
        )  # fmt: skip
        self._filters.update(*self._sensed[1:])
        return self._shaken(motion if traces else None, bodies if traces else None)

    def observe(self) -> Shaken:
        """Where the experiments stand."""
        return self._shaken(None, None)

    def _shaken(self, motion: FloatArray | None, bodies: FloatArray | None) -> Shaken:
        own, naive, filters = self._estimator, "naive", self._filters
        moments, noise, samples = filters.statistic(own)
        return Shaken(
            mean=filters.mean[own].copy(),
            covariance=filters.covariance[own].copy(),
            bits=self.bits,
            mean_naive=filters.mean[naive].copy(),
            covariance_naive=filters.covariance[naive].copy(),
            bits_naive=information_of(filters.covariance[naive], self.estimated, self._records),
            moments=moments,
            noise=noise,
            samples=samples,
            command=self._command.copy(),
            phase=self._phase.copy(),
            base=self._base.copy(),
            variances=variances(self._maxima, self._fractions),
            motion=motion,
            bodies=bodies,
        )

    def state(self) -> dict[str, NDArray[Any]]:
        """An exact snapshot: plain arrays by name."""
        own = {name: getattr(self, f"_{name}").copy() for name in _STATE}
        return own | {f"filters_{name}": part for name, part in self._filters.state().items()}

    def set_state(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Return to a snapshot.

        Raises:
            ModelError: If the snapshot is of other experiments.
        """
        own = self.state()
        if own.keys() != state.keys() or any(own[k].shape != np.shape(state[k]) for k in own):
            raise ModelError("the snapshot is of experiments of another kind or batch size")
        for name in _STATE:
            getattr(self, f"_{name}")[...] = state[name]
        prefix = "filters_"
        self._filters.set_state({k[len(prefix) :]: v for k, v in state.items() if k.startswith(prefix)})


_STATE = (
    "vehicles",
    "keys",
    "counts",
    "command",
    "phase",
    "states",
    "maxima",
    "base",
    "arm_motion",
    "history",
)
