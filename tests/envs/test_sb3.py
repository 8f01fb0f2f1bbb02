"""Vector environments under Stable-Baselines3: ends of episodes, what the learner is given."""

import sys
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

pytest.importorskip("stable_baselines3")

from stable_baselines3 import PPO
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.utils import explained_variance

import fieldgym
from fieldgym.info import part
from fieldgym.sb3 import NativeVecEnv


def cartpole(n: int = 6, steps: int = 40) -> NativeVecEnv:
    def make():
        return gymnasium.make("CartPole-v1", max_episode_steps=steps)

    return NativeVecEnv(SyncVectorEnv([make] * n, autoreset_mode=AutoresetMode.DISABLED), seed=3)


def falls(observation):
    """CartPole's own limits of the cart's place and the pole's angle."""
    return (np.abs(observation[0]) > 2.4) | (np.abs(observation[2]) > np.radians(12))


def test_an_end_gives_the_last_observation_apart_and_the_next_first_one_at_once():
    env = cartpole()
    rng = np.random.default_rng(0)
    env.reset()
    kinds = set()
    length = np.zeros(6, dtype=int)
    for _ in range(300):
        observation, reward, done, infos = env.step(rng.integers(0, 2, 6))
        assert np.all(reward == 1)  # every row is a step that was made
        length += 1
        for i in range(6):
            assert (infos[i] != {}) == done[i]
            if done[i]:
                last = infos[i]["terminal_observation"]
                assert infos[i]["TimeLimit.truncated"] != falls(last)
                assert infos[i]["episode"] == {"r": float(length[i]), "l": length[i]}
                assert np.all(np.abs(observation[i]) <= 0.05)  # CartPole begins within +-0.05
                kinds.add(infos[i]["TimeLimit.truncated"])
                length[i] = 0
            else:
                assert not falls(observation[i])
    assert kinds == {True, False}


def test_rows_are_the_scalar_environments():
    """A batch that ends at different times is, row by row, a scalar environment that is reset at its ends."""
    env_id = fieldgym.TASKS["pose_reaching"].env_id
    settings = {"timeout": 4.0}
    native = gymnasium.make_vec(env_id, 3, vectorization_mode="vector_entry_point", settings=settings)
    env = NativeVecEnv(native, seed=5)
    alone = [gymnasium.make(env_id, settings=settings) for _ in range(3)]
    first = [one.reset(seed=5 + i)[0] for i, one in enumerate(alone)]
    np.testing.assert_array_equal(env.reset(), first)
    rng = np.random.default_rng(0)
    ends = 0
    for _ in range(120):
        actions = rng.uniform(-1, 1, (3, 2)).astype(np.float32)
        observation, reward, done, _ = env.step(actions)
        for i, one in enumerate(alone):
            expected, value, terminated, truncated, _ = one.step(actions[i])
            assert done[i] == (terminated or truncated)
            assert reward[i] == value
            if done[i]:
                expected, ends = one.reset()[0], ends + 1
            np.testing.assert_array_equal(observation[i], expected)
    assert ends >= 3


def test_what_is_logged_of_the_value_is_of_steps_that_were_made():
    """The explained variance is that of the rollout, which has no row that is no experience."""
    model = PPO("MlpPolicy", cartpole(), n_steps=64, batch_size=64, n_epochs=1, seed=0, device="cpu")
    model.learn(6 * 64)
    buffer = model.rollout_buffer
    assert np.all(buffer.rewards >= 1)
    expected = explained_variance(buffer.values.flatten(), buffer.returns.flatten())
    assert model.logger.name_to_value["train/explained_variance"] == pytest.approx(expected)
    assert model.num_timesteps == 6 * 64


def test_parts_are_the_rows_one_after_the_other():
    """Two kinds of walks in one batch are what each is alone, to the bit, seeds included."""
    env_id = fieldgym.TASKS["heel_strike"].env_id

    def make(kind, n):
        settings = {"collision_kind": kind, "strides": 7}
        return gymnasium.make_vec(env_id, n, vectorization_mode="vector_entry_point", settings=settings)

    together = NativeVecEnv(make("ar1", 2), make("low_pass", 3), seed=4)
    alone = [NativeVecEnv(make("ar1", 2), seed=4), NativeVecEnv(make("low_pass", 3), seed=6)]
    np.testing.assert_array_equal(together.reset(), np.concatenate([env.reset() for env in alone]))
    rng = np.random.default_rng(0)
    for _ in range(20):
        actions = rng.uniform(-1, 1, (5, 3)).astype(np.float32)
        whole = together.step(actions)
        parts = [env.step(actions[rows]) for env, rows in zip(alone, together.rows, strict=True)]
        for k in range(3):
            np.testing.assert_array_equal(whole[k], np.concatenate([part[k] for part in parts]))
        assert [bool(info) for info in whole[3]] == [bool(info) for part in parts for info in part[3]]
        for i, env in enumerate(alone):
            mine, own = part(together.infos[i], "privileged"), part(env.infos[0], "privileged")
            np.testing.assert_array_equal(mine["levels"], own["levels"])
    pose = gymnasium.make_vec("fieldgym/PoseReaching-v0", 2, vectorization_mode="vector_entry_point")
    with pytest.raises(ValueError, match="need equal spaces"):
        NativeVecEnv(make("ar1", 2), pose, seed=0)


