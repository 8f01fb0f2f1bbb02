"""LabVIEW's .tdms, by npTDMS (extra ``labview``): every channel; times of a waveform by its step."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from fieldmodels.recording.readers.nested import flattened
from fieldmodels.recording.tables import Series, SeriesTable, check_size, readable
from fieldmodels.recording.words import is_time


def read(path: Path) -> SeriesTable:
    """Read all channels; a column is ``group.channel``, the times of a group's waveforms ``group.t``."""
    from nptdms import TdmsFile

    result: dict[str, Series] = {}
    plain: dict[str, dict[str, Any]] = {}
    units: dict[str, str] = {}
    clocks: dict[Any, str] = {}
    with readable(path, "TDMS file"), TdmsFile.open(path) as file:
        every = (c for group in file.groups() for c in group.channels())
        channels = [c for c in every if c.dtype.kind in "biufM" and len(c) > 1]
        check_size(path, sum(map(len, channels)), 1)
        starts = (c.properties.get("wf_start_time") for c in channels)
        first = min((start for start in starts if start is not None), default=None)
        for channel in channels:
            group, about = channel.group_name, channel.properties
            name = f"{group}.{channel.name}"
            values, unit = channel[:], "s" if channel.dtype.kind == "M" else about.get("unit_string", "")
            if not about.get("wf_increment"):
                plain.setdefault(group, {})[channel.name], units[name] = values, unit
                continue
            wave = (
                group,
                len(values),
                *(about.get(f"wf_{one}") for one in ("increment", "start_offset", "start_time")),
            )
            if wave not in clocks:
                clocks[wave] = f"{group}.t" if f"{group}.t" not in result else f"{name}.t"
                late = about["wf_start_time"] - first if "wf_start_time" in about else np.timedelta64(0)
                seconds = channel.time_track() + late / np.timedelta64(1, "s")
                result[clocks[wave]] = Series.of(seconds, "s", clocks[wave])
            result[name] = Series.of(values, unit, clocks[wave])
    found = {name: replace(s, unit=units[name] or s.unit) for name, s in flattened(plain).items()}
    times = {name.rpartition(".")[0]: name for name, s in found.items() if clocks and is_time(name, s.unit)}
    for name, s in found.items():
        result[name] = replace(s, clock=s.clock or times.get(name.rpartition(".")[0], ""))
    return SeriesTable(path, result)
