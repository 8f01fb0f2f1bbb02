"""The Kalman filters of ``kalman.py`` once more, by the library filterpy: dense matrices, Joseph form.

They read the same gyro samples and strike angles as the compiled filters and share nothing else with them but
the numbers of leg and noise, so each is the other's proof. A stride takes 18 ms, with the bank 0.4 s.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.estimation.filterpy_reference import ExtendedKalmanFilter, IMMEstimator
from fieldmodels.machines.heel_strike.walker import BANK


class LegFilter(ExtendedKalmanFilter):  # type: ignore[misc]  # filterpy has no types
    """State: angle, speed, process torque per inertia, collision noise; the leg moves by the leapfrog.

    Args:
        levels: What the filter is given of the noise, shape (4,); see ``filter_levels``.
        walk: Leg and noise, one row of ``kernel_walk``.
    """

    def __init__(self, levels: FloatArray, walk: Any) -> None:
        super().__init__(dim_x=4, dim_z=1)
        self.walk, self.levels = walk, levels
        self.x = np.array([0.0, walk.speed, 0.0, 0.0])
        self.P = np.diag([0.0, 0.0, levels[0] / (1 - walk.torque_memory**2), levels[3]])
        self.Q = np.diag([0.0, 0.0, levels[0], levels[1]])
        self.R = np.array([[walk.gyro_variance]])
        half, memory = walk.step / 2, np.diag([1, 1, walk.torque_memory, walk.correlation])
        self._drift = np.array([[1, half, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
        self._drift_and_memory = memory @ self._drift

    def predict_x(self, u: Any = 0) -> None:  # noqa: ARG002
        """Move the mean by a sample, and take the Jacobian there."""
        step, stiffness = self.walk.step, self.walk.stiffness
        middle = self._drift @ self.x
        kick = np.eye(4)
        kick[1, 0], kick[1, 2] = -step * stiffness * np.cos(middle[0]), step
        self.F = self._drift_and_memory @ kick @ self._drift
        middle[1] += step * (middle[2] - stiffness * np.sin(middle[0]))
        self.x = self._drift_and_memory @ middle

    def read_gyro(self, gyro: float, envelope: float) -> None:
        """Take in a gyro sample [rad/s]: speed plus collision noise under its envelope, plus white noise."""
        h = np.array([[0.0, 1.0, 0.0, envelope]])
        self.update(np.array([gyro]), lambda _: h, lambda x: h @ x)

    def read_angle(self, angle: float) -> None:
        """Take in the angle that the geometry gives at a strike [rad]."""
        h = np.array([[1.0, 0.0, 0.0, 0.0]])
        self.update(np.array([angle]), lambda _: h, lambda x: h @ x, R=np.array([[self.levels[2]]]))

    def strike(self) -> None:
        """The push-off, known to the robot, and a collision noise that begins anew."""
        keep = np.diag([1.0, 1 - self.walk.push_off, 1.0, 0.0])
        aim = np.array([0.0, self.walk.push_off * np.copysign(self.walk.speed, self.x[1]), 0.0, 0.0])
        self.x = keep @ self.x + aim
        self.P = keep @ self.P @ keep + np.diag([0, 0, 0, self.levels[3]])


class WalkerFilters:
    """One walker's filters: the one that is given the typical noise, and perhaps the bank of eight.

    Args:
        walk: Leg and noise, one row of ``kernel_walk``.
        use_bank: Whether the bank runs.
    """

    def __init__(self, walk: Any, use_bank: bool) -> None:
        self.walk = walk
        self.typical = LegFilter(walk.levels[BANK], walk)
        self.bank: Any = None
        if use_bank:
            members = [LegFilter(levels, walk) for levels in walk.levels[:BANK]]
            self.bank = IMMEstimator(members, np.full(BANK, 1 / BANK), np.array(walk.transition))

    @property
    def members(self) -> list[LegFilter]:
        """All filters, the typical one first."""
        return [self.typical, *(self.bank.filters if self.bank else ())]

    def follow(self, gyro: FloatArray, geometry: float, begins: bool) -> tuple[float, float]:
        """Follow one stride, and take in the angle of the strike that closes it.

        Args:
            gyro: Samples of the stride [rad/s], shape (samples,).
            geometry: Angle that the geometry gives at its end [rad].
            begins: Whether no strike came before this stride.

        Returns:
            Angle at the closing strike, before it is taken in [rad]: the typical filter's, and the bank's
            (NaN without one).
        """
        if not begins:
            for member in self.members:
                member.strike()
        evidence = np.zeros(BANK)
        for n, value in enumerate(gyro, start=1):
            for member in self.members:
                member.predict()
                member.read_gyro(value, max(0.0, 1 - n / self.walk.envelope))
            if self.bank:
                evidence += [member.log_likelihood for member in self.bank.filters]
        angle, mixture = float(self.typical.x[0]), np.nan
        if self.bank:
            self._weigh(evidence)
            mixture = float(self.bank.mu @ [member.x[0] for member in self.bank.filters])
        for member in self.members:
            member.read_angle(geometry)
        if self.bank:
            self._weigh(np.array([member.log_likelihood for member in self.bank.filters]))
            self._mix()
        return angle, mixture

    def _weigh(self, evidence: FloatArray) -> None:
        """Weigh the bank's filters by their log likelihoods, shape (8,)."""
        weights = self.bank.mu * np.exp(evidence - evidence.max())
        self.bank.mu = weights / weights.sum()

    def _mix(self) -> None:
        """Let the regimes switch. filterpy mixes at every prediction; here they switch at strikes alone."""
        bank = self.bank
        bank._compute_mixing_probabilities()
        mixed = []
        for share in bank.omega.T:
            x = sum(w * f.x for w, f in zip(share, bank.filters, strict=True))
            spread = [f.P + np.outer(f.x - x, f.x - x) for f in bank.filters]
            mixed.append((x, np.tensordot(share, spread, axes=1)))
        for member, (x, p) in zip(bank.filters, mixed, strict=True):
            member.x, member.P = x, p
        bank.mu = bank.cbar


