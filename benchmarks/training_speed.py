"""Rollouts a second: the native vector environment under Stable-Baselines3 against its own DummyVecEnv.

Both collect with the same policy and the same number of environments; the ratio within one run is what
counts: ``python benchmarks/training_speed.py``.
"""

import time

import gymnasium
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv

import fieldgym
from fieldgym.sb3 import NativeVecEnv

ENVIRONMENTS, STEPS, REPEATS = 64, 64, 3


def native() -> VecEnv:
    env_id = fieldgym.TASKS["heel_strike"].env_id
    envs = gymnasium.make_vec(env_id, num_envs=ENVIRONMENTS, vectorization_mode="vector_entry_point")
    return NativeVecEnv(envs, seed=0)


def dummy() -> VecEnv:
    env_id = fieldgym.TASKS["heel_strike"].env_id
    return DummyVecEnv([lambda: gymnasium.make(env_id) for _ in range(ENVIRONMENTS)])


def steps_per_second(envs: VecEnv) -> list[float]:
    model = PPO("MlpPolicy", envs, n_steps=STEPS, batch_size=64, seed=0, device="cpu")
    _, callback = model._setup_learn(10**9)
    rates = []
    for _ in range(REPEATS + 1):  # the first one warms up
        begun = time.perf_counter()
        model.collect_rollouts(model.env, callback, model.rollout_buffer, STEPS)
        rates.append(ENVIRONMENTS * STEPS / (time.perf_counter() - begun))
    envs.close()
    return rates[1:]


if __name__ == "__main__":
    torch.set_num_threads(1)
    ours, theirs = (float(np.median(steps_per_second(make()))) for make in (native, dummy))
    print(f"native vector environment  {ours:8.0f} strides/s")
    print(f"DummyVecEnv of scalar ones {theirs:8.0f} strides/s")
    print(f"ratio                      {ours / theirs:8.1f}")
