"""NumPy's .npy and .npz files; pickled objects in them are refused."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from fieldmodels.recording.data import RecordingError
from fieldmodels.recording.readers.nested import flattened
from fieldmodels.recording.tables import SeriesTable, check_size, readable


def read(path: Path) -> SeriesTable:
    """Read a structured or plain array, or an archive of arrays."""
    with readable(path, "NumPy file without pickled objects"):
        if zipfile.is_zipfile(path):
            with zipfile.ZipFile(path) as archive:
                check_size(path, sum(part.file_size for part in archive.infolist()) // 8, 1)
            with np.load(path, allow_pickle=False) as arrays:
                found: Any = {name: _plain(path, arrays, name) for name in arrays.files}
        else:
            found = np.load(path, allow_pickle=False, mmap_mode="r")
    return SeriesTable(path, flattened(found))


def _plain(path: Path, arrays: Any, name: str) -> Any:
    """One array of an archive, which must not be pickled."""
    try:
        return arrays[name]
    except ValueError:
        load = f"numpy.load({path.name!r}, allow_pickle=True)[{name!r}].item()"
        raise RecordingError(
            f"{path}: {name!r} is pickled, which may run code when opened: if you trust it, write plain "
            f"arrays by `numpy.savez('plain.npz', **{load})`"
        ) from None
