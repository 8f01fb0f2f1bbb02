"""Named columns of a log, whatever its format: what every reader gives, and what it says of a bad file.

Only the columns that are asked for are kept, as float64. Row numbers in messages count from 1, with a text's
header in row 1, as editors and spreadsheets show them.
"""

from __future__ import annotations

import re
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.extras import MissingExtraError, needed
from fieldmodels.files import replacing
from fieldmodels.recording.data import RecordingError
from fieldmodels.recording.words import unit_of
from fieldmodels.rounding import listed

SHOWN = 5
"""Largest number of problems of one kind in a message."""
EMPTY = "the cell is empty or NaN"
REMEDY = (
    "leave such rows out (gaps of up to four are then filled, longer ones begin a new episode), or fill them"
)
LARGEST = 4 << 30
"""Most bytes that the columns of one log may take in memory."""
_FORMS = (
    (r"(:[\d.,:]+) ?(Z|[+-]\d\d:?\d\d)$", r"\1%z"),
    (r"^\d{4}([-/])\d+\1\d+", r"%Y\1%m\1%d"),
    (r"^\d+([-./])\d+\1\d{4}", r"%d\1%m\1%Y"),
    (r"^\d+([- ])[A-Za-z]{3}\1\d{4}", r"%d\1%b\1%Y"),
    (r"^\d+([- ])[A-Za-z]{4,}\1\d{4}", r"%d\1%B\1%Y"),
    (r"^\d+([-./])\d+\1\d\d(?= )", r"%d\1%m\1%y"),
    (r"\d+:\d\d:\d\d([.,:;])\d+", r"%H:%M:%S\1%f"),
    (r"\d+:\d\d:\d\d", r"%H:%M:%S"),
    (r"\d+:\d\d", r"%H:%M"),
    (r"%H(.*)[AaPp][Mm]$", r"%I\1%p"),
)
"""Parts of a time as text to their directives."""


@dataclass(frozen=True)
class Problem:
    """Something wrong with a file, and where.

    Attributes:
        message: What is wrong and what to do.
        column: Column in the file, empty if it concerns the whole file.
        row: Index of the data row (0-based), None if there is none.
        more: Other data rows of which the same is true, ascending, ``row`` the first of them.
    """

    message: str
    column: str = ""
    row: int | None = None
    more: tuple[int, ...] = ()


class Table(ABC):
    """A log's named columns; opening one reads its header alone.

    Attributes:
        path: The file.
        header: Column names in the file's order, as they are written there.
        units: Column name to its unit as the file states it; a column without one is left out.
        clocks: Column name to the column that holds its times, in a file of several rates; empty for one.
        notes: Peculiarities of the file.
        named: False if the file names no columns, so that they are ``column 1`` and so on.
        rate: Rows a second as the file says beside its table; 0 for nothing.
    """

    path: Path
    header: tuple[str, ...]
    units: Mapping[str, str]
    clocks: Mapping[str, str] = {}
    notes: tuple[str, ...] = ()
    named: bool = True
    rate: float = 0.0

    @abstractmethod
    def read(self, names: Sequence[str], rows: int | None = None) -> dict[str, FloatArray]:
        """Read columns as float64, each of shape (n,); missing cells are NaN.

        Columns have one length, unless they have ``clocks`` of their own. Dates become seconds.

        Args:
            names: Of the columns.
            rows: Only about so many from the first on; None for all.

        Raises:
            RecordingError: If a cell is not a number, a row has not as many cells as the header, or the
                columns would not fit into memory.
        """

    def __getitem__(self, name: str) -> FloatArray:
        """Values of one column, shape (n,)."""
        return self.read([name])[name]

    def numbers(self) -> tuple[str, ...]:
        """Names of the columns that hold numbers or times."""
        return self.header

    def signals(self, rows: int | None = None) -> dict[str, FloatArray]:
        """Read all columns of numbers; one that holds words further down is left out, and noted.

        Raises:
            RecordingError: If that is true of all.
        """
        names = self.numbers()
        try:
            return self.read(names, rows)
        except RecordingError:
            found: dict[str, FloatArray] = {}
            wrong = []
            for name in names:
                try:
                    found |= self.read([name], rows)
                except RecordingError as one:
                    wrong.append(str(one).replace(f"{self.path}: ", "").splitlines()[-1].strip(" -"))
            if not found:
                raise
            self.notes = tuple(dict.fromkeys((*self.notes, *(f"left out: {one}" for one in wrong))))
            return found

    def rows_shown(self, rows: Iterable[int]) -> dict[int, int]:
        """Row numbers as in an editor, from data row indices."""
        return {row: row + 1 for row in rows}

    def place(self, rows: Sequence[int], column: str) -> str:
        """Where some rows of a column are, in words: "rows 5, 9 to 12 and 40 (6 rows)"."""
        del column  # of several files each has its own rows
        found = _ranges(rows)
        ends = {row for pair in (*found[:SHOWN], found[-1]) for row in pair}
        return _rows(found, self.rows_shown(ends), len(rows))

    def fail(self, problems: Sequence[Problem]) -> RecordingError:
        """Make one error of all problems."""
        ranges = {p: _ranges(p.more) for p in problems if p.more}
        ends = {row for found in ranges.values() for pair in (*found[:SHOWN], found[-1]) for row in pair}
        shown = self.rows_shown({*ends, *(p.row for p in problems if p.row is not None)})
        lines = []
        for p in problems:
            column = f"column {p.column!r}" if p.column else ""
            row = f"row {shown[p.row]}" if p.row is not None else ""
            if p in ranges:
                row = _rows(ranges[p], shown, len(p.more))
            place = ", ".join(x for x in (column, row) if x)
            lines.append(f"{place}: {p.message}" if place else p.message)
        if len(lines) == 1:
            return RecordingError(f"{self.path}: {lines[0]}")
        return RecordingError("\n  - ".join([f"{self.path}: {len(lines)} problems", *lines]))


