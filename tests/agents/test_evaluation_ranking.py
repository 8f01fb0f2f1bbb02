"""All pairs of agents: what is claimed holds as often as it says."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from fieldagents.evaluation.ranking import (
    all_pairs,
    holm,
    interquartile_mean,
    leading,
    probability_of_improvement,
    scores_of,
    standings,
)
from fieldagents.task import Metric

ERROR = Metric("error", "m", "error", "error", lower_is_better=True)


def drawn(rng, runs, episodes, spread_of_runs, mean=0.0, common=None):
    """Scores whose runs and episodes both vary, and each episode of each run a little of its own."""
    run = rng.normal(0, spread_of_runs, (runs, 1))
    episode = (rng.gamma(2.0, 0.5, episodes) if common is None else common)[None]
    return mean + run + episode + rng.normal(0, 0.3, (runs, episodes))


@pytest.mark.every(("runs", "spread"), [(5, 0.2), (5, 0.02), (10, 0.2)])
def test_the_interval_over_runs_and_episodes_covers_the_mean_of_the_algorithm(runs, spread):
    """Of 1000 intervals (standard error 0.7 %) the promised 95 % hold the true difference, within 3 %."""
    rng = np.random.default_rng(1)
    hits = 0
    for _ in range(1000):
        common = rng.gamma(2.0, 0.5, 50)
        scores = {"a": drawn(rng, runs, 50, spread, 0.1, common), "b": drawn(rng, 1, 50, 0.0, 0.0, common)}
        (pair,) = all_pairs(scores, ERROR, {"a"})
        hits += pair.ci95[0] < 0.1 < pair.ci95[1]
        assert pair.of_algorithms
    assert 0.92 <= hits / 1000 <= 0.985


def test_an_interval_over_episodes_alone_would_not():
    """The error this would be: taking five policies for the algorithm."""
    rng = np.random.default_rng(1)
    hits = 0
    for _ in range(400):
        difference = drawn(rng, 5, 50, 0.2, 0.1).mean(axis=0) - 1.0
        half = stats.t.ppf(0.975, 49) * stats.sem(difference)
        hits += abs(difference.mean() - 0.1) < half
    assert hits / 400 < 0.9


def test_equal_agents_are_seldom_told_apart_however_many_pairs_there_are():
    """Of 300 evaluations of six equal agents (15 pairs), one in twenty has any verdict (error 1.3 %)."""
    rng = np.random.default_rng(2)
    wrong = 0
    for _ in range(300):
        common = rng.gamma(2.0, 0.5, 40)
        scores = {name: drawn(rng, 1, 40, 0.0, 0.0, common) for name in "abcdef"}
        wrong += any(pair.verdict != "cannot tell" for pair in all_pairs(scores, ERROR, ()))
    assert wrong / 300 < 0.08


def test_holm_by_hand():
    """The smallest of four p values counts four times, the next three times, and none below one before it."""
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.5, 0.9]) == pytest.approx([1.0, 1.0])
    assert holm([0.01, None, 0.02]) == pytest.approx([0.02, None, 0.02])


def test_shares_that_always_agree_keep_a_width():
    success = Metric("success", "1", "successes", "success", lower_is_better=False, binary=True)
    (pair,) = all_pairs({"a": np.ones((1, 50)), "b": np.ones((1, 50))}, success, ())
    assert pair.verdict == "cannot tell"
    assert pair.ci95[0] < 0 < pair.ci95[1]
    mixed = np.ones((1, 50))
    mixed[0, :20] = 0
    (pair,) = all_pairs({"a": np.ones((1, 50)), "b": mixed}, success, ())
    assert pair.verdict == "better"


def test_few_runs_speak_for_themselves_and_few_episodes_not_at_all():
    rng = np.random.default_rng(4)
    scores = {"a": drawn(rng, 3, 40, 0.0), "b": drawn(rng, 1, 40, 0.0, 3.0)}
    (pair,) = all_pairs(scores, ERROR, {"a"})
    assert (pair.verdict, pair.of_algorithms) == ("better", False)
    single = {"a": scores["a"][:1], "b": drawn(rng, 5, 40, 0.0, 3.0)}
    assert not all_pairs(single, ERROR, {"a", "b"})[0].of_algorithms
    assert all_pairs(single, ERROR, {"b"})[0].of_algorithms  # a has nothing to train
    (pair,) = all_pairs({name: x[:, :19] for name, x in scores.items()}, ERROR, {"a"})
    assert (pair.verdict, pair.ci95) == ("insufficient", None)


def test_standings_by_hand():
    scores = {
        "base": np.array([[4.0, 4.0, 4.0, 4.0]]),
        "own": np.array([[3.0, 5.0, 4.0, 0.0], [3.0, 3.0, 3.0, 3.0]]),
        "ceiling": np.array([[1.0, 1.0, 1.0, 1.0]]),
    }
    found = standings(scores, "base", {"ceiling"}, ERROR)
    assert found["own"].gap == pytest.approx((4 - 3.0) / 3)
    assert found["own"].improvement == pytest.approx((6 + 0.5) / 8)
    assert found["own"].middle == 3.0
    assert found["base"].improvement is None
    assert found["ceiling"].gap is None
    assert interquartile_mean(np.array([[np.nan]])) is None
    assert probability_of_improvement(np.array([[np.nan]]), scores["base"][:, :1], True) is None


def test_an_episode_that_lacks_a_value_is_left_out_of_the_pairs_it_is_in():
    rng = np.random.default_rng(5)
    rows = [
        {"agent": agent, "run": run, "seed": seed, "error": rng.normal(shift, 0.1)}
        for agent, shift, runs in (("a", 0.0, 2), ("b", 1.0, 1))
        for run in range(runs)
        for seed in range(30)
    ]
    frame = pd.DataFrame(rows)
    frame.loc[(frame["agent"] == "b") & (frame["seed"] < 5), "error"] = np.nan
    scores = scores_of(frame, ERROR)
    assert scores["a"].shape == (2, 30)
    assert scores["b"].shape == (1, 30)
    (pair,) = all_pairs(scores, ERROR, ())
    assert pair.verdict == "better"
    expected = scores["a"][:, 5:].mean() - scores["b"][:, 5:].mean()
    assert pair.difference == pytest.approx(expected)
    assert leading(["a", "b"], (pair,)) == ["a"]
