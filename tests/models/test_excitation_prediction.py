"""Forecasts of what a command will teach, against the experiments themselves."""

from dataclasses import replace

import numpy as np
import pytest

from fieldmodels.information import fast
from fieldmodels.machines.excitation.dynamics import simulate
from fieldmodels.machines.excitation.motion import CONSTANT, arm_motion
from fieldmodels.machines.excitation.parameters import (
    CG,
    INERTIA,
    LOWER,
    PRESETS,
    SAMPLE,
    UPPER,
    Arm,
    Rules,
    SensorNoise,
)
from fieldmodels.machines.excitation.prediction import Predictor, Situation, make_physical
from fieldmodels.machines.excitation.shaker import VARIANTS, Shaken, Shakers
from fieldmodels.model import ModelError

BATCH = 4


def situation(shaken: Shaken) -> Situation:
    return Situation(
        shaken.mean,
        shaken.covariance,
        shaken.moments,
        shaken.noise,
        shaken.samples,
        shaken.command,
        shaken.phase,
        shaken.variances,
    )


def bits(covariance, estimated):
    sigma = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    return fast(sigma, LOWER, UPPER)[..., estimated].sum(axis=-1)


def started(preset="table1", noise="full_scale", estimator="compensated", variant="full", batch=BATCH):
    shakers = Shakers(batch, Rules(preset=preset, noise=noise, estimator=estimator, variant=variant))
    shakers.restart(range(batch), [np.random.default_rng(i) for i in range(batch)])
    predictor = Predictor(noise=SensorNoise(noise), method=estimator, variant=VARIANTS[variant])
    return shakers, predictor


@pytest.fixture(scope="module")
def midway():
    """An experiment in its midst, and its predictor."""
    shakers, predictor = started()
    rng = np.random.default_rng(5)
    for _ in range(6):
        shakers.advance(rng.uniform(*shakers.ranges))
    return situation(shakers.observe()), predictor


@pytest.mark.every(
    ("preset", "noise", "estimator", "variant", "limit"),
    [
        ("table1", "full_scale", "compensated", "full", 0.5),
        ("table1", "running_max", "compensated", "full", 0.8),
        ("soft", "full_scale", "compensated", "full", 1.0),
        ("table1", "full_scale", "low_passed", "full", 0.8),
        ("table1", "full_scale", "compensated", "table2", 0.5),
    ],
)
def test_the_expected_bits_are_those_that_come(preset, noise, estimator, variant, limit):
    """After four decisions the estimate is good enough to foresee the sum of bits to a fraction of one."""
    shakers, predictor = started(preset, noise, estimator, variant)
    rng = np.random.default_rng(1)
    for decision in range(12):
        command = rng.uniform(*shakers.ranges)
        expected = predictor.outlook(situation(shakers.observe()), command[:, None, None]).covariance[:, 0]
        got = shakers.advance(command).covariance
        if decision >= 4:
            difference = bits(expected, shakers.estimated) - bits(got, shakers.estimated)
            assert abs(difference.mean()) < limit


def test_several_decisions_ahead_are_foreseen_as_one_after_the_other_come():
    shakers, predictor = started()
    rng = np.random.default_rng(2)
    for _ in range(6):
        shakers.advance(rng.uniform(*shakers.ranges))
    plan = rng.uniform(shakers.ranges[0][0], shakers.ranges[1][0], (BATCH, 4, 3))
    expected = predictor.outlook(situation(shakers.observe()), plan[:, None]).covariance[:, 0]
    for k in range(4):
        got = shakers.advance(plan[:, k]).covariance
    difference = bits(expected, shakers.estimated) - bits(got, shakers.estimated)
    assert np.abs(difference).mean() < 0.8


def test_one_integration_step_a_sample_is_enough(midway):
    now, coarse = midway
    commands = np.random.default_rng(3).uniform((0, 0.5, -1.5), (1.5, 12, 1.5), (BATCH, 8, 1, 3))
    fine = Predictor(substeps=4)
    every = np.ones(22, dtype=bool)
    difference = bits(coarse.outlook(now, commands).covariance, every) - bits(
        fine.outlook(now, commands).covariance, every
    )
    assert np.abs(difference).max() < 0.3


