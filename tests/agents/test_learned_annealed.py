"""PPO whose standard deviation falls on a schedule: it does, and the learning rate with it."""

import numpy as np
import pandas as pd
import pytest

pytest.importorskip("stable_baselines3")

from fieldagents.learned.config import TrainConfig
from fieldagents.learned.training import train


def annealed(**learner) -> TrainConfig:
    own = {"n_steps": 8, "batch_size": 32, "n_epochs": 2, "stds": [0.4, 0.02], "learning_rate": 1e-2}
    return TrainConfig(
        name="annealed",
        task="heel_strike",
        algorithm="fieldagents.learned.annealed:AnnealedPPO",
        steps=20 * 32,
        num_envs=4,
        learner=own | learner,
        network={"hidden": [8]},
        validation={"every": 20, "episodes": 4},
    )


def test_the_spread_falls_geometrically_from_first_to_last(tmp_path):
    run = train(annealed(), progress=False, out=tmp_path / "run")
    std = pd.read_csv(run / "curve.csv")["std"].to_numpy()
    # the rollout of update k is made when k - 1 of 20 are over
    np.testing.assert_allclose(std, 0.4 * (0.02 / 0.4) ** (np.arange(20) / 20), rtol=1e-5)


def test_the_critic_is_silent_after_its_share_of_the_training(tmp_path):
    run = train(annealed(critic=0.4), progress=False, out=tmp_path / "run")
    explained = pd.read_csv(run / "curve.csv")["explained_variance"].to_numpy()
    assert (np.abs(explained[:8]) > 1e-4).all()
    np.testing.assert_allclose(explained[8:], 0.0, atol=1e-6)  # what is always 0 explains nothing


def test_without_a_critic_no_single_step_outweighs_all_others():
    gymnasium = pytest.importorskip("gymnasium")
    from fieldagents.learned.annealed import AnnealedPPO

    class Rare(gymnasium.Wrapper):
        def step(self, action):
            observation, _, terminated, truncated, info = self.env.step(action)
            self.made += 1
            return observation, -1e4 if self.made == 100 else self.made % 2, terminated, truncated, info

    env = Rare(gymnasium.make("fieldgym/HeelStrike-v0"))
    env.made = 0
    learner = AnnealedPPO("MlpPolicy", env, n_steps=400, batch_size=400, n_epochs=1, critic=0.0, gamma=0.5)
    learner.learn(400)
    worth = learner.rollout_buffer.advantages.ravel()
    # unclipped, all together would be the loss of that step and half of it, a quarter, ... before it
    assert worth.min() == pytest.approx(-10 * 2e4 / 400, rel=0.05)


def test_the_learning_rate_falls_in_the_same_proportion():
    gymnasium = pytest.importorskip("gymnasium")
    from fieldagents.learned.annealed import AnnealedPPO

    env = gymnasium.make("fieldgym/HeelStrike-v0")
    learner = AnnealedPPO("MlpPolicy", env, n_steps=8, batch_size=8, stds=(0.4, 0.1), learning_rate=1e-2)
    assert learner.lr_schedule(1.0) == pytest.approx(1e-2)
    assert learner.lr_schedule(0.5) == pytest.approx(0.5e-2)
    assert learner.lr_schedule(0.0) == pytest.approx(0.25e-2)
