"""Runs of one file (segments, rollouts, tests) one after the other, numbered by a column ``episode``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.recording.bench import EPISODE
from fieldmodels.recording.data import RecordingError
from fieldmodels.recording.tables import Series

_LARGEST = 1 << 28  # bytes of text: Python's objects take ten times as many


def joined(
    runs: Sequence[Mapping[str, FloatArray]],
    units: Mapping[str, str] | None = None,
    clocks: Mapping[str, str] | None = None,
) -> dict[str, Series]:
    """Columns that all runs hold, and of several runs their numbers from 1.

    Args:
        runs: Of each run its columns by name, shape (n,) for all of one clock.
        units: Column to unit, where one is stated.
        clocks: Column to clock where there are several; the runs are numbered by the first one.
    """
    units, clocks = units or {}, clocks or {}
    names = [name for name in runs[0] if all(name in run for run in runs)]
    result = {
        name: Series.of(
            np.concatenate([run[name] for run in runs]), units.get(name, ""), clocks.get(name, "")
        )
        for name in names
    }
    if len(runs) > 1 and EPISODE not in result:
        first = next((name for name in names if clocks.get(name, name) == name), names[0]) if names else ""
        numbers = [np.full(len(run[first]), float(k)) for k, run in enumerate(runs, 1)] if names else []
        result |= {EPISODE: Series.of(np.concatenate(numbers), "", clocks.get(first, ""))} if names else {}
    return result


def check_text(path: Path, kind: str) -> None:
    """Refuse a text that must be read as a whole and would not fit into memory.

    Raises:
        RecordingError: If it is too large.
    """
    if path.stat().st_size > _LARGEST:
        raise RecordingError(f"{path}: {kind} of more than {_LARGEST >> 20} MB; save it as CSV or Parquet")
