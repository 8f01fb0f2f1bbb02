"""A training run: its parts, and their state as a whole."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, ClassVar, cast

import gymnasium
import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.vec_env import VecNormalize

from fieldagents.learned.checkpoint import random_state, restore_random_state, to_arrays
from fieldagents.learned.config import TrainConfig
from fieldagents.learned.pixels import is_image
from fieldagents.learned.vector import NativeVecEnv

ACTIVATIONS = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU}


class SpaceError(ValueError):
    """An environment whose observations or actions the algorithm cannot take."""


class Run(ABC):
    """The parts of a training run, and their state as a whole; one subclass an algorithm.

    Attributes:
        model: The learner of Stable-Baselines3.
        environment: The training environments.
        normaliser: Normalises what they give.
        best: Steps and mean return of the best validation so far.
        logged: What the learner logs of an update and the learning curve keeps.
    """

    model: BaseAlgorithm
    logged: ClassVar[tuple[str, ...]]

    def __init__(self, config: TrainConfig, environment: NativeVecEnv) -> None:
        space = environment.observation_space
        image = is_image(space)
        if not image and (
            not isinstance(space, gymnasium.spaces.Box) or not np.issubdtype(space.dtype, np.floating)
        ):
            raise SpaceError(
                f"training needs observations that are arrays of floating numbers or grey images, not {space}"
            )
        if image and config.algorithm != "ppo":
            raise SpaceError(f"images are learned from by ppo, not by {config.algorithm}")
        self.config, self.environment = config, environment
        self.best: tuple[int, float] = (0, -np.inf)
        self.normaliser = VecNormalize(
            environment,
            norm_obs=config.normalise.observation and not image,  # pixels have their scale
            norm_reward=config.normalise.reward,
            clip_obs=config.normalise.clip,
            clip_reward=config.normalise.clip,
            gamma=config.learner.gamma,
        )

    @property
    def policy(self) -> BasePolicy:
        """The policy that is being trained."""
        return self.model.policy

    @abstractmethod
    def learn(self, steps: int, recorder: Any, fresh: bool) -> None:
        """Train for some more steps.

        Args:
            steps: How many.
            recorder: The callback to call.
            fresh: Whether the run begins.
        """

    @abstractmethod
    def learner_state(self) -> dict[str, Any]:
        """What the next update depends on in this algorithm alone: optimisers, buffers, its own streams."""

    @abstractmethod
    def restore_learner(self, state: dict[str, Any]) -> None:
        """Set what `learner_state` gave, after a round trip through a file."""

    def state(self) -> dict[str, Any]:
        """All that the next update depends on."""
        model, normaliser = self.model, self.normaliser
        return {
            "algorithm": self.config.algorithm,
            "steps": model.num_timesteps,
            "updates": model._n_updates,
            "policy": self.policy.state_dict(),
            "learner": self.learner_state(),
            "observation": model._last_obs,
            "episode_starts": model._last_episode_starts,
            "episodes": list(model.ep_info_buffer or ()),
            "observation_statistics": _statistics(normaliser.obs_rms) if normaliser.norm_obs else None,
            "return_statistics": _statistics(normaliser.ret_rms),
            "returns": normaliser.returns,
            "environment": self.environment.get_state(),
            "random": random_state(),
            "best": self.best,
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from a state that `state` gave, after a round trip through a file."""
        model, normaliser = self.model, self.normaliser
        model.learn(0, reset_num_timesteps=True)  # has the library set up what it sets up only here
        model.num_timesteps = state["steps"]
        model._n_updates = state["updates"]
        self.policy.load_state_dict(state["policy"])
        self.restore_learner(state["learner"])
        observation = state["observation"].numpy()
        if is_image(self.environment.observation_space):
            # the library turns images by a view, and the order in memory is that of torch's sums
            turned = np.array(np.moveaxis(observation, 1, 3), order="C", copy=True)
            observation = np.moveaxis(turned, 3, 1)
        model._last_obs = observation
        model._last_episode_starts = state["episode_starts"].numpy()
        assert model.ep_info_buffer is not None
        model.ep_info_buffer.extend(state["episodes"])
        if normaliser.norm_obs:
            _restore_statistics(normaliser.obs_rms, state["observation_statistics"])
        _restore_statistics(normaliser.ret_rms, state["return_statistics"])
        normaliser.returns = state["returns"].numpy()
        self.environment.set_state(to_arrays(state["environment"]))
        self.best = (state["best"][0], state["best"][1])
        restore_random_state(state["random"])  # last, since building the rest draws from these streams


def schedule(rate: float, decay: str) -> float | Callable[[float], float]:
    """The learning rate over the remaining part of the training, 1 to 0."""
    return (lambda remaining: rate * remaining) if decay == "linear" else rate


def _statistics(statistics: Any) -> list[Any]:
    running = cast(RunningMeanStd, statistics)
    return [np.asarray(running.mean), np.asarray(running.var), float(running.count)]


def _restore_statistics(statistics: Any, saved: list[Any]) -> None:
    statistics.mean, statistics.var, statistics.count = saved[0].numpy(), saved[1].numpy(), saved[2]
