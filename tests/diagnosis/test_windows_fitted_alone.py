"""Windows are independent given the parameters: a poor start of one keeps no other from its own."""

from dataclasses import replace

import numpy as np
import pytest

from fieldmodels.diagnosis.fit import fit
from fieldmodels.diagnosis.gain import predict
from fieldmodels.diagnosis.problem import build
from fieldmodels.model import Model, Parameter, Signal
from fieldmodels.recording import Recording

STEP, SAMPLES, WINDOWS, NOISE = 0.02, 80, 30, 0.002
RATE = 4.0
LONG = (SAMPLES - 1) * STEP  # of a window [s]


class Swing(Model):
    """A frictionless swing, whose acceleration is -rate^2 sin(angle): a wrong start goes over the top."""

    name = "swing"
    inputs = ()
    outputs = (Signal("angle", "rad", noise=NOISE),)
    states = (Signal("angle", "rad"), Signal("speed", "rad/s"))
    parameters = (Parameter("rate", "rad/s", 3.6, 0.01, 10.0, 0.1),)
    effects = ()
    horizons = (LONG, LONG)

    def simulate(self, parameters, windows):
        square = np.atleast_2d(parameters)[:, :1] ** 2
        angle = np.repeat(windows.states[None, :, 0], len(square), axis=0)
        speed = np.repeat(windows.states[None, :, 1], len(square), axis=0)
        result = np.empty((*angle.shape, windows.samples, 1))
        for n in range(windows.samples):
            result[:, :, n, 0] = angle
            speed = speed - STEP * square * np.sin(angle)
            angle = angle + STEP * speed
        return result

    def initial_states(self, recording, starts):
        return np.column_stack([recording["angle"][starts], recording["speed"][starts]])


class Growth(Swing):
    """An amount that changes at 10 (rate amount^2 - amount): from above 1/rate it soon reaches infinity."""

    name = "growth"
    outputs = (Signal("angle", "1", noise=NOISE),)
    states = (Signal("angle", "1"),)
    parameters = (Parameter("rate", "1", 1.0, 0.01, 10.0, 0.1),)

    def simulate(self, parameters, windows):
        rate = np.atleast_2d(parameters)[:, :1]
        amount = np.repeat(windows.states[None, :, 0], len(rate), axis=0)
        result = np.empty((*amount.shape, windows.samples, 1))
        with np.errstate(over="ignore", invalid="ignore"):
            for n in range(windows.samples):
                result[:, :, n, 0] = amount
                amount = amount + STEP * 10.0 * (rate * amount**2 - amount)
        return result

    def initial_states(self, recording, starts):
        return recording["angle"][starts][:, None]


def swings(seed=0):
    """Thirty short episodes of a swing, by a thousand small steps each; true starts are measured."""
    rng = np.random.default_rng(seed)
    angles, speeds = [], []
    for _ in range(WINDOWS):
        angle, speed = rng.uniform(-2.0, 2.0), rng.uniform(-1.0, 1.0)
        for n in range(SAMPLES * 25):
            if n % 25 == 0:
                angles.append(angle)
                speeds.append(speed)
            speed -= STEP / 25 * RATE**2 * np.sin(angle)
            angle += STEP / 25 * speed
    return recorded(np.array(angles) + NOISE * rng.standard_normal(len(angles)), np.array(speeds))


def recorded(angle, speed):
    time = np.tile(np.arange(SAMPLES) * STEP, WINDOWS)
    episode = np.repeat(np.arange(WINDOWS), SAMPLES)
    return Recording(time, {"angle": angle, "speed": speed}, episode=episode)


def fitted(problem, states=None, free=(0,), iterations=40, parameters=None):
    """A fit with errors weighed by the sensor's noise in an average of four samples."""
    whitener = np.eye(len(problem.outputs)) / NOISE
    start = problem.model.nominal if parameters is None else parameters
    return fit(problem, start, np.array(free, dtype=np.int64), whitener, states, iterations)


