"""JSON: records, columns, rows with names beside them, one record a line, runs (rollouts, SysId's tests)."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.recording.bench import TIME
from fieldmodels.recording.readers.nested import WIDEST, arrays, flattened, is_time
from fieldmodels.recording.readers.runs import check_text, joined
from fieldmodels.recording.tables import Series, SeriesTable, readable

Run = Mapping[str, FloatArray]

_SYSID = {
    4: "time voltage position velocity",
    9: "time left_voltage right_voltage left_position right_position left_velocity right_velocity angle "
    "angular_rate",
}
"""Columns of SysId's tests by their number (docs/data-collection.md of wpilibsuite/sysid)."""
_RATE = re.compile(r"(?i)(hz|fps|sampl[a-z]*[ _]?rate)$")
_LENGTHS = {
    "Meters": "m", "Feet": "ft", "Inches": "in", "Degrees": "deg", "Radians": "rad", "Rotations": "rev",
}  # fmt: skip


def read(path: Path) -> SeriesTable:
    """Read a JSON document, or a JSON record a line."""
    check_text(path, "JSON")
    with readable(path, "JSON file"):
        text = path.read_text(encoding="utf-8-sig")
        try:
            data = json.loads(text)
        except json.JSONDecodeError as error:
            if error.msg != "Extra data":
                raise
            data = [json.loads(line) for line in text.splitlines() if line.strip()]
        found = _sysid(data) or _rollouts(data)
        return SeriesTable(path, found or flattened(_columns(data)))


def _columns(data: Any) -> Any:
    """Nested lists of one length a column, out of the ways in which JSON holds a table."""
    if isinstance(data, list) and data and isinstance(data[0], Mapping):
        flat = [_flat(record, "") for record in data]
        if kinds := _kinds(flat):
            return {kind: _columns(records) for kind, records in kinds.items()}
        return {
            name: [record.get(name) for record in flat] for name in dict.fromkeys(k for r in flat for k in r)
        }
    if isinstance(data, Mapping):
        inner = [*data.values()]
        if inner and all(
            isinstance(one, Mapping) and not any(map(_is_nested, one.values())) for one in inner
        ):
            if all(map(str.isdigit, data)):  # pandas: records by their numbers
                return _columns(inner)
            if inner[0] and all([*one] == [*inner[0]] and all(map(str.isdigit, one)) for one in inner):
                return {name: [*column.values()] for name, column in data.items()}
        names = data.get("columns") or data.get("names") or data.get("header")
        rows = data.get("data") or data.get("rows") or data.get("values")
        if isinstance(names, list) and isinstance(rows, list) and rows and isinstance(rows[0], list):
            return {str(name): [row[j] for row in rows] for j, name in enumerate(names)}
        columns = {key: _columns(value) for key, value in data.items()}
        return (
            columns["data"]
            if set(columns) <= {"data", "meta", "info", "schema"} and "data" in columns
            else columns
        )
    return data


def _is_nested(value: Any) -> bool:
    return isinstance(value, (Mapping, list))


def _kinds(records: list[Any]) -> dict[str, list[dict[str, Any]]]:
    """Records of several sensors by the field that names each, all of which have fields of their own."""
    common = set.intersection(*(set(record) for record in records))
    for field in sorted(common):
        names = {record[field] for record in records if isinstance(record[field], str)}
        kinds: dict[str, list[dict[str, Any]]] = {name: [] for name in names}
        if not 1 < len(names) <= WIDEST or not all(isinstance(record[field], str) for record in records):
            continue
        for record in records:
            kinds[record[field]].append({key: value for key, value in record.items() if key != field})
        if all(set(some[0]) - common for some in kinds.values()):
            return kinds
    return {}


def _flat(record: Mapping[str, Any], prefix: str) -> dict[str, Any]:
    result: dict[str, Any] = {}
    for key, value in record.items():
        if isinstance(value, Mapping):
            result |= _flat(value, f"{prefix}{key}.")
        elif isinstance(value, list):
            result |= {f"{prefix}{key}[{j + 1}]": v for j, v in enumerate(value)}
        else:
            result[f"{prefix}{key}"] = value
    return result


def _sysid(data: Any) -> dict[str, Series]:
    """The tests of WPILib's SysId, whose positions are in rotations whatever unit it names."""
    if not isinstance(data, Mapping) or not data.get("sysid"):
        return {}
    tests = [np.asarray(rows, dtype=np.float64) for rows in data.values() if isinstance(rows, list) and rows]
    names = _SYSID[tests[0].shape[1]].split()
    kinds = [name.rpartition("_")[2] for name in names]
    size = data.get("unitsPerRotation")
    length = _LENGTHS.get(str(data.get("units")), "rev") if size else "rev"
    told = {"time": "s", "voltage": "V", "position": length, "velocity": f"{length}/s", "angle": "rad"}
    units = {name: told.get(kind, "rad/s") for name, kind in zip(names, kinds, strict=True)}
    gains = [float(size or 1.0) if kind in ("position", "velocity") else 1.0 for kind in kinds]
    return joined([dict(zip(names, (test * gains).T, strict=True)) for test in tests], units)


def _rollouts(data: Any) -> dict[str, Series]:
    """Records of arrays, each a run; of runs without times the only rate that stands beside them tells."""
    runs = _runs(data)
    result = joined(runs) if runs else {}
    rates = set(_rates(data))
    if result and len(rates) == 1 and not any(map(is_time, result)):
        rows = next(iter(result.values())).rows
        result[TIME] = Series.of(np.arange(rows) / rates.pop(), "s")
    return result


def _runs(data: Any) -> list[Run]:
    """The only list of runs in a document; of each the arrays that are as long as its longest one."""
    if isinstance(data, Mapping):
        found = [inner for value in data.values() if (inner := _runs(value))]
        return found[0] if len(found) == 1 else []
    if not isinstance(data, list) or not all(isinstance(one, Mapping) for one in data):
        return []
    runs: list[Run] = []
    for record in data:
        columns = {n: v for n, v in arrays(record) if v.dtype.kind in "biuf"}
        rows = max(map(len, columns.values()), default=0)
        runs.append({n: v for n, v in columns.items() if len(v) == rows})
        if rows < 2:
            return []
    lengths = {len(next(iter(run.values()))) for run in runs}
    # Else a record is a row, and its arrays are the joints of a robot.
    return runs if len(runs) == 1 or len(lengths) > 1 or max(lengths, default=0) > WIDEST else []


def _rates(data: Any) -> Iterator[float]:
    """Numbers that are called a rate: ``action_hz``, ``fps``, ``sampleRate``."""
    for key, value in data.items() if isinstance(data, Mapping) else ():
        if isinstance(value, (int, float)) and _RATE.search(str(key)) and value > 0:
            yield float(value)
        yield from _rates(value)
