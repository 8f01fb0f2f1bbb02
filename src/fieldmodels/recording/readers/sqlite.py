"""SQLite: bags of ROS 2 (see ``ros``), and the columns of anybody's tables."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

from fieldmodels.recording.readers import ros
from fieldmodels.recording.readers.nested import flattened
from fieldmodels.recording.tables import SeriesTable, check_size, readable


def read(path: Path) -> SeriesTable:
    """Read all tables; a column is ``table.column``, of a single table ``column``."""
    address = f"{path.resolve().as_uri()}?mode=ro"
    with readable(path, "SQLite file"), closing(sqlite3.connect(address, uri=True)) as base:
        tables = [name for (name,) in base.execute("select name from sqlite_master where type = 'table'")]
        if not {"topics", "messages"} <= set(tables):
            found = {name: _columns(path, base, name) for name in tables if not name.startswith("sqlite_")}
            return SeriesTable(path, flattened(found if len(found) > 1 else next(iter(found.values()), {})))
    return ros.read(path)


def _columns(path: Path, base: sqlite3.Connection, table: str) -> dict[str, list[Any]]:
    quoted = table.replace('"', '""')
    cursor = base.execute(f'select * from "{quoted}"')
    names = [one[0] for one in cursor.description]
    ((rows,),) = base.execute(f'select count(*) from "{quoted}"')
    check_size(path, 10 * rows, len(names))  # Python's numbers take ten times as many bytes
    columns = dict(zip(names, map(list, zip(*cursor, strict=True)), strict=bool(rows)))
    return {name: values for name, values in columns.items() if not any(isinstance(v, bytes) for v in values)}
