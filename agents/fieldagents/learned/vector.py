"""Gymnasium's vector environments as Stable-Baselines3 wants them, without copying a step.

Gymnasium's vector environments reset one step late; Stable-Baselines3 expects the first observation of the
next episode from the step that ends one. So the ended rows are reset at once, by ``reset_mask``: every row
that a learner sees is a step that was made.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvStepReturn

from fieldgym.base import TaskVectorEnv


class NativeVecEnv(VecEnv):
    """A Gymnasium vector environment behind the interface of Stable-Baselines3.

    Args:
        native: A vector environment of fieldgym, or another whose rows are reset from outside
            (``AutoresetMode.DISABLED``).
        seed: Of the first reset; row i is seeded with ``seed + i``.

    Attributes:
        info: What the environments last said beside their observations, of the episodes now under way. No
            learner is given it.

    Raises:
        ValueError: If its rows cannot be reset one by one.
    """

    def __init__(self, native: VectorEnv[Any, Any, Any], seed: int) -> None:
        mode = native.metadata.get("autoreset_mode")
        if mode != AutoresetMode.DISABLED and not isinstance(native.unwrapped, TaskVectorEnv):
            raise ValueError(
                f"training resets the ended rows of a vector environment itself; make this one with"
                f" autoreset_mode=AutoresetMode.DISABLED, not {mode}"
            )
        self.native = native
        self.info: dict[str, Any] = {}
        self._seed: int | None = seed
        self._returns = np.zeros(native.num_envs)
        self._lengths = np.zeros(native.num_envs, dtype=np.int64)
        self._actions: NDArray[Any] | None = None
        super().__init__(native.num_envs, native.single_observation_space, native.single_action_space)

    def reset(self) -> NDArray[Any]:
        """Begin new episodes everywhere; the first time from the seed handed in."""
        observation, self.info = self.native.reset(seed=self._seed)
        self._seed = None
        self._returns[:], self._lengths[:] = 0.0, 0
        return np.array(observation)

    def step_async(self, actions: NDArray[Any]) -> None:
        """Take the actions of the next step."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Step every environment, and begin the next episode of those that have ended.

        Returns:
            Observations, rewards, ends of episodes, and a dict for each environment; at an end it holds
            ``terminal_observation``, ``TimeLimit.truncated`` and the ``episode``'s return and length.
        """
        observation, reward, terminated, truncated, self.info = self.native.step(self._actions)
        reward = np.asarray(reward, dtype=np.float64)
        self._returns += reward
        self._lengths += 1
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        ended = np.asarray(terminated | truncated)
        if not ended.any():
            return np.array(observation), reward, ended, infos
        for i in np.flatnonzero(ended):
            infos[i] = {
                "terminal_observation": np.array(observation[i]),
                "TimeLimit.truncated": bool(truncated[i] and not terminated[i]),
                "episode": {"r": float(self._returns[i]), "l": int(self._lengths[i])},
            }
        self._returns[ended], self._lengths[ended] = 0.0, 0
        first, info = self.native.reset(options={"reset_mask": ended.copy()})
        self.info = _taken_over(self.info, info, ended)
        following = np.array(observation)
        following[ended] = first[ended]
        return following, reward, ended, infos

    def close(self) -> None:
        """Close the vector environment."""
        self.native.close()

    def get_state(self) -> dict[str, Any]:
        """Everything that the next steps depend on, the native environment's own state included."""
        return {
            "native": self.native.unwrapped.get_state(),  # type: ignore[attr-defined]
            "returns": self._returns.copy(),
            "lengths": self._lengths.copy(),
        }

    def set_state(self, state: dict[str, Any]) -> None:
        """Continue from a state that `get_state` gave."""
        self.native.unwrapped.set_state(state["native"])  # type: ignore[attr-defined]
        self._returns[:] = state["returns"]
        self._lengths[:] = state["lengths"]
        self._seed = None

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """An attribute of the vector environment, once for each environment asked for."""
        return [getattr(self.native, attr_name)] * len(self._indices(indices))

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Not possible: the environments of a native batch have no attributes of their own."""
        raise NotImplementedError("the environments of a native batch have no attributes of their own")

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> list[Any]:
        """Not possible: the environments of a native batch have no methods of their own."""
        raise NotImplementedError("the environments of a native batch have no methods of their own")

    def env_is_wrapped(
        self,
        wrapper_class: type[gym.Wrapper],  # noqa: ARG002
        indices: VecEnvIndices = None,
    ) -> list[bool]:
        """False for each environment: a native batch wraps none."""
        return [False] * len(self._indices(indices))

    def _indices(self, indices: VecEnvIndices) -> Sequence[int]:
        return list(self._get_indices(indices))


def _taken_over(info: dict[str, Any], begun: dict[str, Any], rows: NDArray[np.bool_]) -> dict[str, Any]:
    """An ``info`` with the entries of some rows from another one; what only one of them has stays."""
    result = dict(info)
    for key, value in begun.items():
        if key not in info:
            result[key] = value
        elif isinstance(value, dict):
            result[key] = _taken_over(info[key], value, rows)
        else:
            result[key] = np.where(rows.reshape(-1, *[1] * (np.ndim(value) - 1)), value, info[key])
    return result
