"""Measured data, and the windows that they are cut into."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from fieldmodels.model import FloatArray, Model

BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]


class RecordingError(ValueError):
    """Measured data that cannot be used as they are; the message names the place and the remedy."""


class RecordingWarning(UserWarning):
    """Measured data that can be used, but that look as if something about them were mistaken."""


@dataclass(frozen=True)
class Recording:
    """Measured signals on a uniform time grid, in one or more episodes.

    Attributes:
        time: Sample times [s], shape (n,); increasing within an episode.
        signals: Column name to values, each of shape (n,), in SI units.
        units: Column name to unit.
        episode: Episode number of each sample, shape (n,); episodes are contiguous.
        source: Where the data come from (a path, "simulation of rig"), for messages and reports.
        known: Values of a model's base parameters that are known of this machine (a wheel's radius).
        notes: What is odd about the data, or was done to them on reading.
    """

    time: FloatArray
    signals: Mapping[str, FloatArray]
    units: Mapping[str, str] = field(default_factory=dict)
    episode: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    source: str = "memory"
    known: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Give a recording without episodes a single one; check that all columns have one length.

        Raises:
            RecordingError: If a column's length differs from that of the time column.
        """
        if len(self.episode) == 0:
            object.__setattr__(self, "episode", np.zeros(len(self.time), dtype=np.int64))
        for name, values in {**self.signals, "episode": self.episode}.items():
            if len(values) != len(self.time):
                raise RecordingError(
                    f"{self.source}: column {name!r} has {len(values)} rows, 't' has {len(self.time)}"
                )

    def __getitem__(self, name: str) -> FloatArray:
        """Values of one signal, shape (n,)."""
        return self.signals[name]

    def __contains__(self, name: object) -> bool:
        """Whether the recording has this signal."""
        return name in self.signals

    def __len__(self) -> int:
        """Number of samples."""
        return len(self.time)

    @cached_property
    def step(self) -> float:
        """Sampling interval [s]: the median time step within episodes (of a long record, of a million)."""
        rows = np.arange(0, len(self) - 1, 1 + len(self) // 1_000_000)
        rows = rows[self.episode[rows + 1] == self.episode[rows]]
        return float(np.median(self.time[rows + 1] - self.time[rows])) if len(rows) else float("nan")

    @cached_property
    def bounds(self) -> IntArray:
        """First sample and end (exclusive) of every episode, shape (episodes, 2)."""
        changes = np.flatnonzero(self.episode[1:] != self.episode[:-1]) + 1
        edges = np.concatenate([[0], changes, [len(self)]])
        return np.column_stack([edges[:-1], edges[1:]]).astype(np.int64)


@dataclass(frozen=True)
class Windows:
    """Stretches of one recording, each predicted from its own initial state.

    Attributes:
        recording: The measured data; commands before a window act through it too (delay, lag).
        starts: First sample of each window, shape (windows,).
        lengths: Number of samples of each window, shape (windows,).
        states: Initial states, shape (windows, states).
        observed: Which measured samples count, shape (windows, samples, outputs); False beyond a
            window's length and for outputs that the recording lacks.
        disturbance: Additive generalised force on every sample of the recording, shape (n,), in the
            model's ``disturbance_unit``; None for none.
    """

    recording: Recording
    starts: IntArray
    lengths: IntArray
    states: FloatArray
    observed: BoolArray
    disturbance: FloatArray | None = None

    def __len__(self) -> int:
        """Number of windows."""
        return len(self.starts)

    @property
    def samples(self) -> int:
        """Samples that arrays over windows have room for: no window is longer."""
        return int(self.observed.shape[1])

    def select(self, which: BoolArray | IntArray) -> Windows:
        """Keep some of the windows."""
        return replace(
            self,
            starts=self.starts[which],
            lengths=self.lengths[which],
            states=self.states[which],
            observed=self.observed[which],
        )

    def with_states(self, states: FloatArray) -> Windows:
        """Start the same windows from other states."""
        return replace(self, states=states)

    def with_disturbance(self, disturbance: FloatArray | None) -> Windows:
        """Add a generalised force along the whole recording."""
        return replace(self, disturbance=disturbance)

    def measured(self, outputs: tuple[str, ...]) -> FloatArray:
        """Measured outputs of every window; NaN where not observed, shape (windows, samples, outputs)."""
        rows = self.starts[:, None] + np.arange(self.samples)[None, :]
        rows = np.minimum(rows, len(self.recording) - 1)
        result = np.full((len(self), self.samples, len(outputs)), np.nan)
        for j, name in enumerate(outputs):
            if name in self.recording:
                result[:, :, j] = self.recording[name][rows]
        result[~self.observed] = np.nan
        return result


def uniform_windows(model: Model, recording: Recording, horizon: float) -> Windows:
    """Cut every episode into non-overlapping windows of one length.

    Args:
        model: Gives the outputs and the initial states.
        recording: The measured data.
        horizon: Length of a window [s].

    Raises:
        RecordingError: If no episode is as long as the horizon.
    """
    length = round(horizon / recording.step) + 1
    starts = np.concatenate([np.arange(a, b - length + 1, length) for a, b in recording.bounds])
    if length < 4 or len(starts) == 0:
        raise RecordingError(
            f"{recording.source}: too short or too coarse for windows of {horizon:g} s "
            f"({len(recording)} samples, {recording.step:g} s apart); record longer or sample faster"
        )
    starts = starts.astype(np.int64)
    observed = np.zeros((len(starts), length, len(model.outputs)), dtype=np.bool_)
    for j, output in enumerate(model.outputs):
        observed[:, :, j] = output.name in recording
    return Windows(
        recording=recording,
        starts=starts,
        lengths=np.full(len(starts), length, dtype=np.int64),
        states=model.initial_states(recording, starts),
        observed=observed,
    )
