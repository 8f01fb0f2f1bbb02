"""The search of names and curves by their evidence, which is on trial."""

import math
import sys
import warnings
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import expit
from scipy.stats import multivariate_t, norm

sys.path.insert(0, str(Path(__file__).parent))
from test_budget import STEP, Cart, record

from fieldmodels.diagnosis import diagnose
from fieldmodels.diagnosis.candidates import Candidates
from fieldmodels.diagnosis.cutting import split
from fieldmodels.diagnosis.gain import noise_floor, predict
from fieldmodels.diagnosis.marginal import (
    FALLS,
    FREEDOM,
    ORDERS,
    PACES,
    SIZES,
    STRENGTHS,
    Evidence,
    _by_distance,
    _deviations,
    _least,
    _near,
)
from fieldmodels.diagnosis.options import DiagnosisOptions
from fieldmodels.diagnosis.posterior import SAME, _curves_instead, _with_test, bagged, posterior_of
from fieldmodels.diagnosis.result import MissingCurve
from fieldmodels.diagnosis.search import Search
from fieldmodels.diagnosis.statements import explained
from fieldmodels.drivers.variables import direction_of
from fieldmodels.model import Effect, Parameter
from fieldmodels.recording import Recording
from fieldmodels.registry import get_model

EVIDENCE = DiagnosisOptions(engine="evidence")


def candidates_of(recording: Recording, cart: Cart | None = None, **drag: float) -> Candidates:
    model = cart or Cart()
    problem, _ = split(model, [recording], [])
    whitener = np.diag(1 / problem.output_scale)
    start, known = model.vector({}, {"drag": drag}), frozenset(f"drag.{name}" for name in drag)
    return Candidates(problem, start, known, problem.folds, whitener)


def test_the_evidence_of_errors_is_the_product_of_what_each_predicts_of_the_next():
    """By scipy's multivariate t, one row after the other, in place of the closed form."""
    evidence = Evidence(candidates_of(record(1)).problem)
    rng = np.random.default_rng(4)
    rows = rng.standard_normal((30, len(evidence._number))) * 0.02
    rows[:, 1] += 0.9 * rows[:, 0]
    found, covariance = evidence._errors(rows.T @ rows, len(rows))
    features, windows = rows.shape[1], STRENGTHS[evidence._strength] * rows.shape[1]
    prior = windows * (covariance * (windows + len(rows)) - rows.T @ rows) / windows
    freedom, total = windows + features + 1.0, 0.0
    for row in rows:
        df = freedom - features + 1.0
        total -= multivariate_t.logpdf(row, shape=prior / df, df=df)
        prior, freedom = prior + np.outer(row, row), freedom + 1.0
    assert found == pytest.approx(total, rel=1e-9)


def test_far_errors_cost_what_students_t_says():
    squares, size = np.array([0.5, 4.0, 300.0]), 4
    weights, cost = _by_distance(squares, size)
    normal = 0.5 * float(weights @ squares) + 0.5 * size * len(squares) * math.log(2.0 * math.pi)
    rows = np.zeros((3, size))
    rows[:, 0] = np.sqrt(squares)
    told = -float(multivariate_t.logpdf(rows, shape=np.eye(size), df=FREEDOM).sum())
    assert cost + normal == pytest.approx(told, rel=1e-12)


def test_a_cause_is_seen_by_errors_in_one_direction_out_of_many():
    """By the covariance of what lacks it, it is one of ten directions, each as large as the others."""
    evidence = Evidence(candidates_of(record(1)).problem)
    rng = np.random.default_rng(7)
    features = len(evidence._number)
    white = 0.01 * rng.standard_normal((20, features))
    lacking = white + 0.1 * rng.standard_normal((20, 1)) * np.sin(np.arange(features))
    values = [evidence._errors(rows.T @ rows, 20)[0] for rows in (lacking, white)]
    own = np.linalg.inv(np.linalg.cholesky(lacking.T @ lacking / 20 + 1e-6 * np.eye(features)))
    by_the_weights = [0.5 * float(np.sum((rows @ own.T) ** 2)) for rows in (lacking, white)]
    assert values[0] - values[1] > 30.0
    assert by_the_weights[0] - by_the_weights[1] < 15.0


