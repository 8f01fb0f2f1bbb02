"""Chapter 2's runs, against closed forms and against what the score must change."""

import math
from itertools import pairwise

import numpy as np
import pytest

from papers.heel_strike import basics, gait, sweeps


def quiet(_stage: str, _part: float) -> None:
    pass


STRIKE = math.sqrt(2 * (gait.ENERGY - gait.GRAVITY * math.cos(gait.HALF)))
"""Speed at the strike [m/s], by energy."""


def test_push_off_at_the_strike_costs_what_the_collision_takes():
    # Ruina, Bertram and Srinivasan 2005: the impulse v tan(alpha) turns the speed from one arc into the next.
    impulse, work = gait.needed(0.0)
    assert impulse == pytest.approx(STRIKE * math.tan(gait.HALF), rel=1e-6)
    assert work == pytest.approx(0.5 * impulse**2, rel=1e-6)


def test_without_push_off_the_strike_takes_the_speed_along_the_leading_leg():
    energy, work = gait.step(0.0, 0.0)
    left = 0.5 * (STRIKE * math.cos(2 * gait.HALF)) ** 2 + gait.GRAVITY * math.cos(gait.HALF)
    assert energy == pytest.approx(left, rel=1e-9)
    assert work == 0


def test_a_late_push_off_costs_four_times_as_much_and_work_rises_with_the_lead():
    # Small angles: (v 2 alpha)^2 / 2 against (v alpha)^2 / 2.
    works = [gait.needed(lead)[1] for lead in (0.0, 0.005, 0.01, 0.02, 0.04)]
    assert all(before < after for before, after in pairwise(works))
    assert gait.needed(-0.001)[1] / works[0] == pytest.approx(4, rel=0.2)


def test_the_double_pendulum_without_a_leg_is_the_single_one():
    time = np.linspace(0, 0.5, 11)
    rate = gait.double_pendulum(1e-9, time)
    angle = -gait.HALF + np.concatenate([[0.0], np.cumsum((rate[1:] + rate[:-1]) / 2 * np.diff(time))])
    energy = 0.5 * rate**2 + gait.GRAVITY * np.cos(angle)
    assert energy == pytest.approx(np.full(11, gait.ENERGY), rel=2e-3)
    assert np.abs(gait.double_pendulum(0.2, time) - rate).max() > 0.1


def test_the_period_is_that_of_the_elliptic_integral_and_of_a_small_swing():
    assert basics._period() == pytest.approx(2 * math.pi / math.sqrt(9.81) * (1 + 1 / (16 * 9.81)), rel=1e-3)


@pytest.mark.every(("decay", "error"), [(995.0, 0.99**200), (1005.0, 1.01**200)])
def test_the_filter_alone_grows_by_its_eigenvalue(decay, error):
    assert basics._filter_alone(decay)[0][199] == pytest.approx(error, rel=0.05)


def test_mean_errors_of_walks_are_those_of_their_strides():
    walks = sweeps.walked((1,), sweeps.Noise(), 30, 3)
    errors = np.arange(2 * 90.0).reshape(2, 90) - 80
    found = sweeps.per_walk(errors, walks, floor_added=False)
    assert found == pytest.approx(np.abs(errors).reshape(2, 3, 30).mean(axis=2))
    added = sweeps.per_walk(np.zeros(90), walks, floor_added=True)
    assert added == pytest.approx([2.0, 2.0, 2.0], rel=0.35)  # mean of |U(-4, 4)| mm


def test_what_a_model_gains_depends_on_the_score():
    result = sweeps.section_2_7.run(quiet, strides=1000, tests=30, process=0.2)
    estimate, added = (
        result.statistics[f"gain over Ranger's estimator, {score} [%]"] for score in sweeps.SCORES
    )
    assert estimate.low > 8
    assert added.high < 6
