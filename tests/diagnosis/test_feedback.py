"""A controller feeds noise back: its command holds what a sensor errs, and nothing is wrong with that."""

import numpy as np
import pytest
from scipy.signal import lfilter

from fieldmodels.diagnosis import diagnose
from fieldmodels.diagnosis.feedback import _told, fed_back
from fieldmodels.diagnosis.problem import build
from fieldmodels.recording import Recording
from fieldmodels.registry import get_model

STEP, INERTIA, GRAVITY = 0.005, 0.055, 1.2
PENDULUM = get_model("pendulum")


def pendulum(seed, count=4000, feedback=(1.0, 1.0), measured=0.0, keep=0.8):
    """A swing along a smooth path, by a controller that is shown noise, or by the same commands without.

    Args:
        seed: Of path and noise.
        count: Samples.
        feedback: How much of what each sensor errs the controller is shown.
        measured: Share of its acceleration that the angle's sensor shows too much [s^2].
        keep: Of a sample's noise in the next one.
    """
    rng = np.random.default_rng(seed)
    smooth = lfilter([1], [1, -0.99], lfilter([1], [1, -0.99], rng.normal(size=count)))
    path = 0.3 * smooth / np.abs(smooth).max()
    white = rng.normal(size=(count, 2)) * np.sqrt(1 - keep**2)
    noise = lfilter([1], [1, -keep], white, axis=0) * [3e-3, 3e-2]
    angle, speed, rows = 0.0, 0.0, []
    for n in range(count):
        shown = np.array([angle, speed]) + noise[n] * feedback
        torque = 4.0 * (path[n] - shown[0]) - 0.35 * shown[1]
        rows.append((torque, angle, speed, (torque - GRAVITY * np.sin(angle)) / INERTIA))
        for _ in range(10):  # semi-implicit Euler, half a millisecond
            speed += STEP / 10 * (torque - GRAVITY * np.sin(angle)) / INERTIA
            angle += STEP / 10 * speed
    torque, angle, speed, acceleration = np.array(rows).T
    columns = {
        "torque": torque,
        "angle": angle + measured * acceleration + noise[:, 0],
        "velocity": speed + noise[:, 1],
    }
    return Recording(STEP * np.arange(count), columns, source="pendulum")


@pytest.mark.parametrize("seed", [1, 5])
def test_noise_that_is_fed_back_is_no_curve_of_the_acceleration(seed):
    found = diagnose(PENDULUM, [pendulum(seed)], [pendulum(100 + seed)])
    assert found.verdict == "consistent"


@pytest.mark.matrix(keep=("feedback0",))
@pytest.mark.parametrize("feedback", [(0.0, 0.0), (1.0, 1.0)])
def test_a_sensor_that_shows_the_acceleration_is_found_in_closed_loop_too(feedback):
    """It shows what the path moves, too, not only what the noise does."""
    train, test = (pendulum(seed, feedback=feedback, measured=5e-3) for seed in (1, 101))
    found = diagnose(PENDULUM, [train], [test])
    assert ("sensor", "angle", "rate of velocity") in [(c.place, c.target, c.over) for c in found.curves]


def loop(seed, gain, late=0, count=3000):
    """A lag of ten samples whose command follows what was measured so many samples before, and a path."""
    rng = np.random.default_rng(seed)
    path = lfilter([1], [1, -0.9], rng.normal(size=count))
    noise = 0.3 * rng.normal(size=count)
    state, shown, command = 0.0, np.zeros(count), np.zeros(count)
    for n in range(count):
        shown[n] = state + noise[n]
        command[n] = path[n] - gain * shown[max(n - late, 0)]
        state += 0.1 * (command[n] - state)
    return command, shown, np.array([[0, count]])


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("late", [0, 1])
def test_what_is_fed_back_is_a_share_of_the_innovations(seed, late):
    """At least that of the noise in the command, and more where what came before does not tell the state."""
    assert _told(*loop(seed, 0.0, late)) < 0.005
    for gain in (0.5, 2.0):
        share = (0.3 * gain) ** 2 / (1.0 + (0.3 * gain) ** 2)
        assert 0.6 * share < _told(*loop(seed, gain, late)) < 2.0 * share


def test_gaps_and_short_episodes_tell_nothing_of_their_own():
    command, shown, whole = loop(1, 2.0)
    told = _told(command, shown, whole)
    shown[::50] = np.nan
    assert _told(command, shown, np.array([[0, 3], [3, 1500], [1500, 3000]])) == pytest.approx(told, abs=0.02)
    assert _told(command, shown, np.array([[0, 3], [3, 6]])) == 0.0


def test_a_sensor_that_feels_steps_of_a_command_is_not_taken_for_feedback():
    rng = np.random.default_rng(4)
    command = np.repeat(rng.normal(size=300), 10)
    bounds = np.array([[0, 3000]])
    assert _told(command, 0.5 * command + 0.1 * rng.normal(size=3000), bounds) == 0.0
    each = rng.normal(size=3000)  # at every sample it cannot be told from that
    assert _told(each, 0.5 * each + 0.1 * rng.normal(size=3000), bounds) > 0.5


def test_each_sensor_is_asked_by_itself():
    problem = build(PENDULUM, [pendulum(3, count=2000, feedback=(0.0, 1.0), keep=0.0)], 0.3)
    assert not fed_back(problem, "angle")
    assert fed_back(problem, "velocity")
