"""A log as a user names it: a file, or several files of one run."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from fieldmodels.recording.data import RecordingError
from fieldmodels.recording.merging import JoinedTable
from fieldmodels.recording.proposals import clock_of
from fieldmodels.recording.reading import DATABASES, read_table
from fieldmodels.recording.tables import Table


def read_log(source: str | Path) -> Table:
    """Open a log; ``a.csv+b.parquet`` are files of one run, put on one clock; a DBC is of the CAN traces.

    Raises:
        RecordingError: If a file cannot be read, or one of several has no column of times.
    """
    parts = str(source).split("+")
    if len(parts) == 1 or Path(source).exists():
        return read_table(source)
    databases = [part for part in parts if part.lower().endswith(DATABASES)]
    tables = [read_table(part, databases) for part in parts if part not in databases]
    if len(tables) == 1:
        return tables[0]
    clocks = []
    for table in tables:
        clock = clock_of(table)
        if clock is None:
            what = "no single column holds its times; put one into it, or all signals into one file"
            raise RecordingError(f"{table.path}: {what}")
        clocks.append(clock.channel)
    return JoinedTable(tables, clocks)


def together(paths: Sequence[Path]) -> list[tuple[Path, ...]]:
    """Files that came at once as logs, each of one file or of several files of one run.

    Files with the same columns are runs of their own. Those with other columns are other loggers of the same
    runs if there are as many of each and they can be read on one clock; they are matched in their order. A
    single file without times (a CAN trace's DBC) goes with every run.

    Args:
        paths: In the user's order.
    """
    alone: list[tuple[Path, ...]] = [(path,) for path in paths]
    kinds: dict[tuple[str, ...], list[Path]] = {}
    timed = set()
    for path in paths if len(paths) > 1 else ():
        try:
            table: Table = read_table(path)
            kind = table.header
            timed |= {kind} if clock_of(table) or table.clocks else set()
        except RecordingError:
            kind = (path.suffix,)
        kinds.setdefault(kind, []).append(path)
    most = max(map(len, kinds.values()), default=0)
    beside = [files[0] for kind, files in kinds.items() if kind not in timed and len(files) == 1 < most]
    loggers = [files for files in kinds.values() if files[0] not in beside]
    if len(kinds) < 2 or any(len(files) < most for files in loggers):
        return alone
    runs = [(*run, *beside) for run in zip(*loggers, strict=True)]
    try:
        for run in runs:
            table = read_log("+".join(map(str, run)))
            if isinstance(table, JoinedTable):
                clock = next(iter(table.clocks.values()))
                for other in table.other_clocks(clock):
                    table.shift(clock, other)
    except RecordingError:  # each says why when it is opened by itself
        return alone
    return runs