@pytest.mark.every("drift", [0.0, 0.5])
def test_a_slow_zero_is_part_of_the_evidence_where_there_is_one(drift):
    walk = drift * np.cumsum(np.random.default_rng(5).standard_normal(2000)) / math.sqrt(2000)
    measured = record(1)
    candidates = candidates_of(
        Recording(measured.time, {**measured.signals, "speed": measured["speed"] + walk}), rate=0.6
    )
    evidence, fitted = Evidence(candidates.problem), candidates.base().fit
    rows = evidence._rows(fitted.raw)
    start = evidence._white(np.diff(rows, axis=0) / math.sqrt(2.0))
    still = evidence._settled(candidates.problem, fitted, evidence._white(rows))[0]
    slow = evidence._settled(candidates.problem, fitted, start, still)[0]
    assert (slow < still) == (drift > 0.0)
    assert evidence.of(candidates.problem, fitted).value <= min(still, slow) + 0.1


@pytest.mark.every("size", [0.0, 0.03, 0.06, 0.1, 0.3])
def test_paces_are_the_likeliest_that_no_neighbour_outdoes(size):
    """By the density of what is measured itself: of two sensors, whose zeros share what is fitted."""
    rng, windows = np.random.default_rng(5), 60
    sines = math.sqrt(2.0) * np.sin(np.pi * (np.arange(windows) + 0.5)[:, None] / windows * ORDERS)
    sines[:, 0] = 1.0
    slow = np.kron([[1.0, 0.0], [0.6, 0.8]], sines)
    x = np.column_stack([np.ones(2 * windows), rng.standard_normal(2 * windows)])

    def against(paces: list[int]) -> float:
        covariance = np.eye(2 * windows) + (slow * _deviations(paces).ravel() ** 2) @ slow.T
        left = np.linalg.solve(np.linalg.cholesky(covariance), both)
        errors = left[:, 2] - left[:, :2] @ np.linalg.lstsq(left[:, :2], left[:, 2], rcond=None)[0]
        spread = 0.5 * np.linalg.slogdet(covariance)[1]
        return spread + 0.5 * errors @ errors + math.log(len(PACES)) * np.count_nonzero(paces)

    for _ in range(12):
        walks = size * rng.standard_normal((2, windows)).cumsum(axis=1).ravel()
        both = np.column_stack([x, 3.0 * x[:, 1] + walks + rng.standard_normal(2 * windows)])
        found = _least(slow.T @ slow, slow.T @ both, both.T @ both)
        ways = [_near(k) if k else range(len(PACES)) for k in found]
        near = [[*found[:j], int(k), *found[j + 1 :]] for j in range(2) for k in ways[j]]
        assert against(found) == pytest.approx(min(map(against, [found, *near])), abs=1e-6)


def test_paces_are_reached_from_one_another():
    """From the first, by neighbours alone, every pace, and none."""
    reached, new = {1}, [1]
    while new:
        new = [int(i) for pace in new if pace for i in _near(pace) if int(i) not in reached]
        reached |= set(new)
    assert reached == set(range(1 + len(FALLS) * len(SIZES)))


def test_a_cause_is_named_with_its_probability_and_nothing_else_is():
    found = diagnose(Cart(), [record(1)], options=EVIDENCE)
    [cause] = found.causes
    assert (cause.effect, found.curves) == ("drag", ())
    assert cause.parameters["rate"].value == pytest.approx(0.6, abs=3 * cause.parameters["rate"].std)
    assert cause.chance < 1e-6


def test_probabilities_are_shares_of_the_sets_that_both_records_leave():
    search, testing = Search(candidates_of(record(1))), candidates_of(record(101)).problem
    search.run()
    totals, blocks = _with_test(search, testing)
    least, order = min(totals.values()), sorted(totals, key=lambda one: totals[one])
    scores = np.array([totals[one] for one in order])
    shares = bagged(scores, np.array([blocks[one] for one in order]), np.random.default_rng(0))
    said = posterior_of(search, testing, np.random.default_rng(0))
    with_drag = sum(share for one, share in zip(order, shares, strict=True) if "drag" in one.names)
    assert said.names["drag"] == pytest.approx(with_drag)
    of_both = [len(set(one.blocks)) for one in (search.base.setting.problem, testing)]
    assert len(blocks[said.lead]) == sum(of_both)
    near = {one.names for one, total in totals.items() if total < least + SAME}
    assert (said.lead.names, near) == (("drag",), {("drag",), ("drag", "slope")})
    scores = {one.names: search.score(one) for one in search.sets if not one.curves}
    assert scores["drag",] < scores[()]
    assert scores["drag", "slope"] > scores["drag",]  # a number more that brings nothing has its price


