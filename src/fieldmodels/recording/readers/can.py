"""CAN traces (candump, .asc, .blf, .trc, .csv, .mf4) with a DBC, by python-can and asammdf (``can``)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fieldmodels.recording.data import RecordingError
from fieldmodels.recording.readers.mdf import columns, opened
from fieldmodels.recording.reading import DATABASES
from fieldmodels.recording.tables import SeriesTable, check_size, readable

_LONGEST = 64  # bytes of a message, as CAN FD has it
_FRAME = [(f"CAN_DataFrame.{name}", kind) for name, kind in (
    ("BusChannel", "u1"), ("ID", "u4"), ("IDE", "u1"), ("DLC", "u1"), ("DataLength", "u1"),
    ("DataBytes", f"({_LONGEST},)u1"),
)]  # fmt: skip


def read(path: Path, databases: Sequence[str | Path] = ()) -> SeriesTable:
    """Read the signals of all messages that a database knows; a column is ``message.signal``.

    Args:
        path: The trace.
        databases: What the messages hold; by default the only such file beside the trace.
    """
    if path.suffix.lower() in DATABASES:
        raise RecordingError(f"{path}: says what messages hold; give it with its trace, as TRACE+{path.name}")
    found = sorted(databases or (p for p in path.parent.iterdir() if p.suffix.lower() in DATABASES))
    if len(found) != 1 and not databases:
        beside = f"{len(found)} such files lie" if found else "no such file lies"
        raise RecordingError(
            f"{path}: a trace of a CAN bus; a DBC says what its messages hold, and {beside} beside it: give "
            f"both as {path}+FILE.dbc"
        )
    with readable(path, "CAN trace"), _raw(path) as file:
        with file.extract_bus_logging({"CAN": [(str(one), 0) for one in found]}) as signals:
            result = columns(path, signals)
        if not result:
            raise RecordingError(f"{path}: no message of it is in {' or '.join(map(str, found))}")
        return SeriesTable(path, result)


def _raw(path: Path) -> Any:
    """The trace as a measurement file, from which asammdf takes the signals of whole messages at once."""
    import can
    from asammdf import MDF, Signal
    from asammdf.blocks.v4_blocks import SourceInformation
    from asammdf.blocks.v4_constants import BUS_TYPE_CAN, SOURCE_BUS

    readers = {"(": can.CanutilsLogReader, "d": can.ASCReader, ";": can.TRCReader, "L": can.BLFReader,
               "t": can.CSVReader}  # fmt: skip
    with path.open("rb") as opening:
        first = opening.read(100).lstrip()[:1].decode(errors="replace")
    if first not in readers:
        return opened(path)
    with readers[first](str(path)) as trace:
        sent = [m for m in trace if not m.is_error_frame and not m.is_remote_frame and m.data]
    check_size(path, len(sent), _LONGEST // 8 + 2)
    buses = {bus: number for number, bus in enumerate(dict.fromkeys(m.channel for m in sent), 1)}
    frames = np.zeros(len(sent), _FRAME)
    frames["CAN_DataFrame.BusChannel"] = [buses[m.channel] for m in sent]
    frames["CAN_DataFrame.ID"] = [m.arbitration_id for m in sent]
    frames["CAN_DataFrame.IDE"] = [m.is_extended_id for m in sent]
    frames["CAN_DataFrame.DLC"] = frames["CAN_DataFrame.DataLength"] = [len(m.data) for m in sent]
    whole = b"".join(m.data.ljust(_LONGEST, b"\0") for m in sent)
    frames["CAN_DataFrame.DataBytes"] = np.frombuffer(whole, np.uint8).reshape(-1, _LONGEST)
    times, bus = (
        np.array([m.timestamp for m in sent]),
        SourceInformation(source_type=SOURCE_BUS, bus_type=BUS_TYPE_CAN),
    )
    file = MDF(version="4.10")
    file.append(Signal(frames, times, name="CAN_DataFrame", source=bus))
    return file
