"""The decision rule by itself: each test of it against SciPy's, each threshold from both sides."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from fieldmodels.diagnosis import causes, selection
from fieldmodels.diagnosis.candidates import Candidate
from fieldmodels.diagnosis.events import Observations
from fieldmodels.diagnosis.gain import Prediction, noise_floor, share
from fieldmodels.diagnosis.held_out import TAIL, heavy_tailed, held_out_loss
from fieldmodels.diagnosis.options import DEFAULT
from fieldmodels.diagnosis.selection import (
    _called_for,
    _simplest,
    accepted,
    block_p_value,
    dispersion,
    far_beyond,
    indistinguishable,
    likelihood_p_value,
)
from fieldmodels.diagnosis.whitening import _from_covariance

BLOCKS = np.repeat(np.arange(16), 4)


def stands(total, blocks=BLOCKS, effects=(), size=0, cost=0.0, spread=0.02, seed=0):
    """A candidate whose windows' losses sum up to a total, with a small spread between them."""
    noise = np.random.default_rng(seed).normal(size=len(blocks))
    loss = np.full(len(blocks), total / len(blocks)) + spread * (noise - noise.mean())
    return Candidate(effects, SimpleNamespace(cost=cost, observations=None), 0.0, loss, size)


def test_a_total_is_the_loss_with_the_price_of_search_and_size():
    candidate = Candidate(("a", "b"), None, np.log(7.0), np.array([1.0, 2.0]), 3)
    assert candidate.total == pytest.approx(3.0 + np.log(7.0) + 3.0)  # one nat a parameter


@pytest.mark.parametrize("neighbours", [0.0, 1.0])
def test_p_value_is_student_s_over_blocks_and_over_pairs_of_blocks(neighbours):
    rng = np.random.default_rng(1)
    blocks = np.repeat(np.arange(40), 3)
    common = np.repeat(rng.normal(size=20), 6)  # alike in two neighbouring blocks
    gain = 0.5 + rng.normal(size=120) + neighbours * common
    sums = gain.reshape(40, 3).sum(axis=1)
    one = stats.ttest_1samp(sums, 0.0, alternative="greater").pvalue
    two = stats.ttest_1samp(sums.reshape(20, 2).sum(axis=1), 0.0, alternative="greater").pvalue
    assert block_p_value(gain, blocks) == pytest.approx(max(one, two), rel=1e-9)
    if neighbours:
        assert two > 1.5 * one


@pytest.mark.parametrize(("gain", "yes"), [(7.5, False), (8.5, True), (-20.0, False)])
def test_a_cause_must_bring_8_nats(gain, yes):
    parent, child = stands(100.0, cost=50.0), stands(100.0 - gain, effects=("a",), cost=40.0, seed=1)
    assert accepted(parent, child, BLOCKS) == yes


def test_a_cause_must_bring_3_in_a_thousand_of_the_misfit():
    few, many = (stands(10_000.0 - g, effects=("a",), cost=-1.0, seed=1) for g in (29.0, 31.0))
    assert not accepted(stands(10_000.0), few, BLOCKS)
    assert accepted(stands(10_000.0), many, BLOCKS)


def test_a_fit_that_is_no_better_is_not_accepted():
    parent, child = stands(100.0, cost=50.0), stands(50.0, effects=("a",), cost=50.0)
    assert not accepted(parent, child, BLOCKS)


def test_a_gain_that_varies_between_blocks_needs_a_p_value_below_one_percent():
    gain = np.zeros(64)
    gain[BLOCKS < 4] = 4.0  # 64 nats, of a quarter of the blocks
    parent = stands(100.0, cost=50.0, spread=0.0)
    child = Candidate(("a", "b"), SimpleNamespace(cost=0.0, observations=None), 0.0, parent.loss - gain, 2)
    p = stats.ttest_1samp(np.bincount(BLOCKS, gain), 0.0, alternative="greater").pvalue
    assert 0.01 < p < 0.1
    assert not accepted(parent, child, BLOCKS)  # two effects at once: no second chance


def rare(largest, other, effects):
    """A cause that shows in one block above all: certain by its likelihood, not by a t-test."""
    gain = np.full(64, other / 4)
    gain[BLOCKS == 5] = largest / 4
    parent = stands(100.0, cost=50.0, spread=0.0)
    child = Candidate(effects, SimpleNamespace(cost=0.0, observations=None), 0.0, parent.loss - gain, 0)
    p = stats.ttest_1samp(np.bincount(BLOCKS, gain), 0.0, alternative="greater").pvalue
    assert 0.01 < p < 0.1
    return accepted(parent, child, BLOCKS)


