"""The folder in which compiled kernels and generated code are kept."""

import functools
import os
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from numba.core import config

APPLICATION = "fieldgym"


@functools.cache
def cache_folder() -> Path | None:
    """The first folder that can be written, found once per process; None where there is none.

    In this order: ``NUMBA_CACHE_DIR``, the user's cache folder (``XDG_CACHE_HOME``, ``~/.cache``;
    ``~/Library/Caches`` on macOS, ``%LOCALAPPDATA%`` on Windows), a private folder among the temporary files.
    """
    return next((folder for folder in candidates() if _writable(folder)), None)


def candidates() -> Iterator[Path]:
    """Every folder that may hold kernels of this user, whether it can be written or not."""
    named = getattr(config, "CACHE_DIR", "")  # NUMBA_CACHE_DIR, or set in the program
    if named:
        yield Path(named) / APPLICATION
    user = _user_cache()
    if user is not None:
        yield user / APPLICATION / "kernels"
    temporary = _private_temporary()
    if temporary is not None:
        yield temporary


def _user_cache() -> Path | None:
    try:
        if sys.platform == "win32":
            return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
        if sys.platform == "darwin":
            return Path.home() / "Library" / "Caches"
        return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    except RuntimeError:  # no home folder
        return None


def _private_temporary() -> Path | None:
    """A folder that nobody else can write: what is loaded from it is executed."""
    owner = os.getuid() if hasattr(os, "getuid") else None
    try:
        folder = Path(tempfile.gettempdir()) / (APPLICATION if owner is None else f"{APPLICATION}-{owner}")
        folder.mkdir(mode=0o700, exist_ok=True)
        status = folder.lstat()
    except OSError:
        return None
    ours = owner is None or (
        status.st_uid == owner and not status.st_mode & 0o022 and not folder.is_symlink()
    )
    return folder if ours else None


def _writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True
