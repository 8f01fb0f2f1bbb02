"""Yes-or-no outputs: the exact Bernoulli likelihood of single looks beside the Gaussian one of averages.

An event feature is one look: 1 if something happened, 0 if not; the simulation gives its probability p.
Residuals (y - p) / sqrt(p (1 - p)) with columns dp / sqrt(p (1 - p)) make a Gauss-Newton step one of Fisher
scoring, whose gradient is the exact one of the likelihood.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray

CERTAIN = 1e-6
"""How close to 0 or 1 a probability counts: a simulation that is certain and wrong pays 14 nats a look."""


@dataclass(frozen=True)
class Looks:
    """The event features of a problem.

    Attributes:
        columns: Which features are events, shape (features,).
        seen: Whether a look was made, shape (windows, events).
        happened: What it found, 0 or 1 (0 without a look), shape (windows, events).
    """

    columns: NDArray[np.bool_]
    seen: NDArray[np.bool_]
    happened: FloatArray

    def select(self, which: NDArray[np.bool_] | slice) -> Looks:
        """The looks of some windows."""
        return Looks(self.columns, self.seen[which], self.happened[which])

    def probability(self, raw: FloatArray) -> FloatArray:
        """Simulated probabilities behind residuals, inside (0, 1), shape (windows, events)."""
        return np.clip(self.happened - raw[:, self.columns], CERTAIN, 1.0 - CERTAIN)

    def weight(self, raw: FloatArray) -> FloatArray:
        """What a residual is multiplied by before whitening, shape (windows, features).

        It is 1 for an average, 1 / sqrt(p (1 - p)) for a look, and 0 for one that was not made.
        """
        result = np.ones(raw.shape)
        p = self.probability(raw)
        result[:, self.columns] = self.seen / np.sqrt(p * (1.0 - p))
        return result

    def loss(self, raw: FloatArray, change: FloatArray | None = None) -> FloatArray:
        """Negative log-likelihood [nats] of every look, shape (windows, events).

        Args:
            raw: Measured minus simulated features, shape (windows, features).
            change: Change of the log-odds, shape (windows, events): a linearised step that keeps
                probabilities probabilities.
        """
        p = self.probability(raw)
        odds = np.log(p / (1.0 - p))
        if change is not None:
            limit = np.log((1.0 - CERTAIN) / CERTAIN)
            odds = np.clip(odds + change, -limit, limit)
        return np.where(self.seen, np.logaddexp(0.0, odds) - self.happened * odds, 0.0)

    def averages(self, raw: FloatArray) -> FloatArray:
        """Residuals with the looks' set to zero, shape (windows, features)."""
        return np.where(self.columns, 0.0, raw)

    def rows(self, whitener: FloatArray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Which rows of a whitener are looks, and which of the events each one is.

        Looks are never whitened with each other or with averages: such a row has a single 1.
        """
        row, event = np.nonzero(whitener[:, self.columns])
        return row, event


def calibration(probability: FloatArray, happened: FloatArray, bins: int = 10) -> FloatArray:
    """Predicted against observed frequency: what a calibration curve draws.

    Args:
        probability: Simulated probability of every look, shape (looks,).
        happened: What each found, 0 or 1, shape (looks,).
        bins: Largest number of groups; each holds equally many looks.

    Returns:
        Mean probability, observed frequency, its standard error if the probabilities are right, and the
        number of looks, shape (groups, 4).
    """
    order = np.argsort(probability, kind="stable")
    rows = []
    for group in np.array_split(order, max(1, min(bins, len(order) // 10))):
        if len(group):
            p = probability[group]
            error = np.sqrt(np.sum(p * (1.0 - p))) / len(group)
            rows.append([p.mean(), happened[group].mean(), error, len(group)])
    return np.array(rows).reshape(-1, 4)
