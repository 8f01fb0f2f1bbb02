"""Checkpoints of a training run: all that the next update depends on, in one file, loaded without pickle.

A checkpoint is taken between two updates and restores the policy, the optimiser, the normaliser, the
environments, every random stream and the counters, so that a resumed run continues bit for bit. It is read
by torch's ``weights_only`` loader, which builds tensors and plain containers and runs no code of the file.
"""

from __future__ import annotations

import io
import random
import sys
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch

from fieldmodels.files import write_bytes

SCHEMA = 3
NPY = "npy"


class CheckpointError(ValueError):
    """A checkpoint that cannot be read."""


def save_checkpoint(state: dict[str, Any], path: Path) -> None:
    """Write a checkpoint; it appears whole or not at all."""
    whole = {"schema": SCHEMA, **{key: to_plain(value) for key, value in state.items()}}
    stream = io.BytesIO()  # torch's own writer hides the errors of a full disk
    torch.save(whole, stream)
    write_bytes(path, stream.getbuffer())


def checkpoints(folder: Path) -> list[Path]:
    """The checkpoints of a folder, oldest first; what is being written, or was never finished, is none."""
    return sorted(folder.glob("[0-9]*.pt"))


def latest_checkpoint(folder: Path, unreadable: Callable[[str], None]) -> dict[str, Any] | None:
    """The newest checkpoint that can be read; None if the folder has none.

    Args:
        folder: Of the checkpoints.
        unreadable: Told of each newer one that cannot be read.

    Raises:
        CheckpointError: If there are some, but none can be read.
    """
    found = checkpoints(folder)
    for path in reversed(found):
        try:
            return load_checkpoint(path)
        except CheckpointError as error:
            if path == found[0]:
                raise
            unreadable(f"{error}; going on from the one before")
    return None


def load_checkpoint(path: Path) -> dict[str, Any]:
    """Read a checkpoint: tensors and plain containers.

    Raises:
        CheckpointError: If the file is damaged or of another schema.
    """
    try:
        state = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:
        raise CheckpointError(f"{path}: not a checkpoint that can be read: {error}") from None
    if not isinstance(state, dict) or state.get("schema") != SCHEMA:
        raise CheckpointError(f"{path}: not a checkpoint of schema {SCHEMA}; train anew without --resume")
    return state


def to_plain(value: Any) -> Any:
    """Turn nested arrays and NumPy scalars into tensors and Python numbers.

    A structured array, for which torch has no type, becomes the bytes of an ``.npy`` file. Equal texts become
    one object: a file refers to what it has written before, and a resumed run's is equal to the last byte.
    """
    if isinstance(value, str):
        return sys.intern(value)
    if isinstance(value, dict):
        return {to_plain(key): to_plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | deque):
        return [to_plain(item) for item in value]
    if isinstance(value, np.ndarray):
        if value.dtype.names:
            stream = io.BytesIO()
            np.save(stream, value, allow_pickle=False)
            return {NPY: torch.frombuffer(stream.getbuffer(), dtype=torch.uint8).clone()}
        return torch.from_numpy(value.copy())
    return value.item() if isinstance(value, np.generic) else value


def to_arrays(value: Any) -> Any:
    """Turn what `to_plain` gave back into arrays."""
    if isinstance(value, dict):
        if value.keys() == {NPY}:
            return np.load(io.BytesIO(value[NPY].numpy().tobytes()), allow_pickle=False)
        return {key: to_arrays(item) for key, item in value.items()}
    if isinstance(value, list):
        return [to_arrays(item) for item in value]
    return value.numpy() if isinstance(value, torch.Tensor) else value


def random_state() -> dict[str, Any]:
    """The state of the global random streams: torch draws the actions, libraries may use the others."""
    version, numbers, gauss = random.getstate()
    return {
        "torch": torch.get_rng_state(),
        "numpy": to_plain(np.random.get_state(legacy=False)),  # noqa: NPY002 - saved, not drawn from
        "python": [version, list(numbers), gauss],
    }


def restore_random_state(state: dict[str, Any]) -> None:
    """Set the global random streams to a state that `random_state` gave."""
    torch.set_rng_state(state["torch"])
    np.random.set_state(to_arrays(state["numpy"]))  # noqa: NPY002 - restored, not drawn from
    version, numbers, gauss = state["python"]
    random.setstate((version, tuple(numbers), gauss))