@pytest.mark.parametrize(("size", "yes"), [(10.0, True), (5.0, False)])
def test_what_helps_in_a_part_of_the_data_and_harms_in_another_must_bring_three_times_as_much(size, yes):
    """32 or 16 nats, of three of sixteen blocks; the others cost a little."""
    gain = np.full(64, -0.05)
    for block in (9, 12, 13, 15):
        gain[block == BLOCKS] = size / 4
    parent = stands(100.0, cost=50.0, spread=0.0)
    child = Candidate(("a",), SimpleNamespace(cost=0.0, observations=None), 0.0, parent.loss - gain, 0)
    p = stats.ttest_1samp(np.bincount(BLOCKS, gain), 0.0, alternative="greater").pvalue
    assert 0.01 < p < 0.1
    assert far_beyond(gain, gain.sum(), 8.0, BLOCKS) == yes
    if yes:
        assert accepted(parent, child, BLOCKS)


def test_two_causes_at_once_have_no_second_chance(monkeypatch):
    monkeypatch.setattr(selection, "likelihood_p_value", lambda *_: 1e-9)
    assert rare(20.0, 0.6, ("a",))
    assert not rare(20.0, 0.6, ("a", "b"))


def test_a_cause_that_shows_in_a_single_block_is_not_accepted(monkeypatch):
    monkeypatch.setattr(selection, "likelihood_p_value", lambda *_: 1e-9)
    assert not rare(20.0, 0.5, ("a",))  # without that block it brings 7.5 nats
    monkeypatch.setattr(selection, "likelihood_p_value", lambda *_: 6e-6)  # as noise that is not white had
    assert not rare(20.0, 0.6, ("a",))


def regression(seed, blocks=200, strength=0.0, alike=0.0):
    """A linear fit in white noise: one column that is tested beside another one; six rows a block."""
    rng = np.random.default_rng(seed)
    columns = rng.normal(size=(blocks, 6, 2))
    columns[:, :, 1] += 0.8 * columns[:, :, 0]
    data = rng.normal(size=(blocks, 6)) + strength * columns[:, :, 1]
    data += alike * rng.normal(size=(blocks, 1)) * columns[:, :, 1]
    flat, target = columns.reshape(-1, 2), data.ravel()
    fits, costs = [], []
    for free in ([0], [0, 1]):
        left = target - flat[:, free] @ np.linalg.lstsq(flat[:, free], target, rcond=None)[0]
        costs.append(0.5 * left @ left)
        fits.append(
            SimpleNamespace(
                free=np.array(free), active=np.ones(len(free), dtype=bool), observations=None, cost=costs[-1],
                residual=left.reshape(blocks, 6), jacobian=columns[:, :, free],
            )
        )  # fmt: skip
    loss = np.zeros(blocks)
    parent = Candidate((), fits[0], 0.0, loss + costs[0] / blocks)
    child = Candidate(("a",), fits[1], 0.0, loss + costs[1] / blocks)
    return parent, child, np.arange(blocks)


def test_likelihood_p_value_is_that_of_an_f_test_in_white_noise():
    parent, child, blocks = regression(1, strength=0.15)
    excess = dispersion(child.fit, np.array([False, True]), blocks)
    assert 1.0 <= excess < 1.3
    ratio = 2.0 * (parent.total - child.total) / excess
    expected = stats.f.sf(ratio, 1, len(blocks) - 1)
    assert expected < 0.05
    assert likelihood_p_value(parent, child, blocks) == pytest.approx(expected, rel=1e-9)


def test_errors_alike_within_blocks_make_a_gain_less_certain():
    """A slope that wanders between blocks with deviation s moves a score by 1 + s^2 times its power."""
    parent, child, blocks = regression(2, strength=0.3, alike=1.0)
    power = 6 * 1.64 * (1 - 0.64 / 1.64)  # of six rows of the column beside the other one
    excess = dispersion(child.fit, np.array([False, True]), blocks)
    assert excess == pytest.approx(1.0 + power, rel=0.35)
    plain = stats.f.sf(2.0 * (parent.total - child.total), 1, len(blocks) - 1)
    assert likelihood_p_value(parent, child, blocks) > 1e3 * plain


def accepted_of(tried, **how):
    """Share of some regressions over few blocks whose second column is called for, losses block by block."""
    count = 0
    for seed in range(tried):
        parent, child, blocks = regression(seed, blocks=28, **how)
        losses = [0.5 * np.sum(one.fit.residual**2, axis=1) for one in (parent, child)]
        parent, child = replace(parent, loss=losses[0]), replace(child, loss=losses[1], size=1)
        count += accepted(parent, child, blocks)
    return count / tried


def test_in_few_blocks_what_is_certain_by_its_likelihood_is_accepted_and_chance_is_not():
    """A gain of n nats has the variance 2 n: of ten nats t is 2.2, and in 28 blocks p 0.02."""
    power = 28 * 6.0  # of the second column beside the first one
    assert accepted_of(200, strength=np.sqrt(2 * 16.0 / power)) > 0.45
    assert accepted_of(1000) == 0.0
    assert accepted_of(1000, alike=0.7) <= 0.01  # its slope varies between blocks, and is zero on average


