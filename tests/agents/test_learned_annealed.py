"""PPO whose standard deviation falls on a schedule: it does, and the learning rate with it."""

import numpy as np
import pandas as pd
import pytest

pytest.importorskip("stable_baselines3")

from fieldagents.learned.config import TrainConfig
from fieldagents.learned.training import train


def test_the_spread_falls_geometrically_from_first_to_last(tmp_path):
    config = TrainConfig(
        name="annealed",
        task="heel_strike",
        algorithm="fieldagents.learned.annealed:AnnealedPPO",
        steps=20 * 32,
        num_envs=4,
        learner={"n_steps": 8, "batch_size": 32, "n_epochs": 2, "stds": [0.4, 0.02], "learning_rate": 1e-2},
        network={"hidden": [8]},
        validation={"every": 20, "episodes": 4},
    )
    run = train(config, progress=False, out=tmp_path / "run")
    std = pd.read_csv(run / "curve.csv")["std"].to_numpy()
    # the rollout of update k is made when k - 1 of 20 are over
    np.testing.assert_allclose(std, 0.4 * (0.02 / 0.4) ** (np.arange(20) / 20), rtol=1e-5)


def test_the_learning_rate_falls_in_the_same_proportion():
    gymnasium = pytest.importorskip("gymnasium")
    from fieldagents.learned.annealed import AnnealedPPO

    env = gymnasium.make("fieldgym/HeelStrike-v0")
    learner = AnnealedPPO("MlpPolicy", env, n_steps=8, batch_size=8, stds=(0.4, 0.1), learning_rate=1e-2)
    assert learner.lr_schedule(1.0) == pytest.approx(1e-2)
    assert learner.lr_schedule(0.5) == pytest.approx(0.5e-2)
    assert learner.lr_schedule(0.0) == pytest.approx(0.25e-2)