def test_rows_and_candidates_do_not_touch_each_other(midway):
    now, predictor = midway
    commands = np.random.default_rng(4).uniform((0, 0.5, -1.5), (1.5, 12, 1.5), (BATCH, 3, 2, 3))
    together = predictor.outlook(now, commands)
    one = Situation(*(getattr(now, name)[2:3] for name in Situation.__dataclass_fields__))
    alone = predictor.outlook(one, commands[2:3, 1:2])
    np.testing.assert_array_equal(alone.covariance[0, 0], together.covariance[2, 1])
    np.testing.assert_array_equal(alone.gram[0, 0], together.gram[2, 1])


def test_nothing_is_forgotten_and_noise_teaches_less(midway):
    """More data never widen the ellipsoid by more than the noise may; ten times the noise teaches less."""
    now, predictor = midway
    commands = np.random.default_rng(6).uniform((0, 3, -1.5), (1.5, 12, 1.5), (BATCH, 5, 1, 3))
    every = np.ones(22, dtype=bool)
    after = bits(predictor.outlook(now, commands).covariance, every)
    assert (after > bits(now.covariance, every)[:, None] - 0.2).all()
    noisy = replace(now, variances=100 * now.variances)
    assert (bits(predictor.outlook(noisy, commands).covariance, every) < after).all()


def test_an_arm_that_rests_teaches_next_to_nothing(midway):
    now, predictor = midway
    rest = np.array([0.0, 0.5, 0.0])
    still = replace(now, command=np.tile(rest, (BATCH, 1)))
    every = np.ones(22, dtype=bool)
    gained = bits(predictor.outlook(still, np.tile(rest, (BATCH, 1, 1, 1))).covariance, every)[:, 0] - bits(
        now.covariance, every
    )
    moved = bits(predictor.outlook(still, np.tile(CONSTANT, (BATCH, 1, 1, 1))).covariance, every)[:, 0]
    assert (gained < moved - bits(now.covariance, every)).all()


def test_gram_is_that_of_the_regressor(midway):
    """A'A of what was sensed: its diagonal of mass is the sum of squared specific forces."""
    now, predictor = midway
    gram = predictor.outlook(now, np.tile(CONSTANT, (BATCH, 1, 1, 1))).gram[:, 0]
    np.testing.assert_allclose(gram, np.swapaxes(gram, 1, 2), rtol=1e-12)
    assert (np.linalg.eigvalsh(gram) > -1e-9 * np.trace(gram, axis1=1, axis2=2)[:, None]).all()
    scale = 10 / np.sqrt(12)
    sensed = np.trace(now.moments[:, :, 0:3, 0:3], axis1=2, axis2=3).sum(axis=1) * scale**2
    assert (gram[:, 0, 0] > sensed).all()


def test_any_estimate_makes_a_vehicle_that_can_be_shaken():
    rng = np.random.default_rng(7)
    arm = Arm()
    motion, _ = arm_motion(np.tile([1.5, 12.0, 0.5], (3, 1)), 25.0)
    for _ in range(50):
        mean = rng.normal(0.5 * (LOWER + UPPER), 2.0 * (UPPER - LOWER))
        (vehicle,) = make_physical(mean[None])
        xx, yy, zz, xz, yz, xy = vehicle[INERTIA:CG]
        assert np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])[0] > 0
        assert np.isfinite(simulate(vehicle[None], motion, arm.row(), SAMPLE, substeps=1)).all()


def test_a_physical_estimate_stays_as_it_is():
    for truth in PRESETS.values():
        np.testing.assert_array_equal(make_physical(truth[None])[0], truth)


def test_bad_candidates_are_refused(midway):
    now, predictor = midway
    with pytest.raises(ModelError, match="shape"):
        predictor.outlook(now, np.zeros((BATCH, 3, 3)))
    with pytest.raises(ModelError, match="finite"):
        predictor.outlook(now, np.full((BATCH, 1, 1, 3), np.nan))
    with pytest.raises(ModelError, match="compensated"):
        Predictor(method="honest")
