"""A replay buffer of real experience: steps that only reset an environment are never drawn from it."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.type_aliases import ReplayBufferSamples
from stable_baselines3.common.vec_env import VecNormalize

from fieldagents.learned.vector import NativeVecEnv


class RealReplayBuffer(ReplayBuffer):
    """Keeps the latest steps of every environment; draws n-step transitions from the real ones alone.

    A row holds one step of each environment. Since environments reset one step late, the observation that
    follows a row is always that of the next row, an episode's last one included: each is kept once. A late
    reset keeps its place in the ring, marked.

    Args:
        buffer_size: Steps that are kept, of all environments together.
        args: As the library hands them over: the spaces.
        environment: Says which steps are late resets.
        rng: Draws the batches.
        n_steps: Rewards that are summed before the value takes over; fewer at an episode's end.
        gamma: Discount.
        kwargs: As the library hands them over.
    """

    def __init__(
        self,
        buffer_size: int,
        *args: Any,
        environment: NativeVecEnv,
        rng: np.random.Generator,
        n_steps: int = 1,
        gamma: float = 0.99,
        **kwargs: Any,
    ) -> None:
        kwargs |= {"optimize_memory_usage": True, "handle_timeout_termination": False}
        super().__init__(buffer_size, *args, **kwargs)
        self._environment, self._rng = environment, rng
        self._n_steps, self._gamma = n_steps, gamma
        self._ended = np.zeros((self.buffer_size, self.n_envs), dtype=np.bool_)
        self._real = np.zeros((self.buffer_size, self.n_envs), dtype=np.bool_)

    def add(
        self,
        obs: NDArray[Any],
        next_obs: NDArray[Any],
        action: NDArray[Any],
        reward: NDArray[Any],
        done: NDArray[Any],
        infos: list[dict[str, Any]],
    ) -> None:
        """Store one step of every environment, observations and rewards as they were given."""
        truncated = np.array([info.get("TimeLimit.truncated", False) for info in infos], dtype=np.bool_)
        self._ended[self.pos] = done
        self._real[self.pos] = ~self._environment.late_resets
        super().add(obs, next_obs, action, reward, done & ~truncated, infos)

    def sample(self, batch_size: int, env: VecNormalize | None = None) -> ReplayBufferSamples:
        """Draw real transitions, each as likely as any other.

        Args:
            batch_size: How many.
            env: Normalises observations and rewards, by its statistics of this moment.
        """
        row, column = self._draw(batch_size)
        first = row
        rewards = np.zeros(batch_size, dtype=np.float32)
        discount = np.ones(batch_size, dtype=np.float32)
        going = np.ones(batch_size, dtype=np.bool_)
        last = row.copy()
        for _ in range(self._n_steps):
            rewards += np.where(
                going, discount * self._normalize_reward(self.rewards[row, column], env), np.float32(0)
            )
            discount = np.where(going, discount * np.float32(self._gamma), discount)
            last = np.where(going, row, last)
            following = (row + 1) % self.buffer_size
            going &= ~self._ended[row, column] & (following != self.pos)
            row = following
        data = (
            self._normalize_obs(self.observations[first, column], env),
            self.actions[first, column],
            self._normalize_obs(self.observations[(last + 1) % self.buffer_size, column], env),
            self.dones[last, column].reshape(-1, 1),
            rewards.reshape(-1, 1),
            discount.reshape(-1, 1),
        )
        return ReplayBufferSamples(*(self.to_torch(cast(NDArray[Any], part)) for part in data))

    def get_state(self) -> dict[str, Any]:
        """What is stored, without the part that is still empty."""
        filled = self.buffer_size if self.full else min(self.pos + 1, self.buffer_size)
        return {
            "position": self.pos,
            "full": self.full,
            **{name: array[:filled] for name, array in self._arrays().items()},
        }

    def set_state(self, state: dict[str, Any]) -> None:
        """Continue from what `get_state` gave."""
        self.pos, self.full = int(state["position"]), bool(state["full"])
        for name, array in self._arrays().items():
            array[: len(state[name])] = state[name]

    def _arrays(self) -> dict[str, NDArray[Any]]:
        return {
            "observations": self.observations,
            "actions": self.actions,
            "rewards": self.rewards,
            "terminated": self.dones,
            "ended": self._ended,
            "real": self._real,
        }

    def _draw(self, batch_size: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Rows and environments of real steps. In a full ring the row at ``pos`` is being replaced."""
        rows = self.buffer_size - 1 if self.full else self.pos
        oldest = self.pos + 1 if self.full else 0
        row = np.empty(batch_size, dtype=np.int64)
        column = np.empty(batch_size, dtype=np.int64)
        missing = np.arange(batch_size)
        while len(missing):
            row[missing] = (oldest + self._rng.integers(0, rows, len(missing))) % self.buffer_size
            column[missing] = self._rng.integers(0, self.n_envs, len(missing))
            missing = missing[~self._real[row[missing], column[missing]]]
        return row, column
