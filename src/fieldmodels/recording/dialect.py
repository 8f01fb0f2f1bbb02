"""The dialect of a text log, found from its first lines: encoding, separator, decimals, header, units."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import takewhile
from typing import Literal

from fieldmodels.recording.units import is_unit
from fieldmodels.recording.words import names_and_units, unit_of

Kind = Literal["number", "time", "text"]

COMMENTS = ("#", "%", "//", "!")
MISSING = ("", "nan", "-nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "bad", "bad input", "no data",
           "error", "invalid", "ovld", "#value!", "#num!", "#div/0!")  # fmt: skip
"""Cells that say that there is no value."""

_TIME = re.compile(
    r"(\d{4}-\d{1,2}-\d{1,2}|\d{1,2}[./]\d{1,2}[./]\d{4}|\d{4}/\d{1,2}/\d{1,2}"
    r"|\d{1,2}[- ][A-Za-z]{3,9}[- ]\d{4})([T ]+\d{1,2}:\d{2}[^;,\t|\"]*(,\d+)?)?"
    r"|\d{1,2}(?P<mark>[-./])\d{1,2}(?P=mark)\d{2} \d{1,2}:\d{2}(:\d{2}([.,:;]\d+)?)?( ?[AaPp][Mm])?"
    r"|(-?\d+ days? )?\d{1,2}:\d{2}(:\d{2}([.,:;]\d+)?)?( ?[AaPp][Mm])?"
)
_SIGN = r"[-+\u2212]?"
_EXPONENT = r"(?:[eE][-+]?\d+)?"
# (decimal, thousands) in the order in which they are preferred, and the cells that they read.
_NUMBERS = {
    (decimal, thousands): re.compile(
        _SIGN
        + (
            rf"(?:\d+|\d{{1,3}}(?:{re.escape(thousands)}\d{{3}})+)(?:{re.escape(decimal)}\d*)?"
            if thousands
            else rf"(?:\d+(?:{re.escape(decimal)}\d*)?|{re.escape(decimal)}\d+)"
        )
        + _EXPONENT
    )
    for decimal, thousands in ((".", ""), (",", ""), (",", "."), (".", ","), (".", "'"), (",", " "))
}
_NAME_WITH_UNIT = re.compile(r'"[^"]*"|[^\s\[(]+(?:\s*[\[(][^\])]*[\])])?')
_STAMP = r"\s*\[?((?:\d{4}-\d\d-\d\d[T ])?\d{1,2}:\d\d:\d\d(?:[.,]\d+)?)\]?[ \t]*(?:->)?"
_VALUE = r"\s*[:=][ \t]*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|[-+]?(?i:nan|inf))"
_PAIR = re.compile(
    rf"(?<!\w)([^\W\d][^:=,;|\t\"]{{0,60}}?){_VALUE}(?:\s?([^\W\d][^\s,;|:=]*|[°%]\S*))?(?=[\s,;|]|$)"
)
_JSON = str.maketrans({'"': None, "{": " ", "}": " "})
_BEHIND = re.compile(r"\d[ \u00a0]?([^\W\d_][^\s\",;|]{0,10}|[°%][^\s\",;|]{0,5})(?=\"?\s*(?:[,;|\t\r\n]|$))")
_RATE = re.compile(
    r"(?i)(?:(?:sampl\w+|update|scan|frame)[ _-]?(?:rate|frequency)|abtastrate)"
    r"\W{1,6}(\d+(?:\.\d+)?)\W{0,4}(k(?=Hz))?"
)
WRAPPED = re.compile(r"(?m)^[ \t]*[\[(]|[\])][ \t]*(?=\r?$)")
"""The brackets of a row."""
_EXAMINED = 400  # lines
_HEADERS = 6  # lines above the data that may name columns or state units
_OPEN = re.compile(r'^(?:[^"]|"[^"]*")*?(?:^|[,;|\t]) *"(?:[^"]|"")*$')  # a cell in quotes that goes on
_LONGEST = 10_000  # letters of a header in several lines
_PREAMBLE = 50  # of which so many may stand above a header


@dataclass(frozen=True)
class Dialect:
    """How a text file holds a table.

    Attributes:
        encoding: Of the text, as Python calls it.
        delimiter: Between cells; a space stands for any run of blanks.
        decimal: Decimal point or comma.
        thousands: Between groups of three digits, empty for nothing.
        skip: Lines above the first row of data.
        names: The columns' names, as in the header; ``column 1`` and so on without one.
        units: The columns' units, empty where none is stated.
        kinds: What the columns hold.
        header: False if the file names no columns.
        comment: Whether lines of comment stand among the rows.
        rate: Rows a second as a line above the data says, 0 for nothing.
        wrapped: Whether rows stand in brackets, as Python prints them.
        suffixes: Of each column the unit that stands behind its numbers; none if there are none at all.
        pairs: Of ``name: value`` lines the pattern, a group a column; other lines are no rows.
    """

    encoding: str
    delimiter: str
    decimal: str
    thousands: str
    skip: int
    names: tuple[str, ...]
    units: tuple[str, ...]
    kinds: tuple[Kind, ...]
    header: bool
    comment: bool
    pairs: str = ""
    suffixes: tuple[str, ...] = ()
    rate: float = 0.0
    wrapped: bool = False

    def cells(self, line: str) -> list[str]:
        """The cells of one line; none of a line that is no row."""
        if self.pairs:
            found = re.match(self.pairs, line.translate(_JSON))
            return list(found.groups("")) if found else []
        cells = split(WRAPPED.sub("", line) if self.wrapped else line, self.delimiter)
        if len(cells) == len(self.suffixes):
            bare = [cell.removesuffix(unit) for cell, unit in zip(cells, self.suffixes, strict=True)]
            cells = [
                one.strip() if self.is_number(one) else cell for cell, one in zip(cells, bare, strict=True)
            ]
        return cells

    def is_number(self, cell: str) -> bool:
        """Whether a cell holds a number."""
        return _NUMBERS[self.decimal, self.thousands].fullmatch(cell.strip()) is not None


def split(line: str, delimiter: str) -> list[str]:
    """Split a line into its cells; quotes hide the delimiter.

    Raises:
        csv.Error: If a cell is longer than 131,072 characters.
    """
    if delimiter == " ":
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line.rstrip("\r\n")], delimiter=delimiter), [])]


def encoding_of(start: bytes) -> str:
    """Encoding of a text by its first bytes: UTF-8 and UTF-16 by their marks and forms, else Windows-1252."""
    for mark, name in ((b"\xef\xbb\xbf", "utf-8-sig"), (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16")):
        if start.startswith(mark):
            return name
    try:
        start.decode("utf-8")
    except UnicodeDecodeError as error:
        if error.start < len(start) - 4:  # else a character was cut at the end
            return "cp1252"
    return "utf-8"


def sniff(text: str, encoding: str) -> Dialect:
    """Find the dialect of a table from its first lines.

    Args:
        text: The beginning of the file, whole lines.
        encoding: Of the file.
    """
    lines = [(i, line) for i, line in _whole_lines(text.splitlines()) if line.strip()][:_EXAMINED]
    if told := _pairs([line for _, line in lines], encoding):
        return told
    inner = lines[len(lines) // 2 :]
    if wrapped := all(len(WRAPPED.findall(line)) == 2 for _, line in inner) and bool(inner):
        lines = [(i, WRAPPED.sub("", line)) for i, line in lines]
    rows = [(i, line) for i, line in lines if not line.lstrip().startswith(COMMENTS)] or lines
    raw = [line for _, line in rows[len(rows) // 2 :]]
    suffixes = _suffixes(raw)
    body = [_without(line, suffixes) for line in raw]
    delimiter, (decimal, thousands) = _separators(body)
    number = _NUMBERS[decimal, thousands]
    width = _usual([len(split(line, delimiter)) for line in body])
    cells = [c for line in body if len(c := split(line, delimiter)) == width]
    kinds = tuple(_kind([row[j] for row in cells], number) for j in range(width))
    above: list[tuple[int, str]] = []
    first = len(rows)
    for k, (_, line) in enumerate(rows):
        row = split(_without(line, suffixes), delimiter)
        if len(row) == width and not _is_text(row, kinds, number, bool(above)):
            first = k
            break
        above.append((k, line))
    first, above = _below_pairs(
        rows, first, above, lambda row: _names(_without(row, suffixes), delimiter, kinds, number)
    )
    labelled = _labelled([split(line, delimiter) for _, line in rows[:_PREAMBLE]], width, number)
    first = max([first, *(k + 1 for k in labelled)])
    skip = rows[first][0] if first < len(rows) else rows[-1][0] + 1
    blank = width > 2 and not any(row[-1] for row in cells)
    heads = (header_cells(line, delimiter, width, blank) for _, line in above[-_HEADERS:])
    texts = [found for found in heads if found]
    if labelled:
        of_channels, *more = labelled.values()
        units_too = (
            row for row in more if all(is_unit(c, True) and not number.fullmatch(c) for c in row[1::2])
        )
        texts = [of_channels, *units_too]
    if not any(texts):
        said = [line for i, line in lines if i < skip and line.lstrip().startswith(COMMENTS)]
        texts = [header_cells(re.sub(r"^\s*(#|%|//|!)+", "", line), delimiter, width) for line in said[-3:]]
    names, units = names_and_units([t for t in texts if t], width)
    whole = [row for line in raw if len(row := split(line, delimiter)) == width]
    behind = tuple(
        _behind([row[j] for row in whole], suffixes) if kind == "number" else ""
        for j, kind in enumerate(kinds)
    )
    units = [unit or own for unit, own in zip(units, behind, strict=True)]
    return Dialect(
        encoding=encoding,
        delimiter=delimiter,
        decimal=decimal,
        thousands=thousands,
        skip=skip,
        names=tuple(name or f"column {j + 1}" for j, name in enumerate(names)),
        units=tuple(units),
        kinds=kinds,
        header=any(names),
        comment=any(line.lstrip().startswith(COMMENTS) for i, line in lines if i > skip),
        suffixes=behind if any(behind) else (),
        rate=_rate([line for i, line in lines if i < skip]),
        wrapped=wrapped,
    )


def _rate(above: Sequence[str]) -> float:
    """Rows a second, where the lines above the data say one rate."""
    found = {float(m[1]) * (1e3 if m[2] else 1.0) for line in above for m in _RATE.finditer(line)}
    return found.pop() if len(found) == 1 else 0.0


def _whole_lines(lines: Sequence[str]) -> Iterator[tuple[int, str]]:
    """Lines with their numbers; a name in quotes may go on in the next one."""
    rest = iter(enumerate(lines))
    for i, line in rest:
        while _OPEN.search(line) and len(line) < _LONGEST and (more := next(rest, None)):
            line = f"{line} {more[1]}"
        yield i, line


def _labelled(rows: Sequence[list[str]], width: int, number: re.Pattern[str]) -> dict[int, list[str]]:
    """Rows above channels with their times at the left that say in front of each channel what they tell.

    ``Name, force, Name, position`` (TwinCAT): by their numbers, what stands above times and channels.
    """
    told = {
        k: row[1::2]
        for k, row in enumerate(rows)
        if len(row) == width > 2 and width % 2 == 0 and len({*row[::2]}) == 1
        if row[0] and not number.fullmatch(row[0]) and not _TIME.fullmatch(row[0])
    }
    return {
        k: [c for cell in cells for c in (f"time ({cell})" if k == min(told) else "", cell)]
        for k, cells in told.items()
        if len(told) > 1
    }


def _suffixes(lines: Sequence[str]) -> tuple[str, ...]:
    """Units that stand behind the numbers in most lines, the longest first."""
    found = Counter(unit for line in lines for unit in set(_BEHIND.findall(line)))
    usual = (unit for unit, count in found.items() if count > 0.5 * len(lines) and is_unit(unit, usual=True))
    return tuple(sorted(usual, key=len, reverse=True))


def _without(text: str, suffixes: Sequence[str]) -> str:
    """Text without these units behind its numbers."""
    return _BEHIND.sub(lambda m: m[0].removesuffix(m[1]).rstrip() if m[1] in suffixes else m[0], text)


def _behind(cells: Sequence[str], suffixes: Sequence[str]) -> str:
    """The unit behind the numbers of a column."""
    found = Counter(unit for cell in cells for unit in _BEHIND.findall(cell) if unit in suffixes)
    return found.most_common(1)[0][0] if found else ""


def _pairs(lines: Sequence[str], encoding: str) -> Dialect | None:
    """The dialect of a console or a plotter, ``name: value, name: value`` a line; None of other text."""
    lines = [line.translate(_JSON) for line in lines]
    found = Counter(tuple((name, unit) for name, _, unit in _PAIR.findall(line)) for line in lines)
    usual, count = found.most_common(1)[0] if found else ((), 0)
    names = tuple(name for name, _ in usual)
    pattern = "".join(rf"[^\r\n]*?(?<!\w){re.escape(name)}{_VALUE}" for name in names)
    rows = [line for line in lines if re.match(pattern, line)]
    if not names or len(set(names)) < len(names) or count < max(2, 0.5 * len(lines)):
        return None
    stamped = sum(re.match(_STAMP, line) is not None for line in rows) >= 0.9 * len(rows)
    rest = re.split(r"[\s,;|]+", _PAIR.sub("", re.sub(_STAMP, "", rows[0])))
    if any(number.fullmatch(cell) for cell in rest for number in _NUMBERS.values()):  # a cell without a name
        return None
    units = tuple(unit or unit_of(name) for name, unit in usual)
    clock = "time" if "time" not in names else "stamp"
    numbers: tuple[Kind, ...] = tuple("number" for _ in names)
    return Dialect(
        encoding=encoding,
        delimiter="\t",
        decimal=".",
        thousands="",
        skip=0,
        names=(clock, *names) if stamped else names,
        units=("s", *units) if stamped else units,
        kinds=("time", *numbers) if stamped else numbers,
        header=True,
        comment=False,
        pairs=_STAMP * stamped + pattern,
    )


def header_cells(line: str, delimiter: str, width: int, blank: bool = False) -> list[str]:
    """Cells of a line above the data, empty unless there are as many as columns; ``blank``: the last is."""
    cells = _NAME_WITH_UNIT.findall(line) if delimiter == " " else split(line, delimiter)
    cells = [cell.strip().strip('"').strip() for cell in cells]
    if len(cells) == width - 1 and delimiter != " ":  # rows end with a separator, the header does not
        cells.append("")
    elif len(cells) > width and blank:  # what stands beside the names says no column (Rigol)
        cells = [*cells[: width - 1], ""]
    return cells if len(cells) == width and any(cells) else []


def _separators(body: Sequence[str]) -> tuple[str, tuple[str, str]]:
    """The delimiter and the form of numbers under which most cells of consistent rows are numbers."""
    best, chosen = (0.0, 0), (",", (".", ""))
    quoted = all(line.lstrip().startswith('"') for line in body)
    for delimiter in (",", ";", "\t", "|", " "):
        rows = [split(line, delimiter) for line in body]
        width = _usual([len(row) for row in rows])
        if width < 2 and delimiter != ",":
            continue
        same = [row for row in rows if len(row) == width]
        cells = [c for row in same for c in row if c.lower() not in MISSING]
        for form, number in _NUMBERS.items():
            if (form[1] == delimiter and not quoted) or (delimiter == " " and form[1]):
                continue
            good = sum(bool(number.fullmatch(c) or _TIME.fullmatch(c)) for c in cells)
            score = round(len(same) / len(rows) * good / max(len(cells), 1), 3), min(width, 2)
            if score > best:
                best, chosen = score, (delimiter, form)
    if best[0] == 0.0 and body:  # no number at all: a header alone
        chosen = max((",", ";", "\t", "|"), key=body[0].count), (".", "")
    return chosen


def _kind(cells: Sequence[str], number: re.Pattern[str]) -> Kind:
    """What a column holds by most of its cells."""
    said = [c for c in cells if c.lower() not in MISSING]
    if sum(number.fullmatch(c) is not None for c in said) >= 0.5 * len(said):
        return "number"
    return "time" if sum(_TIME.fullmatch(c) is not None for c in said) >= 0.5 * len(said) else "text"


def _is_text(row: Sequence[str], kinds: Sequence[Kind], number: re.Pattern[str], after_text: bool) -> bool:
    """Whether a line is a header or states units: words where the rows below have numbers."""
    judged = [
        number.fullmatch(c) is None and _TIME.fullmatch(c) is None
        for c, kind in zip(row, kinds, strict=True)
        if kind != "text" and c.lower() not in MISSING[:6]
    ]
    if not judged:
        return not after_text or not any(c for c in row)
    return sum(judged) > 0.5 * len(judged) if after_text else any(judged)


def _below_pairs(
    rows: Sequence[tuple[int, str]],
    first: int,
    above: list[tuple[int, str]],
    names: Callable[[str], bool | None],
) -> tuple[int, list[tuple[int, str]]]:
    """Where the data begin, and the header, if what seems to be data are pairs of a name and a number.

    Args:
        rows: Number and text of the lines.
        first: Where the data seem to begin.
        above: The lines above.
        names: Whether a line names columns; None if it begins with a number.
    """
    told = list(
        takewhile(lambda k: names(rows[k][1]) is not None, range(first, min(first + _PREAMBLE, len(rows))))
    )
    while told and not names(rows[told[-1]][1]):
        told.pop()
    if not told:
        return first, above
    head = list(takewhile(lambda k: names(rows[k][1]), reversed(told)))
    return told[-1] + 1, [(k, rows[k][1]) for k in reversed(head)]


def _names(line: str, delimiter: str, kinds: Sequence[Kind], number: re.Pattern[str]) -> bool | None:
    row = split(line, delimiter)
    if not row or number.fullmatch(row[0]) or _TIME.fullmatch(row[0]) or kinds[0] == "text":
        return None
    return len(row) == len(kinds) and _is_text(row, kinds, number, True)


def _usual(widths: Sequence[int]) -> int:
    return Counter(widths).most_common(1)[0][0] if widths else 1
