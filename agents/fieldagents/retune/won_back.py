"""How much of what a wrong simulation costs an agent is won back by the simulation that has learned."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fieldagents.evaluation.comparison import Interval, compare

RESAMPLES = 10_000


@dataclass(frozen=True)
class WonBack:
    """Share of the loss that re-tuning wins back.

    Attributes:
        outcome: ``measured``; ``nothing to win`` if the oracle is not better than the nominal agent;
            ``insufficient`` with too few episodes to say whether it is.
        share: (nominal - retuned) / (nominal - oracle) of the mean scores: 1 for all, below 0 where re-tuning
            did harm. None if there is nothing to win.
        ci95: Percentile bootstrap interval over episodes; None unless measured. It does not hold the chance
            of the tuning itself.
    """

    outcome: Literal["measured", "nothing to win", "insufficient"]
    share: float | None
    ci95: Interval | None


def won_back(
    nominal: ArrayLike,
    retuned: ArrayLike,
    oracle: ArrayLike,
    *,
    lower_is_better: bool,
    binary: bool = False,
    rng: np.random.Generator,
) -> WonBack:
    """Compare three agents on the same episodes.

    Args:
        nominal: Scores of the agent designed in the nominal simulation, shape (episodes,).
        retuned: Of the one designed in the extended simulation, on the same episodes.
        oracle: Of the one designed in the reality in which all three are flown, on the same episodes.
        lower_is_better: Whether a lower score is a better one.
        binary: Whether the scores are successes.
        rng: Source of the resampling.
    """
    to_win = compare(oracle, nominal, lower_is_better=lower_is_better, binary=binary)
    if to_win.verdict in ("worse", "cannot tell"):
        return WonBack("nothing to win", None, None)
    worst, learned, best = (np.asarray(x, dtype=np.float64) for x in (nominal, retuned, oracle))
    won, loss = worst - learned, worst - best
    if to_win.verdict == "insufficient":
        return WonBack("insufficient", _ratio(won.mean(), loss.mean()), None)
    drawn = rng.integers(len(loss), size=(RESAMPLES, len(loss)))
    gains, losses = won[drawn].mean(axis=1), loss[drawn].mean(axis=1)
    shares = gains[losses != 0] / losses[losses != 0]
    low, high = np.quantile(shares, (0.025, 0.975))
    return WonBack("measured", _ratio(won.mean(), loss.mean()), (float(low), float(high)))


def _ratio(won: NDArray[np.float64] | float, loss: NDArray[np.float64] | float) -> float | None:
    return float(won / loss) if loss else None