@pytest.fixture(scope="module")
def problem():
    return build(Swing(), [swings()], LONG)


def thrown(problem):
    """Measured states, three of them nearly a turn too fast."""
    states = problem.states.copy()
    states[[3, 11, 20], 1] += [6.0, -6.0, 6.0]
    return states


def test_some_poor_starts_end_where_good_ones_do(problem):
    good = fitted(problem)
    assert good.parameters[0] == pytest.approx(RATE, rel=1e-3)
    poor = fitted(problem, thrown(problem))
    assert poor.cost == pytest.approx(good.cost, abs=0.1)
    assert poor.parameters == pytest.approx(good.parameters, rel=1e-4)


def test_with_parameters_known_no_window_notices_another(problem):
    states, parameters = thrown(problem), np.array([3.8])
    others = np.delete(np.arange(len(problem)), [3, 11, 20])
    for steps in (1, 2, 3, 4):
        beside = fitted(problem, states, (), steps, parameters)
        alone = fitted(problem, None, (), steps, parameters)
        assert beside.states[others] == pytest.approx(alone.states[others], abs=1e-9)


def test_no_step_raises_the_cost(problem):
    states = thrown(problem)
    costs = [fitted(problem, states, iterations=k).cost for k in range(16)]
    assert (np.diff(costs) <= 1e-9).all()
    assert costs[-1] < 1e-3 * costs[0]


def test_without_parameters_no_window_gets_worse(problem):
    states = thrown(problem)
    parameters = np.array([RATE])
    before = fitted(problem, states, (), 0, parameters)
    after = fitted(problem, states, (), 20, parameters)
    prior = (problem.states - states) / (2.0 * problem.state_scale)
    then = np.sum((before.raw / NOISE) ** 2, axis=1) + np.sum(prior**2, axis=1)
    prior = (problem.states - after.states) / (2.0 * problem.state_scale)
    now = np.sum((after.raw / NOISE) ** 2, axis=1) + np.sum(prior**2, axis=1)
    assert (now < then + 0.01).all()
    assert now.max() < 100


@pytest.fixture(scope="module")
def growing():
    """Thirty windows of a rate of 0.8, in closed form."""
    rng = np.random.default_rng(1)
    time, starts = np.arange(SAMPLES) * STEP, rng.uniform(0.1, 0.9, WINDOWS)
    clean = np.concatenate([1 / (0.8 + (1 / x - 0.8) * np.exp(10 * time)) for x in starts])
    noisy = clean + NOISE * rng.standard_normal(len(clean))
    return build(Growth(), [recorded(noisy, 0 * clean)], LONG)


def test_a_window_that_diverges_returns_and_the_others_do_not_wait_for_it(growing):
    states = growing.states.copy()
    states[[2, 9]] = [[6.0], [40.0]]
    assert not np.isfinite(fitted(growing, states, iterations=0).cost)
    found, good = fitted(growing, states), fitted(growing)
    assert found.cost == pytest.approx(good.cost, abs=0.1)
    assert found.parameters == pytest.approx(good.parameters, rel=1e-3)


def test_where_every_window_diverges_the_cost_says_so(growing):
    assert fitted(growing, np.full_like(growing.states, 1e50), (), 5).cost == float("inf")


class Broken(Growth):
    """It has no number for the first window of a recording."""

    def simulate(self, parameters, windows):
        result = super().simulate(parameters, windows)
        result[:, windows.starts == 0] = np.nan
        return result


@pytest.mark.filterwarnings("error")
def test_a_window_without_a_prediction_is_left_out_without_a_word(growing):
    """Also of a sensor whose zero wanders, that is free in each window."""
    broken = replace(growing, model=Broken())
    others = growing.select(np.arange(len(growing)) > 0)
    for wandering in ((), (0,)):
        found, expected = (predict(one, np.array([0.8]), wandering).rmse() for one in (broken, others))
        assert found == pytest.approx(expected, rel=0.02)
