"""PPO whose exploration narrows on a schedule: for tasks whose best action is next to a forbidden one."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv


class AnnealedPPO(PPO):
    """PPO with a standard deviation of the actions that falls geometrically instead of being learned.

    A policy that learns its standard deviation keeps as far from an abyss as it scatters, and narrows only as
    fast as its gradient says. The learning rate falls in the same proportion, since a step that is small
    beside a wide distribution is large beside a narrow one.

    Args:
        policy: See ``PPO``.
        env: See ``PPO``.
        stds: First and last standard deviation, in units of the action space.
        critic: Share of the training in which a critic says what is luck. Then advantages are discounted sums
            of rewards alone, clipped to ten times their mean size: for twins, whose rewards have little luck
            in them. A critic's errors stay as large as they were while the distribution was wide.
        more: Further arguments of ``PPO``.
    """

    def __init__(
        self,
        policy: Any,
        env: VecEnv,
        stds: tuple[float, float] = (0.15, 0.01),
        critic: float = 1.0,
        **more: Any,
    ) -> None:
        self.stds = (float(stds[0]), float(stds[1]))
        self.critic = critic
        super().__init__(policy, env, **more)

    def _narrowed(self, remaining: float) -> float:
        """The present standard deviation over the first, at a remaining part of the training, 1 to 0."""
        return float((self.stds[1] / self.stds[0]) ** (1.0 - remaining))

    def _setup_lr_schedule(self) -> None:
        super()._setup_lr_schedule()
        rate = self.lr_schedule
        self.lr_schedule = lambda remaining: rate(remaining) * self._narrowed(remaining)

    def spread_now(self) -> float:
        """Set the standard deviation that the actions have by now, and return it."""
        spread = self.stds[0] * self._narrowed(self._current_progress_remaining)
        with torch.no_grad():
            self.policy.log_std.fill_(math.log(spread))
        return spread

    def collect_rollouts(self, *args: Any, **kwargs: Any) -> bool:
        """See ``PPO``; sets the standard deviation with which the rollout is made."""
        self.spread_now()
        alone = 1.0 - self._current_progress_remaining >= self.critic
        if alone:
            self.vf_coef, self.rollout_buffer.gae_lambda = 0.0, 1.0
            with torch.no_grad():
                for weights in self.policy.value_net.parameters():
                    weights.zero_()
        going_on = super().collect_rollouts(*args, **kwargs)
        if alone:
            advantages = self.rollout_buffer.advantages
            most = 10.0 * np.abs(advantages).mean()
            np.clip(advantages, -most, most, out=advantages)
        return going_on

    def train(self) -> None:
        """See ``PPO``; leaves the standard deviation as it is."""
        self.policy.log_std.requires_grad_(False)
        super().train()