@pytest.mark.every("spread", [0.0, 2.0, 8.0])
def test_certainty_is_what_other_blocks_of_the_records_would_leave_of_it(spread):
    """By the integral over how a sum over 400 resampled blocks varies about six nats; its error is 0.02."""
    rng = np.random.default_rng(9)
    ahead = rng.standard_normal(400)
    ahead *= spread / np.sqrt(np.sum((ahead - ahead.mean()) ** 2))
    found = bagged(np.array([10.0, 16.0]), np.stack([0.0 * ahead, ahead + 1.0]), rng)
    over = quad(lambda z: expit(6.0 + spread * z) * norm.pdf(z), -8.0, 8.0)[0]
    assert found == pytest.approx([over, 1.0 - over], abs=0.04)
    assert found[1] == pytest.approx(1.0 - over, rel=0.4)


def test_a_set_costs_its_numbers_and_what_was_tried():
    """Half a logarithm of the samples a number, of the names or curves tried, and the odds of something."""
    search = Search(candidates_of(record(1)))
    one = search.sets.with_name(search.base, "drag", [], search.marginal(search.base).whitener)
    number, start = 0.5 * math.log(search.evidence.rows), one.candidate.search
    assert search.score(search.base) == search.marginal(search.base).value
    priced = search.score(one) - search.marginal(one).value - start
    assert priced == pytest.approx(number + math.log(2.0) + math.log(20.0), abs=0.01)
    curve = search.curves_beside(search.base).all[0]
    tried = math.log(len(search.curves_beside(search.base).all) * curve.tried)
    assert search.price_of_curve(curve, 3) == pytest.approx(3 * number + tried + math.log(10.0), abs=0.01)


@pytest.mark.every("again", [1.0, 0.4, 0.0])
def test_what_one_record_shows_and_another_does_not_is_not_of_the_machine(again):
    """A push of 0.04 m/s2, 10 times its standard error; in the test all, less than half or nothing of it."""

    def pushed(seed, push):
        cart = record(seed)
        speed, own = np.zeros(len(cart.time)), np.random.default_rng(seed + 50)
        for n in range(len(speed) - 1):
            speed[n + 1] = speed[n] + STEP * (cart["force"][n] / 1.4 - 0.6 * speed[n] + push)
        return Recording(cart.time, {**cart.signals, "speed": speed + 0.01 * own.standard_normal(len(speed))})

    options = {"fixed": {"drag.rate": 0.6}, "options": EVIDENCE}
    found = diagnose(Cart(), [pushed(1, 0.04)], [pushed(2, 0.04 * again)], **options)
    assert [cause.effect for cause in found.causes] == ["slope"] * (again == 1.0)


def test_a_gain_is_foreseen_whatever_size_an_effect_usually_has():
    """A drag that is usually 30 times what it is here stops the cart in a sample, whatever it is."""
    rates = {
        scale: Effect("drag", "Air.", "force", (Parameter("rate", "1/s", 0.0, -50.0, 50.0, scale),))
        for scale in (0.05, 19.0)
    }
    foreseen = []
    for drag in rates.values():
        cart = Cart()
        cart.effects = (drag, Cart.effects[1])
        candidates = candidates_of(record(1), cart)
        foreseen.append(candidates.score_test(candidates.base(), "drag"))
    assert foreseen[1] == pytest.approx(foreseen[0], rel=0.2)


