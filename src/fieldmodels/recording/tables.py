"""Numeric columns of CSV and Parquet files, streamed so that a file larger than memory can be read.

Only the required columns are kept, as float64; the rest of the file is never held in memory as a whole.
Row numbers in messages count from 1, with a CSV's header in row 1, as editors and spreadsheets show them.
"""

from __future__ import annotations

import csv
import difflib
import math
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq

from fieldmodels.arrays import FloatArray
from fieldmodels.files import replacing
from fieldmodels.recording import RecordingError

SHOWN = 5
"""Largest number of problems of one kind in a message."""

_DATE = re.compile(r"\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}([T ]|$)|\d{1,2}:\d{2}")
_BLOCK = 1 << 20  # bytes of text parsed at once
_BATCH = 1 << 17  # Parquet rows decoded at once
_ROWS = 1 << 27  # more than are ever expected: a damaged file may declare any number
_CONTENT = {
    b"PAR1": "a Parquet file: rename it to .parquet",
    b"PK\x03\x04": "a zip archive (or an Excel workbook): unpack it, or export the sheet as CSV",
    b"\x1f\x8b": "a gzip archive: unpack it first",
    b"\xd0\xcf\x11\xe0": "an old Excel workbook: export the sheet as CSV",
    b"\x89HDF": "an HDF5 file (or a MATLAB 7.3 one): export the signals as CSV or Parquet",
    b"MATLAB": "a MATLAB file: export the signals as CSV or Parquet",
    b"\xff\xfe": "text in UTF-16: save it as UTF-8",
    b"\xfe\xff": "text in UTF-16: save it as UTF-8",
}


@dataclass(frozen=True)
class Problem:
    """Something wrong with a file, and where.

    Attributes:
        message: What is wrong and what to do.
        column: Column in the file, empty if it concerns the whole file.
        row: Index of the data row (0-based), None if there is none.
    """

    message: str
    column: str = ""
    row: int | None = None


class Table(ABC):
    """A file of named columns.

    Attributes:
        path: The file.
        header: Column names in the file's order.
    """

    path: Path
    header: tuple[str, ...]

    @abstractmethod
    def read(self, names: Sequence[str]) -> dict[str, FloatArray]:
        """Read columns as float64, each of shape (n,); missing cells are NaN.

        Raises:
            RecordingError: If a cell is not a number or a row has not as many cells as the header.
        """

    @abstractmethod
    def rows_shown(self, rows: Iterable[int]) -> dict[int, int]:
        """Row numbers as in an editor, from data row indices."""

    def unit(self, name: str) -> str | None:  # noqa: ARG002
        """Unit that the file itself states for a column, None if it states none."""
        return None

    def fail(self, problems: Sequence[Problem]) -> RecordingError:
        """Make one error of all problems."""
        shown = self.rows_shown([p.row for p in problems if p.row is not None])
        lines = []
        for p in problems:
            column = f"column {p.column!r}" if p.column else ""
            row = f"row {shown[p.row]}" if p.row is not None else ""
            place = ", ".join(x for x in (column, row) if x)
            lines.append(f"{place}: {p.message}" if place else p.message)
        if len(lines) == 1:
            return RecordingError(f"{self.path}: {lines[0]}")
        return RecordingError("\n  - ".join([f"{self.path}: {len(lines)} problems", *lines]))


def open_table(path: Path) -> Table:
    """Open a .csv or .parquet file and read its header.

    Raises:
        RecordingError: If the file is missing, does not match its extension, or has no header.
    """
    if not path.exists():
        raise RecordingError(f"{path}: no such file{_near(path)}")
    if path.is_dir():
        inside = sorted(p.name for p in path.iterdir() if p.suffix.lower() in (".csv", ".parquet"))
        found = f"; it holds {', '.join(inside[:SHOWN])}" if inside else ""
        raise RecordingError(f"{path}: is a directory, not a file{found}")
    kinds: dict[str, Callable[[Path], Table]] = {".csv": CsvTable, ".parquet": ParquetTable}
    kind = kinds.get(path.suffix.lower())
    if kind is None:
        raise RecordingError(
            f"{path}: files named {path.suffix or 'without extension'} are not read; "
            "export the signals as .csv (with a header line) or .parquet"
        )
    try:
        return kind(path)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read ({error.strerror or error})") from None


