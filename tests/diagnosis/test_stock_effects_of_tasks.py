"""What stock effect a task's recorder hides, a diagnosis with such around the model finds, a task flies."""

import gymnasium as gym
import numpy as np
import pytest

import fieldgym
from fieldmodels.diagnosis.procedure import diagnose
from fieldmodels.drivers.around import with_effects
from fieldmodels.drivers.named import stock_of
from fieldmodels.machines.line_following.recording import record_walk
from fieldmodels.registry import get_model
from fieldmodels.yaml import save_yaml

SOUGHT = ("steering_lag", "steering_dead_zone", "line_bend", "line_drift", "stride_drift")


@pytest.mark.parametrize(
    ("effect", "parameter", "value"),
    [
        ("steering_lag", "time_constant", 0.8),
        ("steering_dead_zone", "width", 0.03),
        ("line_bend", "curvature", 3.0),
    ],
)
def test_a_hidden_effect_is_found_and_flown(effect, parameter, value, tmp_path):
    nominal = get_model("line_following")
    model = with_effects(nominal, *(stock_of(nominal)[name] for name in SOUGHT))
    hidden = {effect: {parameter: value}}
    train, test = (record_walk(hidden, 500, rng=np.random.default_rng(seed)) for seed in (1, 2))
    found = diagnose(model, [train], [test])
    assert [cause.effect for cause in found.causes] == [effect]
    extended = found.extended()
    assert extended["effects"][effect][parameter]["value"] == pytest.approx(value, rel=0.25)
    path = tmp_path / "extended.yaml"
    save_yaml(extended, path)
    env = gym.make(fieldgym.TASKS["line_following"].env_id, reality=str(path)).unwrapped
    env.reset(seed=0)
    assert effect in env.reality.effects
    assert np.isfinite(env.step(np.array([0.3]))[1])
