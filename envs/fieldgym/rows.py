"""Scalar environments side by side, as a vector environment whose rows are reset from outside."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space, concatenate, create_empty_array, iterate
from numpy.typing import NDArray

STEP_REWARD = "step_reward"
"""Entry of a row's ``info`` after a step: its reward."""


class RowsVectorEnv(VectorEnv[Any, Any, Any]):
    """Scalar environments side by side, reset from outside by ``reset_mask``.

    A row that has ended stands still until it is reset: its observation stays, its reward is zero.

    Args:
        envs: The environments, of equal spaces.
    """

    def __init__(self, envs: Sequence[gymnasium.Env[Any, Any]]) -> None:
        self.envs = list(envs)
        self.num_envs = len(self.envs)
        self.spec = self.envs[0].spec
        self.metadata = {**self.envs[0].metadata, "autoreset_mode": AutoresetMode.DISABLED}
        self.single_observation_space = self.envs[0].observation_space
        self.single_action_space = self.envs[0].action_space
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._latest: list[Any] = [None] * self.num_envs
        self._terminated = np.zeros(self.num_envs, dtype=np.bool_)
        self._truncated = np.zeros(self.num_envs, dtype=np.bool_)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin new episodes, of all rows or of those of ``options["reset_mask"]``."""
        given = dict(options or {})
        chosen = given.pop("reset_mask", np.ones(self.num_envs, dtype=np.bool_))
        seeds: list[int | None] = [None] * self.num_envs
        if isinstance(seed, int | np.integer):
            seeds = [int(seed) + i for i in range(self.num_envs)]
        elif seed is not None:
            seeds = list(seed)
        infos: dict[str, Any] = {}
        for i in np.flatnonzero(chosen).tolist():
            self._latest[i], info = self.envs[i].reset(seed=seeds[i], options=given or None)
            infos = self._add_info(infos, info, i)
        self._terminated[chosen] = self._truncated[chosen] = False
        return self._observations(), infos

    def step(
        self, actions: Any
    ) -> tuple[Any, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Step the rows that have not ended."""
        rewards = np.zeros(self.num_envs)
        infos: dict[str, Any] = {}
        standing = self._terminated | self._truncated
        for i, action in enumerate(iterate(self.action_space, actions)):
            info: dict[str, Any] = {}
            if not standing[i]:
                stepped = self.envs[i].step(action)
                self._latest[i], reward, self._terminated[i], self._truncated[i], info = stepped
                rewards[i] = float(reward)
            infos = self._add_info(infos, {**info, STEP_REWARD: float(rewards[i])}, i)
        return self._observations(), rewards, self._terminated.copy(), self._truncated.copy(), infos

    def _observations(self) -> Any:
        empty: Any = create_empty_array(self.single_observation_space, self.num_envs)
        return deepcopy(concatenate(self.single_observation_space, self._latest, empty))

    def get_state(self) -> dict[str, Any]:
        """Where the random generators stand: all that third-party environments are sure to tell."""
        return {"generators": [env.unwrapped.np_random.bit_generator.state for env in self.envs]}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Continue from where the generators stood; the next `reset` begins new episodes."""
        for env, own in zip(self.envs, state["generators"], strict=True):
            env.unwrapped.np_random.bit_generator.state = own

    def close_extras(self, **_: Any) -> None:
        """Close the rows."""
        for env in self.envs:
            env.close()
