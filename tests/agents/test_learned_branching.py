"""PPO from branches: each advantage is what scalar flights say, and a run begins from the zoo."""

import gymnasium
import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

import fieldgym  # noqa: F401 - registers the environments
from fieldagents.config import ConfigError, load_config
from fieldagents.evaluation.episodes import run_episodes
from fieldagents.learned.config import TrainConfig
from fieldagents.learned.session import run_training
from fieldagents.learned.training import prepare, train
from fieldagents.policies import zoo
from fieldagents.policies.policy import OnnxAgent
from fieldgym import find_task
from fieldgym.sb3 import NativeVecEnv
from fieldmodels.yaml import save_yaml

SETTINGS = {"lock_loss": False}
GROUPS, BRANCHES, FIRST = 4, 3, 12_345


def config(**keys):
    learner = {"stds": [0.02, 0.005], "branches": 3, "n_steps": 12, "batch_size": 48, "learning_rate": 1e-4}
    return TrainConfig(
        **{
            "name": "branching",
            "task": "uav_route",
            "algorithm": "fieldagents.learned.branching:BranchingPPO",
            "steps": 6 * 12 * 12,
            "num_envs": 12,
            "checkpoint_every": 3,
            "environment": {"settings": SETTINGS},
            "begin": "ppo_unseen",
            "learner": learner,
            "network": {"hidden": [128, 128], "activation": "relu"},
            "validation": {"every": 2, "episodes": 4},
            **keys,
        }
    )


def learner_of(**arguments):
    from fieldagents.learned.branching import BranchingPPO

    batch = find_task("uav_route").make_vec(GROUPS * BRANCHES, settings=SETTINGS)
    env = NativeVecEnv(batch, seed=FIRST)
    return BranchingPPO("MlpPolicy", env, branches=BRANCHES, n_steps=60, batch_size=36, seed=3, **arguments)


def test_an_advantage_is_the_difference_of_the_returns_of_scalar_flights():
    learner = learner_of(stds=(0.3, 0.2))
    told = []
    learner.train = lambda: told.extend(learner.tried)  # the policy stays what it is
    learner.learn(60 * GROUPS * BRANCHES)
    tried = [column.reshape(-1, BRANCHES, *column.shape[1:]) for column in told[0]]
    env = gymnasium.make("fieldgym/UavRoute-v1", settings=SETTINGS)
    for group, (seen, acted, advantage) in enumerate(zip(*tried, strict=True)):
        returns = []
        for action in acted:
            env.reset(seed=FIRST + group * BRANCHES)
            observation, _ = env.reset()  # the library has begun an episode of its own before
            np.testing.assert_array_equal(observation, seen[0])
            given, total, over = action, 0.0, False
            while not over:
                observation, reward, over, _, _ = env.step(np.clip(given, -1, 1))
                total += float(reward)
                given, _ = learner.predict(observation, deterministic=True)
            returns.append(total)
        np.testing.assert_allclose(advantage, returns - np.mean(returns), atol=1e-4)
        assert np.ptp(returns) > 0.01
    assert group == GROUPS - 1  # the first episodes are branched in their first step: none is left out


def test_later_steps_are_branched_as_often_as_they_occur():
    learner = learner_of(stds=(0.01, 0.01))
    learner.lengths = np.array([1, 3, 3, 4])
    shares = np.bincount(learner.when(30_000), minlength=4) / 30_000
    np.testing.assert_allclose(shares, np.array([4, 3, 3, 1]) / 11, atol=0.01)


def test_a_run_begins_from_the_zoo():
    from fieldagents.learned.begin import begin
    from fieldagents.learned.export import to_onnx
    from fieldagents.learned.run import Run

    one = config(seed=2)
    native = find_task("uav_route").make_vec(12, **one.environment.options)
    run = Run(one, NativeVecEnv(native, seed=0))
    begin(run, afresh=True)
    mine = OnnxAgent(to_onnx(run.policy, run.normaliser, ""))
    published = zoo.load("uav_route", "ppo_unseen", SETTINGS, run=2)
    seeds = range(20)
    scores = [run_episodes(agent, "uav_route", one.environment, seeds) for agent in (mine, published)]
    np.testing.assert_allclose(scores[0]["path_length"], scores[1]["path_length"], rtol=1e-5)


@pytest.mark.every(
    ("keys", "message"),
    [
        ({"seed": 7}, "begin: uav_route/ppo_unseen/no_lock_loss has no run of seed 7"),
        ({"begin": "ppo_unsen"}, "begin: the zoo has no 'ppo_unsen' for 'uav_route'"),
    ],
)
def test_an_entry_that_is_not_there_is_a_mistake_in_the_config(tmp_path, keys, message):
    save_yaml(config().model_dump(mode="json") | keys, tmp_path / "config.yaml")
    with pytest.raises(ConfigError, match=message):
        load_config(tmp_path / "config.yaml", TrainConfig)


def test_another_network_than_the_entry_has_is_refused(tmp_path):
    with pytest.raises(zoo.ZooError, match=r"policy_seed0[.]onnx has another network than this config's"):
        train(config(network={"hidden": [16]}), progress=False, out=tmp_path / "run")


def test_a_resumed_run_is_that_of_an_uninterrupted_one(tmp_path):
    whole = train(config(), progress=False, out=tmp_path / "whole")
    prepare(config(), tmp_path / "parts")
    run_training(config(), tmp_path / "parts", lambda *_: None, until=3 * 144)
    parts = train(config(), progress=False, resume=tmp_path / "parts")
    for name in ("policy.onnx", "curve.csv"):
        assert (whole / name).read_bytes() == (parts / name).read_bytes(), name


def test_rollouts_shorter_than_an_episode_are_refused():
    learner = learner_of(stds=(0.01, 0.01))
    learner.n_steps = 1
    with pytest.raises(ValueError, match=r"no episode has ended within n_steps=1: raise learner[.]n_steps"):
        learner.learn(12)


@pytest.mark.every("branches", [1, 5])
def test_groups_that_do_not_fit_are_refused(branches):
    from fieldagents.learned.branching import BranchingPPO

    env = NativeVecEnv(find_task("uav_route").make_vec(12, settings=SETTINGS), seed=0)
    with pytest.raises(ValueError, match=f"branches={branches}: 2 at least, and a divisor of the 12"):
        BranchingPPO("MlpPolicy", env, branches=branches, n_steps=12, batch_size=36)