def test_twins_meet_the_same_walk_and_are_rewarded_by_what_they_do_better():
    """Groups see what single environments of the group's seed see; their rewards are those less the mean."""
    env_id, settings = fieldgym.TASKS["heel_strike"].env_id, {"strides": 7}

    def make(n):
        return gymnasium.make_vec(env_id, n, vectorization_mode="vector_entry_point", settings=settings)

    groups = NativeVecEnv(make(6), seed=4, twins=3)
    alone = [gymnasium.make(env_id, settings=settings) for _ in range(6)]
    first = [one.reset(seed=4 + i // 3)[0] for i, one in enumerate(alone)]
    np.testing.assert_array_equal(groups.reset(), first)
    rng = np.random.default_rng(0)
    total = np.zeros(6)
    for _ in range(7):
        actions = rng.uniform(-1, 1, (6, 3)).astype(np.float32)
        observation, reward, done, infos = groups.step(actions)
        steps = [one.step(action) for one, action in zip(alone, actions, strict=True)]
        own = np.array([step[1] for step in steps])
        total += own
        np.testing.assert_allclose(reward, own - np.repeat([own[:3].mean(), own[3:].mean()], 3), atol=1e-12)
        assert np.abs(reward).max() > 1e-3  # twins that act alike would teach nothing
        np.testing.assert_array_equal(observation[:3], observation[[0, 0, 0]])
        assert done.all() or not np.array_equal(observation[0], observation[3])  # another group, another walk
    assert done.all()
    np.testing.assert_allclose([info["episode"]["r"] for info in infos], total)
    with pytest.raises(ValueError, match="groups of 4 twins do not divide"):
        NativeVecEnv(make(6), seed=0, twins=4)


def test_twins_begin_their_next_episode_together():
    """Where one leaves the line, the others' episodes are truncated: all of them then meet the same walk."""
    env_id = fieldgym.TASKS["line_following"].env_id
    groups = NativeVecEnv(
        gymnasium.make_vec(env_id, 6, vectorization_mode="vector_entry_point"), seed=4, twins=3
    )
    groups.reset()
    rng = np.random.default_rng(0)
    cut, failed, biases = 0, 0, set()
    for _ in range(200):
        _, _, done, infos = groups.step(rng.uniform(-1, 1, (6, 1)).astype(np.float32))
        assert (done.reshape(2, 3).all(axis=1) == done.reshape(2, 3).any(axis=1)).all()
        bias = part(groups.infos[0], "privileged")["bias"].reshape(2, 3)
        np.testing.assert_array_equal(bias, bias[:, :1].repeat(3, axis=1))
        biases |= set(bias[:, 0])
        ends = [info for info in infos if info]
        assert all(info["TimeLimit.truncated"] != bool(info["failed"]) for info in ends)
        cut += sum(info["TimeLimit.truncated"] and info["episode"]["l"] < 100 for info in ends)
        failed += sum(bool(info["failed"]) for info in ends)
    assert cut > failed > 10
    assert len(biases) > 10


def test_one_call_gives_what_a_trainer_takes_and_logs_success():
    """SB3's own evaluation trusts the monitored returns, and the learner's seed begins the episodes."""
    env = fieldgym.make_sb3_vec("fieldgym/PoseReaching-v0", 4, settings={"timeout": 1.0})
    model = PPO("MlpPolicy", env, n_steps=64, batch_size=64, n_epochs=1, seed=5, device="cpu")
    native = gymnasium.make_vec("fieldgym/PoseReaching-v0", 4, settings={"timeout": 1.0})
    np.testing.assert_array_equal(env.reset(), native.reset(seed=5)[0])
    model.learn(4 * 64)
    assert {episode["l"] for episode in model.ep_info_buffer} == {10}
    assert len(model.ep_success_buffer) == len(model.ep_info_buffer) == 24
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        returns, lengths = evaluate_policy(model, env, n_eval_episodes=8, return_episode_rewards=True)
    assert lengths == [10] * 8
    assert len(set(returns)) > 1


def test_an_end_says_what_the_environment_said_and_pictures_are_one_a_row():
    env = fieldgym.make_sb3_vec(
        "fieldgym/PoseReaching-v0", 2, seed=1, settings={"timeout": 0.2}, render_mode="rgb_array"
    )
    env.reset()
    for _ in range(2):
        *_, infos = env.step(np.zeros((2, 2), np.float32))
    assert [info["time"] for info in infos] == [0.2, 0.2]
    assert not any(info["is_success"] for info in infos)
    assert infos[0]["privileged.pose"].shape == (3,)
    assert [image.shape for image in env.get_images()] == [(540, 960, 3)] * 2


def test_without_the_library_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    monkeypatch.delitem(vars(fieldgym), "make_sb3_vec", raising=False)  # kept from its first use
    with pytest.raises(ImportError, match=r"fieldgym\[train\]"):
        fieldgym.make_sb3_vec  # noqa: B018