class CsvTable(Table):
    """Comma-separated text in UTF-8 with one header line."""

    def __init__(self, path: Path) -> None:
        self.path = path
        with path.open("rb") as file:
            start = file.read(1 << 16)
        for magic, content in _CONTENT.items():
            if start.startswith(magic):
                raise RecordingError(f"{path}: not a CSV file but {content}")
        if not start.strip():
            raise RecordingError(f"{path}: the file is empty; it needs a header line and data rows")
        if b"\0" in start:
            raise RecordingError(f"{path}: a binary file, not CSV text; export the signals as text")
        line = start.removeprefix(b"\xef\xbb\xbf").splitlines()[0]
        try:
            text = line.decode("utf-8")
        except UnicodeDecodeError as error:
            raise RecordingError(
                f"{path}: row 1: byte {error.start + 1} is not UTF-8 text; save the file as UTF-8"
            ) from None
        self.header = tuple(name.strip() for name in next(csv.reader([text]), []))
        self._check_header(text)
        self._bytes_per_row = _mean_line(start)

    def read(self, names: Sequence[str]) -> dict[str, FloatArray]:
        """Read columns in blocks; on a bad cell, find its row by a second, slower pass."""
        try:
            reader = pa_csv.open_csv(
                self.path,
                read_options=pa_csv.ReadOptions(
                    column_names=self.header, skip_rows=1, block_size=_BLOCK, use_threads=False
                ),
                convert_options=pa_csv.ConvertOptions(
                    include_columns=list(names), column_types=dict.fromkeys(names, pa.float64())
                ),
            )
            expected = int(1.2 * self.path.stat().st_size / self._bytes_per_row) + 16
            columns = _collect(reader, names, expected)
        except pa.ArrowInvalid as error:
            if "Empty CSV file" in str(error) or "Could not skip" in str(error):  # nothing but the header
                return {name: np.empty(0) for name in names}
            raise self.fail(list(islice(self._bad_cells(names), SHOWN)) or [Problem(str(error))]) from None
        if any(not np.isfinite(values).all() for values in columns.values()):
            bad = list(islice(self._bad_cells(names), SHOWN))
            if bad:
                raise self.fail(bad)
        return columns

    def rows_shown(self, rows: Iterable[int]) -> dict[int, int]:
        """Header is row 1; blank lines are skipped as data but counted as rows."""
        wanted = set(rows)
        if not wanted:
            return {}
        last, shown = max(wanted), {}
        for index, (line, _) in enumerate(self._cells()):
            if index in wanted:
                shown[index] = line
            if index == last:
                break
        return shown

    def _cells(self) -> Iterator[tuple[int, list[str]]]:
        with self.path.open(encoding="utf-8", errors="replace", newline="") as file:
            reader = csv.reader(file)
            next(reader, None)
            for cells in reader:
                if cells:
                    yield reader.line_num, cells

    def _bad_cells(self, names: Sequence[str]) -> Iterator[Problem]:
        positions = [(name, self.header.index(name)) for name in names]
        for index, (_, cells) in enumerate(self._cells()):
            if len(cells) != len(self.header):
                hint = "; a decimal comma? write 1.5, not 1,5" if len(cells) > len(self.header) else ""
                yield Problem(f"{len(cells)} cells, but the header has {len(self.header)}{hint}", row=index)
                continue
            if index == 0 and not any(_is_number(cells[position]) for _, position in positions):
                yield Problem("a second line of text (units?); delete it: the header is one line", row=index)
                return
            for name, position in positions:
                message = _wrong(cells[position])
                if message:
                    yield Problem(message, name, index)

    def _check_header(self, text: str) -> None:
        for separator, word in ((";", "semicolons"), ("\t", "tabs")):
            if separator in text and "," not in text:
                raise RecordingError(
                    f"{self.path}: row 1: columns are separated by {word}; write commas, and a point in "
                    f"decimals: pandas.read_csv(old, sep={separator!r}, decimal=',').to_csv(new, index=False)"
                )
        if text.startswith(("#", "%", "//")):
            raise RecordingError(
                f"{self.path}: row 1: is a comment; delete the lines above the header (t,...)"
            )
        if all(_is_number(name) for name in self.header):
            raise RecordingError(
                f"{self.path}: row 1: holds numbers; the first line must name the columns (t,...)"
            )


