"""A log as a user names it: a file, or several files of one run."""

from __future__ import annotations

from pathlib import Path

from fieldmodels.recording.data import RecordingError
from fieldmodels.recording.merging import JoinedTable
from fieldmodels.recording.proposals import clock_of
from fieldmodels.recording.reading import read_table
from fieldmodels.recording.tables import Table


def read_log(source: str | Path) -> Table:
    """Open a log; ``a.csv+b.parquet`` are files of one run, put on one clock.

    Raises:
        RecordingError: If a file cannot be read, or one of several has no column of times.
    """
    parts = str(source).split("+")
    if len(parts) == 1 or Path(source).exists():
        return read_table(source)
    tables = [read_table(part) for part in parts]
    clocks = []
    for table in tables:
        clock = clock_of(table)
        if clock is None:
            raise RecordingError(f"{table.path}: no single column holds its times")
        clocks.append(clock.channel)
    return JoinedTable(tables, clocks)