def test_dispersion_is_judged_beside_the_other_parameters():
    """An error along the other column alone says nothing of this one."""
    _, child, blocks = regression(3)
    other = child.fit.jacobian[:, :, 0]
    wander = np.random.default_rng(4).normal(size=(len(blocks), 1))
    own = child.fit.jacobian[:, :, 1] - 0.8 * other
    moved = SimpleNamespace(**{**vars(child.fit), "residual": child.fit.residual + 2.0 * wander * other})
    along = SimpleNamespace(**{**vars(child.fit), "residual": child.fit.residual + 2.0 * wander * own})
    which = np.array([False, True])
    assert dispersion(moved, which, blocks) < 0.4 * dispersion(along, which, blocks)
    assert dispersion(SimpleNamespace(**{**vars(child.fit), "residual": 0.01 * own}), which, blocks) == 1.0


@pytest.mark.parametrize(
    ("worse", "spread", "size", "cost", "alike"),
    [
        (2.5, 0.0, 1, 0.0, True),  # so little decides nothing, however steady
        (4.0, 0.0, 1, 0.0, False),  # steady: certain
        (4.0, 2.0, 1, 0.0, True),  # scattered over the windows: not certain
        (7.0, 5.0, 1, 0.0, False),  # six nats always do
        (1.5, 0.0, 2, 0.05, False),  # worse with more parameters: the better one in disguise
        (1.5, 0.0, 2, 0.2, True),  # it does not fit as well, so it is another one
        (-1.5, 0.0, 2, 0.0, True),
        (-7.0, 0.0, 1, 0.0, True),
    ],
)
def test_which_sets_the_data_cannot_tell_apart(worse, spread, size, cost, alike):
    first = stands(100.0, size=1, effects=("a",), spread=0.0)
    second = stands(100.0 - 1.0 * (size - 1) + worse, size=size, effects=("b",), cost=cost, spread=spread)
    assert second.total - first.total == pytest.approx(worse)
    assert indistinguishable(first, second, BLOCKS) == alike


def test_the_wrong_one_of_two_sets_leads_by_more_in_one_record_of_a_hundred_at_most():
    """Two means that differ by d deviations of a sum of normal numbers, of which the first is true."""
    errors = np.random.default_rng(9).normal(size=200_000)
    wrong = []
    for d in np.linspace(0.3, 6.0, 20):
        leads = 0.5 * errors**2 - 0.5 * (errors - d) ** 2  # of the wrong one in likelihood
        wrong.append(float(np.mean(leads > DEFAULT.undecided)))
    assert 0.009 < max(wrong) < 0.011


def test_of_sets_alike_the_one_with_fewest_parameters_is_chosen():
    large = stands(100.0, size=3, effects=("a",))
    small = stands(102.5, size=1, effects=("b",))
    middle = stands(101.2, size=2, effects=("c",))
    chosen, alternatives = _simplest(large, (middle, small), BLOCKS)
    assert chosen is small
    assert large in alternatives


@pytest.mark.parametrize(
    ("gain", "left", "yes"),
    [
        (9.5, 40.0, True),  # enough beside what wanders
        (7.5, 40.0, False),
        (4.5, 2.5, True),  # by itself it explains more than the walks did, whose gain is nearly gone
        (4.5, 5.5, False),
        (-3.0, 1.5, True),  # nothing wanders beside it
    ],
)
def test_a_name_must_explain_as_much_as_noise_that_wanders(monkeypatch, gain, left, yes):
    monkeypatch.setattr(selection, "beside", lambda *_: (gain + 1.0, left))  # its parameter costs a nat
    monkeypatch.setattr(selection, "wander", lambda *_: SimpleNamespace(walked=np.inf))
    monkeypatch.setattr(selection, "is_steady", lambda *_: False)
    candidates = SimpleNamespace(problem=SimpleNamespace(observations=None), options=selection.DEFAULT)
    parent, child = stands(100.0), stands(50.0, effects=("a",), size=1)
    monkeypatch.setattr(selection, "follows_slowly", lambda *_: False)
    assert selection._stands(candidates, parent, child) == yes
    monkeypatch.setattr(selection, "follows_slowly", lambda *_: True)
    monkeypatch.setattr(selection, "wanders_more", lambda *_: False)
    assert selection._stands(candidates, parent, child) == yes
    monkeypatch.setattr(selection, "wanders_more", lambda *_: True)
    assert selection._stands(candidates, parent, child) == (left < 2.0)


@pytest.mark.parametrize(("walked", "yes"), [(1.9, True), (2.1, False)])
def test_a_name_stands_where_walks_beside_it_bring_nothing_by_walking(monkeypatch, walked, yes):
    """They may bring much by smaller errors along their offsets."""
    monkeypatch.setattr(selection, "beside", lambda *_: (-3.0, 40.0))
    monkeypatch.setattr(selection, "wander", lambda *_: SimpleNamespace(walked=walked))
    monkeypatch.setattr(selection, "is_steady", lambda *_: False)
    candidates = SimpleNamespace(problem=None, options=selection.DEFAULT)
    assert selection._stands(candidates, stands(100.0), stands(50.0, effects=("a",), size=1)) == yes


