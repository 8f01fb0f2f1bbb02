"""Hide an effect in a walk and require the diagnosis to name it, from gyro and heel strikes alone.

A process torque of 0.15 rad/s2 and a floor of 1 mm, two minutes at 100 Hz: seeds apart from those used to
develop.
"""

import numpy as np
import pytest

from fieldmodels.diagnosis import Diagnosis, diagnose
from fieldmodels.machines.heel_strike.model import HeelStrikeModel
from fieldmodels.machines.heel_strike.parameters import Leg, Noise
from fieldmodels.machines.heel_strike.recording import record_walk
from fieldmodels.reality import Reality

LEG = Leg(step=0.01)
NOISE = Noise(process=0.15, floor=0.001)
HIDDEN = {
    "viscous_friction": {"rate": 0.15},
    "coulomb_friction": {"acceleration": 0.2},
    "quadratic_drag": {"coefficient": 0.25},
    "constant_force": {"acceleration": 0.1},
    "periodic_force": {"sine": 0.3, "frequency": 1.37},
    "gyro_bias": {"rate": 0.0043},
    "gyro_drift": {"rate": 1e-4},
    "gyro_gain": {"gain": 1.03},
    "gyro_delay": {"delay": 0.006},
    "gyro_quantisation": {"step": 0.02},
    "parameter_step": {"rate": 0.012, "time": 60.0},
}


def diagnosed(
    seed: int, reality: Reality | None = None, cogging: tuple[float, float] = (0.0, 1.0)
) -> Diagnosis:
    walk = record_walk(120.0, np.random.default_rng(seed), NOISE, reality, LEG, cogging)
    return diagnose(HeelStrikeModel(LEG), [walk])


def test_every_listed_effect_is_hidden():
    assert set(HIDDEN) == {effect.name for effect in HeelStrikeModel().effects}


@pytest.mark.parametrize("seed", [101, 102])
@pytest.mark.parametrize("effect", HIDDEN)
def test_a_hidden_effect_is_named_with_its_size(effect, seed):
    found = diagnosed(seed, Reality(effects={effect: HIDDEN[effect]}))
    assert found.verdict in ("named", "ambiguous")
    assert [cause.effect for cause in found.causes] == [effect]
    for name, true in HIDDEN[effect].items():
        estimate = found.causes[0].parameters[name]
        neutral = HeelStrikeModel().effect(effect).parameters[0].nominal
        tolerance = {"time": 5.0, "frequency": 0.01}.get(name, 0.2 * abs(true - neutral))
        assert estimate.value == pytest.approx(true, abs=tolerance)


@pytest.mark.parametrize("seed", range(201, 211))
def test_nothing_is_named_where_nothing_is_hidden(seed):
    found = diagnosed(seed)
    assert found.verdict == "consistent"
    assert found.parameters["length"].value == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("seed", [301, 302])
def test_a_force_outside_the_library_is_unknown_and_its_direction_shown(seed):
    found = diagnosed(seed, cogging=(0.5, 25.0))
    assert found.verdict == "unknown"
    assert not found.causes
    assert found.unknown.direction == "strike_angle"
