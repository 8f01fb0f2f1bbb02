"""The walker's observer: its gain against Riccati's equation, and turns that a law's own commands hide."""

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from fieldmodels.diagnosis import diagnose
from fieldmodels.exam.benches import Conditions, Hidden, get_bench
from fieldmodels.exam.plants import walk
from fieldmodels.exam.sizes import recordings
from fieldmodels.machines.line_following.observer import observer_gain

OUTPUTS = ("line", "offset", "heading")


def of_riccati() -> np.ndarray:
    """Gain of the stationary Kalman filter of the plant, linear about the line."""
    robot, small = walk.Walker(), 1e-5
    here = robot.look(np.zeros(1), np.zeros(1))
    line = [
        (robot.look(np.array([a]), np.array([b])) - here)[0] / small for a, b in ((small, 0.0), (0.0, small))
    ]
    seen = np.array([line, [1.0, 0.0], [0.0, 1.0]])
    onward = np.array([[1.0, robot.stride], [0.0, 1.0]])
    chance = np.diag([walk.NOISE["lateral"], walk.NOISE["yaw"]]) ** 2
    noise = np.diag([walk.NOISE[name] for name in OUTPUTS]) ** 2
    spread = solve_discrete_are(onward.T, seen.T, chance, noise)
    return onward @ spread @ seen.T @ np.linalg.inv(seen @ spread @ seen.T + noise)


@pytest.mark.parametrize("commands", ["", "law"])
def test_the_gain_is_that_of_a_kalman_filter_whether_or_not_the_law_adds_anything(commands):
    """From 20,000 strides to 0.04; standard errors are of 0.01."""
    conditions = Conditions(duration=24_000.0, commands=commands)
    train, _ = recordings(get_bench("line_following"), [], conditions, 7)
    assert observer_gain([train], OUTPUTS) == pytest.approx(of_riccati(), abs=0.04)


def test_short_records_have_no_observer():
    bench = get_bench("line_following")
    train, _ = recordings(bench, [], Conditions(duration=100.0), 7)
    assert observer_gain([train], OUTPUTS) is None
    assert not bench.model.scaled_to([train]).corrected


def test_the_law_that_answers_to_chance_makes_no_turn_seem_smaller():
    """Errors over seven strides had put a gain 1.5 standard errors too low on average, a lost turn 1.9 high.

    The mean of 8 standardised errors has a standard deviation of 0.35.
    """
    bench, off = get_bench("line_following"), []
    for seed in range(5_000, 5_008):
        train, test = recordings(bench, [Hidden("turn_gain", 3.0, -1)], Conditions(), seed)
        causes = diagnose(bench.model, [train], [test]).causes
        assert [cause.effect for cause in causes] == ["turn_gain"]
        gain = causes[0].parameters["factor"]
        off.append((gain.value - bench.values("turn_gain", 3.0, -1, seed)["factor"]) / gain.std)
    assert abs(np.mean(off)) < 1.0
    assert np.sqrt(np.mean(np.square(off))) < 1.8
