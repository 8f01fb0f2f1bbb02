"""A x = F: exact on noise-free data, wrong by the known amounts after the usual slips; its noise."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fieldmodels.machines.excitation.dynamics import simulate
from fieldmodels.machines.excitation.motion import arm_motion
from fieldmodels.machines.excitation.parameters import (
    CG,
    DAMPING,
    INERTIA,
    MASS,
    PRESETS,
    PRIOR_VARIANCE,
    SAMPLE,
    SOFT,
    STIFFNESS,
    TABLE1,
    Arm,
    SensorNoise,
)
from fieldmodels.machines.excitation.regression import (
    ANGLE,
    FEATURES,
    FORCE,
    POSITION,
    RATE,
    SIGNALS,
    TERMS,
    TORQUE,
    TURNING,
    VELOCITY,
    add_feature_noise,
    fill_features,
    regressor,
)
from fieldmodels.machines.excitation.sensors import FULL, TABLE2, full_scale, measure, variances

ARM = Arm()
COMMANDS = np.random.default_rng(5).uniform([0.4, 2.0, -1.0], [1.4, 12.0, 1.0], (25, 3))


def run(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Noise-free signals of a lively run, and the arm's angle at its samples."""
    moved, _ = arm_motion(COMMANDS, 25.0, start=(0.0, 1.0, 0.3), per_decision=320)
    return simulate(PRESETS[name], moved, ARM.row(), SAMPLE)[0], moved[4::4, 0]


def solved(signals: np.ndarray) -> np.ndarray:
    """Least squares, the pseudo-inverse of section IV with scaled columns."""
    a, f = regressor(signals.transpose(1, 0, 2))
    size = np.sqrt(PRIOR_VARIANCE)
    return np.asarray(np.linalg.lstsq(a.reshape(-1, 22) * size, f.ravel(), rcond=None)[0] * size)


def percent(signals: np.ndarray, name: str) -> np.ndarray:
    """Error of each unknown that is not zero [%]."""
    true = PRESETS[name]
    return np.asarray(100 * np.abs(solved(signals) - true)[true != 0] / np.abs(true[true != 0]))


