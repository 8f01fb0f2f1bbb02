"""Text logs of any dialect, streamed so that a file larger than memory can be read."""

from __future__ import annotations

import bz2
import csv
import gzip
import io
import lzma
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import accumulate, islice, pairwise
from pathlib import Path
from typing import Any

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.recording.bench import EPOCH
from fieldmodels.recording.converters import BLACKBOX, advice
from fieldmodels.recording.data import RecordingError
from fieldmodels.recording.dialect import COMMENTS, MISSING, WRAPPED, encoding_of, sniff
from fieldmodels.recording.evidence import is_clock
from fieldmodels.recording.tables import (
    EMPTY,
    REMEDY,
    SHOWN,
    Problem,
    Table,
    collect,
    leaps,
    over_midnight,
    stamps,
)
from fieldmodels.recording.units import canonical
from fieldmodels.recording.words import is_time

_SAMPLE = 1 << 20  # bytes in which the dialect is found
_BLOCK = 1 << 20  # characters of text, or cells, parsed at once
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
        if len(re.findall(r"(?m)^---\s*$", text)) > 1:
            what = "documents of YAML, as `ros2 topic echo` prints: let it print rows (--csv) or record a bag"
            raise RecordingError(f"{path}: {what}")
        try:
            self.dialect = sniff(text, encoding)
        except csv.Error as error:
            raise RecordingError(f"{path}: a cell among the first rows is too long ({error})") from None
        self.header, self.named, self.rate = self.dialect.names, self.dialect.header, self.dialect.rate
        if self.dialect.kinds == ("text",):
            first = next(line for line in text.splitlines() if line.strip())
            raise RecordingError(
                f"{path}: row 1, {first[:60]!r}: no line holds numbers between ',', ';', tabs, '|' or "
                "blanks, or after names as in 'name: value'; write a table with the columns time, name, value"
            )
        self._doubled = {name for name, count in Counter(self.header).items() if count > 1}
        self.units = {n: u for n, u in zip(self.header, self.dialect.units, strict=True) if u}
        self.units |= dict.fromkeys(self._of_kind("time"), "s")
        lines = (line.strip() for line in text.splitlines() if self.dialect.pairs and line.strip())
        if left := [line for line in lines if not self.dialect.cells(line)]:
            self.notes = (f"lines without {', '.join(self.header)} are left out, as {left[-1]!r}",)
        self._row_bytes = max(2.0, len(start) / (1 + start.count(b"\n")))
        self._rest: dict[str, tuple[str, float]] = {}
        self.clocks = self._side_by_side()
        self._rest = self._in_parts()

    def numbers(self) -> tuple[str, ...]:
        """Columns of which most cells are numbers or times, and whose name is no other column's, too."""
        kinds = zip(self.header, self.dialect.kinds, strict=True)
        return tuple(n for n, kind in kinds if kind != "text" and n not in self._doubled)

    def texts(self, names: Sequence[str]) -> dict[str, list[str]]:
        """Cells of columns as they are written; of rows that have all cells."""
        rows = [cells for _, cells in self._cells() if len(cells) == len(self.header)]
        return {name: [row[self.header.index(name)] for row in rows] for name in names}

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

    def _in_parts(self) -> dict[str, tuple[str, float]]:
        """A clock of whole seconds to the column beside it that holds the rest of each, and its worth [s]."""
        first = dict(zip(self.header, next(self._cells(), (0, []))[1], strict=False))
        for whole, rest in () if self.clocks else pairwise(self.numbers()):
            named = is_time(whole, self.units.get(whole, ""))
            if re.search(r"[.,]\d", first.get(whole, ".0")) or not (named or not self.named):
                continue
            with suppress(RecordingError):  # said when they are used
                seconds, parts = self._read([whole, rest], _LOOKED_AT).values()
                steps = np.diff(seconds)
                if (
                    (named or seconds[0] > EPOCH)
                    and (steps == np.floor(steps)).all()
                    and (steps == 0.0).any()
                ):
                    worth = next((w for w in (1e-3, 1e-6, 1e-9) if 0.5 < w * parts.max() < 1.0), 0.0)
                    if worth and parts.min() >= 0.0 and is_clock(seconds + worth * parts):
                        self.notes += (f"{whole!r} and {rest!r} are read as one clock",)
                        return {whole: (rest, worth)}
        return {}

    def read(self, names: Sequence[str], rows: int | None = None) -> dict[str, FloatArray]:
        """Read columns as ``_read``; one with times of its own ends where they end."""
        for whole, (rest, worth) in self._rest.items():
            if whole in names:
                found = self._read([*{*names, rest}], rows)
                return {n: found[n] + worth * found[rest] if n == whole else found[n] for n in names}
        if not self.clocks:
            return self._read(names, rows)
        clocks = {name: self.clocks.get(name, self.header[0]) for name in names}
        found = self._read(list(dict.fromkeys([*names, *clocks.values()])), rows)
        ends = {c: int(np.flatnonzero(np.isfinite(found[c])).max(initial=-1)) + 1 for c in clocks.values()}
        return {name: found[name][: ends[clocks[name]]] for name in names}

    def _read(
        self, names: Sequence[str], rows: int | None, month_first: bool = False
    ) -> dict[str, FloatArray]:
        """Read columns in blocks; on a bad cell, find its row by a second, slower pass."""
        expected = int(1.2 * self.path.stat().st_size / self._row_bytes) + 16
        self._uneven, times = False, self._of_kind("time") & {*names}
        try:
            columns = collect(self.path, self._blocks(names, month_first), names, expected, rows)
        except (ValueError, OverflowError, OSError, EOFError, lzma.LZMAError) as error:
            if times and not month_first:
                return self._read(names, rows, month_first=True)
            if not self.dialect.comment:  # one far down, perhaps
                self.dialect = replace(self.dialect, comment=True)
                return self._read(names, rows)
            said = str(error).splitlines() or ["cannot be read"]
            raise self.fail(self._found(names) or [Problem(said[0])]) from None
        gaps = [n for n in names if not np.isfinite(columns[n]).all()]
        if (gaps or self._uneven) and (bad := self._found(gaps, missing=False)):
            raise self.fail(bad)
        if not month_first and any(leaps(columns[name]) for name in times):
            with suppress(RecordingError):
                other = self._read(names, rows, month_first=True)
                return columns if any(leaps(other[name]) for name in times) else other
        return columns | {name: over_midnight(columns[name]) for name in times}

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

    def _blocks(self, names: Sequence[str], month_first: bool) -> Iterator[dict[str, FloatArray]]:
        """Columns block by block; notes whether a row has not as many cells as the header has names."""
        import pandas as pd

        d, times, width, count = self.dialect, self._of_kind("time"), len(self.header), 0
        wanted = {d.names.index(name): name for name in names}
        kinds = {j: "str" if name in times else "float64" for j, name in wanted.items()}
        with suppress(pd.errors.EmptyDataError), self._rows() as source:  # nothing but the header
            for block in pd.read_csv(
                source, sep=d.delimiter, decimal=d.decimal, header=None, names=range(width), index_col=False,
                usecols=[*{*wanted, width - 1}], dtype={width - 1: "str"} | kinds, skipinitialspace=True,
                na_values=[form for m in MISSING for form in {m, m.upper(), m.title(), "NaN", "#N/A"}],
                keep_default_na=False, chunksize=max(_BLOCK // width, 1), low_memory=False,
            ):  # fmt: skip
                count += len(block)
                self._uneven |= bool(block[width - 1].isna().any())  # pandas fills what a row lacks
                yield {
                    name: stamps(block[j], month_first) if name in times else block[j].to_numpy()
                    for j, name in wanted.items()
                }
            self._uneven |= source.delimiters != count * (width - 1)  # and drops what it has too many

    def _rows(self) -> _Rows:
        """The rows as pandas can read them: for most dialects as they are, for some rewritten."""
        d = self.dialect
        rules: list[tuple[str, Any]] = []
        if d.pairs:
            rules.append((r"[^\r\n]+", lambda found: "\t".join(d.cells(found[0]))))
        if d.wrapped:
            rules.append((WRAPPED.pattern, ""))
        if d.comment:
            rules.append((r"(?m)^[ \t]*(?:#|%|//|!)[^\r\n]*", ""))
        if d.suffixes:
            rules.append((r"[^\r\n]+", lambda found: '"' + f'"{d.delimiter}"'.join(d.cells(found[0])) + '"'))
        if d.thousands:
            rules.append((rf"(?<=\d){re.escape(d.thousands)}(?=\d{{3}}(?!\d))", ""))
        if d.delimiter == " ":
            rules += [(r"(?m)^[ \t]+|[ \t]+(?=\r?$)", ""), (r"[ \t]+", " ")]
        text = self._text()
        for _ in range(d.skip):
            text.readline()
        return _Rows(text, [(re.compile(p), r) for p, r in rules], self._is_cut, d.delimiter)

    def _text(self) -> io.TextIOWrapper:
        return io.TextIOWrapper(self._bytes(), self.dialect.encoding, errors="replace", newline="")

    def _is_cut(self, line: str) -> bool:
        """Whether a line is the last one, and the logger was stopped in the midst of it."""
        ended = line.endswith(("\n", "\r")) or len(line) >= _BLOCK
        return not ended and len(self._split(line)) < len(self.header)

    def _cells(self) -> Iterator[tuple[int, list[str]]]:
        """Rows of data with the number of their line."""
        with self._text() as text:
            try:
                for number, line in enumerate(iter(lambda: text.readline(_BLOCK), ""), 1):
                    wanted = number > self.dialect.skip and line.strip()
                    if wanted and not (self.dialect.comment and line.lstrip().startswith(COMMENTS)):
                        cells = self._split(line)
                        if (cells or not self.dialect.pairs) and not self._is_cut(line):
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
        return f"{cell!r} is not a number; leave such cells empty"


class _Rows(io.TextIOBase):
    """A text whose whole lines are rewritten as they are read, without a last one that is cut.

    Attributes:
        delimiters: How many stand in what was read.
    """

    def __init__(
        self, file: Any, rules: Sequence[tuple[re.Pattern[str], Any]], is_cut: Any, delimiter: str
    ) -> None:
        self._file, self._rules, self._is_cut, self._delimiter = file, rules, is_cut, delimiter
        self._rest, self.delimiters = "", 0

    def readable(self) -> bool:
        return True

    def read(self, size: int | None = -1) -> str:
        while not self._rest:
            if not (block := self._file.read(_BLOCK)):
                return ""
            block += self._file.readline(_BLOCK)
            if not block.endswith(("\n", "\r")) and self._is_cut(last := re.split(r"[\r\n]", block)[-1]):
                block = block[: len(block) - len(last)]
            for pattern, replacement in self._rules:
                block = pattern.sub(replacement, block)
            self._rest = block
            self.delimiters += block.count(self._delimiter)
        size = len(self._rest) if size is None or size < 0 else size
        result, self._rest = self._rest[:size], self._rest[size:]
        return result

    def close(self) -> None:
        self._file.close()
        super().close()
