"""Native vector environments under Stable-Baselines3: ends of episodes, late resets, what is learned from."""

import gymnasium
import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from stable_baselines3 import PPO

from fieldagents.learned.vector import NativeVecEnv, RealRolloutBuffer


def cartpole(n: int = 6, steps: int = 40) -> NativeVecEnv:
    native = gymnasium.make_vec(
        "CartPole-v1", num_envs=n, vectorization_mode="vector_entry_point", max_episode_steps=steps
    )
    return NativeVecEnv(native, seed=3)


def falls(observation):
    """CartPole's own limits of the cart's place and the pole's angle."""
    return (np.abs(observation[:, 0]) > 2.4) | (np.abs(observation[:, 2]) > np.radians(12))


def test_an_end_keeps_its_last_observation_and_the_next_step_only_resets():
    env = cartpole()
    rng = np.random.default_rng(0)
    env.reset()
    ended = np.zeros(6, dtype=bool)
    kinds = set()
    length = np.zeros(6, dtype=int)
    for _ in range(300):
        observation, reward, done, infos = env.step(rng.integers(0, 2, 6))
        np.testing.assert_array_equal(env.late_resets, ended)
        assert np.all(np.abs(observation[ended]) <= 0.05)  # CartPole begins within +-0.05
        assert not done[ended].any()
        assert np.all(reward[ended] == 0)
        length = np.where(ended, 0, length + 1)
        for i in range(6):
            assert (infos[i] != {}) == done[i]
            if done[i]:
                np.testing.assert_array_equal(infos[i]["terminal_observation"], observation[i])
                assert infos[i]["TimeLimit.truncated"] != falls(observation)[i]
                assert infos[i]["episode"] == {"r": float(length[i]), "l": length[i]}
                kinds.add(infos[i]["TimeLimit.truncated"])
        ended = done.copy()
    assert kinds == {True, False}


def test_batches_hold_each_real_step_once_and_no_late_reset():
    env = cartpole()
    model = PPO(
        "MlpPolicy",
        env,
        n_steps=64,
        batch_size=64,
        n_epochs=1,
        seed=0,
        device="cpu",
        rollout_buffer_class=RealRolloutBuffer,
        rollout_buffer_kwargs={"environment": env, "rng": np.random.default_rng(0)},
    )
    _, callback = model._setup_learn(64 * 6)
    model.collect_rollouts(model.env, callback, model.rollout_buffer, 64)
    buffer = model.rollout_buffer
    late = np.zeros((64, 6), dtype=bool)
    # a late reset follows an end, which the buffer marks as the next step's start of an episode
    late[1:] = buffer.episode_starts[1:].astype(bool)
    assert 0 < late.sum() < 100
    expected = np.sort(buffer.observations[~late][:, 3])
    drawn = np.concatenate([batch.observations.numpy() for batch in buffer.get(50)])
    np.testing.assert_array_equal(np.sort(drawn[:, 3]), expected)


def test_ppo_learns_to_balance_through_the_adapter():
    env = cartpole(n=8, steps=500)
    model = PPO(
        "MlpPolicy",
        env,
        n_steps=64,
        batch_size=128,
        n_epochs=10,
        learning_rate=1e-3,
        seed=1,
        device="cpu",
        rollout_buffer_class=RealRolloutBuffer,
        rollout_buffer_kwargs={"environment": env, "rng": np.random.default_rng(0)},
    )
    model.learn(15_000)
    recent = [episode["r"] for episode in model.ep_info_buffer][-20:]
    assert np.mean(recent) > 80  # random actions balance for 22 steps


def test_an_environment_of_another_autoreset_is_refused():
    native = gymnasium.make_vec("CartPole-v1", num_envs=2, vectorization_mode="vector_entry_point")
    native.metadata = {**native.metadata, "autoreset_mode": gymnasium.vector.AutoresetMode.SAME_STEP}
    with pytest.raises(ValueError, match="NEXT_STEP"):
        NativeVecEnv(native, seed=0)
