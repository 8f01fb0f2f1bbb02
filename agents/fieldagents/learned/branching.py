"""PPO from branches: what an action is worth is tried in copies of the episode, not judged by a critic.

The "vine" of Schulman et al., "Trust region policy optimization", 2015, section 5.2, with the clipped
surrogate of PPO.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv

from fieldagents.learned.annealed import AnnealedPPO
from fieldgym.sb3 import NativeVecEnv


class BranchingPPO(AnnealedPPO):
    """Annealed PPO whose advantages are differences between the returns of copies of an episode.

    The rows of a group meet the same episode and act by the most likely action, but for one step, in which
    each tries its own. Their returns differ by that step alone: no critic's error hides an advantage of a
    thousandth of the return. Episodes must depend on seed and actions alone. It improves a policy that works
    and explores little: let it ``begin`` from another one.

    Args:
        policy: See ``PPO``; the critic is not used.
        env: A ``NativeVecEnv`` of exact environments, without twins.
        branches: Rows in a group.
        more: Further arguments of ``AnnealedPPO``; ``n_steps`` is best several episodes, of which those
            that it cuts off are not used.

    Raises:
        ValueError: If the environments cannot be copied, or the groups do not divide them.
    """

    SHARE_LEARNED = 0.1
    """Of the steps, about how many are learned from: one of an episode, while the longest is waited for."""

    def __init__(self, policy: Any, env: VecEnv, branches: int = 8, **more: Any) -> None:
        super().__init__(policy, env, **more)
        native = env.unwrapped
        if not isinstance(native, NativeVecEnv) or not native.exact or native.twins > 1:
            raise ValueError(
                "branches are copies of this package's own environments, without wrappers or twins"
            )
        if branches < 2 or self.n_envs % branches:
            raise ValueError(
                f"branches={branches}: 2 at least, and a divisor of the {self.n_envs} environments"
            )
        self.native, self.branches = native, branches
        self.lengths = np.ones(1, dtype=np.int64)
        """Of the latest episodes; the steps in which something is tried are drawn by them."""
        self.tried: list[tuple[NDArray[np.float32], ...]] = []
        """Since the last update: observations, actions and advantages, each of shape (rows, ...)."""

    def collect_rollouts(self, env: VecEnv, callback: Any, *_: Any, **__: Any) -> bool:
        """Let each group play whole episodes, as many as fit into ``n_steps``."""
        callback.on_rollout_start()
        self.tried = []
        group = self._begin_together(env)
        for _step in range(self.n_steps):
            ended, infos = group.step(self, env)
            self.num_timesteps += self.n_envs
            callback.update_locals(locals())
            if not callback.on_step():
                return False
            done = np.flatnonzero(group.running & ended)
            self._update_info_buffer([infos[i] for i in done], ended[done])
            group.returns[done] = [infos[i]["episode"]["r"] for i in done]
            group.running &= ~ended
            if not group.running.any():
                self.tried.append(group.compared(self.branches))
                self.lengths = group.steps[:: self.branches].copy()
                group = self._begin_together(env)
        if not self.tried:
            raise ValueError(f"no episode has ended within n_steps={self.n_steps}: raise learner.n_steps")
        callback.on_rollout_end()
        return True

    def _begin_together(self, env: VecEnv) -> _Groups:
        """Begin an episode in all rows, the same in all of a group, and draw what will be tried."""
        state = self.native.get_state()
        for part in state["parts"]:
            own = part["generators"]
            part["generators"] = [own[i - i % self.branches] for i in range(len(own))]
        self.native.set_state(state)
        self._last_obs = env.reset()  # type: ignore[assignment]
        noise = torch.randn(self.n_envs, *(self.action_space.shape or ())) * self.spread_now()
        return _Groups(self.when(self.n_envs // self.branches).repeat(self.branches), noise.numpy())

    def when(self, groups: int) -> NDArray[np.int64]:
        """Draw in which step each group tries something: any step of any episode is as likely."""
        after = np.array([np.sum(self.lengths > step) for step in range(self.lengths.max())])
        return torch.multinomial(torch.as_tensor(after / after.sum()), groups, replacement=True).numpy()

    def train(self) -> None:
        """Make the better of what was tried more likely."""
        self.policy.set_training_mode(True)
        self._update_learning_rate(self.policy.optimizer)
        seen, acted, advantage = (
            torch.as_tensor(np.concatenate(column)) for column in zip(*self.tried, strict=True)
        )
        advantage = advantage / (advantage.std() + 1e-8)
        clip = self.clip_range(self._current_progress_remaining)  # type: ignore[operator]
        with torch.no_grad():
            before = self.policy.get_distribution(seen).log_prob(acted)
        divergences = []
        for _ in range(self.n_epochs):
            for part in torch.split(torch.randperm(len(seen)), self.batch_size):
                logs = self.policy.get_distribution(seen[part]).log_prob(acted[part]) - before[part]
                ratio, worth = logs.exp(), advantage[part]
                loss = -torch.min(worth * ratio, worth * ratio.clamp(1 - clip, 1 + clip)).mean()
                divergences.append(float((ratio - 1 - logs).detach().mean()))
                self.policy.optimizer.zero_grad()
                loss.backward()  # type: ignore[no-untyped-call]
                torch.nn.utils.clip_grad_norm_(self.policy.parameters(), self.max_grad_norm)
                self.policy.optimizer.step()
        self.policy.set_training_mode(False)
        self.logger.record("train/approx_kl", np.mean(divergences))
        self.logger.record("train/std", self.policy.log_std.exp().mean().item())


class _Groups:
    """Groups of rows in the middle of an episode.

    Attributes:
        when: Step in which each row tries something.
        noise: By how much its action then differs from the most likely one.
        running: Which rows are still in the episode.
        steps: That each has made in it.
        returns: Of the rows that have ended.
    """

    def __init__(self, when: NDArray[np.int64], noise: NDArray[np.float32]) -> None:
        rows = len(when)
        self.when, self.noise = when, noise
        self.running = np.ones(rows, dtype=np.bool_)
        self.steps, self.returns = np.zeros(rows, dtype=np.int64), np.zeros(rows)
        self._acted = np.zeros(noise.shape, dtype=np.float32)
        self._seen: NDArray[np.float32] | None = None

    def step(self, learner: BranchingPPO, env: VecEnv) -> tuple[NDArray[np.bool_], list[dict[str, Any]]]:
        """Act by the most likely action, but for the rows whose step it is to try another."""
        observation: Any = learner._last_obs
        if self._seen is None:
            self._seen = np.zeros_like(observation, dtype=np.float32)
        actions = np.zeros(self.noise.shape, dtype=np.float32)
        with torch.no_grad():
            given = torch.as_tensor(observation[self.running])
            actions[self.running] = learner.policy._predict(given, deterministic=True).numpy()
        now = self.running & (self.when == self.steps)
        actions[now] += self.noise[now]
        self._seen[now], self._acted[now] = observation[now], actions[now]
        space: Any = learner.action_space
        following, _, ended, infos = env.step(np.clip(actions, space.low, space.high))
        learner._last_obs = following  # type: ignore[assignment]
        self.steps += self.running
        return ended, infos

    def compared(self, branches: int) -> tuple[NDArray[np.float32], ...]:
        """What was tried, and by how much each was better than the mean of its group."""
        assert self._seen is not None
        worth = self.returns.reshape(-1, branches)
        advantage = (worth - worth.mean(axis=1, keepdims=True)).ravel()
        used = self.when < self.steps.reshape(worth.shape).min(axis=1).repeat(branches)
        return self._seen[used], self._acted[used], advantage[used].astype(np.float32)
