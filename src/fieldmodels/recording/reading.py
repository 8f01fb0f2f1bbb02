"""Any log as a table: the file's first bytes say its format, its name only what these leave open."""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from fieldmodels.extras import words
from fieldmodels.recording.data import RecordingError
from fieldmodels.recording.long import a_column_each
from fieldmodels.recording.tables import SHOWN, Table
from fieldmodels.recording.text import TextTable

_MAGIC = (
    (b"PAR1", "arrow"),
    (b"ARROW1", "arrow"),
    (b"\xd0\xcf\x11\xe0", "excel"),
    (b"\x93NUMPY", "numpy_files"),
    (b"\x89HDF", "hdf5"),
    (b"MATLAB 7.3", "hdf5"),
    (b"MATLAB", "matlab"),
    (b"MDF ", "mdf"),
    (b"UnFinMF ", "mdf"),
    (b"#ROSBAG", "ros"),
    (b"SQLite format 3", "sqlite"),
    (b"\x89MCAP0", "ros"),
    (b"ULog", "ulog"),
    (b"\xa3\x95\x80", "dataflash"),
    (b"FMT, 128,", "dataflash"),
    (b"FMT,128,", "dataflash"),
    (b"# Created by Octave", "matlab"),
    (b"TDSm", "tdms"),
    (b"WPILOG", "wpilog"),
    (b"LabVIEW Measurement", "lvm"),
)
_CAN = re.compile(
    rb"\s*\(\d+\.\d+\)\s+\S+\s+[0-9A-Fa-f]+#|date [^\n]*\n\s*base (hex|dec)|;\$FILEVERSION|LOGG"
    rb"|timestamp,arbitration_id,"
)
"""How traces of candump, Vector (text and binary), PCAN and python-can begin."""
_FOLDERS = {"metadata.yaml": "ros", "meta/info.json": "lists"}
"""File that a folder holds to the module that reads it."""
DATABASES = (".dbc", ".arxml", ".kcd")
"""Endings of files that say what the messages on a bus hold."""
_SUFFIXES = {
    ".parquet": "arrow", ".pq": "arrow", ".feather": "arrow", ".arrow": "arrow",
    ".xlsx": "excel", ".xlsm": "excel", ".xlsb": "excel", ".xls": "excel", ".ods": "excel",
    ".npy": "numpy_files", ".npz": "numpy_files", ".json": "json_files", ".jsonl": "json_files",
    ".ndjson": "json_files", ".mat": "matlab", ".h5": "hdf5", ".hdf5": "hdf5", ".mf4": "mdf", ".mdf": "mdf",
    **dict.fromkeys(DATABASES, "can"), ".bag": "ros", ".db3": "ros", ".mcap": "ros", ".tlog": "mavlink",
    **dict.fromkeys(DATABASES, "can"),
}  # fmt: skip


def read_table(path: str | Path, databases: Sequence[str | Path] = ()) -> Table:
    """Open a log of any format and read its header: names and units of its columns, no roles.

    A text's dialect (encoding, separator, decimal comma, thousands, comments, preamble, a row of units, no
    header, dates, gzip) is found from its first lines. Values are loaded by ``Table.read(names)`` or
    ``table[name]``; ``Table.header``, ``Table.units`` and ``Table.clocks`` are known at once.

    Args:
        path: A file, or the folder of a ROS 2 bag or a LeRobot data set.
        databases: Files that say what the messages of a CAN trace hold; the only one beside it otherwise.

    Raises:
        RecordingError: If the file is missing, of no known format, damaged or too large, or needs an extra
            that is not installed.
    """
    path = Path(path)
    if not path.exists():
        raise RecordingError(f"{path}: no such file{_near(path)}")
    folder = next((kind for file, kind in _FOLDERS.items() if (path / file).exists()), "")
    if path.is_dir() and not folder:
        inside = sorted(p.name for p in path.iterdir() if p.suffix.lower() in (".csv", *_SUFFIXES))
        found = f"; it holds {', '.join(inside[:SHOWN])}" if inside else ""
        raise RecordingError(f"{path}: is a directory, not a file{found}")
    if not path.is_file() and not path.is_dir():
        raise RecordingError(f"{path}: is a device or a pipe, not a file")
    try:
        kind = "can" if databases else folder or _kind(path)
        if kind == "text":
            return a_column_each(TextTable(path))
        reader = import_module(f"fieldmodels.recording.readers.{kind}")
        table: Table = reader.read(path, databases) if databases else reader.read(path)
    except ModuleNotFoundError as error:
        if not (said := words(error)):
            raise
        raise RecordingError(f"{path}: {said}, or export the signals as CSV or Parquet") from None
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read ({error.strerror or error})") from None
    return table


def _kind(path: Path) -> str:
    """The module that reads a file."""
    with path.open("rb") as file:
        start = file.read(1024)
    for magic, kind in _MAGIC:
        if start.startswith(magic):
            return kind
    if _CAN.match(start):
        return "can"
    suffix = path.suffix.lower()
    if start[512:516] == b"\x89HDF":  # MATLAB 7.3 has 512 bytes of its own before it
        return "hdf5"
    if start.startswith(b"PK\x03\x04"):
        return "numpy_files" if suffix == ".npz" else "excel"
    return _SUFFIXES.get(suffix, "text")


def _near(path: Path) -> str:
    folder = path.parent
    if not folder.is_dir():
        return f" (there is no directory {folder})"
    close = difflib.get_close_matches(path.name, [p.name for p in folder.iterdir()], n=3, cutoff=0.6)
    return f" (did you mean {' or '.join(repr(str(folder / name)) for name in close)}?)" if close else ""
