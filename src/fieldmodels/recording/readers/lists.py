"""Parquet and Feather with a list a cell: a file, or a LeRobot data set, whose folder names the joints."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from pyarrow.dataset import dataset

from fieldmodels.arrays import FloatArray
from fieldmodels.recording.data import RecordingError
from fieldmodels.recording.readers.nested import WIDEST
from fieldmodels.recording.tables import Series, SeriesTable, readable
from fieldmodels.recording.words import unit_of

INFO = "meta/info.json"
"""What makes a folder a LeRobot data set (https://huggingface.co/docs/lerobot)."""


def read(path: Path, kind: str = "parquet") -> SeriesTable:
    """Read the columns of numbers; those of a list are ``action[shoulder.pos]``, or ``action[1]``.

    Args:
        path: A file, or a LeRobot data set, whose files follow each other.
        kind: "parquet" or "ipc".
    """
    root = path if path.is_dir() else path.parents[min(2, len(path.parents) - 1)]
    with readable(path, "LeRobot data set" if path.is_dir() else "file"):
        info = json.loads((root / INFO).read_text(encoding="utf-8")) if (root / INFO).exists() else {}
        files = sorted(path.glob("data/*/*.parquet")) if path.is_dir() else [path]
        if not files:
            raise RecordingError(f"{path}: its folder 'data' holds no Parquet file; fetch the data, too")
        rows = dataset([str(file) for file in files], format=kind)
        count = rows.count_rows()
        series: dict[str, Series] = {}
        for field in rows.schema:
            told = info.get("features", {}).get(field.name, {})
            unit = (field.metadata or {}).get(b"unit", b"").decode(errors="replace") or unit_of(field.name)
            load = partial(_column, path, rows, field.name)
            if _is_list(field.type):
                width = len((rows.head(1).column(field.name).to_pylist() or [[]])[0] or [])
                for k, name in enumerate(_names(told.get("names"), width)):
                    one = Series(partial(load, k), count, unit or unit_of(name))
                    series[f"{field.name}[{name}]"] = one
            elif pa.types.is_primitive(field.type):
                series[field.name] = Series(load, count, "s" if told and field.name == "timestamp" else unit)
    return SeriesTable(path, series)


def has_lists(schema: pa.Schema) -> bool:
    """Whether cells hold lists of numbers."""
    return any(_is_list(kind) for kind in schema.types)


def numeric(column: pa.Array) -> FloatArray:
    """An Arrow column as float64, its dates as seconds."""
    if pa.types.is_temporal(column.type):
        kinds = {"time": pa.time64("ns"), "dura": pa.duration("ns")}
        stamps = column.cast(kinds.get(str(column.type)[:4], pa.timestamp("ns")))
        values = stamps.cast(pa.int64()).to_numpy(zero_copy_only=False) * 1e-9
        return np.asarray(np.where(np.asarray(column.is_null()), np.nan, values))
    return np.asarray(column.to_numpy(zero_copy_only=False), dtype=np.float64)


def _is_list(kind: pa.DataType) -> bool:
    lists = pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind)
    return bool(lists and pa.types.is_primitive(kind.value_type))


def _names(told: Any, width: int) -> list[str]:
    """Names of a list's places: as the data set tells (a list, or one within a mapping), else numbers."""
    if isinstance(told, dict):
        told = next(iter(told.values()), None)
    named = isinstance(told, list) and len(told) == width
    return [str(told[k] if named else k + 1) for k in range(width if width <= WIDEST else 0)]


def _column(path: Path, rows: Any, name: str, place: int | None = None) -> FloatArray:
    """One column, or one place of a column's lists, shape (n,)."""
    column = rows.to_table(columns=[name]).column(name).combine_chunks()
    if place is None:
        return numeric(column)
    values, count = numeric(column.flatten()), max(len(column), 1)
    if len(values) % count:
        raise RecordingError(
            f"{path}: column {name!r}: its lists differ in length, so their places mean nothing"
        )
    return np.ascontiguousarray(values.reshape(count, -1)[:, place])
