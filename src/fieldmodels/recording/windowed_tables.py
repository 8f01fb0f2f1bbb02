"""Tables with one row a window and one column a sample, as recordings: each window becomes an episode."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fieldmodels.recording import Recording
from fieldmodels.recording.reading import read_table
from fieldmodels.recording.units import si_unit

NUMBER = "#"
"""Stands for the sample's number, from 0, in a column's name: ``icp_x_#``."""


@dataclass(frozen=True)
class Layout:
    """How a table holds its windows.

    Attributes:
        columns: Signal to the columns' common name with ``#`` for the sample's number, and their unit
            behind a colon: ``{"x": "icp_x_#:m"}``.
        step: Sampling interval [s].
        group: Column whose whole numbers say which windows belong together (a step of commands).
        part: Which half of these groups is read: 0 the even ones, 1 the odd ones, None all.
        known: Values of base parameters that are known of the machine.
    """

    columns: Mapping[str, str]
    step: float
    group: str
    part: int | None = None
    known: Mapping[str, float] = field(default_factory=dict)


def load_windows(path: Path, layout: Layout) -> Recording:
    """Load a table of windows.

    Time runs on as if the windows followed each other without a gap; windows of the other half of the
    groups are left out, their time with them.

    Args:
        path: The published file, known by its checksum.
        layout: How it holds its windows.

    Returns:
        One episode a window, numbered by the table's rows from 0; values in SI units.
    """
    table = read_table(path)
    signals: dict[str, tuple[list[str], float, str]] = {}
    for signal, spec in layout.columns.items():
        pattern, _, stated = spec.rpartition(":")
        found = re.compile(re.escape(pattern).replace(re.escape(NUMBER), r"(\d+)"))
        matches = [m for name in table.header if (m := found.fullmatch(name))]
        unit, scale = si_unit(stated)
        signals[signal] = [m[0] for m in sorted(matches, key=lambda m: int(m[1]))], scale, unit
    values = table.read([layout.group, *(name for names, _, _ in signals.values() for name in names)])
    group = values[layout.group]
    rows = np.flatnonzero((group % 2 == layout.part) if layout.part is not None else group == group)
    samples = len(next(iter(signals.values()))[0])
    episode = np.repeat(rows, samples)
    return Recording(
        time=np.asarray((episode * samples + np.tile(np.arange(samples), len(rows))) * layout.step),
        signals={
            signal: scale * np.stack([values[name][rows] for name in names], axis=1).ravel()
            for signal, (names, scale, _) in signals.items()
        },
        units={signal: unit for signal, (_, _, unit) in signals.items()},
        episode=episode.astype(np.int64),
        source=str(path),
        known=layout.known,
    )
