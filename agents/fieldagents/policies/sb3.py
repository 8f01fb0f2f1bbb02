"""A policy saved by Stable-Baselines3 itself. Loading it runs its pickles: only for files that one trusts."""

from __future__ import annotations

import json
import pickle
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import Space
from numpy.typing import NDArray

from fieldagents.agent import Agent
from fieldagents.policies.algorithms import algorithms
from fieldagents.policies.policy import PolicyError


def _normaliser(path: Path) -> Any:
    """The normaliser that a file of statistics holds."""
    from stable_baselines3.common.vec_env import VecNormalize

    try:
        found = pickle.loads(path.read_bytes())
    except Exception as error:  # a pickle may raise anything
        raise PolicyError(f"{path}: not the statistics of a VecNormalize: {error}") from None
    if not isinstance(found, VecNormalize):
        raise PolicyError(f"{path}: not the statistics of a VecNormalize, but {type(found).__name__}")
    return found


class Sb3Agent(Agent):
    """Acts by a ``.zip`` of Stable-Baselines3 or sb3-contrib, deterministically, recurrent policies included.

    Args:
        path: The file.
        statistics: What ``VecNormalize.save`` wrote, by which observations were normalised in training; by
            default they are given as the environment gives them.

    Raises:
        PolicyError: If it is not such a file.
    """

    sees = "observation"

    def __init__(self, path: Path, statistics: Path | None = None) -> None:
        try:
            with zipfile.ZipFile(path) as archive:
                wanted = json.loads(archive.read("data"))["policy_class"]["__module__"]
        except (OSError, KeyError, TypeError, ValueError, zipfile.BadZipFile) as error:
            raise PolicyError(f"{path}: not a model saved by Stable-Baselines3: {error}") from None
        fitting = [
            one
            for one in algorithms().values()
            if wanted in {policy.__module__ for policy in one.policy_aliases.values()}
        ]
        if not fitting:
            raise PolicyError(f"{path}: no algorithm that is installed has policies of {wanted}")
        self._model = fitting[0].load(path, device="cpu")
        self._normaliser = None if statistics is None else _normaliser(statistics)
        self._path, self.name, self.title = path, path.stem, "policy saved by Stable-Baselines3"
        self._state: Any = None
        self._begun = np.zeros(0, dtype=np.bool_)

    def reset(self, seed: int) -> None:  # noqa: ARG002 - nothing is drawn
        """See ``Agent.reset``."""
        self._state, self._begun = None, np.zeros(0, dtype=np.bool_)

    def begin_episodes(self, begun: NDArray[np.bool_]) -> None:
        """See ``Agent.begin_episodes``."""
        self._begun = np.asarray(begun)

    def fits(self, observations: Space[Any], actions: Space[Any]) -> None:
        """See ``Agent.fits``."""
        for word, own, given in (
            ("observations", self._model.observation_space, observations),
            ("actions", self._model.action_space, actions),
        ):
            if own is None or own.shape != given.shape:
                raise PolicyError(f"{self._path}: made for {word} {own}, the environment has {given}")

    def act(self, observation: NDArray[Any], info: Mapping[str, Any]) -> NDArray[Any]:  # noqa: ARG002
        """The deterministic actions for a batch of observations."""
        if self._normaliser is not None:
            observation = self._normaliser.normalize_obs(observation)
        begun = self._begun if len(self._begun) == len(observation) else None
        actions, self._state = self._model.predict(
            observation, self._state, episode_start=begun, deterministic=True
        )
        self._begun = np.zeros(len(observation), dtype=np.bool_)
        return np.asarray(actions)
