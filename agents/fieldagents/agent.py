"""Who acts: the one interface of published algorithms, tuned rules, oracles and learned policies."""

from __future__ import annotations

import importlib.util
from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from pkgutil import resolve_name
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from gymnasium import Space
from numpy.typing import NDArray

from fieldgym import find_task
from fieldmodels.guard import guard, located

Sees = Literal["observation", "diagnosis", "model", "privileged"]
"""What an agent may see, least first.

``observation``: the observation of each step, nothing else; its ``info`` is empty. ``diagnosis``: also what
it was told of its machine beforehand, a diagnosis' estimates and their standard errors; its ``info`` is
empty, too, but for the angle by which the task turns observations (``turned_by``). ``model``: beside the
observation the environment's settings (its constants and noise levels, as an algorithm's author knows them)
and the entries of ``info`` that the task declares in ``model_reads``. ``privileged``: all of ``info``, the
hidden truth of the simulation and the scores among it; such a result is a bound, no competitor.
"""


class Agent(ABC):
    """Chooses the actions of every environment of a batch.

    An agent's memory (if it has one) is a batch too: one row an environment. The evaluation hands an
    agent no more than it declares to see: the entries of ``info`` that `visible` lets through.

    Attributes:
        name: Its name in tables; a task's reference agents have theirs from where they are listed.
        sees: What it may see.
        title: One line that says what it does.
        estimator: Empty for an agent that acts. For an estimator outside the action space, the entry of
            ``info`` with its error on the very same strides; its actions are neutral and mean nothing.
        settings: Settings of the environment that compute an estimator and change nothing else.
    """

    name: str = ""
    sees: Sees = "observation"
    title: str = ""
    estimator: str = ""
    settings: Mapping[str, Any] = MappingProxyType({})

    @property
    def kind(self) -> str:
        """How its results are to be read: what it sees, or that it is an estimator which does not act."""
        return f"estimator, {self.sees}" if self.estimator else self.sees

    def fits(self, observations: Space[Any], actions: Space[Any]) -> None:  # noqa: B027
        """Make sure that this agent can act in an environment, before the first episode.

        Args:
            observations: Space of one observation.
            actions: Space of one action.

        Raises:
            ValueError: If it cannot; says which space is wrong.
        """

    def reset(self, seed: int) -> None:  # noqa: B027 - most agents have nothing to forget
        """Forget everything before a new batch of episodes begins.

        Args:
            seed: Seed of the agent's own randomness (agents without any ignore it).
        """

    def begin_episodes(self, begun: NDArray[np.bool_]) -> None:  # noqa: B027
        """Forget the finished episodes of some environments of the batch.

        Args:
            begun: Which environments begin an episode with the next ``act``, shape (environments,).
        """

    @abstractmethod
    def act(self, observation: NDArray[Any], info: Mapping[str, Any]) -> NDArray[Any]:
        """Choose the next actions.

        Args:
            observation: Observations of the batch, shape (environments, ...).
            info: The vector environment's ``info``: arrays of shape (environments, ...); cut down to
                what ``sees`` allows.

        Returns:
            Actions of the batch, shape (environments, ...), dtype of the action space.
        """

    def overruled(self, action: NDArray[Any]) -> None:  # noqa: B027 - most agents keep no account of it
        """Take in that something else was done than the last ``act`` chose, as by a human operator.

        Args:
            action: What was done, shape (environments, ...).
        """

    def account(self) -> Mapping[str, NDArray[Any]]:
        """What the agent says of its latest decisions, such as that it had no plan.

        The evaluation puts it into the ``info`` that metrics read, under ``agent``.

        Returns:
            Names to numbers, each of shape (environments,); NaN where there is none to give.
        """
        return {}

    def sketch(self) -> Mapping[str, Any] | None:
        """What a picture may show of the latest decision, or None.

        It is handed to the environment's method ``show`` by name before the next step is drawn; the
        evaluation never asks for it.
        """
        return None


class AgentError(ValueError):
    """An agent that cannot take part, or actions that no environment can take."""


CALLED = ("fits", "reset", "begin_episodes", "act", "overruled", "account", "sketch")


def own_agent(name: str, settings: Mapping[str, Any]) -> Agent:
    """An agent of the user's own, every call into it under guard.

    Args:
        name: ``module:Class``.
        settings: What it is called with.

    Raises:
        AgentError: If it is no `Agent`; a ModelError if its own code fails, with its line.
    """
    module, _, _ = name.partition(":")
    with located(_file_of(module), name):
        kind = resolve_name(name)
        made = kind(settings)
    if not isinstance(made, Agent):
        raise AgentError(f"{name}: gives {type(made).__name__}, which is not a fieldagents.agent.Agent")
    guard(type(made), _file_of(type(made).__module__), dict.fromkeys(CALLED))
    return made


def _file_of(module: str) -> Path:
    try:
        found = importlib.util.find_spec(module)
    except (ImportError, ValueError):
        found = None
    return Path(found.origin if found and found.origin else module)


def checked_actions(actions: Any, name: str, count: int, space: Space[Any]) -> NDArray[Any]:
    """Actions as an array.

    Raises:
        AgentError: If they are not numbers of the right shape, or not finite.
    """
    try:
        values = np.asarray(actions)
    except ValueError:
        values = np.asarray(None)
    wanted = (count, *(space.shape or ()))
    if values.dtype.kind not in "fiub":
        raise AgentError(f"agent {name!r} gives actions of type {values.dtype}, not numbers")
    if values.shape != wanted:
        raise AgentError(f"agent {name!r} gives actions of shape {values.shape}, not {wanted}")
    wrong = ~np.isfinite(values)
    if wrong.any():
        at = np.argwhere(wrong)[0]
        raise AgentError(
            f"agent {name!r} gives the action {values[tuple(at)]} in row {at[0]}; it must be finite"
        )
    return values


def visible(info: Mapping[str, Any], sees: Sees, task: str) -> Mapping[str, Any]:
    """Cut an ``info`` down to what an agent may see: an entry that nobody has allowed is not handed on.

    Args:
        info: Of the environment; a vector environment's masks (``"_key"``) go with their entries.
        sees: The agent's right.
        task: Name of the task, which declares what the rights ``model`` and ``diagnosis`` read.
    """
    if sees == "privileged":
        return info
    allowed: tuple[str, ...] = ()
    if sees == "model":
        allowed = find_task(task).model_reads
    elif sees == "diagnosis" and (angle := find_task(task).turned_by):
        allowed = (angle,)
    return {key: value for key, value in info.items() if key.removeprefix("_").split(".")[0] in allowed}
