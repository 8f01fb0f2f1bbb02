"""What an evaluation says of all its agents together: who leads, by how much, and how sure that is."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats

from fieldagents.evaluation.comparison import MIN_EPISODES, MIN_RUNS, Interval, Verdict
from fieldagents.task import Metric

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Pair:
    """Two agents on the same episodes, among all pairs of a scenario.

    Attributes:
        agent: The one that is judged.
        other: The one it is compared with.
        difference: Mean of ``agent`` minus ``other``; None without an episode in which both have a value.
        ci95: Its interval over training runs and episodes together, for this pair alone.
        p: Probability of such a difference between equal agents, corrected for the number of pairs (Holm).
        verdict: By ``p`` at 5 %: among all pairs of equal agents, one false verdict in twenty evaluations.
        of_algorithms: Whether training runs count as drawn at random, so that the verdict is about the
            algorithms; else it is about these very policies.
    """

    agent: str
    other: str
    difference: float | None
    ci95: Interval | None
    p: float | None
    verdict: Verdict
    of_algorithms: bool


@dataclass(frozen=True)
class Standing:
    """How an agent stands among all.

    Attributes:
        middle: Interquartile mean over runs and episodes: a few bad episodes do not move it.
        improvement: Probability that an episode of this agent is better than the same one of the baseline,
            ties counted half; None for the baseline.
        gap: Part of the way from the baseline to the best privileged agent; None without one, or for itself.
    """

    middle: float | None
    improvement: float | None
    gap: float | None


def scores_of(episodes: pd.DataFrame, metric: Metric) -> dict[str, Floats]:
    """Every agent's scores, shape (runs, episodes), episodes in the order of their seeds; NaN where none."""
    table = episodes.pivot_table(index=["agent", "run"], columns="seed", values=metric.name, dropna=False)
    return {
        str(agent): table.loc[agent].dropna(how="all").to_numpy(dtype=np.float64)
        if table.loc[agent].notna().any(axis=None)
        else np.full((1, table.shape[1]), np.nan)
        for agent in episodes["agent"].unique()
    }


def all_pairs(scores: Mapping[str, Floats], metric: Metric, learned: Collection[str]) -> tuple[Pair, ...]:
    """Compare every agent with every other; verdicts are corrected for their number.

    Args:
        scores: See `scores_of`.
        metric: Which score it is.
        learned: Agents that were trained; with fewer than ``MIN_RUNS`` runs they stand for themselves alone.
    """
    found = []
    for a, b in combinations(scores, 2):
        runs = [len(scores[name]) for name in (a, b) if name in learned]
        of_algorithms = bool(runs) and min(runs) >= MIN_RUNS
        found.append((a, b, *_difference(scores[a], scores[b], metric.binary, of_algorithms), of_algorithms))
    corrected = holm([p for *_, p, _ in found])
    return tuple(
        Pair(a, b, difference, interval, p, _verdict(difference, p, metric), of_algorithms)
        for (a, b, difference, interval, _, of_algorithms), p in zip(found, corrected, strict=True)
    )


def standings(
    scores: Mapping[str, Floats], baseline: str, privileged: set[str], metric: Metric
) -> dict[str, Standing]:
    """How every agent stands; see `Standing`."""
    means = {name: float(np.nanmean(x)) for name, x in scores.items() if not np.isnan(x).all()}
    bounds = [means[name] for name in privileged if name in means]
    ceiling = (min(bounds) if metric.lower_is_better else max(bounds)) if bounds else None
    result = {}
    for name, own in scores.items():
        gap = None
        if ceiling is not None and name in means and baseline in means and name not in privileged:
            way = ceiling - means[baseline]
            gap = (means[name] - means[baseline]) / way if way and name != baseline else None
        improvement = None
        if name != baseline:
            improvement = probability_of_improvement(own, scores[baseline], metric.lower_is_better)
        result[name] = Standing(interquartile_mean(own), improvement, gap)
    return result


def interquartile_mean(scores: Floats) -> float | None:
    """Mean of the middle half of all runs' episodes; None without any value."""
    present = scores[~np.isnan(scores)]
    return float(stats.trim_mean(present, 0.25)) if len(present) else None


def probability_of_improvement(agent: Floats, baseline: Floats, lower_is_better: bool) -> float | None:
    """Part of the pairs of runs on an episode in which the agent is the better one; ties count half."""
    difference = agent[:, None] - baseline[None]
    difference = difference[~np.isnan(difference)]
    if not len(difference):
        return None
    better = difference < 0 if lower_is_better else difference > 0
    return float(np.mean(better) + 0.5 * np.mean(difference == 0))


def holm(p: list[float | None]) -> list[float | None]:
    """Holm's correction: p values that may be read as if there were only one; None stays None."""
    known = sorted((value, i) for i, value in enumerate(p) if value is not None)
    corrected: list[float | None] = [None] * len(p)
    worst = 0.0
    for rank, (value, i) in enumerate(known):
        worst = max(worst, min(1.0, value * (len(known) - rank)))
        corrected[i] = worst
    return corrected


def leading(agents: list[str], pairs: tuple[Pair, ...]) -> list[str]:
    """The first of some agents, best first, and those that cannot be told apart from it."""
    best, *others = agents
    verdicts = {frozenset((pair.agent, pair.other)): pair.verdict for pair in pairs}
    return [best, *(one for one in others if verdicts[frozenset((best, one))] not in ("better", "worse"))]


def _difference(
    agent: Floats, other: Floats, binary: bool, runs_are_random: bool
) -> tuple[float | None, Interval | None, float | None]:
    """Mean difference, its interval, and its p."""
    means = [np.nanmean(x, axis=0) if len(x) > 1 else x[0] for x in (agent, other)]
    both = ~(np.isnan(means[0]) | np.isnan(means[1]))
    if not both.any():
        return None, None, None
    by_episode = (means[0] - means[1])[both]
    difference, n = float(by_episode.mean()), len(by_episode)
    if n < MIN_EPISODES:
        return difference, None, None
    parts = [(_variance(by_episode, binary) / n, n - 1)]
    for x in (agent, other) if runs_are_random else ():
        if len(x) > 1:
            of_runs = np.nanmean(x[:, both], axis=1)
            parts.append((float(np.var(of_runs, ddof=1)) / len(x), len(x) - 1))
    error = float(np.sqrt(sum(part for part, _ in parts)))
    if error == 0.0:
        return difference, (difference, difference), float(difference == 0.0)
    freedom = error**4 / sum(part**2 / degrees for part, degrees in parts)  # Welch and Satterthwaite
    half = float(stats.t.ppf(0.975, freedom)) * error
    p = 2 * float(stats.t.sf(abs(difference) / error, freedom))
    return difference, (difference - half, difference + half), p


def _variance(differences: Floats, binary: bool) -> float:
    """Variance of an episode's difference; of shares with half an episode added to each outcome."""
    if not binary:
        return float(np.var(differences, ddof=1))
    n = len(differences) + 2
    return float(((differences**2).sum() + 1) / n - (differences.sum() / n) ** 2)


def _verdict(difference: float | None, p: float | None, metric: Metric) -> Verdict:
    if difference is None or p is None:
        return "insufficient"
    if p >= 0.05:
        return "cannot tell"
    return "better" if (difference < 0) == metric.lower_is_better else "worse"