@pytest.mark.parametrize(
    ("gain", "steady", "yes"), [(17.5, True, True), (16.5, True, False), (60.0, False, False)]
)
def test_what_is_the_same_all_the_time_stands_beside_zeros_that_return(monkeypatch, gain, steady, yes):
    """It must bring 16 nats; a drift may bring more where zeros walk."""
    monkeypatch.setattr(selection, "beside", lambda *_: (30.0, 40.0))
    monkeypatch.setattr(selection, "wander", lambda *_: SimpleNamespace(walked=50.0))
    for slow in ("follows_slowly", "wanders_more"):
        monkeypatch.setattr(selection, slow, lambda *_: True)
    monkeypatch.setattr(selection, "is_steady", lambda *_: steady)
    monkeypatch.setattr(selection, "beside_returning", lambda *_: gain)
    candidates = SimpleNamespace(problem=None, options=selection.DEFAULT)
    assert selection._stands(candidates, stands(100.0), stands(50.0, effects=("a",), size=1)) == yes


class Search:
    """Fits of sets with known totals, in ``better`` those that only starts beside all others lead to."""

    problem, options = SimpleNamespace(blocks=BLOCKS), DEFAULT

    def __init__(self, totals, better=None):
        self.totals = {frozenset(names): total for names, total in totals.items()}
        self.better = {frozenset(names): total for names, total in (better or {}).items()}
        self.ways, self.fitted_again, self.tried = [], [], set()

    def made(self, names, table):
        key = frozenset(names)
        total = table.get(key, self.totals.get(key, 500.0))
        return stands(total, effects=tuple(names), cost=total, size=len(key), spread=0.0)

    def stuck(self, *names):
        return self.made(names, {})

    def without(self, candidate, gone):
        return self.made([n for n in candidate.effects if n != gone], self.better)

    def extend(self, parent, name):
        self.ways.append(("".join(parent.effects), name))
        self.tried.add((frozenset(parent.effects), name))
        return self.made([*parent.effects, name], self.better)

    def names(self):
        return sorted(set().union(*self.totals))

    def score_test(self, parent, name):
        return parent.total - self.made([*parent.effects, name], self.better).total

    def each(self, function, items):
        return [function(one) for one in items]

    def promised(self, parent, name):
        return parent.fit.cost - self.score_test(parent, name)

    def twins(self, name):
        return {"b"} if name == "h" else set()

    def again(self, candidate):
        self.fitted_again.append(set(candidate.effects))
        return candidate

    def simplified(self, candidate):
        return candidate


PAIRS = {"ab": 100.0, "ac": 103.0, "a": 200.0, "b": 200.0, "c": 200.0}


def settled(search, chosen, *others):
    found = [search.stuck(*names) for names in (chosen, *others)]
    return selection._settled(search, found[0], {1: [search.stuck(n) for n in "abc"], 2: found})


def test_a_set_that_was_stuck_beside_fewer_effects_is_found_beside_all(monkeypatch):
    monkeypatch.setattr(selection, "_stands", lambda *_: True)
    chosen, rivals = settled(Search(PAIRS, {"ac": 60.0}), "ab", "ac")
    assert set(chosen.effects) == {"a", "c"}
    assert chosen.loss.sum() == pytest.approx(60.0)
    assert [set(one.effects) for one in rivals] == [{"a", "b"}]


def test_what_was_added_to_the_same_rest_before_is_not_added_again(monkeypatch):
    monkeypatch.setattr(selection, "_stands", lambda *_: True)
    search = Search(PAIRS, {"ac": 60.0})
    search.tried = {(frozenset("a"), "c")}
    chosen, _ = settled(search, "ab", "ac")
    assert set(chosen.effects) == {"a", "b"}
    assert ("a", "c") not in search.ways
    assert set(settled(Search(PAIRS, {"ac": 60.0}), "ab", "ac")[0].effects) == {"a", "c"}


def test_an_effect_that_an_exchange_makes_superfluous_is_dropped(monkeypatch):
    monkeypatch.setattr(selection, "_stands", lambda *_: True)
    totals = {**PAIRS, "abd": 80.0, "acd": 85.0, "ad": 150.0, "cd": 150.0}
    search = Search(totals, {"acd": 59.0, "ac": 60.0})
    found = [search.stuck(*names) for names in ("abd", "acd")]
    pairs = [search.stuck(*names) for names in ("ab", "ac")]
    chosen, _ = selection._settled(search, found[0], {2: pairs, 3: found})
    assert set(chosen.effects) == {"a", "c"}


