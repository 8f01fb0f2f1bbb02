"""HDF5, and MATLAB's version 7.3 in it, by h5py (extra ``hdf5``): all arrays of numbers."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from fieldmodels.recording.readers.matlab import without_objects
from fieldmodels.recording.readers.nested import arrays, flattened
from fieldmodels.recording.readers.runs import joined
from fieldmodels.recording.tables import Series, SeriesTable, check_size, readable
from fieldmodels.recording.words import unit_of

_RUN = re.compile(r"(.*?(?:demo|traj|trajectory|episode|rollout|run|trial)_?)(\d+)\.(.+)")
_UNITS = ("unit", "units", "Unit", "Units", "UNIT")


def read(path: Path) -> SeriesTable:
    """Read all datasets; what lies in other files (links, external and virtual data) is left alone."""
    import h5py

    data: dict[str, Any] = {}
    units: dict[str, str] = {}

    def visit(name: str, node: Any) -> None:
        if not isinstance(node, h5py.Dataset) or name.startswith("#") or node.is_virtual or node.external:
            return
        if "MATLAB_object_decode" in node.attrs:
            objects[name] = node.attrs["MATLAB_class"].decode()
            return
        if node.dtype.kind not in "biufV" or not 1 <= node.ndim <= 2 or node.attrs.get("MATLAB_empty", 0):
            return
        key = name.replace("/", ".")
        sizes.append(node.size * max(1, len(node.dtype.names or ())))
        check_size(path, sum(sizes), 1)
        data[key] = node[()]
        stated = next((node.attrs[u] for u in _UNITS if u in node.attrs), "")
        units[key] = stated.decode(errors="replace") if isinstance(stated, bytes) else str(stated)

    sizes: list[int] = []
    objects: dict[str, str] = {}
    with readable(path, "HDF5 file"), h5py.File(path, "r") as file:
        file.visititems(visit)
    found = _runs(data) or flattened(_nested(data))
    return without_objects(path, {
        name: Series(s.load, s.rows, units.get(name.partition("[")[0]) or s.unit or unit_of(name), s.clock)
        for name, s in found.items()
    }, objects)  # fmt: skip


def _runs(found: dict[str, Any]) -> dict[str, Series]:
    """Columns of numbered runs (``data/demo_0/actions``), one after the other; none if there are none."""
    paths = [_RUN.fullmatch(key) for key in found]
    runs: dict[int, dict[str, Any]] = {}
    for path, values in zip(paths, found.values(), strict=True):
        if path is None or path[1] != (paths[0] or path)[1]:
            return {}
        runs.setdefault(int(path[2]), {}).update(arrays(values, path[3]))
    return joined([_even(run) for _, run in sorted(runs.items())]) if runs else {}


def _even(run: dict[str, Any]) -> dict[str, Any]:
    """The arrays that are as long as a run; of states there may be one more than of actions."""
    rows = max(map(len, run.values()))
    rows = min(len(values) for values in run.values() if len(values) >= rows - 1)
    return {name: values[:rows] for name, values in run.items() if len(values) >= rows}


def _nested(data: dict[str, Any]) -> dict[str, np.ndarray]:
    """Arrays by their path; a single one at the top gives its columns their own names."""
    if len(data) == 1 and (only := next(iter(data.values()))).dtype.names:
        return {name: only[name] for name in only.dtype.names}
    return data
