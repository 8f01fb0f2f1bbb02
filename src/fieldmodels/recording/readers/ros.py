"""Bags of ROS 1 and 2 (.bag, .db3, .mcap, a folder), by rosbags (extra ``ros``): all numbers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from fieldmodels.recording.data import RecordingError
from fieldmodels.recording.tables import LARGEST, Series, SeriesTable

_OTHER_MCAP = """an MCAP whose messages are not ROS 2's; where they are JSON, Python makes a table of them:
  import json, mcap.reader  # pip install mcap
  rows = mcap.reader.make_reader(open({0!r}, "rb")).iter_messages()
  rows = [{{"t": m.log_time * 1e-9, "topic": c.topic, **json.loads(m.data)}} for _, c, m in rows]
  json.dump(rows, open("plain.json", "w"))"""
_MOST = 32  # numbers of one array of a message; longer ones are pictures and scans


def read(path: Path) -> SeriesTable:
    """Read all topics; a column is ``/topic.field``, its clock ``/topic.t`` the message's stamp."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    topics: dict[str, list[tuple[float, dict[str, float]]]] = {}
    cells = 0
    skipped: set[str] = set()
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
            for connection, stamp, raw in reader.messages():
                if connection.msgtype in skipped or len(raw) > 1 << 16:
                    continue
                message: Any = reader.deserialize(raw, connection.msgtype)
                fields = _numbers(message, "")
                if not fields:
                    skipped.add(connection.msgtype)
                    continue
                cells += len(fields)
                if 200 * cells > LARGEST:  # bytes that a number takes while it is collected
                    raise RecordingError(
                        f"{path}: more than {cells:,} numbers; cut the bag, or leave topics out"
                    )
                topics.setdefault(connection.topic, []).append((_stamp(message, stamp), fields))
    except RecordingError:
        raise
    except Exception as error:  # of the reader, of SQLite, zstd and of broken messages
        if "Profile is not ros2" in str(error):
            raise RecordingError(f"{path}: {_OTHER_MCAP.format(path.name)}") from None
        if not topics:
            raise RecordingError(f"{path}: not a readable bag ({type(error).__name__}: {error})") from None
    return SeriesTable(
        path, {k: s for topic, rows in topics.items() for k, s in _series(topic, rows).items()}
    )


def _series(topic: str, rows: list[tuple[float, dict[str, float]]]) -> dict[str, Series]:
    clock = f"{topic}.t"
    result = {clock: Series.of(np.array([t for t, _ in rows]), "s", clock)}
    for name in dict.fromkeys(n for _, fields in rows for n in fields):
        values = np.array([fields.get(name, np.nan) for _, fields in rows])
        result[f"{topic}.{name}"] = Series.of(values, "", clock)
    return result


def _stamp(message: Any, received: int) -> float:
    """When the message was measured [s], by its header if it has one."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    measured = 0 if stamp is None else int(stamp.sec) * 10**9 + int(stamp.nanosec)
    return 1e-9 * (measured or received)


def _numbers(value: Any, prefix: str, names: Any = None) -> dict[str, float]:
    """All numbers of a message by their path, joints by their names, which the message around may hold."""
    names = getattr(value, "name", None) or getattr(value, "joint_names", None) or names
    result: dict[str, float] = {}
    for field in getattr(value, "__dataclass_fields__", {}):
        if field in ("header", "__msgtype__"):
            continue
        inner, path = getattr(value, field), f"{prefix}{field}"
        if isinstance(inner, (bool, int, float)):
            result[path] = float(inner)
        elif isinstance(inner, np.ndarray) and inner.dtype.kind in "biuf" and 0 < inner.size <= _MOST:
            named = isinstance(names, list) and len(names) == inner.size
            for k, one in enumerate(inner.ravel()):
                result[f"{path}[{names[k] if named and names else k}]"] = float(one)
        elif hasattr(inner, "__dataclass_fields__"):
            result |= _numbers(inner, f"{path}.", names)
        elif (
            isinstance(inner, list) and 0 < len(inner) <= _MOST and hasattr(inner[0], "__dataclass_fields__")
        ):
            for k, one in enumerate(inner):
                result |= _numbers(one, f"{path}[{k}].")
    return result
