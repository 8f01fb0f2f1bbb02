"""Measured data: named signals with units on a time grid, in episodes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from fieldmodels.arrays import FloatArray, IntArray


class RecordingError(ValueError):
    """Measured data that cannot be used as they are; the message gives the place and the remedy."""


class RecordingWarning(UserWarning):
    """Measured data that can be used, but are suspected to contain a mistake."""


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
        notes: Peculiarities of the data, and changes made to them when they were read.
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
