"""Which curves an extended simulation runs with, and why the others cannot."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fieldgym.bench import as_env
from fieldmodels.diagnosis.result import MissingCurve
from fieldmodels.diagnosis.runnable import runnable
from fieldmodels.drivers.named import with_named
from fieldmodels.registry import get_model
from fieldmodels.synthesis import synthesise

RIG = get_model("rig")


def missing(over: str) -> MissingCurve:
    """A force that falls in proportion to a variable, from -0.2 to 0.2."""
    at = np.linspace(-0.2, 0.2, 9)
    return MissingCurve(
        "force", "", over, "1", "N", np.column_stack([at, -300.0 * at, 0.1 + 0.0 * at]), 1e-9, 50.0
    )


@pytest.mark.nightly
def test_a_velocity_times_the_size_of_a_position_runs_as_scipy_says():
    effects, left = runnable(RIG, [missing("velocity times size of position")], 0.2)
    assert not left
    reality = {name: {key: e.value for key, e in values.items()} for name, values in effects.items()}
    force = 8.0 * np.sign(np.sin(np.arange(200) * 0.05))
    log = synthesise(RIG, reality, {"force": force}, rng=np.random.default_rng(0), noise=False)
    m, c, k = RIG.nominal[:3]

    def rates(t: float, y: np.ndarray) -> list[float]:
        push = force[min(int(t / 0.01 + 1e-9), 199)] - 300.0 * np.clip(y[1] * abs(y[0]), -0.2, 0.2)
        return [y[1], (push - c * y[1] - k * y[0]) / m]

    truth = solve_ivp(rates, (0.0, 1.99), [0.0, 0.0], t_eval=np.arange(200) * 0.01, max_step=2e-3).y[0]
    plain = synthesise(RIG, {}, {"force": force}, rng=np.random.default_rng(0), noise=False)["position"]
    assert np.abs(truth - plain).max() > 0.01
    assert np.abs(log["position"] - truth).max() < 0.01 * np.abs(truth - plain).max()
    env = as_env("rig", reality=reality)
    env.reset(seed=1)
    assert np.isfinite(env.step(np.ones(1, np.float32))[0]).all()


def test_a_curve_of_an_acceleration_does_not_run_and_says_why():
    effects, left = runnable(RIG, [missing("rate of velocity")], 0.2)
    assert not effects
    assert left == ("rate of velocity (rate of velocity is neither a state nor an input nor the time)",)


def test_curves_of_one_place_and_variable_add_up():
    """Two curves of a sensor over its own position, and one over that position's size."""
    at = np.linspace(-0.5, 0.5, 5)
    curves = [
        MissingCurve("sensor", "position", over, "m", "m", np.column_stack([x, y, 0.0 * x]), 1e-9, 50.0)
        for over, x, y in (
            ("position", at, 0.02 * at),
            ("position", at, [0.0, 0.01, 0.0, 0.03, 0.0]),
            ("size of position", at[2:], -0.04 * at[2:]),
        )
    ]
    force = {"force": 8.0 * np.sign(np.sin(np.arange(400) * 0.05))}
    effects, left = runnable(RIG, curves, 0.2)
    assert (len(effects), left) == (3, ())
    reality = {name: {key: e.value for key, e in values.items()} for name, values in effects.items()}
    shown, true = (
        synthesise(RIG, r, force, rng=np.random.default_rng(0), noise=False)["position"]
        for r in (reality, {})
    )
    added = 0.02 * true + np.interp(true, at, [0.0, 0.01, 0.0, 0.03, 0.0]) - 0.04 * np.abs(true)
    assert np.ptp(true) > 0.1
    np.testing.assert_allclose(shown, true + added, atol=1e-9)


def test_a_second_curve_of_a_sensor_s_own_stands_beside_the_first_around_a_drive():
    at = np.linspace(-3.0, 3.0, 5)
    curve = MissingCurve(
        "sensor", "heading", "heading", "rad", "rad", np.column_stack([at, 0.1 * at, 0.0 * at]), 1e-9, 50.0
    )
    drive = get_model("pose_reaching")
    effects, left = runnable(drive, [curve] * 3, 0.2)
    assert (len(effects), left) == (3, ())
    reality = {name: {key: e.value for key, e in values.items()} for name, values in effects.items()}
    assert {e.name for e in with_named(drive, reality).effects} >= set(effects)


def test_a_sensor_s_curve_over_a_command_is_that_of_its_own_sample():
    """However late the actuator is: the cable picks up what is sent, as curves are sought."""
    at = np.linspace(-8.0, 8.0, 5)
    curve = MissingCurve(
        "sensor", "position", "force", "N", "m", np.column_stack([at, 1e-4 * at, 0.0 * at]), 1e-9, 50.0
    )
    effects, _ = runnable(RIG, [curve], 0.2)
    picked_up = {name: {key: e.value for key, e in values.items()} for name, values in effects.items()}
    force = np.random.default_rng(0).uniform(-8.0, 8.0, 200)
    force[0] = 0.0  # the sensor shows where the motion begins
    for others in ({}, {"actuator_delay": {"delay": 0.013}}):
        shown, true = (
            synthesise(RIG, r, {"force": force}, rng=np.random.default_rng(0), noise=False)["position"]
            for r in (picked_up | others, others)
        )
        np.testing.assert_allclose(shown - true, 1e-4 * force, atol=1e-9)
