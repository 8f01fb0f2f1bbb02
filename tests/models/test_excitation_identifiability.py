"""What an experiment can tell: rank test, bounds, and that simulated errors obey them."""

import numpy as np
import pytest

from fieldmodels.machines.excitation.dynamics import simulate
from fieldmodels.machines.excitation.identifiability import (
    bound,
    equation_noise,
    identifiability,
    rank_test,
    regression_information,
)
from fieldmodels.machines.excitation.motion import CONSTANT, arm_motion
from fieldmodels.machines.excitation.parameters import (
    NAMES,
    PRIOR_VARIANCE,
    SAMPLE,
    SOFT,
    TABLE1,
    Arm,
    SensorNoise,
)
from fieldmodels.machines.excitation.regression import regressor
from fieldmodels.machines.excitation.sensors import full_scale, measure, variances

ARM = Arm()
STEADY, _ = arm_motion(np.tile(CONSTANT, (25, 1)), 5.0, per_decision=320)


@pytest.mark.nightly
def test_constant_excitation_hides_the_inertia_of_table_one() -> None:
    report = identifiability(TABLE1, STEADY)
    assert report.rank == 22
    assert set(report.prior_only) == {n for n in NAMES if n.startswith("inertia")}
    assert (report.regression[16:] < 0.01 * TABLE1[16:]).all()
    assert not identifiability(SOFT, STEADY).prior_only


def test_bounds_are_ordered() -> None:
    report = identifiability(SOFT, STEADY)
    assert (report.trajectory <= report.regression).all()
    assert (report.with_prior <= np.minimum(report.regression, report.prior) + 1e-12).all()
    assert len(report.lines()) == 24


def test_a_still_arm_tells_nothing() -> None:
    still = np.column_stack([np.full(401, 0.7), np.zeros(401), np.zeros(401)])
    signals = simulate(TABLE1, still, ARM.row(), SAMPLE, 4)[0]
    a, _ = regressor(signals.transpose(1, 0, 2))
    assert rank_test(np.round(a, 10))[1] == 0


def test_rank_test_names_what_one_mode_cannot_see() -> None:
    """Without motion about z there is nothing of the yaw suspension: columns of zeros."""
    a = np.random.default_rng(0).standard_normal((50, 6, 22))
    a[:, :, [15, 21]] = 0.0
    _, rank, lost = rank_test(a)
    assert rank == 20
    assert np.flatnonzero(lost > 0.5).tolist() == [15, 21]


def test_bound_of_no_information_is_infinite_or_the_prior() -> None:
    assert np.isinf(bound(np.diag([1.0] * 21 + [0.0]))[-1])
    assert bound(np.zeros((22, 22)), PRIOR_VARIANCE) == pytest.approx(np.sqrt(PRIOR_VARIANCE))


def test_equation_noise_is_that_of_noisy_equations() -> None:
    """Sample covariance of A x - F over 2000 samples of constant motion, within 15 %."""
    signals = simulate(SOFT, STEADY, ARM.row(), SAMPLE)[0]
    noise = SensorNoise(fraction=0.01)
    maxima = full_scale(SOFT)
    measured, _ = measure(signals, maxima, noise, np.random.default_rng(1))
    a, f = regressor(measured.transpose(1, 0, 2), variances=variances(maxima, noise.fraction))
    found = np.einsum("nmi,nmj->mij", *[(a @ SOFT - f).reshape(-1, 3, 6)] * 2) / len(f)
    expected = equation_noise(signals, variances(maxima, noise.fraction), SOFT, ARM.gravity).mean(axis=0)
    size = np.sqrt(np.einsum("mii->mi", expected))
    assert np.abs((found - expected) / (size[:, :, None] * size[:, None, :])).max() < 0.15


def test_no_estimator_of_a_x_is_f_beats_its_bound() -> None:
    """Weighted least squares on weak noise (so that noise in A biases little) comes near the bound.

    30 runs: the ratio of standard deviations has a standard error of 13 %; all 22 within 0.6 to 1.6.
    """
    signals = simulate(SOFT, STEADY, ARM.row(), SAMPLE)[0]
    noise = SensorNoise(fraction=1e-3)
    maxima = full_scale(SOFT)
    spread = variances(maxima, noise.fraction)
    weights = np.linalg.inv(equation_noise(signals, spread, SOFT, ARM.gravity))
    rng, size = np.random.default_rng(2), np.sqrt(PRIOR_VARIANCE)
    found = []
    for _ in range(30):
        measured, _ = measure(signals, maxima, noise, rng)
        a, f = regressor(measured.transpose(1, 0, 2))
        a, f = a.reshape(-1, 3, 6, 22) * size, f.reshape(-1, 3, 6)
        left = np.einsum("nmiu,nmij,nmjv->uv", a, weights, a, optimize=True)
        right = np.einsum("nmiu,nmij,nmj->u", a, weights, f, optimize=True)
        found.append(size * np.linalg.solve(left, right))
    ratio = np.std(found, axis=0) / bound(regression_information(signals, spread, SOFT, ARM.gravity))
    assert (ratio > 0.6).all()
    assert (ratio < 1.6).all()
