"""The rotary bench against textbook answers."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ellipk

from fieldmodels.machines.pendulum import STANDARD_GRAVITY, Pendulum
from fieldmodels.recording import Recording, Windows

STEP = 0.005


def swing(angle, n=4000, torque=0.0, effects=None, base=None):
    pendulum = Pendulum()
    recording = Recording(
        time=np.arange(n) * STEP,
        signals={"torque": np.full(n, torque), "angle": np.zeros(n), "velocity": np.zeros(n)},
    )
    windows = Windows(
        recording, np.array([0]), np.array([n]), np.array([[angle, 0.0]]), np.ones((1, n, 2), dtype=bool)
    )
    return pendulum.simulate(pendulum.vector(base, effects)[None, :], windows)[0, 0]


def period(angle):
    x = swing(angle)[:, 0]
    down = np.flatnonzero((x[:-1] > 0) & (x[1:] <= 0))
    crossings = (down + x[down] / (x[down] - x[down + 1])) * STEP
    return np.diff(crossings).mean()


def test_energy_without_friction_is_conserved():
    x, v = swing(2.5).T
    energy = 0.5 * 0.0626 * v**2 - np.cos(x)
    np.testing.assert_allclose(energy, energy[0], atol=1e-6)


@pytest.mark.every("angle", [0.01, 1.0, 2.5])
def test_the_period_is_the_elliptic_integral_and_at_small_angles_the_root_of_inertia_over_moment(angle):
    exact = 4 * np.sqrt(0.0626 / 1.0) * ellipk(np.sin(angle / 2) ** 2)
    assert period(angle) == pytest.approx(exact, rel=1e-5)
    if angle < 0.1:
        assert exact == pytest.approx(2 * np.pi * np.sqrt(0.0626), rel=1e-4)


def test_a_torque_holds_the_pendulum_where_gravity_balances_it():
    x = swing(np.arcsin(0.5), torque=0.5)[:, 0]
    np.testing.assert_allclose(x, np.arcsin(0.5), atol=1e-9)


def test_a_biased_angle_shows_the_rest_position_off_zero():
    x = swing(0.1, effects={"sensor_bias": {"bias": 0.1}})[:, 0]
    np.testing.assert_allclose(x, 0.1, atol=1e-12)


def test_a_payload_adds_its_inertia_and_its_weight():
    with_load = swing(0.5, effects={"payload": {"mass": 0.2, "length": 0.3}})
    base = {"inertia": 0.0626 + 0.2 * 0.09, "gravity_moment": 1.0 + 0.2 * 0.3 * STANDARD_GRAVITY}
    np.testing.assert_allclose(with_load, swing(0.5, base=base), rtol=1e-9, atol=1e-9)
    assert np.abs(with_load - swing(0.5)).max() > 0.1


def test_viscous_friction_takes_the_energy_that_its_power_says():
    x, v = swing(1.0, effects={"viscous_friction": {"coefficient": 0.05}}).T
    energy = 0.5 * 0.0626 * v**2 - np.cos(x)
    lost = np.sum(0.5 * 0.05 * (v[1:] ** 2 + v[:-1] ** 2)) * STEP
    assert energy[0] - energy[-1] == pytest.approx(lost, rel=1e-4)
