"""Stated standard errors are the spread of estimates, even where few windows say how errors correlate."""

import numpy as np
from scipy.signal import lfilter

from fieldmodels.diagnosis.fit import fit, weighed
from fieldmodels.diagnosis.problem import build
from fieldmodels.diagnosis.uncertainty import standard_errors
from fieldmodels.diagnosis.whitening import covariance_whitener, diagonal_whitener
from fieldmodels.model import Model, Parameter, Signal
from fieldmodels.recording import Recording

STEP, NOISE = 0.02, 0.1
TRUTH = np.array([0.8, 0.6, 1.3])
RNG = np.random.default_rng(5)
COMMAND = lfilter([1], [1, -0.9], RNG.normal(size=4800))


class Wave(Model):
    """An offset that stays within a window, plus a commanded part and a wave of unknown frequency."""

    name = "wave"
    inputs = (Signal("command", "1"),)
    outputs = (Signal("level", "m", noise=NOISE),)
    states = (Signal("offset", "m"),)
    parameters = (
        Parameter("gain", "m", 1.0, -10.0, 10.0, 0.1),
        Parameter("height", "m", 1.0, -10.0, 10.0, 0.1),
        Parameter("frequency", "Hz", 1.3, 0.01, 25.0, 0.01),
    )
    effects = ()
    horizons = (0.4, 0.8)

    def simulate(self, parameters, windows):
        gain, height, frequency = np.atleast_2d(parameters).T[:, :, None, None]
        rows = np.minimum(windows.starts[:, None] + np.arange(windows.samples), len(windows.recording) - 1)
        wave = height * np.sin(2 * np.pi * frequency * windows.recording.time[rows])
        return (windows.states[:, :1] + gain * windows.recording["command"][rows] + wave)[..., None]

    def initial_states(self, recording, starts):
        return recording["level"][starts][:, None]


def record(seed, count=1200, correlation=0.0):
    """The same machine and commands, and other noise."""
    noise = NOISE * lfilter([1], [1, -correlation], np.random.default_rng(seed).normal(size=count))
    time = STEP * np.arange(count)
    level = TRUTH[0] * COMMAND[:count] + TRUTH[1] * np.sin(2 * np.pi * TRUTH[2] * time) + noise
    return Recording(time, {"command": COMMAND[:count], "level": level})


def ratios(correlation):
    """Errors of 100 records with 29 windows each over their stated standard errors."""
    result = []
    for seed in range(100, 200):
        problem, free = build(Wave(), [record(seed, correlation=correlation)], 0.8), np.arange(3)
        first = weighed(problem, fit(problem, TRUTH, free, diagonal_whitener(problem, problem.features)), 20)
        found = fit(problem, first.parameters, free, covariance_whitener(problem, first), first.states)
        result.append((found.parameters - TRUTH) / standard_errors(problem, found))
    return np.abs(result)


def test_an_interval_covers_as_often_as_it_says():
    """The residual covariance is estimated from the same windows; a standard error of coverage is 1.9 %."""
    both = np.concatenate([ratios(0.0), ratios(0.9)])
    assert 0.66 < np.mean(both < 1) < 0.76
    assert np.mean(both < 2) > 0.94


def test_the_derivative_by_a_frequency_is_that_of_a_small_change():
    """A hundredth of a frequency is half a turn after 40 periods."""
    problem = build(Wave(), [record(1)], 0.8)
    found = fit(problem, TRUTH, np.array([2]), np.eye(len(problem.outputs)), iterations=0)
    near = np.repeat(TRUTH[None], 2, axis=0)
    near[:, 2] *= [1 + 1e-6, 1 - 1e-6]
    above, below = problem.simulate(near, found.states)
    derivative = (above - below) / 2e-6
    own = derivative - derivative.mean(axis=1, keepdims=True)  # the offset of each window is free
    np.testing.assert_allclose(found.jacobian[:, :-1, 0], own, atol=0.05 * np.abs(own).max())


def test_a_parameter_without_influence_has_no_standard_error():
    problem = build(Wave(), [record(2)], 0.8)
    found = fit(
        problem, np.array([0.8, 0.0, 1.3]), np.array([0, 2]), np.eye(len(problem.outputs)), iterations=0
    )
    errors = standard_errors(problem, found)
    assert errors[0] > 0
    assert np.isnan(errors[1])
