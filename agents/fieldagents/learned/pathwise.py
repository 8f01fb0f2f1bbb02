"""A recurrent policy that learns by the gradient of its return, where the task can give it.

Where the actions do not change what is observed, episodes can be recorded once and played again with any
actions; and where what a return then owes to each action can be differentiated, nothing has to be explored:
the luck of an episode, which hides an action's worth from learning by reward, is the same before and after.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from sb3_contrib import RecurrentPPO
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from fieldagents.learned.conditioning import Conditioning
from fieldagents.made import imported
from fieldagents.policies.conditioned import simulated
from fieldgym.sb3 import NativeVecEnv


class Recorded(Protocol):
    """Recorded episodes that can be played again with other actions.

    Attributes:
        observations: Shape (episodes, steps, ...); the actions do not change them.
        drawn: What each episode has drawn of a random reality, by effect and parameter.
    """

    observations: NDArray[np.float32]
    drawn: Mapping[str, Mapping[str, Any]]

    def __init__(self, settings: Any, reality: Any, seeds: range) -> None:
        """Record an episode for each seed."""

    def play(
        self, which: NDArray[np.int64], actions: NDArray[np.float32]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Returns of some episodes, shape (len(which),), and their derivatives by the actions.

        Args:
            which: Numbers of the episodes.
            actions: Within their limits, shape (len(which), steps, ...), as the derivatives.
        """


class Pathwise(RecurrentPPO):
    """Gradient ascent on the mean return of recorded episodes, ``num_envs`` of them in an update.

    Args:
        policy: A recurrent one of ``RecurrentPPO``; its critic is not used.
        env: Environments that are recorded, ended by nothing but their time.
        recorded: ``module:Class`` of the task's recorded episodes, see `Recorded`.
        episodes: How many are recorded, of the run's own training seeds.
        n_steps: Steps of an episode.
        more: Further arguments of ``RecurrentPPO``; of those that say how it learns, ``learning_rate`` and
            ``max_grad_norm`` hold here.

    Raises:
        ValueError: If there are several kinds of environments, or their episodes have other lengths.
    """

    def __init__(
        self,
        policy: Any,
        env: VecEnv,
        recorded: str = "",
        episodes: int = 500,
        n_steps: int = 200,
        **more: Any,
    ) -> None:
        self.episodes, self.updates = episodes, 0
        self._recorded_class = imported(recorded)
        self._recorded: Recorded | None = None
        super().__init__(policy, env, n_steps=n_steps, **more)

    def _record(self, native: NativeVecEnv) -> Recorded:
        """Record the episodes, which a resumed run does anew, and show the normaliser all they hold."""
        if len(native.parts) > 1:
            raise ValueError("episodes are recorded of one kind of environment, without the key also")
        part = native.parts[0]
        place = part.unwrapped
        seeds = range(native.first_seed, native.first_seed + self.episodes)
        recorded: Recorded = self._recorded_class(place.settings, place.reality, seeds)  # type: ignore[attr-defined]
        if recorded.observations.shape[1] != self.n_steps:
            raise ValueError(f"n_steps is {self.n_steps}, an episode has {recorded.observations.shape[1]}")
        if isinstance(part, Conditioning):
            conditions = simulated(part.conditions, recorded.drawn)[:, None].repeat(self.n_steps, axis=1)
            recorded.observations = np.concatenate([recorded.observations, conditions], axis=2)
        if self.num_timesteps == 0 and isinstance(self.env, VecNormalize) and self.env.norm_obs:
            self.env.obs_rms.update(recorded.observations.reshape(-1, *recorded.observations.shape[2:]))
        return recorded

    def collect_rollouts(self, env: VecEnv, callback: Any, *_: Any, **__: Any) -> bool:
        """Choose the episodes of the next update; nothing has to be played to explore."""
        if self._recorded is None:
            self._recorded = self._record(env.unwrapped)  # type: ignore[arg-type]
        callback.on_rollout_start()
        self.num_timesteps += self.n_steps * self.n_envs
        callback.update_locals(locals())
        wanted: bool = callback.on_step()
        callback.on_rollout_end()
        return wanted

    def train(self) -> None:
        """Take one step up the mean return."""
        assert self._recorded is not None
        self._update_learning_rate(self.policy.optimizer)
        times = max(1, self.episodes // self.n_envs)
        order = np.random.default_rng(self.updates // times).permutation(self.episodes)
        which = np.array_split(order, times)[self.updates % times]
        self.updates += 1
        observations: Any = self._recorded.observations[which]
        if isinstance(self.env, VecNormalize):
            observations = self.env.normalize_obs(observations)
        proposed = self._acted(torch.as_tensor(observations))
        low, high = torch.as_tensor(self.action_space.low), torch.as_tensor(self.action_space.high)  # type: ignore[attr-defined]
        actions = proposed.detach().clamp(low, high)
        returns, slopes = self._recorded.play(which, actions.numpy())
        wanted = torch.as_tensor(slopes, dtype=torch.float32)
        # beyond a limit nothing changes: there only what leads back counts
        wanted[((proposed > high) & (wanted > 0)) | ((proposed < low) & (wanted < 0))] = 0.0
        self.policy.optimizer.zero_grad()
        loss = -(proposed * wanted).sum() / wanted[..., 0].numel()
        loss.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(self.policy.parameters(), self.max_grad_norm)
        self.policy.optimizer.step()
        assert self.ep_info_buffer is not None
        self.ep_info_buffer.extend({"r": float(one), "l": self.n_steps} for one in returns)

    def _acted(self, observations: torch.Tensor) -> torch.Tensor:
        """Most likely actions over whole episodes, both of shape (episodes, steps, ...)."""
        count, steps = observations.shape[:2]
        network: Any = self.policy
        lstm = network.lstm_actor
        memory = torch.zeros(lstm.num_layers, count, lstm.hidden_size)
        distribution, _ = network.get_distribution(
            observations.reshape(count * steps, -1).float(), (memory, memory), torch.zeros(count * steps)
        )
        return distribution.mode().reshape(count, steps, -1)  # type: ignore[no-any-return]
