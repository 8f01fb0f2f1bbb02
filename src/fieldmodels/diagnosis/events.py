"""Binary outputs: the exact Bernoulli likelihood of single observations beside the Gaussian one of averages.

An event feature is one observation y: 1 if something happened, 0 if not; the simulation gives its
probability p. With residuals (y - p) / sqrt(p (1 - p)) and columns dp / sqrt(p (1 - p)) a Gauss-Newton
step is a step of Fisher scoring, with the exact gradient of the likelihood.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray

CERTAIN = 1e-6
"""Smallest distance of a probability from 0 and 1: a certain but wrong simulation loses 14 nats each time."""


@dataclass(frozen=True)
class Observations:
    """The event features of a problem.

    Attributes:
        columns: Which features are events, shape (features,).
        seen: Whether an observation was made, shape (windows, events).
        happened: Its value, 0 or 1 (0 without an observation), shape (windows, events).
    """

    columns: NDArray[np.bool_]
    seen: NDArray[np.bool_]
    happened: FloatArray

    def select(self, which: NDArray[np.bool_] | slice) -> Observations:
        """The observations of some windows."""
        return Observations(self.columns, self.seen[which], self.happened[which])

    def probability(self, raw: FloatArray) -> FloatArray:
        """Simulated probabilities recovered from residuals, inside (0, 1), shape (windows, events)."""
        return np.clip(self.happened - raw[:, self.columns], CERTAIN, 1.0 - CERTAIN)

    def weight(self, raw: FloatArray) -> FloatArray:
        """Weight of each residual before whitening, shape (windows, features).

        It is 1 for an average, 1 / sqrt(p (1 - p)) for an observation, and 0 for one that was not made.
        """
        result = np.ones(raw.shape)
        p = self.probability(raw)
        result[:, self.columns] = self.seen / np.sqrt(p * (1.0 - p))
        return result

    def loss(self, raw: FloatArray, change: FloatArray | None = None) -> FloatArray:
        """Negative log-likelihood [nats] of every observation, shape (windows, events).

        Args:
            raw: Measured minus simulated features, shape (windows, features).
            change: Change of the log-odds, shape (windows, events): a linearised step after
                which probabilities stay inside (0, 1).
        """
        p = self.probability(raw)
        odds = np.log(p / (1.0 - p))
        if change is not None:
            limit = np.log((1.0 - CERTAIN) / CERTAIN)
            odds = np.clip(odds + change, -limit, limit)
        return np.where(self.seen, np.logaddexp(0.0, odds) - self.happened * odds, 0.0)

    def averages(self, raw: FloatArray) -> FloatArray:
        """Residuals with those of events set to zero, shape (windows, features)."""
        return np.where(self.columns, 0.0, raw)

    def rows(self, whitener: FloatArray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Which rows of a whitener are events, and the index of each.

        Events are never whitened with each other or with averages: such a row has a single 1.
        """
        row, event = np.nonzero(whitener[:, self.columns])
        return row, event


def calibration(probability: FloatArray, happened: FloatArray, bins: int = 10) -> FloatArray:
    """Calibration curve: predicted probability against observed frequency.

    Args:
        probability: Simulated probability of every observation, shape (observations,).
        happened: Value of each, 0 or 1, shape (observations,).
        bins: Maximal number of groups, of equal size.

    Returns:
        Mean probability, observed frequency, its standard error if the probabilities are right, and the
        number of observations, shape (groups, 4).
    """
    order = np.argsort(probability, kind="stable")
    rows = []
    for group in np.array_split(order, max(1, min(bins, len(order) // 10))):
        if len(group):
            p = probability[group]
            error = np.sqrt(np.sum(p * (1.0 - p))) / len(group)
            rows.append([p.mean(), happened[group].mean(), error, len(group)])
    return np.array(rows).reshape(-1, 4)
