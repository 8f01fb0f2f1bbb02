"""Hide an effect in a shaken vehicle and require the diagnosis to name it, from one run of 4 s a mode.

Seeds apart from those used to develop. A record with wandering noise is among the clean ones.
"""

import numpy as np
import pytest

from fieldmodels.diagnosis import Diagnosis, diagnose
from fieldmodels.machines.excitation.model import ExcitationModel
from fieldmodels.machines.excitation.recording import record_experiment
from fieldmodels.reality import Reality

HIDDEN = {
    "payload": {"mass": 0.02},
    "cubic_stiffness": {"force": 40.0, "torque": 2.0},
    "coulomb_friction": {"force": 0.1, "torque": 0.03},
    "stiffness_drift": {"rate": 0.006},
    "soil_compliance": {"share": 0.15},
    "actuator_lag": {"time_constant": 0.002},
    "accelerometer_bias": {"x": 0.01, "y": -0.006, "z": 0.004},
    "accelerometer_gain": {"gain": 1.015},
    "inclinometer_bias": {"pitch": 0.001, "roll": -0.0008},
    "inclinometer_delay": {"delay": 0.003},
    "force_torque_gain": {"gain": 1.01},
}


def diagnosed(seed: int, effects: dict[str, dict[str, float]], coloured: float = 0.0) -> Diagnosis:
    model = ExcitationModel()
    run = record_experiment(
        np.random.default_rng(seed), Reality(effects=effects), duration=4.0, coloured=coloured, model=model
    )
    return diagnose(model, [run])


def test_every_listed_effect_is_hidden() -> None:
    assert set(HIDDEN) == {effect.name for effect in ExcitationModel().effects}


@pytest.mark.parametrize(
    ("effect", "seed"),
    [
        pytest.param(effect, seed, marks=() if seed == 101 else pytest.mark.slow)
        for effect in HIDDEN
        for seed in (101, 102)
    ],
)
def test_a_hidden_effect_is_named_with_its_size(effect: str, seed: int) -> None:
    found = diagnosed(seed, {effect: HIDDEN[effect]})
    assert found.verdict in ("named", "ambiguous")
    assert [cause.effect for cause in found.causes] == [effect]
    for name, true in HIDDEN[effect].items():
        estimate = found.causes[0].parameters[name]
        assert abs(estimate.value - true) < 4.5 * estimate.std
        neutral = next(p.nominal for p in ExcitationModel().effect(effect).parameters if p.name == name)
        assert estimate.std < 0.35 * abs(true - neutral)


@pytest.mark.parametrize("mass", [0.8, *(pytest.param(m, marks=pytest.mark.slow) for m in (0.1, 0.3))])
def test_a_payload_is_named_alone_whatever_its_size(mass: float) -> None:
    """Base parameters fitted without a large one are far off, and the way back is not a straight one."""
    found = diagnosed(301, {"payload": {"mass": mass}})
    assert [cause.effect for cause in found.causes] == ["payload"]
    assert found.causes[0].parameters["mass"].value == pytest.approx(mass, rel=0.01)
    assert found.unknown is None


@pytest.mark.parametrize(
    "seed", [201, 202, *(pytest.param(s, marks=pytest.mark.slow) for s in range(203, 209))]
)
def test_nothing_is_named_where_nothing_is_hidden(seed: int) -> None:
    """Every other record has noise that wanders, which is easily taken for a cause."""
    found = diagnosed(seed, {}, coloured=0.3 * (seed % 2))
    assert found.verdict == "consistent"
    assert found.parameters["stiffness_pitch"].value == pytest.approx(60.0, rel=0.01)
