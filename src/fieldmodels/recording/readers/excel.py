"""Excel and OpenDocument workbooks (.xlsx, .xlsb, .xls, .ods), by python-calamine."""

from __future__ import annotations

import datetime
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fieldmodels.recording.converters import TOOLS
from fieldmodels.recording.data import RecordingError
from fieldmodels.recording.tables import SHOWN, Series, SeriesTable, readable
from fieldmodels.recording.words import names_and_units

_LARGEST = 1 << 30  # bytes of unpacked XML


def read(path: Path) -> SeriesTable:
    """Read the sheet with most rows."""
    from python_calamine import CalamineWorkbook

    if zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:
            size, inside = sum(part.file_size for part in archive.infolist()), archive.namelist()
        if not {"[Content_Types].xml", "mimetype"} & {*inside}:
            what = f"an archive: unpack it, and give its files: {', '.join(inside[:SHOWN])}"
            raise RecordingError(f"{path}: {TOOLS.get(path.suffix.lower(), what).format(name=path.name)}")
        if size > _LARGEST:
            raise RecordingError(f"{path}: unpacks to {1e-9 * size:.1f} GB; save the sheet as CSV")
    with readable(path, "workbook: open it in what can, and save it as .xlsx or CSV"):
        book = CalamineWorkbook.from_path(str(path))
        sheets = [book.get_sheet_by_name(name).to_python() for name in book.sheet_names]
    return SeriesTable(path, _columns(path, max(sheets, key=len, default=[])))


def _columns(path: Path, rows: Sequence[Sequence[Any]]) -> dict[str, Series]:
    """The table in a sheet: rows of numbers, the names above them, perhaps units below the names."""
    wide = max((sum(_is_value(c) for c in row) for row in rows[:1000]), default=0)
    first = next((k for k, row in enumerate(rows) if wide and sum(map(_is_value, row)) > 0.5 * wide), None)
    if first is None:
        raise RecordingError(f"{path}: no sheet holds a table of numbers")
    above = [[str(c).strip() for c in row] for row in rows[:first] if any(str(c).strip() for c in row)]
    wide = max(len(row) for row in rows[first : first + 100])
    names, units = names_and_units([(row + [""] * wide)[:wide] for row in above[-3:]], wide)
    result: dict[str, Series] = {}
    for j in range(wide):
        values = [_value(row[j]) if j < len(row) else None for row in rows[first:]]
        if all(v is None for v in values):
            continue
        name = names[j] or f"column {j + 1}"
        timed = isinstance(next(v for v in values if v is not None), np.datetime64)
        numbers = np.array([np.datetime64("NaT") if v is None else v for v in values]) if timed else values
        result[name] = Series.of(numbers, "s" if timed else units[j])
    return result


def _is_value(cell: Any) -> bool:
    return isinstance(cell, (int, float, datetime.date, datetime.time, datetime.timedelta))


def _value(cell: Any) -> Any:
    """A number, a time as numpy has it, text as it is, None for an empty cell."""
    if isinstance(cell, datetime.time):
        cell = datetime.datetime.combine(datetime.date(1970, 1, 1), cell)
    if isinstance(cell, datetime.date):
        return np.datetime64(cell, "ns")
    if isinstance(cell, datetime.timedelta):
        return cell.total_seconds()
    return None if cell == "" else cell
