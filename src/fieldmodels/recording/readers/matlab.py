"""MATLAB's .mat files up to version 7, by SciPy; version 7.3 is HDF5."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from fieldmodels.recording.data import RecordingError
from fieldmodels.recording.readers.nested import flattened
from fieldmodels.recording.tables import Series, SeriesTable, check_size, readable

_COMPRESSED = 15
_LABELS, _UNITS = ("label", "Name"), ("unit", "Unit")
_DATASET = (
    "for k = 1:numElements({0}), e = getElement({0}, k); s.(matlab.lang.makeValidName(e.Name)) = "
    "struct('t', e.Values.Time, 'data', squeeze(e.Values.Data)); end"
)
_EXPORTS = {
    "Simulink.SimulationData.Dataset": _DATASET,
    "Simulink.SimulationOutput": _DATASET.replace("{0}", "{0}.logsout"),
    "timeseries": "s = struct('t', {0}.Time, '{0}', squeeze({0}.Data));",
    "timetable": "s = timetable2table({0}); s.(1) = seconds(s.(1) - s.(1)(1)); "
    "s = table2struct(s, 'ToScalar', true);",
    "table": "s = table2struct({0}, 'ToScalar', true);",
}
"""Class of an object to the line of MATLAB that makes plain arrays of it."""


def read(path: Path) -> SeriesTable:
    """Read the variables of a file, structures by their fields; objects are refused or left out."""
    from scipy.io import loadmat
    from scipy.io.matlab import MatlabOpaque

    with path.open("rb") as opening:
        octave = opening.read(9) == b"# Created"
    if octave:
        name = path.with_suffix(".v7.mat").name
        raise RecordingError(
            f"{path}: Octave's text; load it there and write it by `save -v7 {name}`, which is read"
        )
    with readable(path, "MATLAB file"):
        check_size(path, _unpacked(path) // 8, 1)
        data = loadmat(path, squeeze_me=True, struct_as_record=False)
    named: list[Any] = [v.item() for v in data.values() if isinstance(v, MatlabOpaque)]
    objects = {name.decode("latin-1"): kind.decode("latin-1") for name, _, kind, _ in named}
    plain = {k: v for k, v in data.items() if not k.startswith("__") and not isinstance(v, MatlabOpaque)}
    return without_objects(path, flattened({k: _plain(v) for k, v in plain.items()}), objects)


def without_objects(path: Path, series: Mapping[str, Series], objects: Mapping[str, str]) -> SeriesTable:
    """The columns of a file of MATLAB that also holds objects, which are noted.

    Args:
        path: The file.
        series: Its columns.
        objects: Name of an object to its class.

    Raises:
        RecordingError: If there are objects alone, with the lines of MATLAB that export the first one.
    """
    if objects and not series:
        name, kind = next(iter(objects.items()))
        line = _EXPORTS.get(kind, "s = struct('t', TIMES, 'y', VALUES);  % of {0}").format(name)
        raise RecordingError(
            f"{path}: {name} is a {kind}, an object that only MATLAB reads: export it there by two lines\n"
            f"  {line}\n  save('plain.mat', '-struct', 's', '-v7')"
        )
    table = SeriesTable(path, series)
    table.notes = tuple(f"{name} is a {kind}, an object, and is left out" for name, kind in objects.items())
    return table


def _plain(value: Any) -> Any:
    """Structures as dictionaries; an array of them by their labels (Simulink, ControlDesk) or numbers."""
    if hasattr(value, "_fieldnames"):
        fields = {name: _plain(getattr(value, name)) for name in value._fieldnames}
        label, unit = (next((fields[n] for n in told if n in fields), "") for told in (_LABELS, _UNITS))
        values = next((fields[n] for n in ("values", "Data") if n in fields), None)
        if isinstance(label, str) and label and values is not None:
            return {f"{label} [{unit}]" if isinstance(unit, str) and unit else label: values}
        return fields
    if isinstance(value, np.ndarray) and value.dtype == object:
        plain = [_plain(one) for one in value.ravel()]
        if all(isinstance(one, dict) for one in plain):
            single = [one for one in plain if len(one) == 1]
            if len({k for one in single for k in one}) == len(plain):
                return {k: v for one in single for k, v in one.items()}
            return {str(k + 1): one for k, one in enumerate(plain)}
        return {str(k + 1): one for k, one in enumerate(plain) if isinstance(one, np.ndarray)}
    return value


def _unpacked(path: Path) -> int:
    """Bytes of all variables once they are unpacked, from the first bytes of each."""
    total = 0
    with path.open("rb") as file:
        start = file.read(128)
        if not start.startswith(b"MATLAB"):  # version 4: nothing is packed
            return path.stat().st_size
        order = "<" if start[126:128] == b"IM" else ">"
        while len(tag := file.read(8)) == 8:
            kind, size = struct.unpack(f"{order}II", tag)
            if kind == _COMPRESSED:
                packed = file.read(min(size, 64))
                inner = zlib.decompressobj().decompress(packed, 8)
                total += struct.unpack(f"{order}II", inner)[1] if len(inner) == 8 else 0
                size -= len(packed)
            else:
                total += size
            file.seek(size, 1)
    return total
