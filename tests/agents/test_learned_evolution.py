"""CMA-ES over a policy's weights: it finds an optimum that is known, from whole episodes alone."""

import gymnasium
import numpy as np
import pytest

pytest.importorskip("sb3_contrib")
pytest.importorskip("cma")

import torch
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from fieldagents.learned.config import TrainConfig
from fieldagents.learned.evolution import Evolution
from fieldagents.learned.knots import Knots
from fieldagents.learned.session import run_training
from fieldagents.learned.training import prepare, train
from fieldgym.sb3 import NativeVecEnv

STEPS = 4
WANTED = np.array([[0.5, -0.3], [-0.6, 0.2], [0.1, 0.7], [0.4, 0.4]])


class Quadratic(gymnasium.Env):
    """The remaining share of the steps is seen; the reward is best for one action in each of them."""

    observation_space = Box(0.0, 1.0, (1,), np.float32)
    action_space = Box(-1.0, 1.0, (2,), np.float32)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.step_number, self.luck = 0, float(self.np_random.normal(0, 100))
        return np.ones(1, np.float32), {}

    def step(self, action):
        reward = self.luck - float(np.sum((np.asarray(action) - WANTED[self.step_number]) ** 2 * [1.0, 9.0]))
        self.step_number += 1
        left = np.array([1 - self.step_number / STEPS], np.float32)
        return left, reward, False, self.step_number >= STEPS, {}


def quadratics(rows: int, twins: int) -> NativeVecEnv:
    batch = SyncVectorEnv([Quadratic] * rows, autoreset_mode=AutoresetMode.DISABLED)
    return NativeVecEnv(batch, seed=0, twins=twins)


def test_a_schedule_is_found_under_luck_a_thousand_times_as_large():
    torch.manual_seed(0)
    network = {
        "net_arch": [],
        "features_extractor_class": Knots,
        "features_extractor_kwargs": {"low": 0.25, "high": 1.0, "knots": STEPS},
    }
    learner = Evolution(
        "MlpPolicy", quadratics(24, 12), spread=0.3, n_steps=STEPS, batch_size=96, policy_kwargs=network
    )
    learner.learn(24 * STEPS * 120)
    left = 1 - np.arange(STEPS, dtype=np.float32)[:, None] / STEPS
    found, _ = learner.predict(left, deterministic=True)
    np.testing.assert_allclose(found, WANTED, atol=0.02)


def test_candidates_that_meet_other_episodes_are_refused():
    with pytest.raises(ValueError, match="candidates meet the same episodes as twins: 4 at least, not 1"):
        Evolution("MlpPolicy", quadratics(8, 1), n_steps=STEPS, batch_size=32)


def test_a_resumed_run_is_that_of_an_uninterrupted_one(tmp_path):
    config = TrainConfig(
        name="evolution",
        task="heel_strike",
        algorithm="fieldagents.learned.evolution:Evolution",
        steps=12 * 8 * 10,
        num_envs=8,
        twins=4,
        checkpoint_every=5,
        environment={"settings": {"strides": 10}},
        learner={"n_steps": 10, "batch_size": 80, "spread": 0.2},
        network={"hidden": []},
        validation={"every": 4, "episodes": 4},
    )
    whole = train(config, progress=False, out=tmp_path / "whole")
    prepare(config, tmp_path / "parts")
    run_training(config, tmp_path / "parts", lambda *_: None, until=7 * 80)
    parts = train(config, progress=False, resume=tmp_path / "parts")
    for name in ("policy.onnx", "curve.csv"):
        assert (whole / name).read_bytes() == (parts / name).read_bytes(), name


def test_knots_are_one_at_their_own_place_and_linear_between():
    space = Box(-np.inf, np.inf, (3,), np.float32)
    knots = Knots(space, entry=1, low=0.5, high=2.5, knots=3)
    seen = torch.tensor([[9.0, place, 9.0] for place in (-4.0, 0.5, 1.5, 2.5, 2.0, 7.0)])
    expected = [[1, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0.5, 0.5], [0, 0, 1]]
    np.testing.assert_allclose(knots(seen).numpy(), expected, atol=1e-6)
