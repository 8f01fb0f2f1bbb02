"""A learned policy as an agent, run by onnxruntime alone: no torch, no pickle."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
from numpy.typing import NDArray

from fieldagents.agent import Agent


class PolicyError(ValueError):
    """A policy file that cannot be run, or does not fit its environment."""


class OnnxAgent(Agent):
    """Acts by an ONNX policy, which holds its own observation normaliser and action limits.

    Attributes:
        shape: Shape of one observation.

    Args:
        policy: The ONNX file or its bytes: input ``observation`` (batch, ...) float32, output ``action``
            (batch, ...).
        name: The agent's name in tables; the file's stem unless given.
        title: One line that says what it is.

    Raises:
        PolicyError: If the file is missing or is no such policy.
    """

    sees = "observation"

    def __init__(
        self, policy: Path | str | bytes, name: str | None = None, title: str = "learned policy"
    ) -> None:
        path = Path("policy") if isinstance(policy, bytes) else Path(policy)
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
        inputs = [entry.name for entry in self._session.get_inputs()]
        outputs = [entry.name for entry in self._session.get_outputs()]
        if (inputs, outputs) != (["observation"], ["action"]):
            raise PolicyError(
                f"{path}: a policy maps 'observation' to 'action', this file maps {inputs} to {outputs}"
            )
        self.shape = tuple(self._session.get_inputs()[0].shape[1:])
        self._source, self.name, self.title = path, name or path.stem, title

    def act(self, observation: NDArray[Any], info: Mapping[str, Any]) -> NDArray[Any]:  # noqa: ARG002
        """The deterministic actions for a batch of observations."""
        observation = np.ascontiguousarray(observation, dtype=np.float32)
        if observation.shape[1:] != self.shape:
            raise PolicyError(
                f"{self._source}: made for observations of shape {self.shape},"
                f" the environment gives {observation.shape[1:]}"
            )
        actions: NDArray[Any] = self._session.run(["action"], {"observation": observation})[0]
        return actions