@pytest.mark.every("memory, rates, share", [(0.95, (0.55, 0.6), 1.0), (0.0, (0.0, 0.3), 0.75)])
def test_noise_is_as_large_where_nothing_moves(memory, rates, share):
    """Errors above a sensor's white noise leave doubt only where they grow with the movement."""
    rng = np.random.default_rng(6)
    cart = record(1)
    force = cart["force"] * np.repeat(np.tile([0.05, 1.0], 10), 100)
    speed, noise = np.zeros(2000), np.zeros(2000)
    for n in range(1999):
        speed[n + 1] = speed[n] + STEP * (force[n] / 1.4 - 0.6 * speed[n])
        noise[n + 1] = memory * noise[n] + 0.01 * rng.standard_normal()
    testing = candidates_of(Recording(cart.time, {"force": force, "speed": speed + noise})).problem
    before, after = (predict(testing, Cart().vector({"mass": 1.4}, {"drag": {"rate": r}})) for r in rates)
    assert after.rmse()[0] > 1.7 * noise_floor(testing, after, 0)
    assert explained(testing, before, after, 1.7) == pytest.approx(share, abs=0.1)


def test_a_sensor_that_wanders_is_no_cause():
    """A walk as large as the noise is integrated out, where without that it is a slope."""
    cart = record(3)
    rng = np.random.default_rng(8)
    walk = np.cumsum(rng.standard_normal(len(cart.time))) * 0.03 / math.sqrt(500)
    known = {"rate": 0.6}
    still = Recording(cart.time, {**cart.signals, "speed": cart["speed"] + walk})
    found = diagnose(Cart(), [still], fixed={"drag.rate": known["rate"]}, options=EVIDENCE)
    assert (found.causes, found.curves) == ((), ())


def plateaus(speeds: tuple[int, ...], seed: int) -> Recording:
    """A motor at constant speeds under a speed loop: viscous friction of 0.02, dry friction of 0.15."""
    rng, angle, speed, sum_of, rows = np.random.default_rng(seed), 0.0, 0.0, 0.0, []
    inertia, viscous, dry, step = 0.003, 0.02, 0.15, 0.0005
    for n, wanted in enumerate(np.repeat(speeds, 200)):
        sum_of += 0.01 * (wanted - speed)
        torque = 0.08 * (wanted - speed - 0.02 * rng.normal()) + 0.3 * sum_of
        rows.append((0.01 * n, torque, angle + 1e-3 * rng.normal(), speed + 0.02 * rng.normal()))
        for _ in range(20):
            push = torque - viscous * speed
            if speed == 0.0 and abs(push) <= dry:
                continue
            new = speed + step * (push - dry * np.sign(speed if speed else push)) / inertia
            speed = 0.0 if speed and new * speed < 0.0 and abs(push) <= dry else new
            angle += step * speed
    time, *signals = np.transpose(rows)
    return Recording(time, dict(zip(("torque", "angle", "velocity"), signals, strict=True)))


def test_two_causes_are_found_that_are_each_worse_alone():
    """The friction test of every robot lab: constant speeds both ways."""
    train = plateaus((0, 1, -1, 2, -2, 4, -4, 8, -8, 0), 1)
    test = plateaus((0, 2, -4, 1, -1, 8, -2, 4, -8, 0), 2)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = diagnose(
            get_model("pendulum"), [train], [test], fixed={"gravity_moment": 0.0}, options=EVIDENCE
        )
    values = {c.effect: next(iter(c.parameters.values())).value for c in found.causes}
    assert values == pytest.approx({"coulomb_friction": 0.15, "viscous_friction": 0.02}, rel=0.02)


def test_a_curve_says_what_these_data_do_not_tell_from_it():
    def one(*curves):
        made = [SimpleNamespace(curve=SimpleNamespace(place=p, target=t, over=o)) for p, t, o in curves]
        return SimpleNamespace(names=("lag",), curves=tuple(made))

    flow, size, stem, clock = (("parameter", "travel", o) for o in ("flow", "size of flow", "stem", "time"))
    drag = ("force", "", "speed")
    lead = one(flow, drag)
    near = [lead, one(size, drag), one(stem, drag), one(clock, stem), one(stem)]
    assert _curves_instead(lead, near, lead.curves[0]) == (stem,)
    assert _curves_instead(lead, near, lead.curves[1]) == ()
    curve = MissingCurve(*flow, "m^3/s", "s", np.zeros((2, 3)), 0.0, 50.0, alternatives=(stem,))
    assert curve.words == "the flow and acts on the travel or on the stem and acts on the travel"
    assert curve.to_json()["alternatives"] == [direction_of(*stem)]
