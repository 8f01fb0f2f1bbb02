"""Soft actor-critic (Stable-Baselines3) as a run that can be resumed exactly.

The replay buffer holds observations as the environment gave them; they are normalised when they are drawn,
by the statistics of that moment.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3 import SAC
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.vec_env import VecNormalize

from fieldagents.learned.checkpoint import to_arrays
from fieldagents.learned.config import SacConfig, TrainConfig
from fieldagents.learned.replay import RealReplayBuffer
from fieldagents.learned.run import ACTIVATIONS, Run, SpaceError, schedule
from fieldagents.learned.vector import NativeVecEnv


class LateResetSac(SAC):
    """Soft actor-critic over environments that reset one step late."""

    def _store_transition(
        self,
        replay_buffer: ReplayBuffer,
        buffer_action: NDArray[Any],
        new_obs: Any,
        reward: NDArray[Any],  # noqa: ARG002 - the raw one is stored
        dones: NDArray[Any],
        infos: list[dict[str, Any]],
    ) -> None:
        """Store a step as it was.

        An episode's last observation is what the step gave: the library's own way, which takes it from
        ``infos`` and undoes its normalisation, would cut off what normalisation clips.
        """
        environment = cast(VecNormalize, self._vec_normalize_env)
        observation = environment.get_original_obs()
        replay_buffer.add(
            cast(NDArray[Any], self._last_original_obs),
            cast(NDArray[Any], observation),
            buffer_action,
            environment.get_original_reward(),
            dones,
            infos,
        )
        self._last_obs = new_obs
        self._last_original_obs = observation


class SacRun(Run):
    """A run of soft actor-critic."""

    model: LateResetSac
    logged = ("actor_loss", "critic_loss", "ent_coef")

    def __init__(self, config: TrainConfig, environment: NativeVecEnv) -> None:
        super().__init__(config, environment)
        sac, space = config.learner, environment.action_space
        assert isinstance(sac, SacConfig)
        if not (isinstance(space, spaces.Box) and space.is_bounded()):
            raise SpaceError(f"soft actor-critic needs continuous actions with bounds, not {space}")
        self._draw = np.random.default_rng(config.seed)
        self.model = LateResetSac(
            "MlpPolicy",
            self.normaliser,
            learning_rate=schedule(sac.learning_rate, sac.learning_rate_decay),
            replay_buffer_class=RealReplayBuffer,
            replay_buffer_kwargs={
                "environment": environment,
                "rng": self._draw,
                "n_steps": sac.n_steps,
                "gamma": sac.gamma,
            },
            policy_kwargs={
                "net_arch": list(config.network.hidden),
                "activation_fn": ACTIVATIONS[config.network.activation],
            },
            device="cpu",
            **sac.model_dump(exclude={"learning_rate", "learning_rate_decay", "log_interval", "n_steps"}),
        )
        self.model.action_space.seed(config.seed)  # the first actions are drawn from it

    @property
    def buffer(self) -> RealReplayBuffer:
        """The replay buffer."""
        return cast(RealReplayBuffer, self.model.replay_buffer)

    def learn(self, steps: int, recorder: Any, fresh: bool) -> None:
        """See ``Run.learn``."""
        # The library would log every few episodes; the recorder does so every round.
        self.model.learn(
            steps,
            callback=recorder,
            reset_num_timesteps=fresh,
            log_interval=None,  # type: ignore[arg-type]
        )

    def learner_state(self) -> dict[str, Any]:
        """See ``Run.learner_state``."""
        model, entropy = self.model, self.model.ent_coef_optimizer
        return {
            "actor_optimiser": model.actor.optimizer.state_dict(),
            "critic_optimiser": model.critic.optimizer.state_dict(),
            "entropy_optimiser": None if entropy is None else entropy.state_dict(),
            "log_ent_coef": None if model.log_ent_coef is None else model.log_ent_coef.detach().clone(),
            "raw_observation": model._last_original_obs,
            "buffer": self.buffer.get_state(),
            "draw": self._draw.bit_generator.state,
            "first_actions": model.action_space.np_random.bit_generator.state,
        }

    def restore_learner(self, state: dict[str, Any]) -> None:
        """See ``Run.restore_learner``."""
        model = self.model
        model.actor.optimizer.load_state_dict(state["actor_optimiser"])
        model.critic.optimizer.load_state_dict(state["critic_optimiser"])
        if model.ent_coef_optimizer is not None and model.log_ent_coef is not None:
            model.ent_coef_optimizer.load_state_dict(state["entropy_optimiser"])
            with torch.no_grad():
                model.log_ent_coef.copy_(state["log_ent_coef"])
        model._last_original_obs = state["raw_observation"].numpy()
        self.buffer.set_state(to_arrays(state["buffer"]))
        self._draw.bit_generator.state = state["draw"]
        model.action_space.np_random.bit_generator.state = state["first_actions"]
