"""Recordings from hidden realities."""

from __future__ import annotations

import numpy as np
import pytest

from fieldmodels.machines.pendulum import Pendulum
from fieldmodels.machines.rig import Rig
from fieldmodels.model import ModelError
from fieldmodels.synthesis import EXCITATIONS, excitation, synthesise


def rng(seed=0):
    return np.random.default_rng(seed)


@pytest.mark.every("name", sorted(EXCITATIONS))
def test_excitations_have_their_length_and_peak_and_follow_the_seed(name):
    first, again, other = (excitation(name, 20.0, 0.01, rng(seed)) for seed in (1, 1, 2))
    assert first.shape == (2000,)
    assert 0.8 < np.abs(first).max() <= 1.0
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).max() > 0.1


def test_the_recording_is_what_the_model_predicts_from_it_up_to_noise():
    rig = Rig()
    reality = {"coulomb_friction": {"force": 0.8}, "actuator_delay": {"delay": 0.0137}}
    data = synthesise(rig, reality, "mixed", amplitude=8.0, rng=rng(), noise=False)
    windows = rig.windows(data, 0.5)
    predicted = rig.simulate(rig.vector(effects=reality)[None, :], windows)[0]
    measured = windows.measured(("position", "velocity"))
    error = np.sqrt(np.mean((predicted - measured) ** 2, axis=(0, 1)))
    assert (error < 1e-2 * measured.std(axis=(0, 1))).all()


@pytest.mark.every("coloured", [0.0, 0.5])
def test_noise_has_the_stated_deviation_and_colour(coloured):
    rig = Rig()
    arguments = {"duration": 300.0, "amplitude": 8.0, "coloured": coloured}
    noisy = synthesise(rig, None, "steps", rng=rng(), noise={"position": 1e-3, "velocity": 0.0}, **arguments)
    clean = synthesise(rig, None, "steps", rng=rng(), noise=False, **arguments)
    noise = noisy["position"] - clean["position"]
    assert noise.std() == pytest.approx(1e-3, rel=0.1)
    np.testing.assert_array_equal(noisy["velocity"], clean["velocity"])
    neighbours = np.corrcoef(noise[1:], noise[:-1])[0, 1]
    assert neighbours == pytest.approx(coloured * np.exp(-0.01 / 0.5), abs=0.06)


def test_episodes_start_afresh_from_rest():
    data = synthesise(Rig(), None, "steps", duration=5.0, amplitude=8.0, episodes=3, rng=rng(), noise=False)
    assert data.bounds.tolist() == [[0, 500], [500, 1000], [1000, 1500]]
    np.testing.assert_array_equal(data["position"][[0, 500, 1000]], 0.0)
    assert np.abs(data["force"][:500] - data["force"][500:1000]).max() > 0.1


def test_quantisation_acts_after_the_noise():
    data = synthesise(
        Rig(), {"sensor_quantisation": {"step": 1e-3}}, "steps", duration=5.0, amplitude=8.0, rng=rng()
    )
    position = data["position"] / 1e-3
    np.testing.assert_allclose(position, np.round(position), atol=1e-9)


def test_a_swing_leads_the_nominal_pendulum_along_its_path():
    data = synthesise(Pendulum(), None, "swing", duration=20.0, amplitude=1.2, rng=rng(), noise=False)
    assert 0.9 < np.abs(data["angle"]).max() < 1.8


def test_slips_are_named():
    with pytest.raises(ModelError, match="did you mean 'multisine'"):
        synthesise(Rig(), None, "multisin", rng=rng())
    with pytest.raises(ModelError, match="coulomb_friction"):
        synthesise(Rig(), {"coulomb_frictoin": {"force": 1.0}}, "steps", rng=rng())
    with pytest.raises(ModelError, match="takes 1 command"):
        synthesise(Rig(), None, np.zeros((100, 2)), rng=rng())
    with pytest.raises(ModelError, match="force"):
        synthesise(Rig(), None, {"torque": np.zeros(100)}, rng=rng())
    with pytest.raises(ModelError, match="record for longer"):
        synthesise(Rig(), None, "mixed", duration=0.001, rng=rng())
