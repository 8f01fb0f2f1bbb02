"""Whether a command is held or interpolated is found from the data, and said, unless the user has said it."""

import numpy as np
import pytest
from scipy.signal import cont2discrete, dlsim

from fieldmodels.diagnosis import diagnose
from fieldmodels.diagnosis.cutting import main_horizon
from fieldmodels.diagnosis.inputs import decided
from fieldmodels.machine import held_inputs
from fieldmodels.machines.rig import Rig
from fieldmodels.recording import Recording
from fieldmodels.registry import get_model
from fieldmodels.synthesis import synthesise

STEP = 0.01


def recorded(way, seed=0, duration=20.0):
    """A bench of 2 Hz, exactly integrated for either way; sines up to 5 Hz and little noise."""
    rng = np.random.default_rng(seed)
    mass, damping, stiffness = 1.5, 3.0, 240.0
    time = np.arange(round(duration / STEP)) * STEP
    force = sum(np.sin(2 * np.pi * (f * time + rng.uniform())) for f in rng.uniform(0.2, 5.0, 30))
    matrices = [[0, 1], [-stiffness / mass, -damping / mass]], [[0], [1 / mass]], [[1, 0]], [[0]]
    system = cont2discrete([np.array(m) for m in matrices], STEP, {"held": "zoh", "interpolated": "foh"}[way])
    position = dlsim(system, force)[1][:, 0]
    noise = 0.003 * np.std(position) * rng.standard_normal(len(time))
    return Recording(time, {"force": force, "position": position + noise})


def decision(model, record):
    return decided(model, [record], main_horizon, lambda m: m.nominal, frozenset())


@pytest.mark.parametrize("true", ["held", "interpolated"])
@pytest.mark.parametrize("declared", ["held", "interpolated"])
def test_the_better_way_is_used_and_said_where_it_is_not_the_declared_one(true, declared):
    model = Rig()
    model.hold = declared
    found, said = decision(model, recorded(true))
    assert found.hold == true
    assert bool(said) == (model.hold != true)
    assert all("nats" in words and "--hold" in words for words in said)


def test_what_the_user_has_said_stays():
    model = held_inputs(Rig(), "held")
    found, said = decision(model, recorded("interpolated"))
    assert found is model
    assert said == ()


def test_a_measured_force_is_not_questioned():
    record = recorded("interpolated")
    both = Recording(record.time, {**record.signals, "force_measured": record["force"]})
    assert decision(Rig(), both)[1] == ()


@pytest.mark.parametrize("hidden", [
    {"coulomb_friction": {"force": 0.6}}, {"actuator_lag": {"time_constant": 0.02}},
    {"sensor_delay": {"delay": 0.01}}, {"backlash": {"gap": 0.005}},
])  # fmt: skip
def test_no_other_fault_passes_for_the_wrong_way(hidden):
    model, rng = get_model("rig"), np.random.default_rng(4)
    data = synthesise(model, hidden, "mixed", duration=20.0, amplitude=6.0, rng=rng)
    assert decision(model, data)[1] == ()


@pytest.mark.nightly
def test_a_diagnosis_goes_on_with_the_better_way():
    data = recorded("interpolated", duration=30.0)
    found = diagnose(Rig(), [data])
    assert found.verdict == "consistent"
    assert "vary linearly between samples" in found.to_json()["data"]["notes"][0]
    insisting = diagnose(held_inputs(Rig(), "held"), [data])
    assert insisting.verdict != "consistent"
    assert insisting.notes == ()


def test_other_inputs_get_a_driver_of_their_own():
    model, data = Rig(), recorded("held", duration=5.0)
    windows = model.windows(data, 0.5)
    held = model.simulate(model.nominal, windows)
    moving = held_inputs(model, "interpolated").simulate(model.nominal, windows)
    assert np.abs(moving - held).max() > 1e-6
