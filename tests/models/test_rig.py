"""The linear bench against textbook answers."""

from __future__ import annotations

import numpy as np
import pytest

from fieldmodels.machines.rig import Rig
from fieldmodels.recording import Recording, Windows


def respond(command, state=(0.0, 0.0), step=0.01, **values):
    """Response of a rig from a state; keywords: ``effects`` by name, all else base parameters."""
    rig = Rig()
    effects = values.pop("effects", {})
    n = len(command)
    recording = Recording(
        time=np.arange(n) * step,
        signals={"force": np.asarray(command, float), "position": np.zeros(n), "velocity": np.zeros(n)},
    )
    windows = Windows(
        recording, np.array([0]), np.array([n]), np.array([state]), np.ones((1, n, 2), dtype=bool)
    )
    return rig.simulate(rig.vector(values, effects)[None, :], windows)[0, 0]


def test_energy_of_an_undamped_rig_is_conserved():
    x, v = respond(np.zeros(5000), state=(0.1, 0.0), damping=0.0).T
    energy = 0.5 * 2.0 * v**2 + 0.5 * 80.0 * x**2
    np.testing.assert_allclose(energy, energy[0], rtol=1e-5)


def test_period_and_damping_are_those_of_the_textbook():
    x, _ = respond(np.zeros(3000), state=(0.1, 0.0)).T
    decay, omega = 4.0 / (2 * 2.0), np.sqrt(80.0 / 2.0 - 1.0)
    time = np.arange(3000) * 0.01
    expected = 0.1 * np.exp(-decay * time) * (np.cos(omega * time) + decay / omega * np.sin(omega * time))
    np.testing.assert_allclose(x, expected, atol=1e-6)


def test_a_constant_force_deflects_the_spring_by_force_over_stiffness():
    assert respond(np.full(3000, 8.0))[-1, 0] == pytest.approx(0.1, rel=1e-6)
    effects = {"constant_force": {"force": 8.0}}
    assert respond(np.zeros(3000), effects=effects)[-1, 0] == pytest.approx(0.1, rel=1e-6)


def test_a_stiff_light_bench_is_integrated_in_finer_steps():
    """A 160 Hz axis sampled at 100 Hz."""
    x, v = respond(np.zeros(200), state=(0.1, 0.0), damping=0.0, stiffness=2e6).T
    energy = 0.5 * 2.0 * v**2 + 0.5 * 2e6 * x**2
    np.testing.assert_allclose(energy, energy[0], rtol=3e-3)


def test_static_actuator_effects_do_what_their_equation_says():
    def final(command, **effects):
        return 80.0 * respond(np.full(3000, command), effects=effects)[-1, 0]

    assert final(8.0, actuator_saturation={"limit": 5.0}) == pytest.approx(5.0, rel=1e-5)
    assert final(-8.0, actuator_saturation={"limit": 5.0}) == pytest.approx(-5.0, rel=1e-5)
    assert final(8.0, actuator_dead_zone={"width": 1.0}) == pytest.approx(7.0, rel=1e-5)
    assert final(0.9, actuator_dead_zone={"width": 1.0}) == 0.0
    assert final(8.0, actuator_asymmetry={"difference": 0.2}) == pytest.approx(8.8, rel=1e-5)
    assert final(-8.0, actuator_asymmetry={"difference": 0.2}) == pytest.approx(-7.2, rel=1e-5)
    assert final(8.0, actuator_gain={"gain": 0.5}) == pytest.approx(4.0, rel=1e-5)
    assert final(8.0, parameter_step={"time": 15.0, "factor": 0.5}) == pytest.approx(4.0, rel=1e-5)
    assert final(8.0, actuator_lag={"time_constant": 0.5}) == pytest.approx(8.0, rel=1e-5)


def test_backlash_shows_half_the_gap_beside_the_load():
    effects = {"backlash": {"gap": 0.01}}
    command = np.r_[np.full(3000, 8.0), np.full(3000, -8.0)]
    x = respond(command, state=(0.005, 0.0), effects=effects)[:, 0]
    assert x[2999] == pytest.approx(0.1 + 0.005, rel=1e-5)
    assert x[-1] == pytest.approx(-0.1 - 0.005, rel=1e-5)


def test_quantisation_shows_multiples_of_its_step():
    x = respond(np.full(500, 8.0), effects={"sensor_quantisation": {"step": 0.004}})[:, 0]
    np.testing.assert_allclose(x / 0.004, np.round(x / 0.004), atol=1e-9)
    assert len(np.unique(x)) > 5
    np.testing.assert_allclose(x, respond(np.full(500, 8.0))[:, 0], atol=0.002 + 1e-12)


def test_a_payload_adds_to_the_mass():
    command = np.r_[np.full(30, 8.0), np.full(30, -3.0)]
    np.testing.assert_array_equal(
        respond(command, effects={"payload": {"mass": 0.5}}), respond(command, mass=2.5)
    )


def test_a_disturbance_acts_like_the_command():
    rig = Rig()
    n = 200
    push = np.random.default_rng(0).normal(size=n)
    recording = Recording(
        time=np.arange(n) * 0.01,
        signals={"force": np.zeros(n), "position": np.zeros(n), "velocity": np.zeros(n)},
    )
    windows = Windows(
        recording, np.array([0]), np.array([n]), np.zeros((1, 2)), np.ones((1, n, 2), dtype=bool), push
    )
    acted = rig.simulate(rig.nominal[None, :], windows)[0, 0]
    np.testing.assert_allclose(acted, respond(push), atol=1e-15)


@pytest.mark.every(
    "beside",
    [
        {"coulomb_friction": {"force": 1e-9}},
        {"constant_force": {"force": 1e-9}},
        {"hysteresis": {"force": 1e-9}},
    ],
)
def test_play_follows_the_present_command_whatever_else_acts(beside):
    command = np.repeat(np.random.default_rng(1).uniform(-8.0, 8.0, 40), 5)
    alone = respond(command, effects={"backlash": {"gap": 0.01}})
    both = respond(command, effects={"backlash": {"gap": 0.01}} | beside)
    np.testing.assert_allclose(both, alone, atol=1e-6)
