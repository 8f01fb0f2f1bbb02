"""Proximal policy optimisation (Stable-Baselines3) as a run that can be resumed exactly."""

from __future__ import annotations

from typing import Any

import numpy as np
from stable_baselines3 import PPO

from fieldagents.learned.config import PpoConfig, TrainConfig
from fieldagents.learned.pixels import ImageFeatures, is_image
from fieldagents.learned.run import ACTIVATIONS, Run, schedule
from fieldagents.learned.vector import NativeVecEnv, RealRolloutBuffer


class PpoRun(Run):
    """A run of proximal policy optimisation."""

    model: PPO
    logged = ("approx_kl", "explained_variance", "std")

    def __init__(self, config: TrainConfig, environment: NativeVecEnv) -> None:
        super().__init__(config, environment)
        ppo, space = config.learner, environment.observation_space
        assert isinstance(ppo, PpoConfig)
        self._shuffle = np.random.default_rng(config.seed)
        self.model = PPO(
            "MlpPolicy",
            self.normaliser,
            learning_rate=schedule(ppo.learning_rate, ppo.learning_rate_decay),
            rollout_buffer_class=RealRolloutBuffer,
            rollout_buffer_kwargs={"environment": environment, "rng": self._shuffle},
            policy_kwargs={
                "net_arch": list(config.network.hidden),
                "activation_fn": ACTIVATIONS[config.network.activation],
                "log_std_init": config.network.log_std_init,
                **({"features_extractor_class": ImageFeatures} if is_image(space) else {}),
            },
            device="cpu",
            **ppo.model_dump(exclude={"learning_rate", "learning_rate_decay"}),
        )

    def learn(self, steps: int, recorder: Any, fresh: bool) -> None:
        """See ``Run.learn``."""
        self.model.learn(steps, callback=recorder, reset_num_timesteps=fresh)

    def learner_state(self) -> dict[str, Any]:
        """See ``Run.learner_state``."""
        return {
            "optimiser": self.model.policy.optimizer.state_dict(),
            "shuffle": self._shuffle.bit_generator.state,
        }

    def restore_learner(self, state: dict[str, Any]) -> None:
        """See ``Run.restore_learner``."""
        self.model.policy.optimizer.load_state_dict(state["optimiser"])
        self._shuffle.bit_generator.state = state["shuffle"]