class ParquetTable(Table):
    """Apache Parquet; a column's metadata may state its unit under ``unit``."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self._file = pq.ParquetFile(path, buffer_size=_BLOCK)
            self._schema = self._file.schema_arrow
            self.header = tuple(self._schema.names)
        except (pa.ArrowException, ValueError, OSError) as error:
            raise RecordingError(
                f"{path}: not a readable Parquet file ({str(error).splitlines()[0]}); "
                "write it again, or rename it to .csv if it is text"
            ) from None

    def read(self, names: Sequence[str]) -> dict[str, FloatArray]:
        """Read columns in batches of rows."""
        for name in names:
            kind = self._schema.field(self.header.index(name)).type
            if not (pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_boolean(kind)):
                remedy = "seconds as a number" if pa.types.is_temporal(kind) else "numbers"
                raise self.fail([Problem(f"holds {kind}, not numbers; write {remedy}", name)])
        groups = range(self._file.metadata.num_row_groups)
        batches = (  # group by group, since a reader holds on to the groups that it has been through
            batch
            for group in groups
            for batch in self._file.iter_batches(_BATCH, [group], list(names), use_threads=False)
        )
        try:
            return _collect(batches, names, self._file.metadata.num_rows)
        except (pa.ArrowException, ValueError, OSError) as error:
            raise RecordingError(
                f"{self.path}: damaged Parquet data ({str(error).splitlines()[0]}); write the file again"
            ) from None

    def rows_shown(self, rows: Iterable[int]) -> dict[int, int]:
        """Rows count from 1."""
        return {row: row + 1 for row in rows}

    def unit(self, name: str) -> str | None:
        """The unit in the column's metadata."""
        metadata = self._schema.field(self.header.index(name)).metadata or {}
        return metadata[b"unit"].decode(errors="replace") if b"unit" in metadata else None


def write_table(path: Path, columns: dict[str, Any], units: dict[str, str]) -> None:
    """Write columns as .csv (shortest decimals that read back exactly) or .parquet (with units), atomically.

    Raises:
        RecordingError: If the extension is neither.
    """
    fields = [
        pa.field(name, pa.array(values[:0]).type, metadata={"unit": units[name]} if units.get(name) else None)
        for name, values in columns.items()
    ]
    table = pa.table(list(columns.values()), schema=pa.schema(fields))
    if path.suffix.lower() == ".parquet":
        with replacing(path) as temporary:
            pq.write_table(table, temporary)
    elif path.suffix.lower() == ".csv":
        with replacing(path) as temporary, temporary.open("wb") as file:
            header = ",".join(f'"{n}"' if "," in n else n for n in columns)
            file.write(f"{header}\n".encode())
            pa_csv.write_csv(table, file, pa_csv.WriteOptions(include_header=False))
    else:
        raise RecordingError(f"{path}: a recording is written as .csv or .parquet")


def _collect(batches: Iterable[pa.RecordBatch], names: Sequence[str], expected: int) -> dict[str, FloatArray]:
    """Join batches into one array per column; pages after the last row are never touched and cost nothing."""
    size = min(expected, _ROWS)
    columns = {name: np.empty(size) for name in names}
    n = 0
    for batch in batches:
        stop = n + batch.num_rows
        if stop > size:
            size = max(stop, 3 * size // 2)
            for name in names:
                columns[name].resize(size, refcheck=False)
        for name in names:
            columns[name][n:stop] = batch.column(name).to_numpy(zero_copy_only=False)
        n = stop
    for name in names:
        columns[name].resize(n, refcheck=False)
    return columns


def _near(path: Path) -> str:
    folder = path.parent
    if not folder.is_dir():
        return f" (there is no directory {folder})"
    close = difflib.get_close_matches(path.name, [p.name for p in folder.iterdir()], n=3, cutoff=0.6)
    return f" (did you mean {' or '.join(repr(str(folder / name)) for name in close)}?)" if close else ""


def _mean_line(start: bytes) -> float:
    lines = start.splitlines()[1:]
    whole = lines[:-1] or lines
    return max(2.0, sum(map(len, whole)) / len(whole) + 1) if whole else 2.0


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _wrong(cell: str) -> str:
    """What is wrong with a cell, empty if it is a finite number."""
    text = cell.strip()
    if not text:
        return "the cell is empty; fill the gap, or leave the row out and start a new episode"
    if _is_number(text):
        if math.isfinite(float(text)):
            return ""
        return f"{text} is not a finite number; leave the row out and start a new episode"
    if _is_number(text.replace(",", ".", 1)):
        return f"{text!r} has a decimal comma; write {text.replace(',', '.', 1)}"
    if _DATE.match(text):
        return f"{text!r} is a date; write the seconds since the start as a number"
    return f"{text!r} is not a number"
