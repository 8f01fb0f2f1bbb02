"""ArduPilot's DataFlash logs (.bin; .log as text), by pymavlink (``ardupilot``): messages, their clocks."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from fieldmodels.recording.tables import Series, SeriesTable, check_size, readable

_CLOCKS = {"TimeUS": "us", "TimeMS": "ms"}
_NO_UNIT = re.compile("heading|latitude|longitude|instance|satellites|UNKNOWN")


def read(path: Path) -> SeriesTable:
    """Read all messages; a column is ``ATT.Roll``, of several sensors ``IMU[0].GyrX``, in stated units."""
    from pymavlink.DFReader import DFReader_binary

    class Index(DFReader_binary):  # type: ignore[misc]
        init_clock = DFReader_binary.init_clock_usec  # its own walks through all messages to find the date

    result: dict[str, Series] = {}
    check_size(path, path.stat().st_size // 8, 1)
    with path.open("rb") as opening:
        if opening.read(3) == b"FMT":
            return _of_text(path)
    with readable(path, "DataFlash log"), closing(Index(str(path))) as file:
        data = np.fromfile(path, np.uint8)
        for kind, form in file.formats.items():
            clock = next((name for name in _CLOCKS if name in form.columns), "")
            rows = _rows(data, np.array(file.offsets[kind], dtype=np.int64) + 3, form)
            signals = clock and len(rows) > 1 and form.name not in ("UNIT", "MULT", "FMTU")
            for name, some in _instances(form, rows) if signals else ():
                for j, column in enumerate(form.columns):
                    if rows.dtype[j].kind != "S":
                        stated = form.units[j] if form.units else _CLOCKS.get(column, "")
                        values = some[column] * (form.msg_mults[j] or 1)
                        series = Series.of(values, _NO_UNIT.sub("", stated), f"{name}.{clock}")
                        result[f"{name}.{column}"] = series
    return SeriesTable(path, result)


def _of_text(path: Path) -> SeriesTable:
    """The same of a log as text, whose numbers are in the stated units already."""
    from pymavlink.DFReader import DFReader_text

    class Index(DFReader_text):  # type: ignore[misc]
        init_clock = DFReader_text.init_clock_usec

    rows: dict[str, list[Any]] = {}
    with readable(path, "DataFlash log"), closing(Index(str(path))) as file:
        for message in iter(file.recv_msg, None):
            number = getattr(message, message.fmt.instance_field) if message.fmt.instance_field else None
            name = message.get_type() if number is None else f"{message.get_type()}[{number}]"
            rows.setdefault(name, []).append(message)
        result: dict[str, Series] = {}
        for name, some in rows.items():
            form = some[0].fmt
            clock = next((column for column in form.columns if column in _CLOCKS), "")
            for j, column in enumerate(form.columns if clock and len(some) > 1 else ()):
                values = np.array([getattr(message, column) for message in some])
                if values.dtype.kind in "iuf":
                    stated = form.units[j] if form.units else _CLOCKS.get(column, "")
                    result[f"{name}.{column}"] = Series.of(
                        values, _NO_UNIT.sub("", stated), f"{name}.{clock}"
                    )
    return SeriesTable(path, result)


def _rows(data: np.ndarray, places: np.ndarray, form: Any) -> np.ndarray:
    """All messages of a kind, shape (n,); one that is cut at the end is left out."""
    kinds = re.findall(r"(\d*)(\w)", form.msg_struct[1:])
    row = np.dtype([
        (name, f"S{count}" if count else f"<{letter}")
        for name, (count, letter) in zip(form.columns, kinds, strict=True)
    ])  # fmt: skip
    places = places[places + row.itemsize <= len(data)]
    if not len(places):
        return np.empty(0, row)
    return np.asarray(np.lib.stride_tricks.sliding_window_view(data, row.itemsize)[places].view(row)).ravel()


def _instances(form: Any, rows: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """The messages of each sensor by its name."""
    if form.instance_field is None:
        yield form.name, rows
        return
    numbers = rows[form.instance_field]
    for one in np.unique(numbers):
        label = one.decode(errors="replace") if isinstance(one, bytes) else one
        yield f"{form.name}[{label}]", rows[numbers == one]
