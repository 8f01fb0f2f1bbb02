"""ASAM MDF measurement files (.mf4, .mdf, .dat), by asammdf (extra ``mdf``): every channel with its clock."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from fieldmodels.recording.dialect import unit_of
from fieldmodels.recording.tables import Series, SeriesTable, check_size, readable


def read(path: Path) -> SeriesTable:
    """Read all channels of numbers; each group has a clock of its own, ``t`` if there is but one group."""
    from asammdf import MDF

    result: dict[str, Series] = {}
    with readable(path, "MDF file"), MDF(path) as file:
        groups: list[Any] = list(file.groups)
        several = len(groups) > 1
        for number, group in enumerate(groups):
            rows = int(group.channel_group.cycles_nr)
            check_size(path, rows, len(group.channels))
            clock = f"t of group {number + 1}" if several else "t"
            result[clock] = Series.of(file.get_master(number), "s", clock if several else "")
            for index, channel in enumerate(group.channels):
                if index == file.masters_db.get(number):
                    continue
                signal = file.get(group=number, index=index)
                if signal.samples.dtype.kind not in "biuf" or signal.samples.ndim != 1:
                    continue
                name = channel.name if channel.name not in result else f"{channel.name} of group {number + 1}"
                unit = signal.unit or unit_of(name)
                result[name] = Series.of(signal.samples, unit, clock if several else "")
    return SeriesTable(path, result)