def test_no_set_is_exchanged_for_one_that_is_not_called_for(monkeypatch):
    """The best set may act in too few blocks, so that the next one was chosen."""
    monkeypatch.setattr(selection, "_stands", lambda _, __, child: "c" not in child.effects)
    chosen, rivals = settled(Search({**PAIRS, "ac": 90.0}), "ab", "ac")
    assert set(chosen.effects) == {"a", "b"}
    assert [set(one.effects) for one in rivals] == [{"a", "c"}]


def test_held_out_likelihood_is_student_s():
    residual = np.random.default_rng(5).normal(size=(7, 4))
    logpdf = stats.multivariate_t(np.zeros(4), np.eye(4), df=TAIL).logpdf
    np.testing.assert_allclose(heavy_tailed(residual, 4), logpdf(np.zeros(4)) - logpdf(residual), rtol=1e-9)


def test_held_out_loss_of_a_linear_fit_is_that_of_refits_without_each_fold():
    rng = np.random.default_rng(11)
    columns, target, folds = rng.normal(size=(12, 5, 3)), rng.normal(size=(12, 5)), np.arange(12) % 4

    def left(rows):
        """Residual of all windows, fitted to some."""
        best = np.linalg.lstsq(columns[rows].reshape(-1, 3), target[rows].ravel(), rcond=None)[0]
        return target - columns @ best

    fitted = SimpleNamespace(
        residual=left(folds >= 0), jacobian=columns, active=np.ones(3, dtype=bool), observations=None,
        weight=None,
        raw=target,
    )  # fmt: skip
    loss = held_out_loss(fitted, folds)
    for fold in range(4):
        inside = folds == fold
        np.testing.assert_allclose(loss[inside], heavy_tailed(left(~inside)[inside], 5), rtol=1e-9)


def test_whitened_residuals_have_covariance_one():
    rng = np.random.default_rng(6)
    root = np.array([[1.0, 0.5, 0.0], [3.0, 10.0, 0.0], [0.0, 0.02, 0.1]])
    raw = rng.normal(size=(20_000, 3)) @ root.T
    whitener = _from_covariance(raw, np.full(3, 1e-6), 0, 0.0)
    np.testing.assert_allclose(np.cov((raw @ whitener.T).T), np.eye(3), atol=0.03)


def test_a_look_s_likelihood_is_bernoulli_s_and_a_step_moves_its_log_odds():
    happened, p = np.array([[1.0, 0.0, 1.0]]), np.array([[0.8, 0.3, 0.5]])
    observations = Observations(np.array([True, True, True]), np.array([[True, True, False]]), happened)
    raw = happened - p
    expected = -stats.bernoulli.logpmf(happened, p)
    expected[0, 2] = 0.0  # nobody looked
    np.testing.assert_allclose(observations.loss(raw), expected)
    change = np.array([[0.5, -1.0, 2.0]])
    moved = 1 / (1 + (1 - p) / p * np.exp(-change))
    np.testing.assert_allclose(
        observations.loss(raw, change)[0, :2], -stats.bernoulli.logpmf(happened, moved)[0, :2]
    )
    # Weighted residuals of right probabilities have variance one.
    weight = observations.weight(raw)[0]
    np.testing.assert_allclose(weight, [1 / np.sqrt(0.16), 1 / np.sqrt(0.21), 0.0])


def predicted(squares):
    squares = np.asarray(squares, dtype=np.float64)[:, None]
    return Prediction([], squares, np.full(squares.shape, 10.0))


def test_a_share_is_the_part_of_the_root_mean_square_that_goes():
    before, after = predicted([40.0, 80.0]), predicted([10.0, 20.0])
    found = share(before, after, 0, np.arange(2), np.random.default_rng(0))
    assert found.percent == pytest.approx(50.0)
    assert found.ci95 == (pytest.approx(50.0), pytest.approx(50.0))
    assert before.rmse()[0] == pytest.approx(np.sqrt(120 / 20))


