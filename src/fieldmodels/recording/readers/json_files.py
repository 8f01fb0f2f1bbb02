"""JSON: records, columns, rows with names beside them, or one record a line."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fieldmodels.recording.data import RecordingError
from fieldmodels.recording.readers.nested import flattened
from fieldmodels.recording.tables import SeriesTable, readable

_LARGEST = 1 << 28  # bytes: Python's objects take ten times as many


def read(path: Path) -> SeriesTable:
    """Read a JSON document, or a JSON record a line."""
    if path.stat().st_size > _LARGEST:
        raise RecordingError(f"{path}: JSON of more than {_LARGEST >> 20} MB; save it as CSV or Parquet")
    with readable(path, "JSON file"):
        text = path.read_text(encoding="utf-8-sig")
        try:
            data = json.loads(text)
        except json.JSONDecodeError as error:
            if error.msg != "Extra data":
                raise
            data = [json.loads(line) for line in text.splitlines() if line.strip()]
        return SeriesTable(path, flattened(_columns(data)))


def _columns(data: Any) -> Any:
    """Nested lists of one length a column, out of the ways in which JSON holds a table."""
    if isinstance(data, list) and data and isinstance(data[0], Mapping):
        flat = [_flat(record, "") for record in data]
        return {
            name: [record.get(name) for record in flat] for name in dict.fromkeys(k for r in flat for k in r)
        }
    if isinstance(data, Mapping):
        names = data.get("columns") or data.get("names") or data.get("header")
        rows = data.get("data") or data.get("rows") or data.get("values")
        if isinstance(names, list) and isinstance(rows, list) and rows and isinstance(rows[0], list):
            return {str(name): [row[j] for row in rows] for j, name in enumerate(names)}
        columns = {key: _columns(value) for key, value in data.items()}
        return columns["data"] if set(columns) <= {"data", "meta", "info"} and "data" in columns else columns
    return data


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
