"""Columns out of nested data (structures, dictionaries, arrays of several columns), named by their path."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from fieldmodels.recording.tables import Series
from fieldmodels.recording.words import unit_of

WIDEST = 64
"""More columns than these in one array are no signals."""
_TIMES = ("t", "time", "timestamp", "stamp", "zeit", "temps", "tiempo", "tempo", "timestamps")


def flattened(data: Any) -> dict[str, Series]:
    """Columns of all arrays of at least two numbers, each with its clock.

    Columns of one length share a clock. Where lengths differ, or several structures have times, an array's
    clock is the time beside it in its structure, else the only time of its length.
    """
    found = {name: values for name, values in arrays(data) if len(values) > 1}
    lengths = {len(v) for v in found.values()}
    timed = {name.rpartition(".")[0] for name in found if is_time(name)}
    several = max(len(lengths), len(timed)) > 1
    return {
        name: Series.of(values, unit_of(name), _clock(name, found) if several else "")
        for name, values in found.items()
    }


def is_time(name: str) -> bool:
    """Whether an array holds times by its name."""
    return name.rpartition(".")[2].lower() in _TIMES


def arrays(data: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """All arrays of one column with their paths."""
    if isinstance(data, Mapping):
        for key, value in data.items():
            yield from arrays(value, f"{name}.{key}" if name else str(key))
    elif isinstance(data, np.ndarray) and data.dtype.names:
        for key in data.dtype.names:
            yield from arrays(data[key], f"{name}.{key}" if name else key)
    elif isinstance(data, list) and data and not isinstance(data[0], list):
        yield name, np.array([np.nan if v is None else v for v in data])
    elif isinstance(data, (np.ndarray, list)):
        values = np.squeeze(np.asarray(data))
        if values.dtype.kind not in "biufMUS" or not 1 <= values.ndim <= 2:
            return
        if values.ndim == 1:
            yield name or "column 1", values
            return
        columns = values if values.shape[0] >= values.shape[1] else values.T
        for j in range(min(columns.shape[1], WIDEST)):
            yield f"{name}[{j + 1}]" if name else f"column {j + 1}", columns[:, j]


def _clock(name: str, found: Mapping[str, Any]) -> str:
    """The column with the times of another one; a clock has itself."""
    times = [n for n in found if is_time(n) and len(found[n]) == len(found[name])]
    group = name.rpartition(".")[0]
    beside = [n for n in times if n.rpartition(".")[0] == group]
    return next(iter(beside), times[0] if len(times) == 1 else "")
