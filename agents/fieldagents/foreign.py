"""A third-party environment as a task to evaluate: its metrics and its default agents."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium import Space, spaces
from numpy.typing import NDArray

from fieldagents.agent import Agent
from fieldagents.task import Metric, ReferenceAgent, TaskDefinition
from fieldgym import find_task

METRICS = (Metric("episode_return", "1", "return", "reward", lower_is_better=False, over="sum"),)


@dataclass(frozen=True)
class ForeignDefinition(TaskDefinition):
    """A third-party environment as a task to evaluate."""

    metrics: tuple[Metric, ...] = METRICS

    def _listed(self, module: str, name: str = "") -> Sequence[Any]:
        del name
        if module != "agents":
            return ()
        return (
            ReferenceAgent("random", "Actions drawn at random", lambda _: RandomActions()),
            ReferenceAgent(
                "still",
                "The middle of every action, or the first of those that can be counted",
                lambda _: Middle(),
            ),
        )


class RandomActions(Agent):
    """Draws its actions; the seed of the evaluation is that of the draws."""

    def __init__(self) -> None:
        self._space: Space[Any] = spaces.Discrete(1)

    def fits(self, observations: Space[Any], actions: Space[Any]) -> None:
        """See ``Agent.fits``; whatever there is, it can draw from."""
        del observations
        self._space = deepcopy(actions)

    def reset(self, seed: int) -> None:
        """See ``Agent.reset``."""
        self._space.seed(seed)

    def act(self, observation: NDArray[Any], info: Mapping[str, Any]) -> NDArray[Any]:
        """See ``Agent.act``."""
        del info
        return np.stack([np.asarray(self._space.sample()) for _ in range(len(observation))])


class Middle(RandomActions):
    """Always the same action."""

    def act(self, observation: NDArray[Any], info: Mapping[str, Any]) -> NDArray[Any]:
        """See ``Agent.act``."""
        del info
        space, count = self._space, len(observation)
        if isinstance(space, spaces.Box):
            low, high = (np.nan_to_num(end, posinf=1.0, neginf=-1.0) for end in (space.low, space.high))
            return np.repeat(((low + high) / 2).astype(space.dtype)[None], count, axis=0)
        start = np.asarray(getattr(space, "start", 0))
        return np.broadcast_to(start, (count, *(space.shape or ()))).astype(space.dtype)


def definition(name: str) -> ForeignDefinition:
    """A third-party environment as a task to evaluate."""
    return ForeignDefinition(find_task(name).name)