def _ranges(rows: Sequence[int]) -> list[tuple[int, int]]:
    """First and last row of every run of ascending rows."""
    found = np.asarray(rows)
    breaks = np.flatnonzero(np.diff(found) > 1)
    first, last = np.append(0, breaks + 1), np.append(breaks, len(found) - 1)
    return [(int(found[a]), int(found[b])) for a, b in zip(first, last, strict=True)]


def _rows(ranges: Sequence[tuple[int, int]], shown: Mapping[int, int], count: int) -> str:
    """Ranges of rows as in an editor: "rows 5, 9 to 12 and 40 (6 rows)"; of many the first ones."""
    parts = [str(shown[a]) if a == b else f"{shown[a]} to {shown[b]}" for a, b in ranges[:SHOWN]]
    if more := len(ranges) - len(parts):
        parts.append(
            f"{more} more {'stretch' if more == 1 else 'stretches'} up to row {shown[ranges[-1][1]]}"
        )
    return f"row {parts[0]}" if count == 1 else f"rows {listed(parts)} ({count:,} rows)"


@dataclass(frozen=True)
class Series:
    """One column of a file that is not text.

    Attributes:
        load: Gives its values, shape (n,).
        rows: How many.
        unit: As the file states it, empty for none.
        clock: Name of the column with its times, empty for the file's only clock.
    """

    load: Callable[[], Any]
    rows: int
    unit: str = ""
    clock: str = ""

    @classmethod
    def of(cls, values: Any, unit: str = "", clock: str = "") -> Series:
        """A column that is in memory already."""
        return cls(lambda: values, len(values), unit, clock)


class SeriesTable(Table):
    """Columns that a library gives one by one; one whose unit it does not tell may end in it: `x_mm`."""

    def __init__(self, path: Path, series: Mapping[str, Series]) -> None:
        self.path, self._series = path, dict(series)
        self.header = tuple(self._series)
        ends = ((name, s.unit or ("" if "[" in name else unit_of(name))) for name, s in self._series.items())
        self.units = {name: unit for name, unit in ends if unit}
        self.clocks = {name: s.clock for name, s in self._series.items() if s.clock}
        if not self.header:
            raise RecordingError(f"{path}: holds no column of numbers")

    def read(self, names: Sequence[str], rows: int | None = None) -> dict[str, FloatArray]:
        """Load the columns, dates as seconds."""
        check_size(self.path, sum(self._series[name].rows for name in names), 1)
        return {name: self._values(name)[:rows] for name in names}

    def _values(self, name: str) -> FloatArray:
        values = np.asarray(self._series[name].load())
        if values.dtype.kind == "M":
            return np.asarray((values.astype("M8[ns]").astype(np.int64)) * 1e-9)
        if values.dtype.kind in "OUS":
            try:
                return seconds(values.ravel())
            except ValueError:
                pass
        try:
            return np.array(values, dtype=np.float64).ravel()
        except (TypeError, ValueError):
            raise self.fail([Problem("holds text, not numbers", name)]) from None
        except OverflowError:  # JSON's integers have no end
            raise self.fail([Problem("holds a number beyond 1e308", name)]) from None


@contextmanager
def readable(path: Path, kind: str) -> Iterator[None]:
    """Say of whatever a format's library raises that the file is no such one; it prints no results of ours.

    Raises:
        RecordingError: In its place; what is one already, and a missing library, pass.
    """
    try:
        with redirect_stdout(sys.stderr):
            yield
    except (RecordingError, ModuleNotFoundError):
        raise
    except Exception as error:  # libraries raise their own, struct's, zlib's, NumPy's and plain ones
        said = str(error).splitlines() or [type(error).__name__]
        raise RecordingError(f"{path}: not a readable {kind} ({said[0]})") from None


