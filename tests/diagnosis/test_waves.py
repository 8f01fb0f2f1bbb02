"""What waves and tables explain, against sums that are written out and least squares."""

from dataclasses import replace

import numpy as np
import pytest

from fieldmodels.diagnosis.candidates import Candidates
from fieldmodels.diagnosis.curves import Curves, _Screen
from fieldmodels.diagnosis.linearisation import stacked
from fieldmodels.diagnosis.options import DEFAULT
from fieldmodels.diagnosis.problem import build
from fieldmodels.diagnosis.shapes import wave
from fieldmodels.diagnosis.waves import spectrum
from fieldmodels.drivers.curved import FreeCurve
from fieldmodels.effects.curves import on_curve
from fieldmodels.registry import get_model
from fieldmodels.synthesis import synthesise


@pytest.mark.parametrize("counts", [np.arange(2.0, 600.0, 0.5), 0.213 + 0.0331 * np.arange(300), [7.3]])
def test_spectrum_is_the_sum_of_exponentials(counts):
    rng = np.random.default_rng(1)
    x, columns = rng.uniform(-1.0, 2.0, 500), rng.normal(size=(500, 3))
    counts = np.asarray(counts)
    exact = columns.T @ np.exp(2j * np.pi * np.multiply.outer(x, counts))
    assert np.abs(spectrum(x, columns, counts) - exact).max() < 1e-10 * np.abs(columns).sum(axis=0).max()


def test_a_curve_with_a_period_goes_on_as_it_began():
    """In a search it is given over several cycles, in a machine over one; both are the sine everywhere."""
    period, cycle = 0.7, np.linspace(-0.2, 0.5, 65)
    several = np.linspace(-0.2, 1.9, 193)
    free = FreeCurve(
        "force", "", "time", several, np.sin(2 * np.pi * several / period)[:, None], period=period
    )
    row = np.concatenate([[-0.2, 0.5, period], np.sin(2 * np.pi * cycle / period)])
    x = np.linspace(-5.0, 7.0, 401)
    exact = np.sin(2 * np.pi * x / period)
    np.testing.assert_allclose(free.at(x, np.ones(1)), exact, atol=2e-3)
    np.testing.assert_allclose([on_curve(one, row) for one in x], exact, atol=2e-3)
    assert on_curve(3.0, np.array([-0.2, 0.5, 0.0, 1.0, 2.0])) == 2.0  # without one it keeps its last value


@pytest.fixture(scope="module")
def screened():
    rig = get_model("rig")
    record = synthesise(rig, {}, "mixed", duration=20.0, amplitude=8.0, rng=np.random.default_rng(3))
    model = rig.scaled_to([record])
    problem = build(model, [record], 0.5)
    base = Candidates(
        problem=problem, start=model.nominal, fixed=frozenset(), folds=problem.folds,
        whitener=np.diag(1.0 / problem.output_scale),
    ).base()  # fmt: skip
    curves = Curves(problem, base.fit, DEFAULT)
    basis = np.linalg.qr(stacked(base.fit.jacobian[:, :, base.fit.active]))[0]
    return curves, basis, base.fit.residual.reshape(-1), _Screen(curves, basis, base.fit.residual.reshape(-1))


def beside(basis, columns):
    return columns - basis @ (basis.T @ columns)


def test_a_waves_power_is_that_of_least_squares(screened):
    curves, basis, residual, screen = screened
    counts = np.arange(2.0, 30.0, 4.5)
    for place in curves._wave_places:
        powers = screen.powers(place, counts)
        for count, power in zip(counts, powers, strict=True):
            own = replace(place, values=wave(place.values, count))
            flat = beside(basis, stacked(curves.response(own)))
            left = beside(basis, residual)
            explained = left @ (flat @ np.linalg.lstsq(flat, left, rcond=None)[0])
            assert power == pytest.approx(explained, rel=1e-4) or power == 0.0
        assert (powers > 0.0).any()


def test_curves_together_gain_what_each_does_by_least_squares(screened):
    curves, basis, residual, screen = screened
    found = screen.identifiable(curves.all)
    assert len(found) > 100
    assert [k for k, *_ in found] == sorted({k for k, *_ in found})
    for k, gain, combination in found[::7]:
        flat = beside(basis, stacked(curves.response(curves.all[k]) @ combination))
        left = beside(basis, residual)
        explained = left @ (flat @ np.linalg.lstsq(flat, left, rcond=None)[0])
        assert gain == pytest.approx(0.5 * explained, rel=1e-6, abs=1e-9)
