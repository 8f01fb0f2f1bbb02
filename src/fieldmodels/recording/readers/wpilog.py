"""WPILib's data logs of FRC robots (.wpilog): every entry of numbers with its clock.

https://github.com/wpilibsuite/allwpilib/blob/main/wpiutil/doc/datalog.adoc
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from fieldmodels.recording.tables import Series, SeriesTable, check_size, readable

_KINDS = {"boolean": "?", "int64": "<i8", "float": "<f4", "double": "<f8"}
_UNITS = {
    "Meter": "m", "Inch": "in", "Foot": "ft", "Radian": "rad", "Degree": "deg", "Rotation": "rev",
    "Second": "s", "Minute": "min", "Volt": "V", "Amp": "A", "Newton": "N", " per ": "/",
}  # fmt: skip


def read(path: Path) -> SeriesTable:
    """Read all entries of numbers; their clocks are ``entry.timestamp``, units what the metadata name."""
    check_size(path, path.stat().st_size // 8, 1)
    entries: dict[int, str] = {}
    found: dict[str, tuple[str, str, list[int], list[bytes]]] = {}
    with readable(path, "WPILib log"):
        for number, stamp, payload in _records(path.read_bytes()):
            if number == 0 and payload[0] == 0:
                name, kind, about = _texts(payload[5:])
                entries[int.from_bytes(payload[1:5], "little")] = name
                found.setdefault(name, (kind, about, [], []))
            elif number in entries:
                _, _, stamps, payloads = found[entries[number]]
                stamps.append(stamp)
                payloads.append(payload)
        return SeriesTable(path, {k: s for name, entry in found.items() for k, s in _series(name, *entry)})


def _records(data: bytes) -> Iterator[tuple[int, int, bytes]]:
    """Number of an entry (0 begins or ends one), stamp [us] and content of each record; a cut one is none."""
    place = 12 + int.from_bytes(data[8:12], "little")
    while place < len(data):
        lengths = data[place]
        place += 1
        numbers = []
        for length in (lengths & 3, lengths >> 2 & 3, lengths >> 4 & 7):
            numbers.append(int.from_bytes(data[place : place + length + 1], "little"))
            place += length + 1
        number, size, stamp = numbers
        if place + size <= len(data):
            yield number, stamp, data[place : place + size]
        place += size


def _texts(data: bytes) -> list[str]:
    """Texts that follow each other, each after its length."""
    result = []
    while data:
        end = 4 + int.from_bytes(data[:4], "little")
        result.append(data[4:end].decode(errors="replace"))
        data = data[end:]
    return result


def _series(
    name: str, kind: str, about: str, stamps: list[int], payloads: list[bytes]
) -> Iterator[tuple[str, Series]]:
    widths, one = {len(payload) for payload in payloads}, _KINDS.get(kind.removesuffix("[]"), "")
    if not one or len(widths) != 1:
        return
    clock, unit = f"{name}.timestamp", "" if about.startswith("{") else about
    unit = re.sub("|".join(_UNITS), lambda word: _UNITS[word[0]], unit)
    yield clock, Series.of(np.array(stamps), "us", clock)
    values = np.frombuffer(b"".join(payloads), one).reshape(len(stamps), -1)
    for k, column in enumerate(values.T):
        yield name + f"[{k}]" * kind.endswith("[]"), Series.of(column, unit, clock)
