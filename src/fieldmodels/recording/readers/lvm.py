"""LabVIEW's measurement files (.lvm), by lvm_read (extra ``labview``): names, units, steps, segments."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.recording.dialect import encoding_of
from fieldmodels.recording.readers.runs import check_text, joined
from fieldmodels.recording.tables import SeriesTable, readable

_CLOCK = "X_Value"  # as LabVIEW calls the times


@dataclass(frozen=True)
class _Channel:
    time: FloatArray
    values: FloatArray
    unit: str
    timed: bool


def read(path: Path) -> SeriesTable:
    """Read all channels; each segment is an episode, later ones moved on where their times begin anew."""
    from lvm_read import read_str

    check_text(path, "LabVIEW's text")
    with readable(path, "LabVIEW measurement file"):
        data = path.read_bytes()
        file = read_str(data.decode(encoding_of(data), errors="replace"))
        segments = [_channels(file, file[k]) for k in range(file["Segments"])]
    segments = [one for one in segments if one]
    kept = [name for name in (segments or [{}])[0] if all(name in one for one in segments)]
    clocks, runs, end = _clocks(kept, segments), [], -np.inf
    for segment in segments:
        start = min(segment[name].time[0] for name in kept)
        steps = [np.diff(segment[name].time[:2]).max(initial=0.0) for name in kept]
        shift = 0.0 if start > end else end - start + max(steps)
        columns: dict[str, FloatArray] = {}
        for name in kept:
            columns |= {clocks[name]: segment[name].time + shift, name: segment[name].values}
        end = max(columns[clock][-1] for clock in clocks.values())
        runs.append(columns)
    units = {name: segments[0][name].unit for name in kept}
    units |= {clock: "s" for name, clock in clocks.items() if segments[0][name].timed}
    several = len(set(clocks.values())) > 1
    clocks |= {clock: clock for clock in clocks.values()}
    return SeriesTable(path, joined(runs, units, clocks if several else {}) if kept else {})


def _channels(file: Mapping[Any, Any], segment: Mapping[str, Any]) -> dict[str, _Channel]:
    """The channels of a segment that hold something; the header tells of none of their columns of times."""
    names, data, layout = segment["Channel names"], np.asarray(segment["data"]), file.get("X_Columns", "One")
    result = {}
    for j, name in enumerate(names[: data.shape[1]]):
        count = int(np.flatnonzero(np.isfinite(data[:, j])).max(initial=-1)) + 1
        if name in (_CLOCK, "Comment") or not count:
            continue

        def told(key: str, k: int = j - (layout != "No")) -> Any:
            cells = segment.get(key, [])
            return (cells[k] if k < len(cells) else "") or ""

        beside = {"No": None, "Multi": j - 1}.get(
            layout, 0 if told("Delta_X") == told("Delta_X", 0) else None
        )
        counted = (told("X0") or 0.0) + (told("Delta_X") or 1.0) * np.arange(count)
        result[name if names.count(name) == 1 else f"{name} ({j})"] = _Channel(
            time=np.asarray(counted if beside is None else data[:count, beside], dtype=np.float64),
            values=data[:count, j],
            unit=told("Y_Unit_Label"),
            timed=told("X_Dimension") in ("", "Time"),
        )
    return result


def _clocks(names: list[str], segments: list[dict[str, _Channel]]) -> dict[str, str]:
    """Channel to the name of its clock: one for all whose times are the same."""
    known: dict[tuple[bytes, ...], str] = {}
    result = {}
    for name in names:
        times = tuple(segment[name].time.tobytes() for segment in segments)
        result[name] = known.setdefault(times, f"{_CLOCK} ({name})" if known else _CLOCK)
    return result
