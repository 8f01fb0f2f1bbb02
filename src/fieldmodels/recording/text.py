"""Text logs of any dialect, streamed so that a file larger than memory can be read."""

from __future__ import annotations

import bz2
import codecs
import csv
import gzip
import io
import lzma
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import accumulate, islice, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv

from fieldmodels.arrays import FloatArray
from fieldmodels.recording.converters import BLACKBOX, advice
from fieldmodels.recording.data import RecordingError
from fieldmodels.recording.dialect import COMMENTS, MISSING, encoding_of, sniff
from fieldmodels.recording.evidence import is_clock
from fieldmodels.recording.tables import EMPTY, REMEDY, SHOWN, Problem, Table, collect
from fieldmodels.recording.units import canonical
from fieldmodels.recording.words import is_time

_SAMPLE = 1 << 20  # bytes in which the dialect is found
_BLOCK = 1 << 20  # bytes of text parsed at once
_LOOKED_AT = 1000  # rows that tell whether a column is a clock
_RATES = 100  # largest ratio of two channels' rates; clocks in s and ms differ by more
_PACKED = {b"\x1f\x8b": gzip.open, b"BZh": bz2.open, b"\xfd7zXZ": lzma.open}


class TextTable(Table):
    """Rows of text: comma-separated or of another dialect, packed by gzip, bzip2 or xz, or not."""

    def __init__(self, path: Path) -> None:
        self.path = path
        with path.open("rb") as file:
            magic = file.read(8)
        self._open: Any = next((how for start, how in _PACKED.items() if magic.startswith(start)), None)
        try:
            with self._bytes() as file:
                start = file.read(_SAMPLE)
        except (OSError, EOFError, lzma.LZMAError) as error:
            raise RecordingError(f"{path}: a damaged archive ({error}); pack it again") from None
        whole = len(start) < _SAMPLE
        encoding = encoding_of(start)
        if not start.strip(b"\xef\xbb\xbf\xff\xfe \t\r\n\0") and b"\0" not in start[2:].strip(b"\r\n"):
            raise RecordingError(f"{path}: the file is empty; it needs a header line and data rows")
        if (b"\0" in start and encoding != "utf-16") or start.startswith(BLACKBOX):
            raise RecordingError(f"{path}: {advice(path, start)}")
        if not whole:
            start = start[: start.rfind(b"\n") + 1]
            if not start:
                raise RecordingError(f"{path}: row 1 is longer than {_SAMPLE:,} bytes; this is no table")
        text = start.decode(encoding, errors="replace")
        try:
            self.dialect = sniff(text, encoding)
        except csv.Error as error:
            raise RecordingError(f"{path}: a cell among the first rows is too long ({error})") from None
        self.header, self.named = self.dialect.names, self.dialect.header
        self._doubled = {name for name, count in Counter(self.header).items() if count > 1}
        self.units = {n: u for n, u in zip(self.header, self.dialect.units, strict=True) if u}
        self.units |= dict.fromkeys(self._of_kind("time"), "s")
        lines = (line.strip() for line in text.splitlines() if self.dialect.pairs and line.strip())
        if left := [line for line in lines if not self.dialect.cells(line)]:
            self.notes = (f"lines without {', '.join(self.header)} are left out, as {left[-1]!r}",)
        self._row_bytes = max(2.0, len(start) / (1 + start.count(b"\n")))
        self.clocks = self._side_by_side()

    def numbers(self) -> tuple[str, ...]:
        """Columns of which most cells are numbers or times, and whose name is no other column's, too."""
        kinds = zip(self.header, self.dialect.kinds, strict=True)
        return tuple(n for n, kind in kinds if kind != "text" and n not in self._doubled)

    def _side_by_side(self) -> dict[str, str]:
        """Column to clock, of channels that each have their times at their left: time, one, time, other."""
        names = list(self.numbers())
        times = [name for name in names if is_time(name, self.units.get(name, ""))]
        at = [names.index(name) for name in times]
        apart = all(b - a > 1 for a, b in pairwise([*at, len(names)]))
        units = {canonical(self.units.get(name, "")) for name in times}
        if len(times) < 2 or at[0] or not apart or len(units) > 1:
            return {}
        try:
            values = {n: v[np.isfinite(v)] for n, v in self.read(times, _LOOKED_AT).items()}
        except RecordingError:  # said when they are used
            return {}
        if not all(map(is_clock, values.values())):
            return {}
        steps = [float(np.median(np.diff(v))) for v in values.values()]
        begun, ended = max(v[0] for v in values.values()), min(v[-1] for v in values.values())
        if begun >= ended or max(steps) > _RATES * min(steps):
            return {}
        own: Iterator[str] = accumulate(names, lambda clock, name: name if name in times else clock)
        return dict(zip(names, own, strict=True))

    def read(self, names: Sequence[str], rows: int | None = None) -> dict[str, FloatArray]:
        """Read columns as ``_read``; one with times of its own ends where they end."""
        if not self.clocks:
            return self._read(names, rows)
        clocks = {name: self.clocks.get(name, self.header[0]) for name in names}
        found = self._read(list(dict.fromkeys([*names, *clocks.values()])), rows)
        ends = {c: int(np.flatnonzero(np.isfinite(found[c])).max(initial=-1)) + 1 for c in clocks.values()}
        return {name: found[name][: ends[clocks[name]]] for name in names}

    def _read(self, names: Sequence[str], rows: int | None) -> dict[str, FloatArray]:
        """Read columns in blocks; on a bad cell, find its row by a second, slower pass."""
        expected = int(1.2 * self.path.stat().st_size / self._row_bytes) + 16
        try:
            with self._rows() as source:
                columns = collect(self.path, self._reader(source, names), names, expected, rows)
        except (pa.ArrowException, UnicodeError, OSError, EOFError, lzma.LZMAError) as error:
            said = str(error)
            if "Empty CSV file" in said or "Could not skip" in said:  # nothing but the header
                return {name: np.empty(0) for name in names}
            if not self.dialect.comment:  # one far down, perhaps
                self.dialect = replace(self.dialect, comment=True)
                return self._read(names, rows)
            raise self.fail(self._found(names) or [Problem(said.splitlines()[0])]) from None
        if any(not np.isfinite(values).all() for values in columns.values()):
            bad = self._found([n for n in names if not np.isfinite(columns[n]).all()], missing=False)
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

    def _of_kind(self, kind: str) -> set[str]:
        return {n for n, k in zip(self.header, self.dialect.kinds, strict=True) if k == kind}

    def _bytes(self) -> Any:
        return self._open(self.path, "rb") if self._open else self.path.open("rb")

    def _reader(self, source: Any, names: Sequence[str]) -> pa_csv.CSVStreamingReader:
        d, times = self.dialect, self._of_kind("time")
        return pa_csv.open_csv(
            source,
            read_options=pa_csv.ReadOptions(
                column_names=d.names, skip_rows=d.skip, block_size=_BLOCK, use_threads=False,
                encoding="utf8" if d.encoding.startswith("utf") else d.encoding,
            ),
            parse_options=pa_csv.ParseOptions(
                delimiter=d.delimiter, invalid_row_handler=self._row_handler()
            ),
            convert_options=pa_csv.ConvertOptions(
                include_columns=list(names), decimal_point=d.decimal,
                column_types={n: pa.string() if n in times else pa.float64() for n in names},
                null_values=[form for m in MISSING for form in {m, m.upper(), m.title(), "NaN", "#N/A"}],
            ),
        )  # fmt: skip

    def _row_handler(self) -> Any:
        """Skips the last row if the logger was stopped in the midst of it; any other bad row is an error."""
        if self._open or self.dialect.encoding == "utf-16":
            return None
        with self.path.open("rb") as file:
            file.seek(max(0, self.path.stat().st_size - _SAMPLE // 16))
            tail = file.read()
        if tail.endswith((b"\n", b"\r")):
            return None
        cut = re.split(r"[\r\n]", tail.decode(self.dialect.encoding, errors="replace"))[-1]
        return lambda row: (
            "skip" if row.text == cut and row.actual_columns < row.expected_columns else "error"
        )

    def _rows(self) -> Any:
        """The file as what pyarrow can read: for most dialects itself, for some line by line rewritten."""
        d = self.dialect
        rules: list[tuple[bytes, Any]] = []
        if d.pairs:
            line = re.compile(d.pairs.encode("utf-8" if d.encoding.startswith("utf") else d.encoding))

            def values(found: re.Match[bytes]) -> bytes:
                said = line.match(found[0])
                return b"\t".join(said.groups(b"")) if said else b""

            rules.append((rb"[^\r\n]+", values))
        if d.comment:
            rules.append((rb"(?m)^[ \t]*(?:#|%|//|!)[^\r\n]*", b""))
        if d.thousands:
            mark = re.escape(d.thousands.encode())
            rules.append((rb"(?<=\d)" + mark + rb"(?=\d{3}(?!\d))", b""))
        if d.delimiter == " ":
            rules += [(rb"(?m)^[ \t]+|[ \t]+(?=\r?$)", b""), (rb"[ \t]+", b" ")]
        if not rules and d.encoding != "utf-16":
            return self._bytes()
        file = self._bytes()
        if d.encoding == "utf-16":
            file = codecs.EncodedFile(file, "utf-8", "utf-16")
        return _Rewritten(file, [(re.compile(p), r) for p, r in rules])

    def _cells(self) -> Iterator[tuple[int, list[str]]]:
        """Rows of data with the number of their line."""
        with self._bytes() as file:
            text = io.TextIOWrapper(file, self.dialect.encoding, errors="replace", newline="")
            try:
                for number, line in enumerate(iter(lambda: text.readline(_BLOCK), ""), 1):
                    wanted = number > self.dialect.skip and line.strip()
                    if wanted and not (self.dialect.comment and line.lstrip().startswith(COMMENTS)):
                        cells = self._split(line)
                        if cells or not self.dialect.pairs:
                            yield number, cells
            except (OSError, EOFError, UnicodeError, lzma.LZMAError):
                return

    def _split(self, line: str) -> list[str]:
        try:
            return self.dialect.cells(line)
        except csv.Error:  # a cell without an end
            return []

    def _found(self, names: Sequence[str], missing: bool = True) -> list[Problem]:
        return list(islice(self._bad_cells(names, missing), SHOWN))

    def _bad_cells(self, names: Sequence[str], missing: bool) -> Iterator[Problem]:
        times = self._of_kind("time")
        positions = [(name, self.header.index(name)) for name in names if name not in times]
        for index, (_, cells) in enumerate(self._cells()):
            if len(cells) != len(self.header):
                comma = len(cells) > len(self.header) and self.dialect.decimal == "."
                hint = "; a decimal comma? write 1.5, not 1,5" if comma else ""
                yield Problem(f"{len(cells)} cells, but the header has {len(self.header)}{hint}", row=index)
                continue
            for name, position in positions:
                message = self._wrong(cells[position])
                if message and (missing or cells[position].lower() not in MISSING):
                    yield Problem(message, name, index)

    def _wrong(self, cell: str) -> str:
        """What is wrong with a cell, empty if it is a finite number."""
        if self.dialect.is_number(cell):
            return ""
        if cell.lower() in MISSING:
            return f"{EMPTY}; {REMEDY}"
        if cell.lower().lstrip("+-") in ("inf", "infinity"):
            return f"{cell} is not a finite number; leave the row out and start a new episode"
        if self.dialect.decimal == "." and re.fullmatch(r"-?\d+,\d+", cell):
            return f"{cell!r} has a decimal comma; write {cell.replace(',', '.', 1)}"
        return f"{cell!r} is not a number"


class _Rewritten(io.RawIOBase):
    """A file that rewrites whole lines as they are read; never longer than they were."""

    def __init__(self, file: Any, rules: Sequence[tuple[re.Pattern[bytes], Any]]) -> None:
        self._file, self._rules, self._rest = file, rules, b""

    def readable(self) -> bool:
        return True

    def read(self, size: int = -1) -> bytes:
        while not self._rest:
            block = self._file.read(_BLOCK)
            if not block:
                return b""
            block += self._file.readline(_BLOCK)
            for pattern, replacement in self._rules:
                block = pattern.sub(replacement, block)
            self._rest = block
        size = len(self._rest) if size is None or size < 0 else size
        result, self._rest = self._rest[:size], self._rest[size:]
        return result

    def close(self) -> None:
        self._file.close()
        super().close()