def check_size(path: Path, rows: int, columns: int) -> None:
    """Refuse what would not fit into memory, before it is loaded.

    Raises:
        RecordingError: If so many numbers take more than ``LARGEST`` bytes.
    """
    if 8 * rows * columns > LARGEST:
        raise RecordingError(
            f"{path}: {rows:,} rows of {columns} columns take {8e-9 * rows * columns:.1f} GB in memory "
            f"(allowed: {1e-9 * LARGEST:.1f}); cut the log, or lower its rate"
        )


def seconds(texts: Any) -> FloatArray:
    """Times of day, dates and times as text, as seconds; of a time of day that falls, the next day's.

    Raises:
        ValueError: If a text is no time.
    """
    try:
        found = stamps(texts)
        if not leaps(found):
            return over_midnight(found)
    except ValueError:
        return over_midnight(stamps(texts, month_first=True))
    with suppress(ValueError):
        other = stamps(texts, month_first=True)
        return found if leaps(other) else other
    return found


def stamps(texts: Any, month_first: bool = False) -> FloatArray:
    """Texts of one form as seconds, of times of day since midnight, of dates since 1970; NaN for none.

    Raises:
        ValueError: If a text is no time, or not of the form of the longest one.
    """
    import pandas as pd

    text = pd.Series(texts, dtype="str").str.strip()
    form = max(text.dropna(), key=len, default="")
    if " day" in form:
        return np.asarray(pd.to_timedelta(text) / pd.Timedelta(seconds=1))
    dated = re.search(r"\d[-./ ]", form.partition(":")[0])
    for pattern, directives in _FORMS:
        form = re.sub(pattern, directives, form)
    if re.search(r"\d", form):
        raise ValueError(f"{form!r} is no time")
    if month_first:
        form = re.sub("%d(.)%m", r"%m\1%d", form)
    found = pd.to_datetime(text, format=form, errors="coerce", utc=True)
    if (plain := found.isna() & text.notna()).any():  # a logger leaves a fraction of zero out
        found[plain] = pd.to_datetime(text[plain], format=re.sub(".%f", "", form), utc=True)
    origin = pd.Timestamp(1970 if dated else 1900, 1, 1, tz="UTC")  # of a time of day the calendar's own
    return np.asarray((found - origin) / pd.Timedelta(seconds=1))


def leaps(times: FloatArray) -> bool:
    """Whether times leap by weeks, as at midnight where months are taken for days."""
    return bool(np.nanmax(np.abs(np.diff(times)), initial=0.0) > 20 * 86400.0)


def over_midnight(times: FloatArray) -> FloatArray:
    """Times of day that go on over midnight, in place."""
    if len(times) and np.nanmax(times, initial=0.0) < 86400.0:
        times[1:] += 86400.0 * np.cumsum(np.diff(times) < -43200.0)
    return times


def collect(
    path: Path,
    batches: Iterable[Mapping[Any, FloatArray]],
    names: Sequence[Any],
    expected: int,
    most: int | None = None,
) -> dict[Any, FloatArray]:
    """Join batches of columns into one array each; pages after the last row are never touched, cost nothing.

    After ``most`` rows no more batches are taken.

    Raises:
        RecordingError: As ``check_size``.
    """
    size = min(expected, LARGEST // 8 // max(len(names), 1))
    columns = {name: np.empty(size) for name in names}
    n = 0
    for batch in batches:
        stop = n + max(map(len, batch.values()), default=0)
        if stop > size:
            check_size(path, stop, len(names))
            size = max(stop, 3 * size // 2)
            for name in names:
                columns[name].resize(size, refcheck=False)
        for name in names:
            columns[name][n:stop] = batch[name]
        n = stop
        if most is not None and n >= most:
            break
    for name in names:
        columns[name].resize(n, refcheck=False)
    return columns


def write_table(path: Path, columns: dict[str, Any], units: dict[str, str]) -> None:
    """Write columns as .csv (shortest decimals that read back exactly) or .parquet (with units), atomically.

    Raises:
        RecordingError: If the extension is neither, or pyarrow is missing for the latter.
    """
    import pandas as pd

    kind = path.suffix.lower()
    if kind not in (".csv", ".parquet"):
        raise RecordingError(f"{path}: a recording is written as .csv or .parquet")
    table = pd.DataFrame(columns, copy=False)
    if kind == ".csv":
        with replacing(path) as temporary:
            table.to_csv(temporary, index=False)
        return
    try:
        pa, pq = needed("pyarrow"), needed("pyarrow.parquet")
    except MissingExtraError as error:
        raise RecordingError(f"{path}: {error}, or write .csv") from None
    fields = [
        pa.field(name, pa.array(values[:0]).type, metadata={"unit": units[name]} if units.get(name) else None)
        for name, values in columns.items()
    ]
    with replacing(path) as temporary:
        pq.write_table(pa.table(list(columns.values()), schema=pa.schema(fields)), temporary)