def test_the_interval_of_a_share_holds_95_of_100_resampled_blocks():
    rng = np.random.default_rng(7)
    before, after = rng.gamma(5.0, 1.0, 60), rng.gamma(5.0, 0.3, 60)
    found = share(predicted(before), predicted(after), 0, np.arange(60) // 2, np.random.default_rng(0))
    blocks = before.reshape(30, 2).sum(axis=1), after.reshape(30, 2).sum(axis=1)
    drawn = []
    for _ in range(4000):
        rows = rng.integers(0, 30, 30)
        drawn.append(100 * (1 - np.sqrt(blocks[1][rows].sum() / blocks[0][rows].sum())))
    width = np.diff(np.percentile(drawn, [2.5, 97.5]))[0]
    assert np.diff(found.ci95)[0] == pytest.approx(width, rel=0.12)


class Shown:
    """A problem of one signal, measured in windows without any fit."""

    def __init__(self, measured, event=False):
        self.parts = [SimpleNamespace(windows=SimpleNamespace(measured=lambda _names: measured[:, :, None]))]
        self.model = SimpleNamespace(outputs=[SimpleNamespace(name="x", event=event)])
        self.resolved = lambda _output: 0.0


def test_noise_floor_is_the_white_part_of_an_error():
    rng = np.random.default_rng(8)
    time = np.linspace(0, 1, 200)
    slow = np.sin(2 * np.pi * (time + rng.random((50, 1))))
    shown = Shown(slow + 0.03 * rng.normal(size=slow.shape))
    nothing = Prediction([np.zeros((*slow.shape, 1))], np.zeros(0), np.zeros(0))
    # Clipped at one per cent on either side: a normal's variance falls by 7 per cent.
    assert noise_floor(shown, nothing, 0) == pytest.approx(0.03, rel=0.06)


def test_noise_floor_of_an_event_is_chance():
    p = np.full((30, 10), 0.2)
    shown = Shown(np.zeros((30, 10)), event=True)
    assert noise_floor(shown, Prediction([p[:, :, None]], p, p), 0) == pytest.approx(np.sqrt(0.2 * 0.8))


def test_a_cause_that_acts_in_few_blocks_does_not_hide_the_next_one():
    """The best set gains in a single block, the next one everywhere, and so does it beside the best."""
    once = np.where(BLOCKS == 3, 40.0 / 4, 0.0)
    base = stands(400.0, cost=100.0)
    rare = replace(stands(400.0, effects=("rare",), cost=50.0), loss=base.loss - once)
    often = stands(380.0, effects=("often",), cost=60.0, seed=1)
    both = replace(stands(0.0, effects=("rare", "often"), cost=40.0), loss=often.loss - once)
    asked = []

    def extend(parent, name):
        asked.append((parent.effects, name))
        return beside

    candidates = SimpleNamespace(
        problem=SimpleNamespace(blocks=BLOCKS), options=DEFAULT, extend=extend, again=lambda c: c
    )
    beside = both
    assert _called_for(candidates, base, [], [rare, often]) is often
    assert asked == [(("rare",), "often")]
    beside = replace(both, loss=rare.loss)  # it brings nothing more
    assert _called_for(candidates, base, [], [rare, often]) is None


@pytest.mark.parametrize(
    ("losses", "kept"),
    [
        # One alone explains nothing, both do.
        ({"ab": 10.0, "a": 30.0, "b": 40.0, "": 25.0}, ("a", "b")),
        ({"ab": 10.0, "a": 9.0, "b": 40.0, "": 25.0}, ("a",)),
        ({"ab": 10.0, "a": 9.0, "b": 40.0, "": 8.0}, ()),
        # A cause that does not act is not rejected.
        ({"ab": 10.0, "a": 10.0, "b": 12.0, "": 25.0}, ("a", "b")),
    ],
)
def test_the_test_data_reject_effects_one_by_one_beside_all_others(monkeypatch, losses, kept):
    def made(names):
        fitted = SimpleNamespace(parameters=names, whitener=None)
        return Candidate(tuple(names), fitted, 0.0, np.zeros(1), len(names))

    candidates = SimpleNamespace(
        without=lambda c, gone: made("".join(name for name in c.effects if name != gone))
    )
    monkeypatch.setattr(causes, "fit", lambda _problem, names, *_rest, **_more: names)
    monkeypatch.setattr(causes, "window_loss", lambda names: np.array([losses[names]]))
    assert causes.confirmed(candidates, made(""), made("ab"), None).effects == kept


def test_two_effects_that_a_third_one_imitates_are_fitted_together(monkeypatch):
    """To first order half of what the second one brings is promised, less than the first one lacks alone."""
    monkeypatch.setattr(selection, "covariance_whitener", lambda *_: None)
    idle = {f"v{i}": 99.0 for i in range(selection.TRIED_AT_LEAST)}
    search = Search({"v": 100.0, "g": 130.0, "gc": 70.0, **idle})
    search.problem = SimpleNamespace(
        blocks=BLOCKS, model=SimpleNamespace(effect=lambda _: search.made("c", {}))
    )
    search.score_test = lambda parent, name: 0.5 * max(parent.total - search.extend(parent, name).total, 0.0)
    grown = selection._grown(search, [search.stuck("v"), search.stuck("g")])
    assert set(grown[0].effects) == {"g", "c"}


def searching(monkeypatch, totals, **more):
    monkeypatch.setattr(selection, "covariance_whitener", lambda *_: None)
    search = Search(totals, **more)
    search.problem = SimpleNamespace(
        blocks=BLOCKS, model=SimpleNamespace(effect=lambda name: search.made(name, {}))
    )
    return search


def test_what_many_parameters_imitate_is_tried_with_fewer_whatever_little_is_promised(monkeypatch):
    """Eight values of a curve do what an effect and another one do, of which the first is as good alone."""
    idle = {f"v{i}": 99.0 for i in range(selection.TRIED_AT_LEAST)}
    search = searching(monkeypatch, {"v": 100.0, "g": 102.0, "gc": 70.0, **idle})
    search.score_test = lambda parent, name: 2.0 if (*parent.effects, name) == ("g", "c") else 1.0
    many = stands(
        93.0, effects=("v",), cost=100.0, size=8, spread=0.0
    )  # with its price as good as one of one
    assert set(selection._grown(search, [many, search.stuck("g")])[0].effects) == {"g", "c"}
    assert set(selection._grown(search, [search.stuck("v"), search.stuck("g")])[0].effects) != {"g", "c"}


@pytest.mark.parametrize(("lacks", "ways"), [(0.0, [("a", "b")]), (5.0, [("a", "b"), ("b", "a")])])
def test_a_set_is_fitted_from_a_second_parent_if_it_lacks_what_that_promises(monkeypatch, lacks, ways):
    search = searching(monkeypatch, {"a": 100.0, "b": 130.0, "ab": 50.0})
    search.promised = lambda parent, name: 50.0 - lacks
    selection._grown(search, [search.stuck("a"), search.stuck("b")])
    assert search.ways == ways


def test_where_no_larger_set_is_better_none_is_fitted_again(monkeypatch):
    search = searching(monkeypatch, {"a": 100.0, "ab": 101.0, "ac": 102.0, "b": 300.0, "c": 300.0})
    assert [set(one.effects) for one in selection._grown(search, [search.stuck("a")])] == [{"a", "b"}]
    assert search.fitted_again == []


LOOKED = {"a": 60.0, "b": 99.0, "y": 99.0, "z": 99.5, "ay": 59.5, "az": 59.0, "ayz": 30.0, "yz": 95.0}
"""An effect that is found at once, and two that bring nothing one by one, neither alone nor beside it."""


@pytest.mark.parametrize(
    ("left", "totals", "chosen"),
    [
        (True, LOOKED, "ayz"),
        (False, LOOKED, "a"),  # no error remains
        (True, {**LOOKED, "ay": 53.0, "ayz": 45.0}, "a"),  # z brings too little beside the other two
        (True, {**LOOKED, "ayz": 52.0}, "a"),  # both bring too little
    ],
)
def test_two_effects_that_bring_nothing_alone_are_found_where_an_error_remains(
    monkeypatch, left, totals, chosen
):
    monkeypatch.setattr(selection, "_stands", lambda *_: True)
    monkeypatch.setattr(selection, "unexplained", lambda *_: left)
    search = searching(monkeypatch, totals)
    search.base = lambda: search.made("", {frozenset(): 100.0})
    search.identifiable, search.unidentifiable = lambda *_: True, set()
    promises = {((), "a"): 40.0, (("a", "y"), "z"): 20.0}  # beside the first effect nothing promises anything
    search.score_test = lambda parent, name: promises.get((parent.effects, name), 0.0)
    search.promised = lambda *_: -np.inf
    monkeypatch.setattr(selection, "TRIED_AT_LEAST", 1)
    monkeypatch.setattr(selection, "accepted", lambda parent, child, *_: child.total < parent.total - 8.0)
    assert "".join(sorted(selection.select(search, lambda *_: None).chosen.effects)) == chosen


@pytest.mark.parametrize(("rmse", "yes"), [(1.4, False), (1.6, True)])
def test_an_error_remains_from_one_and_a_half_times_the_noise(monkeypatch, rmse, yes):
    monkeypatch.setattr(selection, "predict", lambda *_: SimpleNamespace(rmse=lambda: np.array([rmse, 1.0])))
    monkeypatch.setattr(selection, "noise_floor", lambda *_: 1.0)
    problem = SimpleNamespace(
        model=SimpleNamespace(random_force=False), outputs=np.array([0, 1]), events=np.zeros(2, bool)
    )
    assert selection.unexplained(problem, SimpleNamespace(parameters=None)) == yes
    problem.model.random_force = True  # what it does not explain is chance
    assert not selection.unexplained(problem, SimpleNamespace(parameters=None))


@pytest.mark.parametrize(
    ("once", "often", "where", "found"),
    [
        (25.0, 0.0, "sensor", True),
        (23.0, 0.0, "force", False),
        (25.0, 7.0, "sensor", True),
        (25.0, 9.0, "sensor", False),  # eight nats without its best part, and it may be a zero that wanders
        (25.0, 9.0, "force", True),
    ],
)
def test_what_brings_much_in_few_parts_of_the_data_is_left_to_other_data(
    monkeypatch, once, often, where, found
):
    monkeypatch.setattr(selection, "_stands", lambda *_: True)
    base = stands(400.0, cost=100.0)
    gain = np.where(BLOCKS == 3, once / 4, often / 60)
    rare = replace(stands(0.0, effects=("rare",), cost=50.0), loss=base.loss - gain)
    model = SimpleNamespace(effect=lambda _name: SimpleNamespace(where=where))
    problem = SimpleNamespace(blocks=BLOCKS, model=model)
    candidates = SimpleNamespace(problem=problem, options=DEFAULT, again=lambda c: c)
    assert selection._seldom(candidates, base, [rare]) == ((rare,) if found else ())
    monkeypatch.setattr(selection, "_stands", lambda *_: False)  # noise that wanders
    assert selection._seldom(candidates, base, [rare]) == ()


@pytest.mark.parametrize(
    ("gains", "kept"), [([9.0, 7.0], "a"), ([7.0, 6.0], ""), ([9.0, 12.0], "b"), ([], "")]
)
def test_what_other_data_call_for_as_well_is_added(monkeypatch, gains, kept):
    losses = {"": 50.0, **{name: 50.0 - gain for name, gain in zip("ab", gains, strict=False)}}
    monkeypatch.setattr(causes, "_test_loss", lambda _problem, _whitener, one: losses["".join(one.effects)])
    chosen, *seldom = (stands(100.0, effects=tuple(name)) for name in ("", "a", "b")[: len(gains) + 1])
    for one in (chosen, *seldom):
        one.fit.whitener = None
    found = causes.confirmed_elsewhere(SimpleNamespace(options=DEFAULT), chosen, seldom, None)
    assert "".join(found.effects) == kept


@pytest.mark.parametrize(("better", "alternatives"), [(-1.0, {"c", "h"}), (1.0, {"c"})])
def test_what_contains_the_better_effect_is_no_alternative_to_it(monkeypatch, better, alternatives):
    """Hysteresis that fits less well than the friction that it contains was fitted less well."""
    monkeypatch.setattr(selection, "_stands", lambda *_: True)
    monkeypatch.setattr(selection, "unexplained", lambda *_: False)
    monkeypatch.setattr(selection, "accepted", lambda parent, child, *_: child.total < parent.total - 8.0)
    search = searching(monkeypatch, {"b": 60.0, "h": 60.0 + better, "c": 61.0})
    search.base = lambda: search.made("", {frozenset(): 100.0})
    search.identifiable, search.unidentifiable = lambda *_: True, set()
    found = selection.select(search, lambda *_: None)
    named = {*found.chosen.effects, *(name for one in found.alternatives for name in one.effects)}
    assert named == {"b", *alternatives}


def test_what_does_as_well_in_few_parts_of_the_data_is_an_alternative():
    first, near, far = (
        stands(total, effects=(name,), spread=0.0) for name, total in (("a", 50.0), ("b", 51.0), ("c", 60.0))
    )
    assert selection.rivals_of(first, [far, first, near], BLOCKS) == (near,)
    assert selection.rivals_of(stands(50.0), [first, near], BLOCKS) == ()  # what was there before


@pytest.mark.parametrize(("on_path", "beside", "harms"), [(-5, -5, True), (-5, 5, False), (5, -5, False)])
def test_a_cause_is_doubtful_if_it_harms_predictions_beside_all_others_too(
    monkeypatch, on_path, beside, harms
):
    def cause(percent):
        return SimpleNamespace(gain=SimpleNamespace(ci95=(percent - 1.0, percent + 1.0)))

    monkeypatch.setattr(causes, "beside_the_others", lambda *_: (cause(beside),))
    assert causes._harms(cause(on_path), None, None, None, None) == harms


def test_nothing_is_looked_for_again_beside_nothing(monkeypatch):
    """Where nothing is named, errors above the noise are mostly the noise's own."""
    looked = []
    monkeypatch.setattr(selection, "unexplained", lambda *_: True)
    monkeypatch.setattr(selection, "_looked_again", lambda _, chosen, *__: looked.append(chosen.effects))
    monkeypatch.setattr(selection, "accepted", lambda *_: False)
    search = searching(monkeypatch, {"b": 99.0, "c": 99.5, "bc": 99.0})
    search.base = lambda: search.made("", {frozenset(): 100.0})
    search.identifiable, search.unidentifiable = lambda *_: True, set()
    assert selection.select(search, lambda *_: None).chosen.effects == ()
    assert looked == []


@pytest.mark.parametrize(("total", "found"), [(50.0, True), (60.0, False)])
def test_what_is_left_of_a_second_look_must_beat_what_was_there(monkeypatch, total, found):
    search = searching(monkeypatch, {"a": 60.0, "z": total, "az": 40.0})
    monkeypatch.setattr(selection, "accepted", lambda *_: True)
    monkeypatch.setattr(selection, "_needed", lambda *_: search.stuck("z"))
    levels = {1: [search.stuck("a")]}
    again = selection._looked_again(search, search.stuck("a"), 4, levels)
    assert (again is not None) == found
    assert (levels[1][0].effects == ("z",)) == found
