"""Gymnasium's vector environments as Stable-Baselines3 wants them, without copying a step.

Gymnasium's native vector environments reset one step late (``AutoresetMode.NEXT_STEP``): the step after
an episode's end ignores its action and returns the first observation of the next episode. That step is no
experience. Stable-Baselines3 expects the reset within the last step instead, so here the late step stays
in the rollout, marked, and `RealRolloutBuffer` leaves it out of every update.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.type_aliases import RolloutBufferSamples
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvStepReturn


class NativeVecEnv(VecEnv):
    """A native Gymnasium vector environment behind the interface of Stable-Baselines3.

    Attributes:
        native: The vector environment.
        late_resets: Which environments only reset in the last step: shape (environments,), bool.
    """

    def __init__(self, native: VectorEnv[Any, Any, Any], seed: int) -> None:
        mode = native.metadata.get("autoreset_mode")
        if mode != AutoresetMode.NEXT_STEP:
            raise ValueError(f"training needs a vector environment with NEXT_STEP autoreset, not {mode}")
        self.native = native
        self.late_resets: NDArray[np.bool_] = np.zeros(native.num_envs, dtype=np.bool_)
        self._seed: int | None = seed
        self._ended = np.zeros(native.num_envs, dtype=np.bool_)
        self._returns = np.zeros(native.num_envs)
        self._lengths = np.zeros(native.num_envs, dtype=np.int64)
        self._actions: NDArray[Any] | None = None
        super().__init__(native.num_envs, native.single_observation_space, native.single_action_space)

    def reset(self) -> NDArray[Any]:
        """Begin new episodes everywhere; the first time from the seed handed in."""
        observation, _ = self.native.reset(seed=self._seed)
        self._seed = None
        for array in (self.late_resets, self._ended, self._returns, self._lengths):
            array[:] = 0
        return np.array(observation)

    def step_async(self, actions: NDArray[Any]) -> None:
        """Take the actions of the next step."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Step every environment.

        Returns:
            Observations, rewards, ends of episodes, and a dict for each environment; at an end it holds
            ``terminal_observation``, ``TimeLimit.truncated`` and the ``episode``'s return and length.
        """
        observation, reward, terminated, truncated, _ = self.native.step(self._actions)
        self.late_resets[:] = self._ended
        ended = (terminated | truncated) & ~self.late_resets
        self._ended[:] = ended
        self._returns += np.where(self.late_resets, 0.0, reward)
        self._lengths += ~self.late_resets
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for i in np.flatnonzero(ended):
            infos[i] = {
                "terminal_observation": np.array(observation[i]),
                "TimeLimit.truncated": bool(truncated[i] and not terminated[i]),
                "episode": {"r": float(self._returns[i]), "l": int(self._lengths[i])},
            }
        self._returns[ended] = 0.0
        self._lengths[ended] = 0
        return np.array(observation), np.asarray(reward, dtype=np.float64), ended.copy(), infos

    def close(self) -> None:
        """Close the vector environment."""
        self.native.close()

    def get_state(self) -> dict[str, Any]:
        """Everything that the next steps depend on, the native environment's own state included."""
        return {
            "native": self.native.unwrapped.get_state(),  # type: ignore[attr-defined]
            "ended": self._ended.copy(),
            "returns": self._returns.copy(),
            "lengths": self._lengths.copy(),
        }

    def set_state(self, state: dict[str, Any]) -> None:
        """Continue from a state that `get_state` gave."""
        self.native.unwrapped.set_state(state["native"])  # type: ignore[attr-defined]
        self._ended[:] = state["ended"]
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


class RealRolloutBuffer(RolloutBuffer):
    """A rollout buffer that draws its batches from real experience only, not from late resets."""

    FLAT = ("observations", "actions", "values", "log_probs", "advantages", "returns")

    def __init__(
        self, buffer_size: int, *args: Any, environment: NativeVecEnv, rng: np.random.Generator, **kwargs: Any
    ) -> None:
        self._environment = environment
        self._rng = rng
        self._real = np.ones((buffer_size, environment.num_envs), dtype=np.bool_)
        super().__init__(buffer_size, *args, **kwargs)

    def add(self, *args: Any, **kwargs: Any) -> None:
        """Store one step of every environment."""
        self._real[self.pos] = ~self._environment.late_resets
        super().add(*args, **kwargs)

    def get(self, batch_size: int | None = None) -> Generator[RolloutBufferSamples, None, None]:
        """Give the real steps once, in random order, in batches."""
        if not self.generator_ready:
            for name in self.FLAT:
                setattr(self, name, self.swap_and_flatten(getattr(self, name)))
            self.generator_ready = True
        order = self._rng.permutation(np.flatnonzero(self.swap_and_flatten(self._real)))
        size = batch_size or len(order)
        for start in range(0, len(order), size):
            yield self._get_samples(order[start : start + size])
