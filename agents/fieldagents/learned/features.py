"""Fixed features of observations, so that a policy can remember what it has seen and not the whole of it."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvStepReturn

from fieldgym.sb3 import NativeVecEnv


class FeaturedVecEnv(VecEnvWrapper):
    """Environments that give features of what they observe, and beside them the action just taken.

    Args:
        environment: Gives the observations.
        features: Takes a batch of them, shape (batch, ...), and gives their features, shape (batch, n).

    Attributes:
        features: What computes them; it is exported with the policy.
        taken: Actions just taken, shape (rows, m), within their limits; zeros where an episode begins.

    Raises:
        ValueError: If actions are not one-dimensional and continuous.
    """

    def __init__(self, environment: NativeVecEnv, features: torch.nn.Module) -> None:
        actions = environment.action_space
        if not isinstance(actions, spaces.Box) or len(actions.shape) != 1:
            raise ValueError(f"features stand beside one-dimensional continuous actions, not {actions}")
        self.features = features.eval()
        self.taken = np.zeros((environment.num_envs, *actions.shape), dtype=np.float32)
        shape, kind = environment.observation_space.shape or (), environment.observation_space.dtype
        width = self._seen(np.zeros((1, *shape), dtype=kind)).shape[1] + actions.shape[0]
        super().__init__(environment, spaces.Box(-np.inf, np.inf, (width,), np.float32))

    def _seen(self, observation: NDArray[Any]) -> NDArray[np.float32]:
        with torch.no_grad():
            found: NDArray[np.float32] = self.features(torch.as_tensor(observation)).numpy()
        return found

    def reset(self) -> NDArray[np.float32]:
        """Begin new episodes everywhere."""
        self.taken[:] = 0.0
        return np.concatenate([self._seen(cast(NDArray[Any], self.venv.reset())), self.taken], axis=1)

    def step_async(self, actions: NDArray[Any]) -> None:
        """Take the actions of the next step, and remember them."""
        limits = cast(spaces.Box, self.action_space)
        self.taken = np.clip(actions, limits.low, limits.high, dtype=np.float32)
        self.venv.step_async(actions)

    def step_wait(self) -> VecEnvStepReturn:
        """As of the environments; a ``terminal_observation`` is of features too."""
        observation, reward, ended, infos = self.venv.step_wait()
        rows = np.flatnonzero(ended)
        if len(rows):
            last = self._seen(np.stack([infos[i]["terminal_observation"] for i in rows]))
            for i, seen in zip(rows, last, strict=True):
                infos[i]["terminal_observation"] = np.concatenate([seen, self.taken[i]])
            self.taken[rows] = 0.0
        seen = self._seen(cast(NDArray[Any], observation))
        return np.concatenate([seen, self.taken], axis=1), reward, ended, infos
