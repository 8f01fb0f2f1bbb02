"""MATLAB's .mat files up to version 7, by SciPy; version 7.3 is HDF5."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from fieldmodels.recording.readers.nested import flattened
from fieldmodels.recording.tables import SeriesTable, check_size, readable

_COMPRESSED = 15


def read(path: Path) -> SeriesTable:
    """Read the variables of a file, structures by their fields."""
    from scipy.io import loadmat

    with readable(path, "MATLAB file"):
        check_size(path, _unpacked(path) // 8, 1)
        data = loadmat(path, squeeze_me=True, struct_as_record=False)
    return SeriesTable(path, flattened({k: _plain(v) for k, v in data.items() if not k.startswith("__")}))


def _plain(value: Any) -> Any:
    """Structures as dictionaries; an array of them by their labels (Simulink's ``signals``) or numbers."""
    if hasattr(value, "_fieldnames"):
        fields = {name: _plain(getattr(value, name)) for name in value._fieldnames}
        label = fields.get("label")
        return (
            {label: fields["values"]} if isinstance(label, str) and label and "values" in fields else fields
        )
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
