"""Stated standard errors are the spread of estimates, even where few windows say how errors correlate."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from exam.benches import Conditions, get_bench
from exam.sizes import recordings
from fieldmodels.diagnosis.fit import fit, weighed
from fieldmodels.diagnosis.problem import build
from fieldmodels.diagnosis.result import Cause, Estimate, Share
from fieldmodels.diagnosis.uncertainty import (
    amplitudes,
    differs_from_neutral,
    size_by_chance,
    standard_errors,
)
from fieldmodels.diagnosis.whitening import covariance_whitener, diagonal_whitener
from fieldmodels.drivers.curved import Curved, FreeCurve
from fieldmodels.model import Effect, Model, Parameter, Signal
from fieldmodels.recording import Recording
from fieldmodels.registry import get_model

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


class Hummed(Wave):
    """The same with a hum that may not be there: two amplitudes and a frequency."""

    name = "hummed"
    parameters = Wave.parameters[:1]
    effects = (
        Effect(
            "hum",
            "It hums.",
            "force",
            (
                Parameter("sine", "m", 0.0, -10.0, 10.0, 0.1),
                Parameter("cosine", "m", 0.0, -10.0, 10.0, 0.1),
                Parameter("frequency", "Hz", 1.3, 0.01, 25.0, 0.01),
            ),
        ),
    )

    def simulate(self, parameters, windows):
        gain, sine, cosine, frequency = np.atleast_2d(parameters).T[:, :, None, None]
        rows = np.minimum(windows.starts[:, None] + np.arange(windows.samples), len(windows.recording) - 1)
        turn = 2 * np.pi * frequency * windows.recording.time[rows]
        hum = sine * np.sin(turn) + cosine * np.cos(turn)
        return (windows.states[:, :1] + gain * windows.recording["command"][rows] + hum)[..., None]


def hum(sizes, errors, together=0.0):
    """A hum of such amplitudes whose errors are so correlated: the windows, a fit, and it as a cause."""
    problem = build(Hummed(), [record(1)], 0.8)
    square = np.linalg.inv([[1.0, together, 0.0], [together, 1.0, 0.0], [0.0, 0.0, 1.0]])
    rows = np.linalg.cholesky(square).T[None]
    fitted = SimpleNamespace(
        parameters=np.array([0.8, *sizes, 2.0]), states=problem.states, free=np.array([1, 2, 3]),
        information=np.einsum("wrk,wrl->kl", rows, rows),
    )  # fmt: skip
    values = dict(zip(("sine", "cosine"), map(Estimate, sizes, errors, "mm"), strict=True))
    values["frequency"] = Estimate(2.0, 1e-4, "Hz")
    cause = Cause("hum", "It hums.", "force", values, "level", Share(0.0, (0.0, 0.0)))
    return problem, fitted, cause


def differs(sizes, errors, together=0.0):
    """What is said of such a hum."""
    return differs_from_neutral(*hum(sizes, errors, together))


def test_a_curve_in_an_amplitude_makes_no_amplitude_of_a_width():
    """The curve switches Stribeck friction on where its force is 0, too, and its speed then matters."""
    rig = get_model("rig")
    train, _ = recordings(get_bench("rig"), [], Conditions(), 90_003)
    follows = FreeCurve(
        "parameter", "stribeck_friction.force", "position", np.array([-1.0, 1.0]), np.ones((2, 1))
    )
    problem = build(Curved(rig, [follows]), [train], 0.5)
    vector = np.append(rig.nominal, 0.3)
    vector[[rig.index("stribeck_friction.force"), rig.index("stribeck_friction.velocity")]] = 0.5, 0.1
    fitted = SimpleNamespace(parameters=vector, states=problem.states)
    assert amplitudes(problem, fitted, rig.effect("stribeck_friction")) == [0]


@pytest.mark.parametrize("together", [-0.8, 0.0])
@pytest.mark.parametrize("sizes", [(1.4, 0.8), (2.2, 0.0)])
def test_chance_makes_such_a_size_as_often_as_is_said(sizes, together):
    """By draws whose scale is estimated from as many blocks as there are; 3 standard errors of the count."""
    problem, fitted, cause = hum(sizes, (1.0, 1.0), together)
    said, count = size_by_chance(problem, fitted, cause), 400_000
    rng, freedom = np.random.default_rng(2), len(np.unique(problem.blocks)) - 1
    covariance = np.array([[1, together], [together, 1]])
    drawn = rng.multivariate_normal([0, 0], covariance, count)
    drawn /= np.sqrt(rng.chisquare(freedom, (count, 1)) / freedom)

    def form(x):
        return np.einsum("...k,kl,...l->...", x, np.linalg.inv(covariance), x)

    share = np.mean(form(drawn) > form(np.array(sizes)))
    assert said == pytest.approx(share, abs=3 * np.sqrt(share / count))
    assert np.isnan(size_by_chance(*hum(sizes, (1.0, np.nan))))


def test_a_sharp_frequency_is_no_evidence_of_a_hum():
    assert not differs((0.52, -0.16), (0.73, 0.25))
    assert differs((0.0, -0.8), (0.73, 0.25))


@pytest.mark.parametrize("together", [-0.8, 0.0, 0.8])
@pytest.mark.parametrize("sizes", [(1.9, 1.9), (1.9, -1.9), (2.1, 0.0)])
def test_amplitudes_are_judged_together_at_the_level_of_two_standard_errors_of_one(sizes, together):
    """By the density itself: how often chance draws anything as improbable, of 200,000 pairs."""
    drawn = np.random.default_rng(1).multivariate_normal([0, 0], [[1, together], [together, 1]], 200_000)
    density = stats.multivariate_normal([0, 0], [[1, together], [together, 1]])
    as_rare = np.mean(density.pdf(drawn) < density.pdf(sizes))
    assert abs(as_rare - 0.0455) > 0.002  # the draws decide
    assert differs(sizes, (1.0, 1.0), together) == (as_rare < 0.0455)


class Stopped(Hummed):
    """A stop whose neutral place is far beyond the travel: at it, no stiffness does anything."""

    effects = (
        Effect(
            "stop",
            "It hits a stop.",
            "force",
            (
                Parameter("stiffness", "1", 0.0, -10.0, 10.0, 0.1),
                Parameter("place", "m", 1e3, -1e4, 1e4, 1.0),
                Parameter("slant", "1", 0.0, -10.0, 10.0, 0.1),
            ),
        ),
    )

    def simulate(self, parameters, windows):
        gain, stiffness, place, slant = np.atleast_2d(parameters).T[:, :, None, None]
        rows = np.minimum(windows.starts[:, None] + np.arange(windows.samples), len(windows.recording) - 1)
        level = windows.states[:, :1] + gain * windows.recording["command"][rows]
        beyond = np.maximum(level - place, 0.0)
        return (level - stiffness * beyond - slant * np.minimum(beyond, 0.5))[..., None]


def test_the_place_of_a_stop_that_is_neutral_out_of_reach_is_no_amplitude():
    problem = build(Stopped(), [record(1)], 0.8)
    for stiffness, slant, found in ((2.0, 0.0, [0, 2]), (0.0, 0.3, [0, 2])):
        fitted = SimpleNamespace(parameters=np.array([0.8, stiffness, 0.1, slant]), states=problem.states)
        assert amplitudes(problem, fitted, Stopped.effects[0]) == found


SHAPES = {"frequency", "period", "place", "velocity", "distance", "time", "length"}


@pytest.mark.parametrize("name", ["rig", "pendulum", "servo", "pose_reaching", "differential_drive"])
def test_frequencies_places_and_times_are_the_values_that_are_no_amplitudes(name):
    bench = get_bench(name)
    train, _ = recordings(bench, (), Conditions(), 5)
    model = get_model(name).scaled_to([train])
    problem = build(model, [train], model.horizons[0])
    for effect in model.effects:
        fitted = SimpleNamespace(parameters=model.nominal.copy(), states=problem.states)
        inside = model.slice_of(effect.name)
        # as a fit would leave it, a stop within the travel
        fitted.parameters[inside] = [
            p.starts[0] if p.starts else p.nominal + p.scale for p in effect.parameters
        ]
        found = {effect.parameters[k].name for k in amplitudes(problem, fitted, effect)}
        if len(effect.parameters) > 1:
            assert found == {p.name for p in effect.parameters} - SHAPES, effect.name
