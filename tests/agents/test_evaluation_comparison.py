"""Intervals cover what they promise; verdicts follow from them."""

import numpy as np
import pytest
from scipy import stats

from fieldagents.evaluation.comparison import MIN_EPISODES, compare, mean_interval
from fieldagents.seeds import TEST_SEEDS, TRAINING_SEEDS, TUNING_SEEDS


def test_seeds_of_tuning_training_and_test_are_disjoint():
    assert TUNING_SEEDS.stop <= TRAINING_SEEDS.start
    assert TRAINING_SEEDS.stop <= TEST_SEEDS.start


@pytest.mark.every(
    ("n", "draw", "mean", "least"),
    [
        (20, lambda rng, n: rng.normal(0.3, 1, n), 0.3, 0.935),
        (100, lambda rng, n: rng.normal(0.3, 1, n), 0.3, 0.935),
        # Differences of skewed errors, as between two estimators.
        (20, lambda rng, n: rng.exponential(1, n) - rng.exponential(0.3, n), 0.7, 0.92),
        (100, lambda rng, n: rng.exponential(1, n) - rng.exponential(0.3, n), 0.7, 0.93),
    ],
)
def test_interval_covers_the_mean(n, draw, mean, least):
    """Of 2000 intervals (standard error 0.5 %) the promised 95 % hold the true mean, to two points."""
    rng = np.random.default_rng(1)
    hits = 0
    for _ in range(2000):
        low, high = mean_interval(draw(rng, n), least=2)
        hits += low < mean < high
    assert least <= hits / 2000 <= 0.965


def test_interval_is_student_s():
    x = np.random.default_rng(1).gamma(2.0, 1.0, 6)
    expected = stats.ttest_1samp(x, 0.0).confidence_interval(0.95)
    assert mean_interval(x, least=2) == pytest.approx(tuple(expected), rel=1e-12)


def test_interval_of_nothing_but_noise_rarely_gives_a_verdict():
    rng = np.random.default_rng(2)
    verdicts = [
        compare(rng.gamma(2, 1, 50), rng.gamma(2, 1, 50), lower_is_better=True).verdict for _ in range(1000)
    ]
    assert 0.03 < np.mean([v != "cannot tell" for v in verdicts]) < 0.07


def test_pairing_sees_what_unpaired_scores_hide():
    rng = np.random.default_rng(3)
    episodes = rng.normal(10, 5, 40)
    agent = episodes - 0.2 + rng.normal(0, 0.1, 40)
    assert compare(agent, episodes, lower_is_better=True).verdict == "better"
    assert compare(rng.permutation(agent), episodes, lower_is_better=True).verdict == "cannot tell"


def test_verdicts_mirror():
    rng = np.random.default_rng(4)
    a, b = rng.normal(1, 0.1, 30), rng.normal(2, 0.1, 30)
    assert compare(a, b, lower_is_better=True).verdict == "better"
    assert compare(b, a, lower_is_better=True).verdict == "worse"
    assert compare(a, b, lower_is_better=False).verdict == "worse"
    assert compare(a, b, lower_is_better=True).percent == pytest.approx(-50, abs=3)


def test_few_episodes_give_no_verdict():
    few = np.arange(MIN_EPISODES - 1.0)
    result = compare(few, few + 5, lower_is_better=True)
    assert result.ci95 is None
    assert result.verdict == "insufficient"


def test_equal_scores_cannot_be_told_apart():
    same = np.linspace(1, 2, 30)
    assert compare(same, same, lower_is_better=True).verdict == "cannot tell"


def test_unequal_numbers_are_no_pairs():
    with pytest.raises(ValueError, match="pairs must match"):
        compare([1.0, 2.0], [1.0], lower_is_better=True)


@pytest.mark.every(("n", "rate"), [(20, 0.9), (100, 0.5), (100, 0.98)])
def test_interval_of_a_share_covers_it(n, rate):
    """Of 2000 intervals (standard error 0.5 %); Wilson's swings about 95 % since counts are whole."""
    rng = np.random.default_rng(5)
    hits = 0
    for _ in range(2000):
        low, high = mean_interval((rng.random(n) < rate).astype(float), least=2, binary=True)
        hits += low < rate < high
    assert 0.93 <= hits / 2000 <= 0.985


def test_a_share_of_one_has_an_interval_all_the_same():
    low, high = mean_interval(np.ones(50), least=2, binary=True)
    assert low == pytest.approx(50 / (50 + 1.959964**2))  # Wilson's formula at p = 1
    assert high == 1.0


@pytest.mark.every(("n", "both", "only_agent", "only_base"), [(50, 0.8, 0.1, 0.05), (100, 0.9, 0.02, 0.02)])
def test_interval_of_a_paired_difference_of_shares_covers_it(n, both, only_agent, only_base):
    """Of 2000 intervals (standard error 0.5 %); with few discordant pairs it is on the safe side."""
    rng = np.random.default_rng(6)
    hits = 0
    for _ in range(2000):
        outcome = rng.random(n)
        agent = outcome < both + only_agent
        base = (outcome < both) | ((outcome >= both + only_agent) & (outcome < both + only_agent + only_base))
        found = compare(agent, base, lower_is_better=False, binary=True)
        hits += found.ci95[0] < only_agent - only_base < found.ci95[1]
    assert hits / 2000 >= 0.935


@pytest.mark.every(("failures", "verdict"), [(0, "cannot tell"), (4, "cannot tell"), (6, "worse")])
def test_shares_get_verdicts_only_with_enough_discordant_pairs(failures, verdict):
    """Of 4 discordant pairs all on one side: McNemar's exact p is 0.125; of 6: 0.031."""
    base = np.ones(40)
    agent = base.copy()
    agent[:failures] = 0
    found = compare(agent, base, lower_is_better=False, binary=True)
    assert found.difference == -failures / 40
    assert found.percent is None
    assert found.verdict == verdict


def test_only_episodes_in_which_both_have_a_value_are_pairs():
    agent, base = np.arange(30.0), np.arange(30.0) + 1
    agent[:4] = np.nan
    base[2:8] = np.nan
    found = compare(agent, base, lower_is_better=True)
    assert found.n == 22
    assert found.difference == -1
    assert found.verdict == "better"
    none = compare(np.full(30, np.nan), base, lower_is_better=True)
    assert (none.n, none.difference, none.verdict) == (0, None, "insufficient")
