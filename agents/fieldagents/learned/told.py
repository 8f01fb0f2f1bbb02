"""A policy that is told what a diagnosis knows: a reality's parameters as estimated, and how sure that is.

In training the estimates are drawn: the truth and a normal error, whose standard deviation is drawn as well
and told beside it. Both follow from the truth's bits, so that there is nothing to keep for a resume, and
agents on equal seeds are told the same.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray
from scipy.special import ndtri

from fieldagents.agent import Agent
from fieldagents.policies.policy import OnnxAgent


def estimates(info: Mapping[str, Any], told: Mapping[str, float]) -> NDArray[np.float32]:
    """What a diagnosis might have found: of each parameter the estimate and its standard error.

    Args:
        info: Of a vector environment whose reality is random.
        told: Largest standard error of each ``effect.parameter``.

    Returns:
        Shape (environments, 2 parameters).
    """
    columns = []
    for name, most in told.items():
        effect, parameter = name.split(".")
        truth = np.asarray(info["privileged"]["reality"][effect][parameter], dtype=np.float64)
        error = most * _luck(truth, 1)
        columns += [truth + error * ndtri(_luck(truth, 2)), error]
    return np.stack(columns, axis=-1).astype(np.float32)


def _luck(truth: NDArray[np.float64], number: int) -> NDArray[np.float64]:
    """Even draws between 0 and 1 that follow from bits (splitmix64; Steele, Lea and Flood, 2014)."""
    z = truth.view(np.uint64) + np.uint64(number * 0x9E3779B97F4A7C15 % 2**64)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return ((z ^ (z >> np.uint64(31))) >> np.uint64(11)).astype(np.float64) * 2.0**-53 + 2.0**-54


class Telling(VectorWrapper):
    """Vector environments whose observations end with estimates of what is true in them."""

    def __init__(self, env: VectorEnv[Any, Any, Any], told: Mapping[str, float]) -> None:
        super().__init__(env)
        self._told = told
        space, more = env.single_observation_space, 2 * len(told)
        assert isinstance(space, Box)
        low, high = (
            np.append(end, np.full(more, sign * np.inf)) for end, sign in ((space.low, -1), (space.high, 1))
        )
        self.single_observation_space = Box(low.astype(np.float32), high.astype(np.float32))
        self.observation_space = batch_space(self.single_observation_space, env.num_envs)

    def reset(self, **how: Any) -> tuple[Any, dict[str, Any]]:
        """See ``VectorEnv.reset``."""
        observation, info = self.env.reset(**how)
        return np.concatenate([observation, estimates(info, self._told)], axis=1), info

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """See ``VectorEnv.step``."""
        observation, *rest, info = self.env.step(actions)
        return np.concatenate([observation, estimates(info, self._told)], axis=1), *rest, info


class ToldAgent(Agent):
    """A policy that was trained to be told, with what a diagnosis has found, or, in tests, might have.

    Args:
        policy: The policy.
        told: See `estimates`, which draws what it is told; the truth is read for that alone.
        found: Estimate and standard error of each parameter in its place; nothing hidden is read then.
    """

    def __init__(
        self,
        policy: OnnxAgent,
        told: Mapping[str, float],
        found: Mapping[str, tuple[float, float]] | None = None,
    ) -> None:
        self.name, self.title, self._policy, self._told = policy.name, policy.title, policy, dict(told)
        self.sees = "privileged" if found is None else "observation"
        self._found = None if found is None else np.array([found[name] for name in told], np.float32).ravel()

    def reset(self, seed: int) -> None:
        """See ``Agent.reset``."""
        self._policy.reset(seed)

    def begin_episodes(self, begun: NDArray[np.bool_]) -> None:
        """See ``Agent.begin_episodes``."""
        self._policy.begin_episodes(begun)

    def act(self, observation: NDArray[Any], info: Mapping[str, Any]) -> NDArray[Any]:
        """See ``Agent.act``."""
        if self._found is None:
            known = estimates(info, self._told)
        else:
            known = np.tile(self._found, (len(observation), 1))
        return self._policy.act(np.concatenate([observation, known], axis=1), info)