def into_arm_frame(signals: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """The slip of leaving force and torque in frame IV."""
    result = signals.copy()
    for mode in range(3):
        turn = Rotation.from_rotvec(angle[:, None] * np.eye(3)[mode])
        for first in (FORCE, TORQUE):
            result[mode, :, first : first + 3] = turn.inv().apply(signals[mode, :, first : first + 3])
    return result


def without_d(signals: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """The slip of forgetting d(.): the arm's weight stays in force and torque."""
    result = signals.copy()
    weight = ARM.mass * ARM.gravity
    for mode in range(3):
        reach = [0.0, ARM.reach * np.cos(angle[0]), 0.0] if mode == 0 else [0.0, ARM.reach, 0.0]
        reach = [ARM.reach * np.sin(angle[0]), 0.0, 0.0] if mode == 1 else reach
        result[mode, :, FORCE + 2] += weight
        result[mode, :, TORQUE : TORQUE + 3] += np.cross(reach, [0.0, 0.0, weight])
    return result


def in_degrees(signals: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """The slip of an inclinometer in degrees."""
    result = signals.copy()
    result[:, :, ANGLE : TURNING + 3] = np.rad2deg(signals[:, :, ANGLE : TURNING + 3])
    return result


def inertial(signals: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """The slip of motions of the suspension in the inertial frame."""
    result = signals.copy()
    for mode in range(3):
        turn = Rotation.from_rotvec(signals[mode, :, ANGLE : ANGLE + 3])
        for first in (POSITION, VELOCITY):
            result[mode, :, first : first + 3] = turn.apply(signals[mode, :, first : first + 3])
    return result


@pytest.mark.every("name", ["table1", "soft"])
def test_noise_free_data_give_the_unknowns(name: str) -> None:
    assert percent(run(name)[0], name).max() < 1e-4


@pytest.mark.every(
    ("slip", "least"),
    [(into_arm_frame, 50.0), (without_d, 50.0), (in_degrees, 50.0), (inertial, 1.0)],
)
def test_the_usual_slips_are_caught(slip: Callable[..., np.ndarray], least: float) -> None:
    """On soft springs, whose motions are large; noise-free, so that all of the error is the slip's."""
    assert percent(slip(*run("soft")), "soft").mean() > least


def test_the_wrong_sign_of_r2_turns_the_centre_of_gravity_over() -> None:
    signals, _ = run("soft")
    a, f = regressor(signals.transpose(1, 0, 2))
    a[:, :, 7:10] *= -1
    found = np.linalg.lstsq(a.reshape(-1, 22), f.ravel(), rcond=None)[0]
    assert found[7:10] == pytest.approx(-SOFT[7:10], abs=1e-6)


def test_the_equations_are_those_of_newton_and_euler():
    """Signals that no vehicle gives, so that every product of rates is as large as the others."""
    rng = np.random.default_rng(14)
    signals, vehicle = rng.normal(size=(4, 3, 24)), rng.normal(size=22)
    a, f = regressor(signals)
    mass, centre = vehicle[MASS], vehicle[CG : CG + 3]
    ix, iy, iz, ixz, iyz, ixy = vehicle[INERTIA : INERTIA + 6]
    inertia = np.array([[ix, ixy, ixz], [ixy, iy, iyz], [ixz, iyz, iz]])
    gravity = np.array([0.0, 0.0, -9.81])
    for sample in range(4):
        for mode in range(3):
            r, v, acc, angle, w, turning, force, torque = signals[sample, mode].reshape(8, 3)
            fall = Rotation.from_rotvec(angle).inv().apply(gravity) - gravity
            damping, stiffness = vehicle[DAMPING : DAMPING + 6], vehicle[STIFFNESS : STIFFNESS + 6]
            linear = mass * (fall - acc) - damping[:3] * v - stiffness[:3] * r - force
            spin = inertia @ turning + np.cross(w, inertia @ w) + np.cross(centre, force)
            turn = -spin - damping[3:] * w - stiffness[3:] * angle - torque
            rows = slice(6 * mode, 6 * mode + 6)
            found = a[sample, rows] @ vehicle - f[sample, rows]
            np.testing.assert_allclose(found, [*linear, *turn], rtol=1e-9, atol=1e-9)


def test_feature_noise_is_that_of_many_noisy_features() -> None:
    """Covariances over 20000 draws, within 5 standard errors, and features without a shift."""
    rng = np.random.default_rng(3)
    signals = run("soft")[0][2, 700]
    # Small noise, for which first order holds; larger on the rates, to show the correction of squares.
    spread = np.full(SIGNALS, 1e-5)
    spread[RATE : RATE + 3] = 4e-4
    count = 20_000
    draws = np.sqrt(3 * spread) * rng.uniform(-1, 1, (count, SIGNALS))
    features, y = np.empty((count, FEATURES)), np.empty(FEATURES)
    for n in range(count):
        fill_features(signals + draws[n], spread, 9.81, y)
        features[n] = y
    exact, expected = np.empty(FEATURES), np.zeros((FEATURES, FEATURES))
    fill_features(signals, np.zeros(SIGNALS), 9.81, exact)
    add_feature_noise(signals, spread, 9.81, expected)
    size = np.sqrt(np.diag(expected)) + 1e-12
    assert np.abs((features.mean(axis=0) - exact) / size).max() < 5 / np.sqrt(count) + 0.01
    found = np.cov(features.T)
    assert np.abs((found - expected) / np.outer(size, size)).max() < 0.08


def test_every_equation_and_unknown_has_its_terms() -> None:
    rows, columns, features, _ = TERMS
    assert set(rows) == set(range(6))
    assert set(columns) == set(range(23))
    assert set(features) == set(range(FEATURES))


def test_full_scale_is_the_largest_signal_of_constant_excitation() -> None:
    one, each = full_scale(SOFT), full_scale(SOFT, per_mode=True)
    assert (one == each.max(axis=0)).all()
    assert one[0, TORQUE] == pytest.approx(1.72, abs=0.05)
    assert (full_scale(TABLE1)[:, ANGLE] < one[:, ANGLE]).all()


@pytest.mark.every("kind", ["full_scale", "running_max"])
def test_noise_is_white_and_of_the_stated_size(kind: str) -> None:
    """Variance over 6000 draws a channel, 72 channels: within 12 % (6 standard errors)."""
    signals, _ = run("soft")
    noise = SensorNoise(kind=kind)  # type: ignore[arg-type]
    maxima = full_scale(SOFT)
    measured, spread = measure(signals, maxima, noise, np.random.default_rng(0))
    error = (measured - signals) / np.sqrt(spread)
    assert np.abs(error).max() <= np.sqrt(3) + 1e-9
    assert np.var(error, axis=1) == pytest.approx(np.ones((3, SIGNALS)), rel=0.12)
    if kind == "full_scale":
        assert spread[:, 0] == pytest.approx(variances(maxima, noise.fraction))
    else:
        assert (np.diff(spread, axis=1) >= 0).all()


def test_table_two_has_one_equation_and_five_unknowns() -> None:
    assert TABLE2.rows.sum() == 1
    assert TABLE2.unknowns.sum() == 5
    assert FULL.rows.all()
    assert FULL.unknowns.all()
