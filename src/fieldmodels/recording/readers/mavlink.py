"""MAVLink's telemetry logs (.tlog), by pymavlink (extra ``ardupilot``): every message with its clock."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from fieldmodels.recording.data import RecordingError
from fieldmodels.recording.tables import LARGEST, Series, SeriesTable, readable

_FRAMES = {0xFE: 8, 0xFD: 12}  # bytes beside the payload, of MAVLink 1 and 2


def read(path: Path) -> SeriesTable:
    """Read all messages; a column is ``ATTITUDE.roll``, its clock ``ATTITUDE._timestamp`` the receiver's.

    Those of a further sender begin with its system and component, those of several sensors have numbers.
    """
    found: dict[str, tuple[Any, list[int], list[list[Any]]]] = {}
    senders: dict[str, tuple[int, int]] = {}
    cells = 0
    with readable(path, "MAVLink log"):
        for stamp, message in _messages(bytearray(path.read_bytes())):
            kind, sender = message.get_type(), (message.get_srcSystem(), message.get_srcComponent())
            own = senders.setdefault(kind, sender) == sender
            name = kind if own else f"{sender[0]}.{sender[1]}/{kind}"
            if message._instance_field:
                name += f"[{getattr(message, message._instance_field)}]"
            _, stamps, rows = found.setdefault(name, (message, [], []))
            stamps.append(stamp)
            rows.append([getattr(message, field) for field in message.fieldnames])
            cells += len(message.fieldnames)
            if 200 * cells > LARGEST:  # bytes that a number takes while it is collected
                raise RecordingError(f"{path}: more than {cells:,} numbers; cut the log")
        return SeriesTable(path, {k: s for name, rows in found.items() for k, s in _series(name, *rows)})


def _messages(data: bytearray) -> Iterator[tuple[int, Any]]:
    """Stamps [us] and messages; what is none is passed over."""
    from pymavlink.dialects.v20 import all as dialect

    link = dialect.MAVLink(None)  # not mavutil's reader, which runs a file in a folder called bin
    place = 0
    while place + 18 < len(data):
        packet = place + 8
        size = _FRAMES.get(data[packet], 0)
        if size:
            signed = data[packet] == 0xFD and data[packet + 2] & 1
            size += data[packet + 1] + 13 * signed
            try:
                message = link.decode(data[packet : packet + size])
                if isinstance(message, dialect.MAVLink_unknown):  # whose checksum nobody has compared
                    raise dialect.MAVError("unknown")
                yield int.from_bytes(data[place:packet], "big"), message
            except dialect.MAVError:
                size = 0
        place += 8 + size if size else 1


def _series(
    name: str, message: Any, stamps: list[int], rows: list[list[Any]]
) -> Iterator[tuple[str, Series]]:
    clock = f"{name}._timestamp"
    yield clock, Series.of(np.array(stamps), "us", clock)
    for field, column in zip(message.fieldnames, zip(*rows, strict=True), strict=True):
        values, unit = np.array(column), message.fieldunits_by_name.get(field, "")
        if values.dtype.kind in "biuf":
            for k, one in enumerate(np.atleast_2d(values.T)):
                yield f"{name}.{field}" + f"[{k}]" * (values.ndim == 2), Series.of(one, unit, clock)
