"""Text with one value a row beside the name of its signal (Foxglove, Tinkerforge): a column for each."""

from __future__ import annotations

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.recording.data import RecordingError
from fieldmodels.recording.tables import Series, SeriesTable, Table
from fieldmodels.recording.text import TextTable
from fieldmodels.recording.units import is_unit
from fieldmodels.recording.words import is_time

MOST = 64
"""Signals in one file; more words are no names."""
ROWS = 1000
"""Rows that tell which columns change at all."""


def a_column_each(table: TextTable) -> Table:
    """A table with a column for each signal; the same one if its rows do not hold one value each.

    Times rise within each signal and not from row to row: they repeat or fall only where the signal changes.

    Args:
        table: A log.
    """
    words = [name for name in table.header if name not in table.numbers()]
    if not words or not table.numbers() or table.clocks:
        return table
    try:
        numbers = {n: _tolerant(table, n, ROWS)[:ROWS] for n in table.numbers()}
        there = [n for n, values in numbers.items() if len({*values[np.isfinite(values)]}) > 1]
        times = [name for name in there if is_time(name, table.units.get(name, ""))]
        values = [name for name in there if name not in times]
        if not times or len(values) != 1:
            return table
        time = table[times[0]]
        back = np.diff(time) <= 0.0
        if not back.any():
            return table
        value = _tolerant(table, values[0])
    except RecordingError:  # said when they are used
        return table
    texts = table.texts(words)
    units = next((t for name, t in texts.items() if all(map(is_unit, set(t)))), [""] * len(time))
    for column in reversed(list(texts.values())):
        names, which = np.unique(column, return_inverse=True)
        rows = [np.flatnonzero(which == k) for k in range(len(names))] if len(names) <= MOST else []
        apart = not (back & (np.diff(which) == 0)).any() and all((np.diff(time[r]) > 0.0).all() for r in rows)
        if column is units or len(rows) < 2 or not apart:
            continue
        same = all(np.array_equal(time[r], time[rows[0]]) for r in rows)
        series: dict[str, Series] = {}
        for name, own in zip(map(str, names), rows, strict=True):
            if not np.isfinite(value[own]).any():
                continue
            clock = times[0] if same else f"{name} {times[0]}"
            series[clock] = Series.of(time[own], table.units.get(times[0], ""), "" if same else clock)
            series[name] = Series.of(value[own], units[own[0]], "" if same else clock)
        return SeriesTable(table.path, series)
    return table


def _tolerant(table: TextTable, name: str, rows: int | None = None) -> FloatArray:
    """A column of numbers; one that also holds words has none in their place."""
    try:
        return table.read([name], rows)[name]
    except RecordingError:
        import pandas as pd

        return np.asarray(pd.to_numeric(pd.Series(table.texts([name])[name]), errors="coerce"))
