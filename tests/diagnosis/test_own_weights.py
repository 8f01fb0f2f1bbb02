"""Curves on few windows: what a fit lacks counts as noise, unless the curve is given weights of its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_t

from fieldmodels.diagnosis.candidates import Candidates
from fieldmodels.diagnosis.curves import Curves
from fieldmodels.diagnosis.options import DEFAULT
from fieldmodels.diagnosis.problem import build
from fieldmodels.diagnosis.whitening import covariance_whitener
from fieldmodels.model import Model, Parameter, Signal
from fieldmodels.recording import Recording

STEP, HORIZON, WINDOWS = 0.01, 0.1, 24


class Scale(Model):
    """Two sensors that show a command: nothing moves, so that windows have no state."""

    name = "scale"
    inputs = (Signal("given", "1"), Signal("other", "1"))
    outputs = (Signal("first", "1", noise=0.1), Signal("second", "1", noise=0.1))
    states = ()
    parameters = (Parameter("gain", "1", nominal=1.0, lower=0.1, upper=10.0, scale=0.1),)
    effects = ()
    horizons = (HORIZON, HORIZON)

    def simulate(self, parameters, windows):
        rows = np.minimum(windows.starts[:, None] + np.arange(windows.samples), len(windows.recording) - 1)
        first, second = (windows.recording[name][rows] for name in ("given", "other"))
        gains = np.atleast_2d(parameters)[:, 0, None, None]
        return np.stack(np.broadcast_arrays(gains * first, second), axis=-1)

    def initial_states(self, recording, starts):
        return np.zeros((len(starts), 0))


def log(seed: int, crosstalk: float = 0.0) -> Recording:
    rng = np.random.default_rng(seed)
    count = round(WINDOWS * HORIZON / STEP) + 1
    knots = np.arange(0, count + 8, 4)
    given, other = (np.interp(np.arange(count), knots, rng.normal(size=len(knots))) for _ in range(2))
    first, second = given + crosstalk * other, other
    noise = 0.1 * rng.normal(size=(2, count))
    signals = {"given": given, "other": other, "first": first + noise[0], "second": second + noise[1]}
    return Recording(time=STEP * np.arange(count), signals=signals)


def tried(record: Recording):
    model = Scale()
    problem = build(model, [record], HORIZON)
    candidates = Candidates(
        problem=problem, start=model.nominal, fixed=frozenset(), folds=problem.folds,
        whitener=np.diag(1.0 / problem.output_scale),
    )  # fmt: skip
    whitener = covariance_whitener(problem, candidates.base().fit)
    base = replace(candidates, whitener=whitener).base()
    return Curves(problem, base.fit, DEFAULT), base


def left_out(rows: np.ndarray, columns: np.ndarray, folds: np.ndarray) -> np.ndarray:
    """Errors of each fold after a least-squares fit to the others."""
    result = rows.copy()
    for fold in np.unique(folds):
        inside = folds == fold
        flat = columns[~inside].reshape(-1, columns.shape[-1])
        step = np.linalg.lstsq(flat, rows[~inside].ravel(), rcond=None)[0]
        result[inside] -= columns[inside] @ step
    return result


def test_the_gain_is_a_ratio_of_two_likelihoods_each_with_its_own_covariance():
    """By SciPy's multivariate t, after least squares without each fold."""
    curves, base = tried(log(1, 0.3))
    best = next(s for s in curves.judge(base) if s.curve.over == "other" and s.curve.target == "first")
    beside, _, own = curves.with_own_weights(base, best)
    problem, folds = curves.problem, curves.problem.folds
    added = np.linalg.solve(base.fit.whitener, best.candidate.fit.jacobian[:, :, -len(best.coefficients) :])

    def likelihoods(columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of every window, and the whitener: that of errors left out under the weights of the search."""

        def left(whitener: np.ndarray) -> np.ndarray:
            white = np.einsum("ij,wjk->wik", whitener, columns)
            return left_out(base.fit.raw @ whitener.T, white, folds)

        errors = np.linalg.solve(base.fit.whitener, left(base.fit.whitener).T).T
        own = covariance_whitener(problem, replace(base.fit, raw=errors))
        student = multivariate_t(shape=np.eye(len(own)), df=10.0)
        return student.logpdf(left(own)) + np.linalg.slogdet(own)[1], own

    without, _ = likelihoods(base.fit.by_free)
    with_curve, whitener = likelihoods(np.concatenate([base.fit.by_free, added], axis=2))
    np.testing.assert_allclose(beside.fitted.whitener, whitener, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(own.gain, with_curve - without, atol=1e-6)
    assert own.total > 1.5 * best.total > 0.0


@pytest.mark.parametrize("crosstalk", [0.3, -0.3])
def test_what_few_windows_show_clearly_is_called_for(crosstalk: float):
    """Half a nat a window is too little in 24 windows, however large the error is."""
    curves, base = tried(log(2, crosstalk))
    found = curves.first(base)
    assert found
    assert (found[0].curve.place, found[0].curve.target) == ("sensor", "first")
    assert "other" in found[0].curve.over or "second" in found[0].curve.over


@pytest.mark.nightly
def test_noise_alone_calls_for_nothing():
    """Of 40 records; at a rate of 1 % more than two would be one case in 130."""
    assert sum(bool(curves.first(base)) for curves, base in map(tried, map(log, range(100, 140)))) <= 2
