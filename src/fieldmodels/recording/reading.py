"""Any log as a table: the file's first bytes say its format, its name only what these leave open."""

from __future__ import annotations

import difflib
from importlib import import_module
from pathlib import Path

from fieldmodels.extras import words
from fieldmodels.recording.data import RecordingError
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
    (b"SQLite format 3", "ros"),
    (b"\x89MCAP0", "ros"),
)
_SUFFIXES = {
    ".parquet": "arrow", ".pq": "arrow", ".feather": "arrow", ".arrow": "arrow",
    ".xlsx": "excel", ".xlsm": "excel", ".xlsb": "excel", ".xls": "excel", ".ods": "excel",
    ".npy": "numpy_files", ".npz": "numpy_files", ".json": "json_files", ".jsonl": "json_files",
    ".ndjson": "json_files", ".mat": "matlab", ".h5": "hdf5", ".hdf5": "hdf5", ".mf4": "mdf", ".mdf": "mdf",
    ".bag": "ros", ".db3": "ros", ".mcap": "ros",
}  # fmt: skip


def read_table(path: str | Path) -> Table:
    """Open a log of any format and read its header: names and units of its columns, no roles.

    A text's dialect (encoding, separator, decimal comma, thousands, comments, preamble, a row of units, no
    header, dates, gzip) is found from its first lines. Values are loaded by ``Table.read(names)`` or
    ``table[name]``; ``Table.header``, ``Table.units`` and ``Table.clocks`` are known at once.

    Args:
        path: A file, or the folder of a ROS 2 bag.

    Raises:
        RecordingError: If the file is missing, of no known format, damaged or too large, or needs an extra
            that is not installed.
    """
    path = Path(path)
    if not path.exists():
        raise RecordingError(f"{path}: no such file{_near(path)}")
    if path.is_dir() and not (path / "metadata.yaml").exists():
        inside = sorted(p.name for p in path.iterdir() if p.suffix.lower() in (".csv", *_SUFFIXES))
        found = f"; it holds {', '.join(inside[:SHOWN])}" if inside else ""
        raise RecordingError(f"{path}: is a directory, not a file{found}")
    if not path.is_file() and not path.is_dir():
        raise RecordingError(f"{path}: is a device or a pipe, not a file")
    try:
        kind = "ros" if path.is_dir() else _kind(path)
        if kind == "text":
            return TextTable(path)
        table: Table = import_module(f"fieldmodels.recording.readers.{kind}").read(path)
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
