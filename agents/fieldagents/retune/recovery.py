"""How much of what a wrong simulation costs an agent is recovered by re-tuning in the extended simulation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fieldagents.evaluation.comparison import Interval, compare

RESAMPLES = 10_000


@dataclass(frozen=True)
class Recovery:
    """Share of the loss that re-tuning recovers.

    Attributes:
        outcome: ``measured``; ``nothing to recover`` if the oracle is not better than the nominal agent;
            ``insufficient`` with too few episodes to say whether it is.
        share: (nominal - retuned) / (nominal - oracle) of the mean scores: 1 for all, below 0 where re-tuning
            did harm. None if there is nothing to recover.
        ci95: Percentile bootstrap interval over episodes; None unless measured. It does not hold the chance
            of the tuning itself.
    """

    outcome: Literal["measured", "nothing to recover", "insufficient"]
    share: float | None
    ci95: Interval | None


def recovery(
    nominal: ArrayLike,
    retuned: ArrayLike,
    oracle: ArrayLike,
    *,
    lower_is_better: bool,
    binary: bool = False,
    rng: np.random.Generator,
) -> Recovery:
    """Compare three agents on the same episodes.

    Args:
        nominal: Scores of the agent tuned in the nominal simulation, shape (episodes,).
        retuned: Of the one tuned in the extended simulation, on the same episodes.
        oracle: Of the one tuned in the reality in which all three are tested, on the same episodes.
        lower_is_better: Whether a lower score is a better one.
        binary: Whether the scores are successes.
        rng: Source of the resampling.
    """
    loss_of_nominal = compare(oracle, nominal, lower_is_better=lower_is_better, binary=binary)
    if loss_of_nominal.verdict in ("worse", "cannot tell"):
        return Recovery("nothing to recover", None, None)
    worst, learned, best = (np.asarray(x, dtype=np.float64) for x in (nominal, retuned, oracle))
    gain, loss = worst - learned, worst - best
    if loss_of_nominal.verdict == "insufficient":
        return Recovery("insufficient", _ratio(gain.mean(), loss.mean()), None)
    drawn = rng.integers(len(loss), size=(RESAMPLES, len(loss)))
    gains, losses = gain[drawn].mean(axis=1), loss[drawn].mean(axis=1)
    shares = gains[losses != 0] / losses[losses != 0]
    low, high = np.quantile(shares, (0.025, 0.975))
    return Recovery("measured", _ratio(gain.mean(), loss.mean()), (float(low), float(high)))


def pooled_recovery(
    nominal: ArrayLike,
    retuned: ArrayLike,
    oracle: ArrayLike,
    *,
    lower_is_better: bool,
    rng: np.random.Generator,
) -> Recovery:
    """Compare three agents over many realities: what is recovered in all of them over what is lost in all.

    A ratio of sums, since in a reality where about nothing is lost the share can be any number. The interval
    is that of a hierarchical bootstrap: realities are drawn, and in each of these its episodes.

    Args:
        nominal: Scores of the agent tuned in the nominal simulation, shape (realities, episodes).
        retuned: Of the one tuned by each reality's diagnosis, on the same episodes.
        oracle: Of the one tuned in each reality itself, on the same episodes.
        lower_is_better: Whether a lower score is a better one.
        rng: Source of the resampling.
    """
    sign = 1.0 if lower_is_better else -1.0
    worst, learned, best = (sign * np.asarray(x, dtype=np.float64) for x in (nominal, retuned, oracle))
    gain, loss = worst - learned, worst - best
    many, each = loss.shape
    sums = np.empty((RESAMPLES, 2))
    for one in sums:
        where, which = rng.integers(many, size=(many, 1)), rng.integers(each, size=(many, each))
        one[:] = gain[where, which].mean(), loss[where, which].mean()
    if np.quantile(sums[:, 1], 0.025) <= 0:
        return Recovery("nothing to recover", None, None)
    shares = sums[sums[:, 1] > 0]
    low, high = np.quantile(shares[:, 0] / shares[:, 1], (0.025, 0.975))
    return Recovery("measured", _ratio(gain.mean(), loss.mean()), (float(low), float(high)))


def _ratio(gain: NDArray[np.float64] | float, loss: NDArray[np.float64] | float) -> float | None:
    return float(gain / loss) if loss else None
