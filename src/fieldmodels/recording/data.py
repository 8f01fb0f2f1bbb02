"""Measured data: named signals with units on a time grid, in episodes."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from fieldmodels.arrays import BoolArray, FloatArray, IntArray

MAX_JITTER = 0.01
"""Largest standard deviation of the time step, as a fraction of its median, that counts as even."""
GAP = 1.5
"""A time step of more than this many medians is a gap."""
SAME = 1e-6
"""Share of a step by which mean and median differ from rounding alone."""
STRETCHES = 30  # of an excerpt at most,
STRETCH = 2_000  # and rows in each at least, so that windows fit


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
        aligned: Whether command and response were moved against each other until they agree, so that no delay
            can be told.
        lost: Column name to which of its samples were lost, shape (n,): no fit and no error counts them, and
            what stands in their place lies between the others. A column that lost none is left out.
    """

    time: FloatArray
    signals: Mapping[str, FloatArray]
    units: Mapping[str, str] = field(default_factory=dict)
    episode: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    source: str = "memory"
    known: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    aligned: bool = False
    lost: Mapping[str, BoolArray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Give a recording without episodes a single one; check that all columns have one length.

        Raises:
            RecordingError: If a column's length differs from that of the time column.
        """
        if len(self.episode) == 0:
            object.__setattr__(self, "episode", np.zeros(len(self.time), dtype=np.int64))
        columns = [*self.signals.items(), *self.lost.items(), ("episode", self.episode)]
        for name, values in columns:
            if len(values) != len(self.time):
                raise RecordingError(
                    f"{self.source}: column {name!r} has {len(values)} rows, 't' has {len(self.time)}"
                )

    def __repr__(self) -> str:
        """Where it is from, how much it is and what it holds, in a line."""
        episodes = len(self.bounds)
        several = f" in {episodes} episodes" if episodes > 1 else ""
        signals = ", ".join(f"{n} [{self.units[n]}]" if n in self.units else n for n in self.signals)
        return f"<Recording of {self.source}: {len(self):,} rows of {self.step:.4g} s{several}; {signals}>"

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
        """Sampling interval [s]: the mean time step within episodes, of uneven ones the median.

        Stamps of few digits show steps of two lengths, of which the median is one. A million steps count of a
        long record.
        """
        rows = np.arange(0, len(self) - 1, 1 + len(self) // 1_000_000)
        rows = rows[self.episode[rows + 1] == self.episode[rows]]
        if not len(rows):
            return float("nan")
        steps = self.time[rows + 1] - self.time[rows]
        median = float(np.median(steps))
        if np.any((steps <= 0.0) | (steps > GAP * median)) or steps.std() > MAX_JITTER * median:
            return median
        mean = float(steps.mean())
        return mean if abs(mean - median) > SAME * median else median

    @cached_property
    def bounds(self) -> IntArray:
        """First sample and end (exclusive) of every episode, shape (episodes, 2)."""
        changes = np.flatnonzero(self.episode[1:] != self.episode[:-1]) + 1
        edges = np.concatenate([[0], changes, [len(self)]])
        return np.column_stack([edges[:-1], edges[1:]]).astype(np.int64)

    def rows(self, which: slice | IntArray) -> Recording:
        """Some of its rows."""
        return replace(
            self,
            time=self.time[which],
            signals={name: values[which] for name, values in self.signals.items()},
            episode=self.episode[which],
            lost={name: gone[which] for name, gone in self.lost.items()},
        )

    def excerpt(self, rows: int) -> Recording:
        """Stretches spread evenly over a long recording, as episodes of their own; a short one as it is.

        Args:
            rows: About so many rows.
        """
        if len(self) <= rows:
            return self
        length = min(max(rows // STRETCHES, STRETCH), rows)
        begins = np.linspace(0, len(self) - length, max(rows // length, 1)).astype(np.int64)
        episode = self.bounds[np.searchsorted(self.bounds[:, 0], begins, side="right") - 1]
        begins = np.maximum(np.minimum(begins, episode[:, 1] - length), episode[:, 0])  # whole, if that is
        ends = np.minimum(begins + length, episode[:, 1])
        begins[1:] = np.maximum(begins[1:], ends[:-1])  # long enough, and no row is there twice
        kept = np.concatenate([np.arange(a, b) for a, b in zip(begins, ends, strict=True)])
        number = np.repeat(np.arange(len(begins)), ends - begins)
        return replace(self.rows(kept), episode=number)


def once(said: Iterable[str]) -> tuple[str, ...]:
    """Notes that begin with their file: those that differ in it and in numbers alone are one.

    A note that names rows stays by itself.
    """
    groups: dict[str, dict[str, str]] = {}
    for text in said:
        source, _, what = text.partition(": ")
        kind = text if re.search(r"rows? \d", what) else re.sub(r"\d[\d.]*(e[-+]?\d+)?", "#", what)
        groups.setdefault(kind, {}).setdefault(source, text)
    result = []
    for group in groups.values():
        (first, *others), [text, *_] = group, group.values()
        more = f" and {len(others)} more file{'s' * (len(others) > 1)}" if others else ""
        result.append(first + more + text.removeprefix(first))
    return tuple(result)


def check_recordings(given: Iterable[Any], name: str) -> None:
    """See that an argument is a list of recordings.

    Raises:
        RecordingError: For one recording alone, or one that is not loaded.
    """
    if isinstance(given, Recording):
        raise RecordingError(f"{name} is one recording; give a list of them: [recording]")
    for one in [given] if isinstance(given, str) else given:
        if not isinstance(one, Recording):
            raise RecordingError(
                f"{name} holds {one!r}, a {type(one).__name__} and no recording; load it: "
                "fieldmodels.recording.files.load_recording(path, model)"
            )


def check_apart(train: Iterable[Recording], test: Iterable[Recording]) -> None:
    """See that no recording is given twice: noise that repeats looks like something that is missing.

    Raises:
        RecordingError: For two that hold the same signals; it says whether one of them is to test.
    """
    seen: dict[str, tuple[str, str]] = {}
    for use, given in (("to fit", train), ("to test", test)):
        for one in given:
            digest = hashlib.blake2b()
            for name in sorted(one.signals):
                digest.update(name.encode() + np.ascontiguousarray(one[name]).tobytes())
            if digest.hexdigest() in seen:
                source, before = seen[digest.hexdigest()]
                raise RecordingError(
                    f"{source} ({before}) and {one.source} ({use}) hold the same signals: noise that repeats "
                    "looks like something that is missing, and a gain must be measured on data that were not "
                    "fitted; give each record once (without any to test a part is held out)"
                )
            seen[digest.hexdigest()] = one.source, use
