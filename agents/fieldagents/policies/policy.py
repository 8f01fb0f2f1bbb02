"""A learned policy as an agent, run by onnxruntime alone: no torch, no pickle."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
from gymnasium import Space
from numpy.typing import NDArray

from fieldagents.agent import Agent

FORMS = (
    (["observation"], ["action"]),
    (["observation", "memory"], ["action", "next_memory"]),
)
"""Inputs and outputs of a policy file."""


class PolicyError(ValueError):
    """A policy file that cannot be run, or does not fit its environment."""


class OnnxAgent(Agent):
    """Acts by an ONNX policy, which holds its own observation normaliser and action limits.

    Attributes:
        shape: Shape of one observation.

    Args:
        policy: The ONNX file or its bytes: input ``observation`` (batch, ...) float32, output ``action``
            (batch, ...). One with a memory also has ``memory`` (batch, n) float32 among its inputs and
            ``next_memory`` among its outputs; it is zero when an episode begins.
        name: The agent's name in tables; the file's stem unless given.
        title: One line that says what it is.

    Raises:
        PolicyError: If the file is missing or is no such policy.
    """

    sees = "observation"

    def __init__(
        self, policy: Path | str | bytes, name: str | None = None, title: str = "learned policy"
    ) -> None:
        path = Path(name or "policy") if isinstance(policy, bytes) else Path(policy)
        if not isinstance(policy, bytes):
            if not path.is_file():
                raise PolicyError(f"{path}: no such policy file")
            policy = path.read_bytes()
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 3
        try:
            self._session = onnxruntime.InferenceSession(policy, options, providers=["CPUExecutionProvider"])
        except Exception as error:
            raise PolicyError(f"{path}: not an ONNX policy: {error}") from None
        given = {entry.name: tuple(entry.shape[1:]) for entry in self._session.get_inputs()}
        outputs = [entry.name for entry in self._session.get_outputs()]
        if (list(given), outputs) not in FORMS:
            raise PolicyError(
                f"{path}: a policy maps 'observation' to 'action' (one with a memory also 'memory' to"
                f" 'next_memory'), this file maps {list(given)} to {outputs}"
            )
        self.shape = given["observation"]
        self._memories: tuple[int, ...] | None = given.get("memory")
        self._memory = np.zeros((0, 0), dtype=np.float32)
        self._source, self.name, self.title = path, name or path.stem, title

    def reset(self, seed: int) -> None:  # noqa: ARG002 - nothing is drawn
        """See ``Agent.reset``."""
        self._memory = np.zeros((0, 0), dtype=np.float32)

    def begin_episodes(self, begun: NDArray[np.bool_]) -> None:
        """See ``Agent.begin_episodes``."""
        if len(self._memory) == len(begun):
            self._memory[begun] = 0.0

    def fits(self, observations: Space[Any], actions: Space[Any]) -> None:
        """See ``Agent.fits``."""
        if observations.shape != self.shape:
            raise PolicyError(
                f"{self._source}: made for observations of shape {self.shape},"
                f" the environment gives {observations.shape}"
            )
        action = self.act(np.zeros((2, *self.shape)), {})
        self.reset(0)
        if action.shape != (2, *(actions.shape or ())):
            raise PolicyError(
                f"{self._source}: gives actions of shape {action.shape[1:]},"
                f" the environment takes {actions.shape}"
            )

    def act(self, observation: NDArray[Any], info: Mapping[str, Any]) -> NDArray[Any]:  # noqa: ARG002
        """The deterministic actions for a batch of observations."""
        observation = np.ascontiguousarray(observation, dtype=np.float32)
        if observation.shape[1:] != self.shape:
            raise PolicyError(
                f"{self._source}: made for observations of shape {self.shape},"
                f" the environment gives {observation.shape[1:]}"
            )
        if self._memories is None:
            (actions,) = self._session.run(["action"], {"observation": observation})
            return np.asarray(actions)
        if len(self._memory) != len(observation):
            self._memory = np.zeros((len(observation), *self._memories), dtype=np.float32)
        given = {"observation": observation, "memory": self._memory}
        actions, memory = self._session.run(["action", "next_memory"], given)
        self._memory = np.array(memory)
        return np.asarray(actions)
