"""A learned policy as an agent, run by onnxruntime alone: no torch, no pickle."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import Space
from numpy.typing import NDArray

from fieldagents.agent import Agent, AgentError, checked_actions
from fieldagents.policies.conditioned import Condition, said, turned
from fieldmodels.extras import needed

DIAGNOSIS, CONDITIONS = "diagnosis", "told"
"""The input of what a policy is told of its machine, and the metadata that say of which parameters."""
FORMS = (
    (["observation"], ["action"]),
    (["observation", "memory"], ["action", "next_memory"]),
)
"""Inputs and outputs of a policy file; the input ``diagnosis`` may follow the first."""


class PolicyError(ValueError):
    """A policy file that cannot be run, or does not fit its environment."""


class OnnxAgent(Agent):
    """Acts by an ONNX policy, which holds its own observation normaliser and action limits.

    Attributes:
        shape: Shape of one observation.
        conditions: The parameters of its machine that it is told of, see ``condition``.
        diagnosis: What it is told, shape (2 parameters,) or (environments, 2 parameters); nothing at first.

    Args:
        policy: The ONNX file or its bytes: input ``observation`` (batch, ...) float32, output ``action``
            (batch, ...). One with a memory also has ``memory`` (batch, n) float32 among its inputs and
            ``next_memory`` among its outputs; it is zero when an episode begins. One that is told of its
            machine has ``diagnosis`` (batch, n) after the first input.
        name: The agent's name in tables; the file's stem unless given.
        title: One line that says what it is.

    Raises:
        PolicyError: If the file is missing or is no such policy.
    """

    diagnosis: NDArray[np.float32]

    def __init__(
        self, policy: Path | str | bytes, name: str | None = None, title: str = "learned policy"
    ) -> None:
        path = Path(name or "policy") if isinstance(policy, bytes) else Path(policy)
        if not isinstance(policy, bytes):
            if not path.is_file():
                raise PolicyError(f"{path}: no such policy file")
            policy = path.read_bytes()
        onnxruntime = needed("onnxruntime")
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 3
        try:
            self._session = onnxruntime.InferenceSession(policy, options, providers=["CPUExecutionProvider"])
        except Exception as error:
            raise PolicyError(f"{path}: not an ONNX policy: {error}") from None
        given = {entry.name: tuple(entry.shape[1:]) for entry in self._session.get_inputs()}
        outputs = [entry.name for entry in self._session.get_outputs()]
        if ([name for name in given if name != DIAGNOSIS], outputs) not in FORMS:
            raise PolicyError(
                f"{path}: a policy maps 'observation' to 'action' (one with a memory also 'memory' to"
                f" 'next_memory'), this file maps {list(given)} to {outputs}"
            )
        self.shape = given["observation"]
        metadata = self._session.get_modelmeta().custom_metadata_map
        conditions = json.loads(metadata[CONDITIONS]) if DIAGNOSIS in given else ()
        self.conditions = tuple(Condition(**one) for one in conditions)
        self.condition({})
        self._memories: tuple[int, ...] | None = given.get("memory")
        self._memory = np.zeros((0, 0), dtype=np.float32)
        self._source, self.name, self.title = path, name or path.stem, title

    def condition(self, found: Mapping[str, Mapping[str, Any]]) -> None:
        """Tell it what a diagnosis has found; see `fieldagents.policies.conditioned.said`."""
        if self.conditions:
            self.sees, self.diagnosis = "diagnosis", said(self.conditions, found)

    tell = condition  # its name in 0.1

    def reset(self, seed: int) -> None:  # noqa: ARG002 - nothing is drawn
        """See ``Agent.reset``."""
        self._memory = np.zeros((0, 0), dtype=np.float32)

    def begin_episodes(self, begun: NDArray[np.bool_]) -> None:
        """See ``Agent.begin_episodes``."""
        if len(self._memory) == len(begun):
            self._memory[begun] = 0.0

    def fits(self, observations: Space[Any], actions: Space[Any]) -> None:
        """See ``Agent.fits``."""
        self._check(observations.shape)
        action = self.act(np.zeros((2, *self.shape)), {one.turned_by: np.zeros(2) for one in self.conditions})
        self.reset(0)
        try:
            checked_actions(action, self.name, 2, actions)
        except AgentError as error:
            raise PolicyError(f"{self._source}: {error}") from None

    def act(self, observation: NDArray[Any], info: Mapping[str, Any]) -> NDArray[Any]:
        """The deterministic actions for a batch of observations; ``info`` turns what it is told."""
        observation = np.ascontiguousarray(observation, dtype=np.float32)
        self._check(observation.shape[1:])
        given = {"observation": observation}
        if self.conditions:
            rows = np.broadcast_to(self.diagnosis, (len(observation), 2 * len(self.conditions)))
            given[DIAGNOSIS] = turned(self.conditions, rows, info)
        if self._memories is None:
            return self._run(given)[0]
        if len(self._memory) != len(observation):
            self._memory = np.zeros((len(observation), *self._memories), dtype=np.float32)
        actions, memory = self._run({**given, "memory": self._memory})
        if memory.shape != self._memory.shape:
            raise PolicyError(
                f"{self._source}: next_memory has shape {memory.shape}, not {self._memory.shape}"
            )
        self._memory = memory.astype(np.float32)
        return actions

    def _check(self, shape: tuple[int, ...] | None) -> None:
        if shape != self.shape:
            raise PolicyError(
                f"{self._source}: made for observations of shape {self.shape}, the environment gives {shape}"
            )

    def _run(self, given: Mapping[str, NDArray[Any]]) -> list[NDArray[Any]]:
        try:
            return [np.asarray(one) for one in self._session.run(None, given)]
        except Exception as error:  # of onnxruntime, whose errors have no common base
            raise PolicyError(f"{self._source}: cannot be run: {error}") from None