class LibraryFilters:
    """The filters of a batch of walkers.

    Args:
        batch: Number of walkers.
        use_bank: Whether each has the bank.
    """

    def __init__(self, batch: int, use_bank: bool) -> None:
        self._use_bank = use_bank
        self.walkers: list[WalkerFilters | None] = [None] * batch

    def begin(self, i: int, walk: Any) -> None:
        """Start walker ``i`` anew; ``walk`` is one row of ``kernel_walk``."""
        self.walkers[i] = WalkerFilters(walk, self._use_bank)

    def signed_mm(
        self, traces: FloatArray, truth: FloatArray, samples: NDArray[np.int64], walkers: NDArray[Any]
    ) -> FloatArray:
        """Follow a stride of every walker; errors as of ``StrideResult.signed_mm``, shape (batch, 2).

        Args:
            traces: Gyro samples [rad/s], shape (batch, longest).
            truth: Angle at the closing strike [rad], shape (batch,).
            samples: Samples of the stride, shape (batch,).
            walkers: As they stand after it, shape (batch,), dtype ``WALKER``.
        """
        errors = np.empty((len(self.walkers), 2))
        for i, filters in enumerate(self.walkers):
            assert filters is not None
            begins = bool(walkers["stride"][i] == 1)
            found = filters.follow(traces[i, : samples[i]], float(walkers["geometry"][i]), begins)
            errors[i] = (np.array(found) - truth[i]) * filters.walk.millimetres
        return errors

    def state(self) -> dict[str, FloatArray]:
        """An exact snapshot: means, covariances, and the bank's weights."""
        every = [filters for filters in self.walkers if filters is not None]
        return {
            "means": np.array([[member.x for member in filters.members] for filters in every]),
            "covariances": np.array([[member.P for member in filters.members] for filters in every]),
            "weights": np.array([filters.bank.mu for filters in every if filters.bank]),
        }

    def set_state(self, state: Mapping[str, FloatArray]) -> None:
        """Return to a snapshot."""
        for i, filters in enumerate(self.walkers):
            assert filters is not None
            for k, member in enumerate(filters.members):
                member.x, member.P = state["means"][i, k].copy(), state["covariances"][i, k].copy()
            if filters.bank:
                filters.bank.mu = state["weights"][i].copy()
