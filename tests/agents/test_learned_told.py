"""Policies that are told of their reality: estimates scatter as they say, and are everywhere the same."""

import numpy as np
import pandas as pd
import pytest

pytest.importorskip("stable_baselines3")

import gymnasium

from fieldagents.agent import Agent
from fieldagents.config import EnvironmentConfig
from fieldagents.evaluation.episodes import run_episodes
from fieldagents.learned.config import TrainConfig
from fieldagents.learned.session import run_training
from fieldagents.learned.told import Telling, ToldAgent, estimates
from fieldagents.learned.training import prepare, train
from fieldagents.policies.policy import OnnxAgent, PolicyError

TOLD = {"yaw_slip.share": 0.1, "heading_bias.angle": 0.03}
REALITY = {
    "yaw_slip": {"share": {"uniform": [0, 0.4]}},
    "heading_bias": {"angle": {"uniform": [-0.25, 0.25]}},
}


def test_estimates_scatter_about_the_truth_as_they_say():
    rng = np.random.default_rng(0)
    truth = {
        "yaw_slip": {"share": rng.uniform(0, 0.4, 20_000)},
        "heading_bias": {"angle": rng.normal(size=20_000)},
    }
    told = estimates({"privileged": {"reality": truth}}, TOLD)
    for k, (name, most) in enumerate(TOLD.items()):
        effect, parameter = name.split(".")
        estimate, error = told[:, 2 * k].astype(float), told[:, 2 * k + 1].astype(float)
        assert error.min() > 0
        assert error.max() <= most
        assert error.mean() == pytest.approx(most / 2, rel=0.02)
        away = (estimate - truth[effect][parameter])[error > 0.01 * most] / error[error > 0.01 * most]
        assert abs(away.mean()) < 0.03
        assert away.std() == pytest.approx(1, abs=0.03)
        assert abs(np.corrcoef(error, truth[effect][parameter])[0, 1]) < 0.03
        assert np.mean(np.abs(away) < 1.96) == pytest.approx(0.95, abs=0.01)


class Watching(Agent):
    """Keeps what it is given, as a policy with a longer observation would be."""

    name, title, sees = "watching", "", "observation"

    def __init__(self):
        self.seen = []

    def act(self, observation, info):
        self.seen.append(observation)
        return np.zeros((len(observation), 2), dtype=np.float32)


def test_training_and_evaluation_tell_the_same_on_equal_seeds():
    settings = {"timeout": 0.5}
    native = gymnasium.make_vec(
        "fieldgym/PoseReaching-v0",
        4,
        vectorization_mode="vector_entry_point",
        settings=settings,
        reality=REALITY,
    )
    env = Telling(native, TOLD)
    observation, _ = env.reset(seed=7)
    assert observation.shape == (4, 11)
    assert env.single_observation_space.shape == (11,)
    assert env.observation_space.contains(observation)
    watching = Watching()
    environment = EnvironmentConfig(settings=settings, reality=REALITY)
    run_episodes(ToldAgent(watching, TOLD), "pose_reaching", environment, range(7, 11))
    for seen in watching.seen:
        np.testing.assert_array_equal(seen[:, 7:], observation[:, 7:])  # for a whole episode
    assert len(np.unique(observation[:, 7])) == 4


def test_what_a_diagnosis_has_found_takes_the_place_of_the_draws():
    watching = Watching()
    found = {"heading_bias.angle": (0.1, 0.01), "yaw_slip.share": (0.2, 0.02)}
    agent = ToldAgent(watching, TOLD, found)
    assert agent.sees == "observation"
    run_episodes(agent, "pose_reaching", EnvironmentConfig(settings={"timeout": 0.3}), range(2))
    np.testing.assert_allclose(watching.seen[0][:, 7:], [[0.2, 0.02, 0.1, 0.01]] * 2, rtol=1e-6)


def test_a_told_policy_trains_resumes_and_needs_what_it_was_trained_with(tmp_path):
    config = {
        "name": "told",
        "task": "pose_reaching",
        "steps": 256,
        "num_envs": 4,
        "environment": {"settings": {"timeout": 1.0}, "reality": REALITY},
        "told": TOLD,
        "learner": {"n_steps": 16, "batch_size": 64, "n_epochs": 2},
        "network": {"hidden": [8]},
        "validation": {"every": 2, "episodes": 4},
        "twins": 2,
        "checkpoint_every": 1,
    }
    run = train(TrainConfig(**config), progress=False, out=tmp_path / "run")
    assert len(pd.read_csv(run / "curve.csv")) == 4
    paused, whole = tmp_path / "paused", TrainConfig(**config)
    prepare(whole, paused)
    for until in (128, None):
        run_training(whole, paused, lambda _stage, _part: None, until=until)
    for name in ("curve.csv", "policy.onnx"):
        assert (paused / name).read_bytes() == (run / name).read_bytes()
    policy = OnnxAgent(run / "policy.onnx")
    assert policy.shape == (11,)
    with pytest.raises(PolicyError, match=r"shape \(11,\)"):
        run_episodes(policy, "pose_reaching", EnvironmentConfig(), range(2))
    with pytest.raises(ValueError, match="no sampler of the reality draws it"):
        TrainConfig(**{**config, "told": {"actuator_lag.time_constant": 0.1}})
    with pytest.raises(ValueError, match="leave out also"):
        TrainConfig(**{**config, "also": [{}]})
