"""Binary outputs: the exact likelihood, its gradient, held-out observations, and a whole diagnosis."""

import numpy as np
import pytest
from scipy.optimize import minimize

from fieldmodels.diagnosis import diagnose
from fieldmodels.diagnosis.events import calibration
from fieldmodels.diagnosis.fit import fit
from fieldmodels.diagnosis.held_out import held_out_loss, window_loss
from fieldmodels.diagnosis.problem import build
from fieldmodels.diagnosis.report import write_results
from fieldmodels.diagnosis.response import odds_responses
from fieldmodels.diagnosis.whitening import covariance_whitener, diagonal_whitener
from fieldmodels.model import Effect, Model, Parameter, Signal
from fieldmodels.recording import Recording, RecordingError

STEP = 0.5


class Alarm(Model):
    """A tank whose level is measured, with an alarm that is tested now and then: it sounds or it does not."""

    name = "alarm"
    inputs = (Signal("inflow", "m/s"),)
    outputs = (Signal("level", "m", noise=0.02), Signal("alarm", "1", optional=True, event=True))
    states = (Signal("level", "m", noise=0.02),)
    parameters = (Parameter("outflow", "1/s", 0.1, 0.01, 1.0, 0.01),)
    effects = (
        Effect("threshold", "It sounds late.", "sensor", (Parameter("shift", "m", 0.0, -5, 5, 0.1),)),
        Effect("dull", "It is uncertain.", "sensor", (Parameter("share", "1", 1.0, 0.1, 10, 0.1),)),
        Effect("leak", "Water is lost.", "force", (Parameter("rate", "m/s", 0.0, -1, 1, 0.01),)),
    )
    horizons = (5.0, 10.0)

    def simulate(self, parameters, windows):
        outflow, shift, share, leak = np.atleast_2d(parameters).T[:, :, None]
        inflow = windows.recording["inflow"]
        level = np.repeat(windows.states[None, :, 0], len(outflow), axis=0)
        result = np.empty((len(outflow), len(windows), windows.samples, 2))
        for n in range(windows.samples):
            result[:, :, n, 0] = level
            result[:, :, n, 1] = 1 / (1 + np.exp(-share * 3.0 * (level - 4.0 - shift)))
            level = level + STEP * (inflow[windows.starts + n] - outflow * level - leak)
        return result

    def initial_states(self, recording, starts):
        return recording["level"][starts][:, None]


MODEL = Alarm()
FREE = np.array([0, 1, 2])


