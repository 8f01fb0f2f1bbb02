"""Walkers that advance stride by stride: what environments and evaluations work with."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled
from fieldmodels.declared import neutral
from fieldmodels.drivers.stepped import Channels, Stepped
from fieldmodels.machines.heel_strike.declaration import BASE, EFFECTS, as_plants
from fieldmodels.machines.heel_strike.kernel import advance, read_levels, start
from fieldmodels.machines.heel_strike.lanes import room_for
from fieldmodels.machines.heel_strike.parameters import Leg, Noise, Regimes
from fieldmodels.machines.heel_strike.walker import (
    ESTIMATORS,
    HISTORY,
    LIBRARY,
    TRACES,
    WALKER,
    Walk,
    kernel_walk,
)
from fieldmodels.model import ModelError
from fieldmodels.streams import drawn_key
from fieldmodels.threads import run_rows

if TYPE_CHECKING:
    from fieldmodels.machines.heel_strike.filterpy_filters import LibraryFilters

CHANNELS = Channels(
    observed=("gyro", "strike_angle"),
    without="its actions are an estimator's gains, and nobody commands the leg",
    prompt=("strike_angle",),
)
"""Where stock effects can act on a walker."""


class StrideResult(NamedTuple):
    """What one stride of every walker gave.

    Attributes:
        signed_mm: Estimated minus true foot height at the closing strike, before the reset [mm], shape
            (batch, 5), columns as in ``ESTIMATORS``: agent, ranger (eq (2.3), a tenth of the geometry),
            ranger_tuned, ekf (reference filter, given the typical noise), imm (NaN without the bank);
            with filterpy (batch, 7): then those of ``LIBRARY``.
        floor_mm: Height error of the floor at the closing strike [mm], shape (batch,).
        duration: Time of the stride [s], shape (batch,).
        samples: Samples of the stride, shape (batch,), int64.
        fallen: True where the leg did not come to a strike within the limit, shape (batch,).
        features: Of the reference filter, shape (batch, 6), columns as in ``FEATURES``.
        levels: Regime of the stride just made (privileged), 0 low or 1 high, shape (batch, 3), columns
            process, floor, collision.
        next_levels: Regime of the stride to come (privileged), shape (batch, 3).
        traces: Samples of the stride, shape (batch, longest, 8), columns as in ``TRACES``, NaN beyond a
            walker's last sample; None unless asked for.
    """

    signed_mm: FloatArray
    floor_mm: FloatArray
    duration: FloatArray
    samples: NDArray[np.int64]
    fallen: NDArray[np.bool_]
    features: FloatArray
    levels: NDArray[np.int64]
    next_levels: NDArray[np.int64]
    traces: FloatArray | None = None

    def error_mm(self, estimator: str = "agent", floor_added: bool | NDArray[np.bool_] = False) -> FloatArray:
        """Absolute error of one estimator [mm], shape (batch,).

        Args:
            estimator: One of ``ESTIMATORS`` or, with filterpy, of ``LIBRARY``.
            floor_added: True, for each walker or all, adds the floor's height error (section 2.4.5).
        """
        signed = self.signed_mm[:, (*ESTIMATORS, *LIBRARY).index(estimator)]
        return np.abs(signed + np.where(floor_added, self.floor_mm, 0.0))


@compiled
def levels_of(walkers: NDArray[Any]) -> NDArray[np.int64]:
    """Regimes of walkers, shape (batch, 3): process, floor, collision."""
    levels = np.empty((len(walkers), 3), dtype=np.int64)
    for i in range(len(walkers)):
        read_levels(walkers[i], levels[i])
    return levels


class Strides:
    """A batch of walkers in one reality (or one reality each), advanced stride by stride.

    Truth and noise depend on a walker's seed alone, never on gains or on its neighbours in the batch:
    equal seeds give every agent the same walk, to the bit.

    Attributes:
        walkers: All state, shape (batch,), dtype ``WALKER``.
        plants: What each leg and gyro truly are, shape (batch,), dtype ``PLANT``.
        extended: Which of them have an effect, shape (batch,).
        stock: Stock effects around the walkers, or None.
        library: The same Kalman filters by filterpy, or None.
        threads: On which the rows advance, side by side; in one where stock effects sense.
    """

    threads = 1

    def __init__(
        self,
        batch: int,
        leg: Leg | None = None,
        noise: Noise | Regimes | None = None,
        reality: ArrayLike | None = None,
        *,
        bank: bool = False,
        cromer: bool = True,
        ranger_reset: float = 0.1,
        tuned_reset: float = 1.0,
        stock: Stepped | None = None,
        filterpy: bool = False,
    ) -> None:
        """Make walkers; seed each before the first stride.

        Args:
            batch: Number of walkers.
            leg: The nominal leg, which the estimators believe in.
            noise: Stationary noise, or hidden regimes (default: the ``low_pass`` regimes).
            reality: Parameter vector of ``HeelStrikeModel``, shape (n,) or (batch, n); None is nominal.
            bank: True also runs the interacting-multiple-model bank of eight filters (five times slower).
            cromer: True integrates the agent's estimator by (2.14), False by (2.9).
            ranger_reset: Share of the geometry in Ranger's reset (2.3).
            tuned_reset: The same of the tuned Ranger.
            stock: Stock effects around them, by ``CHANNELS``; parameters change from stride to stride.
            filterpy: True also runs the Kalman filters by the library filterpy.

        Raises:
            ModelError: If the reality has the wrong shape, the batch is empty, the gyro's delay holds more
                samples than a walker remembers.
            MissingExtraError: If filterpy is asked for and not installed.
        """
        if batch < 1:
            raise ModelError(f"a batch needs at least one walker, not {batch}")
        self.leg = leg or Leg()
        self.regimes = Regimes.fixed(noise) if isinstance(noise, Noise) else noise or Regimes()
        vector = neutral(BASE, EFFECTS) if reality is None else np.asarray(reality, dtype=np.float64)
        if vector.shape[:-1] not in ((), (batch,)):
            raise ModelError(f"a reality has shape (n,) or ({batch}, n), not {vector.shape}")
        plants, extended = as_plants(vector)
        if reality is None:
            plants["length"] = self.leg.length
        self._check_delay(plants)
        self.plants = np.array(np.broadcast_to(plants, (batch,)))
        self.extended = np.array(np.broadcast_to(extended, (batch,)))
        self.bank = bank
        self._room = np.empty(0, room_for(batch))  # says to the kernel how many go side by side
        self._untraced = np.empty((batch, 0, len(TRACES)))
        self.walkers: NDArray[Any] = np.zeros(batch, dtype=WALKER)
        walk = Walk(self.leg, self.regimes, cromer, ranger_reset, tuned_reset)
        self._walks = kernel_walk(walk, batch)
        self._keys = np.zeros(batch, dtype=np.uint64)
        self._unseeded = set(range(batch))
        self.stock = stock
        self.library: LibraryFilters | None = None
        if filterpy:
            from fieldmodels.machines.heel_strike.filterpy_filters import LibraryFilters

            self.library = LibraryFilters(batch, bank)

    def __len__(self) -> int:
        """Number of walkers."""
        return len(self.walkers)

    def set_reality(self, rows: list[int], vectors: FloatArray) -> None:
        """Give some walkers, before their next walk, other parameters; shape (len(rows), n).

        Raises:
            ModelError: If a gyro's delay holds more samples than a walker remembers.
        """
        plants, extended = as_plants(vectors)
        self._check_delay(plants)
        self.plants[rows], self.extended[rows] = plants, extended

    def _check_delay(self, plants: NDArray[Any]) -> None:
        latest = float(plants["gyro_delay"]["delay"].max()) / self.leg.step
        if latest > HISTORY - 2:
            raise ModelError(
                f"a gyro's delay of {latest:.1f} samples is longer than the {HISTORY - 2} that a walker "
                f"remembers: a longer step than {self.leg.step:g} s, or a shorter delay"
            )

    def seed(self, i: int, rng: np.random.Generator) -> None:
        """Start walker ``i`` anew with streams keyed by one draw from ``rng``."""
        self._keys[i] = drawn_key(rng)
        self._start(i)
        if self.stock is not None:
            self.stock.begin([i])
        self._unseeded.discard(i)

    def set_walk(self, i: int, walk: Walk) -> None:
        """Let walker ``i``, which has been seeded, begin with another leg, of the same step, and noise."""
        self._walks[i] = kernel_walk(walk, 1)[0]
        self._start(i)

    def _start(self, i: int) -> None:
        start(self.walkers, i, self._keys[i], self._walks)
        if self.library is not None:
            self.library.begin(i, self._walks.view(np.recarray)[i])

    def restart(self, which: Iterable[int], rngs: Iterable[np.random.Generator]) -> None:
        """Start several walkers anew, each from its own generator."""
        for i, rng in zip(which, rngs, strict=True):
            self.seed(int(i), rng)

    @property
    def features(self) -> FloatArray:
        """Features of the reference filter as they stand, shape (batch, 6); a copy."""
        return np.array(self.walkers["features"])

    @property
    def levels(self) -> NDArray[np.int64]:
        """Regime of the stride to come (privileged), shape (batch, 3): process, floor, collision."""
        return levels_of(self.walkers)

    def advance(self, gains: ArrayLike, traces: bool = False) -> StrideResult:
        """Take every walker through one stride.

        A stride begins just after a strike: the agent's S_HR of this call resets its angle there, then
        S_MS and S_FD hold until the next strike, where the error is taken before the next reset.

        Args:
            gains: S_MS early, S_MS late, S_HR, S_FD [1/s], shape (batch, 4) or (4,).
            traces: True also returns the samples.

        Raises:
            ModelError: If the gains have the wrong shape or a walker was never seeded.
        """
        batch = len(self)
        values = np.asarray(gains, dtype=np.float64)
        if values.shape not in ((4,), (batch, 4)):
            raise ModelError(f"gains must have shape (4,) or ({batch}, 4), not {values.shape}")
        if self._unseeded:
            raise ModelError("seed every walker before the first stride")
        if values.ndim == 1:
            values = np.tile(values, (batch, 1))
        sensors = None
        if self.stock is not None:
            self._change(self.stock)
            sensors = self.stock.sensors if self.stock.senses else None
        signed = np.empty((batch, len(ESTIMATORS)))
        levels = np.empty((batch, 2, 3), dtype=np.int64)
        floors, duration = np.empty(batch), np.empty(batch)
        samples = np.empty(batch, dtype=np.int64)
        fallen = np.empty(batch, dtype=np.bool_)
        trace = self._untraced
        if traces or self.library is not None:
            trace = np.full((batch, int(self._walks["limit"].max()), len(TRACES)), np.nan)
        run_rows(
            self.threads if sensors is None else 1,
            batch,
            advance,
            self.walkers,
            values,
            self.plants,
            self.extended,
            sensors,
            self._walks,
            self.bank,
            signed,
            floors,
            duration,
            samples,
            fallen,
            levels,
            trace,
            self._room,
        )
        if self.library is not None:
            gyro = trace[:, :, TRACES.index("gyro")]
            library = self.library.signed_mm(gyro, self.walkers["theta"], samples, self.walkers)
            signed = np.column_stack([signed, library])
        return StrideResult(
            signed_mm=signed,
            floor_mm=floors,
            duration=duration,
            samples=samples,
            fallen=fallen,
            features=self.features,
            levels=levels[:, 0],
            next_levels=levels[:, 1],
            traces=trace[:, : samples.max()].copy() if traces else None,
        )

    def _change(self, stock: Stepped) -> None:
        """Let parameters be what they are when a stride begins."""
        if stock.moves:
            every = list(range(len(self)))
            stock.clock[:] = self.walkers["sample"] * self.leg.step
            self.set_reality(every, stock.change(every, 0.0))

    def state(self) -> NDArray[Any]:
        """An exact snapshot of all walkers: a plain structured array, shape (batch,)."""
        return self.walkers.copy()

    def set_state(self, state: NDArray[Any], library: Mapping[str, FloatArray] | None = None) -> None:
        """Return to a snapshot, with filterpy also to that of ``library.state()``.

        Raises:
            ModelError: If the snapshot is of another batch size or kind.
        """
        if state.dtype != WALKER or state.shape != self.walkers.shape:
            raise ModelError(f"a snapshot of {len(self)} walkers is needed, not {state.shape} {state.dtype}")
        if (library is None) != (self.library is None):
            raise ModelError("the snapshot and the walkers differ in whether filterpy's filters run")
        self.walkers[...] = state
        if self.library is not None and library is not None:
            self.library.set_state(library)
        self._unseeded.clear()
