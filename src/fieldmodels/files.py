"""Writing to disk: a file is either the old one or the new one, whole; a folder has one writer at a time."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

try:
    import fcntl
except ImportError:  # Windows: writers are not kept apart
    fcntl = None  # type: ignore[assignment]

PART = ".part"
"""Of the names of files that are being written."""
LOCK = ".lock"


class OutputError(ValueError):
    """A place that cannot be written, or that another process is writing."""


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a temporary path beside ``path``; on success it takes its place, on error it vanishes.

    Raises:
        OutputError: If the disk is full or fails, or the place cannot be written.
    """
    temporary: Path | None = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=PART + path.suffix)
        temporary = Path(name)
        os.close(handle)
        yield temporary
        with temporary.open("r+b") as file:
            os.fsync(file.fileno())
        temporary.chmod(0o644)
        temporary.replace(path)
    except OSError as error:
        if error.filename not in (None, str(path.parent), str(path), temporary and str(temporary)):
            raise  # of what the caller read
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from error
    finally:
        if temporary is not None:
            with suppress(OSError):
                temporary.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write UTF-8 text atomically."""
    write_bytes(path, text.encode("utf-8"))


def write_bytes(path: Path, data: bytes | memoryview) -> None:
    """Write bytes atomically."""
    with replacing(path) as temporary:
        temporary.write_bytes(data)


@contextmanager
def claimed(folder: Path) -> Iterator[Path]:
    """Hold a folder as its only writer: shown to be writable before any work, removed if it stays empty.

    What a killed writer has left half written is removed. The lock ends with the process, however it ends.

    Raises:
        OutputError: If the folder cannot be made or written, or another process holds it.
    """
    made = not folder.exists()
    with _locked(folder):
        for left in folder.rglob(f".*{PART}*"):
            with suppress(OSError):
                left.unlink()
        try:
            yield folder
        finally:
            with suppress(OSError):
                (folder / LOCK).unlink()
                if made:
                    folder.rmdir()


def _locked(folder: Path) -> IO[str]:
    """The lock of a folder, held until it is closed."""
    path = folder / LOCK
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = path.open("a")
    except FileExistsError:
        raise OutputError(f"{folder}: not a folder; name another place for results") from None
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written: {error.strerror}; name another place") from error
    if fcntl is not None:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            lock.close()
            raise OutputError(
                f"{folder}: another process is writing here; wait for it, or name another place"
            ) from None
        except OSError:  # a file system without locks
            return lock
        if not path.exists() or path.stat().st_ino != os.fstat(lock.fileno()).st_ino:
            lock.close()  # its holder removed it in between
            return _locked(folder)
    return lock


def _seen(path: Path) -> bool:
    """Whether there is such a path; not if nobody may look, so that its parent decides."""
    try:
        return path.exists()
    except PermissionError:
        return False


def check_writable(folder: Path) -> None:
    """Make sure that a folder can be made and written, without leaving a trace.

    Raises:
        OutputError: If it cannot.
    """
    there = next(path for path in (folder.absolute(), *folder.absolute().parents) if _seen(path))
    if not there.is_dir():
        raise OutputError(f"{there}: not a folder; name another place for results")
    if not os.access(there, os.W_OK | os.X_OK):
        raise OutputError(f"{there}: cannot be written; name another place for results")