def record(seed, count=3000, tested=0.6, shift=0.0, share=1.0, odd=0.0):
    rng = np.random.default_rng(seed)
    inflow = np.repeat(rng.uniform(0, 0.9, count // 20), 20)
    level, levels = 4.0, np.empty(count)
    for n in range(count):
        levels[n] = level
        level += STEP * (inflow[n] - 0.1 * level)
    time = STEP * np.arange(count)
    odds = share * 3.0 * (levels - 4.0 - shift) + odd * np.sin(2 * np.pi * time / time[-1])
    sounds = (rng.random(count) < 1 / (1 + np.exp(-odds))).astype(float)
    sounds[rng.random(count) > tested] = np.nan
    signals = {"inflow": inflow, "level": levels + 0.02 * rng.normal(size=count), "alarm": sounds}
    return Recording(time, signals, source="alarm")


def make(seed=1, **kwargs):
    problem = build(MODEL, [record(seed, **kwargs)], 10.0)
    rough = fit(problem, MODEL.nominal, FREE, np.diag(1 / problem.output_scale))
    return problem, diagonal_whitener(problem, rough.raw)


def test_every_look_is_a_feature_and_none_is_averaged():
    problem, _ = make()
    recording = record(1)
    windows = MODEL.windows(recording, 10.0)
    values = windows.measured(("level", "alarm"))[:, :, 1]
    assert problem.observations.seen.sum() == np.isfinite(values).sum()
    assert problem.observations.happened.sum() == np.nansum(values)
    assert len(problem) == len(windows)


def test_gradient_is_that_of_the_likelihood():
    """Residuals times their columns are minus the numerical gradient of the cost, states included."""
    problem, whitener = make(shift=0.3)
    here = fit(problem, MODEL.vector(effects={"threshold": {"shift": 0.1}}), FREE, whitener, iterations=0)
    # states at their best for these parameters, where projecting them out does not change the gradient
    here = fit(problem, here.parameters, np.zeros(0, dtype=np.int64), whitener, here.states, 30)
    at = fit(problem, here.parameters, FREE, whitener, here.states, 0)
    slope = np.einsum("wfk,wf->k", at.jacobian, at.residual)
    for k, i in enumerate(FREE):
        costs = []
        for sign in (1, -1):
            moved = here.parameters.copy()
            moved[i] += sign * 1e-3 * MODEL.all_parameters[i].scale
            costs.append(fit(problem, moved, FREE, whitener, here.states, 0).cost)
        assert slope[k] == pytest.approx(-(costs[0] - costs[1]) / 2e-3, rel=0.03, abs=0.5)


def test_fit_of_looks_alone_is_the_maximum_of_the_likelihood():
    recording = record(2, shift=0.4, share=0.7)
    problem, whitener = make(2, shift=0.4, share=0.7)
    fitted = fit(problem, MODEL.nominal, np.array([1, 2]), whitener)
    windows = MODEL.windows(recording, 10.0)
    levels, sounds = np.moveaxis(windows.measured(("level", "alarm")), 2, 0)
    seen = np.isfinite(sounds)

    def negative(x):
        odds = x[1] * 3.0 * (levels[seen] - 4.0 - x[0])
        return np.sum(np.logaddexp(0, odds) - sounds[seen] * odds)

    best = minimize(negative, [0.0, 1.0]).x  # with measured levels, whose noise is small
    np.testing.assert_allclose(fitted.parameters[1:3], best, atol=0.03)


def test_held_out_loss_is_that_of_refits():
    """One step from the joint optimum against a full refit without each fold, both on the folds left out."""
    problem, whitener = make(3, shift=0.2)
    fitted = fit(problem, MODEL.nominal, FREE, whitener)
    folds = problem.blocks % 4
    quick = held_out_loss(fitted, folds)
    for fold in range(4):
        out = folds == fold
        rest = fit(problem.select(~out), fitted.parameters, FREE, whitener)
        own = fit(problem.select(out), rest.parameters, np.zeros(0, dtype=np.int64), whitener)
        assert quick[out].sum() == pytest.approx(window_loss(own).sum(), abs=0.5)


def test_odds_response_is_the_slope_of_a_probability():
    problem, whitener = make(4)
    fitted = fit(problem, MODEL.nominal, FREE, whitener)
    slope = odds_responses(problem, fitted, 1)
    p = problem.simulate(fitted.parameters[None], fitted.states)[0][:, problem.events]
    odds, step = np.log(np.clip(p, 1e-9, 1 - 1e-9) / np.clip(1 - p, 1e-9, 1)), 1e-5
    numerical = (1 / (1 + np.exp(-odds - step)) - 1 / (1 + np.exp(-odds + step))) / (2 * step)
    seen = problem.observations.seen & (np.minimum(p, 1 - p) > 1e-4)
    np.testing.assert_allclose(slope.sum(axis=2)[:, problem.events][seen], numerical[seen], rtol=1e-4)
    assert np.all(slope[:, ~problem.events] == 0.0)


def test_looks_are_never_whitened_with_averages():
    problem, whitener = make()
    fitted = fit(problem, MODEL.nominal, FREE, whitener)
    matrix = covariance_whitener(problem, fitted)
    events = problem.events
    np.testing.assert_array_equal(matrix[events][:, events], np.eye(events.sum()))
    assert not matrix[events][:, ~events].any()
    assert not matrix[~events][:, events].any()


def test_what_is_neither_yes_nor_no_is_refused():
    recording = record(1)
    recording["alarm"][7] = 0.5
    with pytest.raises(RecordingError, match=r"'alarm', sample 7: 0.5; an event is 1 or 0"):
        diagnose(MODEL, [recording])


@pytest.mark.parametrize(("effect", "hidden"), [("threshold", {"shift": 0.4}), ("dull", {"share": 0.4})])
def test_what_acts_on_events_alone_is_found(effect, hidden):
    result = diagnose(MODEL, [record(4, **hidden)])
    (cause,) = result.causes
    assert cause.effect == effect
    ((name, value),) = hidden.items()
    assert abs(cause.parameters[name].value - value) < 4 * cause.parameters[name].std
    assert cause.signal == "alarm"
    gain = result.gain["alarm"]
    assert gain.rmse_after < gain.rmse_before
    assert gain.rmse_after == pytest.approx(gain.noise_floor, rel=0.1)
    before, after = (
        np.max(np.abs(c[:, 1] - c[:, 0]) / c[:, 2]) for c in result.evidence.calibration["alarm"]
    )
    assert after < 3.5 < before


class Deaf(Alarm):
    """The same with nothing measured but the alarm: the level is an input."""

    name = "deaf"
    inputs = (Signal("inflow", "m/s"), Signal("level", "m"))
    outputs = (Signal("alarm", "1", event=True),)

    def simulate(self, parameters, windows):
        return super().simulate(parameters, windows)[..., 1:]


@pytest.mark.parametrize(("hidden", "names"), [({"shift": 0.4}, ["threshold"]), ({}, [])])
def test_events_alone_suffice(hidden, names):
    result = diagnose(Deaf(), [record(4, **hidden)], fixed={"outflow": 0.1})
    assert [cause.effect for cause in result.causes] == names


def test_the_report_draws_probabilities_beside_frequencies(tmp_path):
    page = write_results(diagnose(MODEL, [record(4, shift=0.4)]), tmp_path)["report.html"].read_text()
    assert "Probabilities and frequencies" in page


def test_separate_test_data_with_other_numbers_of_observations():
    result = diagnose(MODEL, [record(5, shift=0.4)], [record(6, tested=0.9, shift=0.4)])
    assert [cause.effect for cause in result.causes] == ["threshold"]


@pytest.mark.parametrize("seed", [10, 11])
def test_nothing_hidden_is_consistent(seed):
    assert diagnose(MODEL, [record(seed)]).verdict == "consistent"


def test_an_alarm_that_wanders_in_time_is_unknown_and_shown_against_time():
    """No listed effect: its log-odds rise and fall once within the record."""
    result = diagnose(MODEL, [record(7, count=6000, odd=2.0)])
    assert result.verdict == "unknown"
    assert result.unknown.direction == "time, in the log-odds of alarm"
    time, odds, _ = result.unknown.curve.T
    assert odds[time < 1200].mean() > odds[time > 1800].mean() + 1.0


def test_calibration_curve_of_right_probabilities_lies_on_the_diagonal():
    rng = np.random.default_rng(0)
    p = rng.random(20_000)
    curve = calibration(p, (rng.random(len(p)) < p).astype(float))
    assert curve.shape == (10, 4)
    assert curve[:, 3].sum() == len(p)
    np.testing.assert_allclose(curve[:, 1], curve[:, 0], atol=4 * curve[:, 2].max())
