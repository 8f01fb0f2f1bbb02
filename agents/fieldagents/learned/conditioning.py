"""Telling a policy in training, and where it is scored as it was trained."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium import Space
from gymnasium.spaces import Box
from gymnasium.vector import VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from fieldagents.agent import Agent
from fieldagents.learned.config import TrainConfig
from fieldagents.policies.conditioned import Condition, conditions_of, simulated, turned
from fieldagents.policies.policy import OnnxAgent
from fieldgym.info import part


def conditions_in(config: TrainConfig) -> tuple[Condition, ...]:
    """What a policy of a config is told of; nothing unless the config says so."""
    return conditions_of(config.task, config.environment.reality) if config.conditioned else ()


class Conditioning(VectorWrapper):
    """Environments of a random reality that tell what a diagnosis of it might say; see `simulated`.

    Attributes:
        conditions: Of what they tell.

    Raises:
        ValueError: If observations have more than one dimension.
    """

    def __init__(self, env: VectorEnv[Any, Any, Any], conditions: Sequence[Condition]) -> None:
        super().__init__(env)
        self.conditions = conditions
        space, more = env.single_observation_space, np.full(2 * len(conditions), np.inf, dtype=np.float32)
        if not isinstance(space, Box) or len(space.shape) != 1:
            raise ValueError(f"a diagnosis is told beside observations of one dimension, not {space}")
        self.single_observation_space = Box(np.append(space.low, -more), np.append(space.high, more))
        self.observation_space = batch_space(self.single_observation_space, env.num_envs)

    def reset(self, **how: Any) -> tuple[Any, dict[str, Any]]:
        """See ``VectorEnv.reset``."""
        observation, info = self.env.reset(**how)
        return self._condition(observation, info), info

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """See ``VectorEnv.step``."""
        observation, *rest, info = self.env.step(actions)
        return self._condition(observation, info), *rest, info

    def _condition(self, observation: Any, info: dict[str, Any]) -> Any:
        numbers = simulated(self.conditions, part(info, "privileged.reality"))
        return np.concatenate([observation, turned(self.conditions, numbers, info)], axis=1)


class Diagnosed(Agent):
    """A policy in random realities, told what diagnoses of them might say; the truth is read for that alone.

    Args:
        policy: A policy that is told something.
    """

    sees = "privileged"

    def __init__(self, policy: OnnxAgent) -> None:
        self.name, self.title, self._policy = policy.name, policy.title, policy

    def fits(self, observations: Space[Any], actions: Space[Any]) -> None:
        """See ``Agent.fits``."""
        self._policy.fits(observations, actions)

    def reset(self, seed: int) -> None:
        """See ``Agent.reset``."""
        self._policy.reset(seed)

    def begin_episodes(self, begun: NDArray[np.bool_]) -> None:
        """See ``Agent.begin_episodes``."""
        self._policy.begin_episodes(begun)

    def act(self, observation: NDArray[Any], info: Mapping[str, Any]) -> NDArray[Any]:
        """See ``Agent.act``."""
        self._policy.diagnosis = simulated(self._policy.conditions, part(info, "privileged.reality"))
        return self._policy.act(observation, info)


def as_trained(policy: OnnxAgent) -> Agent:
    """A policy as it was trained: with a simulated diagnosis, if it is told one."""
    return Diagnosed(policy) if policy.conditions else policy
