"""Compiled kernels on disk: one file for each kernel, content and signature, so that none is ever stale.

A file's name says all that its content depends on. Hence there is no index that two processes could spoil for
each other, and nothing to be invalidated: whoever edits a helper asks for another name.
"""

import functools
import gc
import hashlib
import multiprocessing
import os
import pickle
import re
import sys
import time
import uuid
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
from numba.core import compiler, serialize
from numba.core.caching import _Cache

from fieldmodels.compiled.fingerprint import UnknownConstantError, describe_type, fingerprint
from fieldmodels.compiled.folder import cache_folder, candidates

SUFFIX = ".kernel"
# Versions of one kernel that stay on disk: those last used, so that several checkouts can share the folder.
VERSIONS = 4
UNUSED_DAYS = 60.0
MOST_BYTES = 1 << 30  # of all kernels together
# Settings of the compiler that change the code but are part of no signature.
SETTINGS = ("OPT", "LOOP_VECTORIZE", "SLP_VECTORIZE", "BOUNDSCHECK", "DEBUGINFO_DEFAULT")


class KernelCache(_Cache):
    """The cache of one kernel, in place of Numba's own, which watches only the file that holds the kernel."""

    def __init__(self, kernel: Any):
        self._kernel = kernel
        self._enabled = True
        function = kernel.py_func
        self._name = re.sub(r"[^\w.]", "_", f"{function.__module__}.{function.__qualname__}")[-120:]

    @property
    def cache_path(self) -> str | None:
        """The folder."""
        folder = cache_folder()
        return None if folder is None else str(folder)

    def enable(self) -> None:
        """Use the disk."""
        self._enabled = True

    def disable(self) -> None:
        """Leave the disk alone."""
        self._enabled = False

    def flush(self) -> None:
        """Remove this kernel's files."""
        for path in self._files(cache_folder()):
            _remove(path)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The compiled kernel of a signature, or None; whatever is wrong with a file, it is compiled anew."""
        target_context.refresh()
        name = self._file_name(sig, target_context.codegen())
        if name is None:
            return None
        for folder in dict.fromkeys(candidates()):  # a folder that cannot be written may still be warm
            try:
                content = (folder / name).read_bytes()
                digest, payload = content[:32], content[32:]
                if hashlib.sha256(payload).digest() != digest:
                    continue
                result = compiler.CompileResult._rebuild(target_context, *pickle.loads(payload))
            except Exception:
                continue
            _mark_used(folder / name)
            return result
        _say(self._name)
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a compiled kernel; where that fails the program goes on without."""
        _say()
        refuse_array(self._kernel, data)
        for constants in data._find_referenced_environments():  # those of its parts, too
            data.codegen.set_env(constants.env_name, constants)
        name = self._file_name(sig, data.codegen)
        if name is None or any(not one.can_cache for one in data.lifted) or data.library.has_dynamic_globals:
            return
        folder = cache_folder()
        if folder is None:
            _warn(
                "no folder can be written to keep compiled kernels: every process compiles anew. "
                "Let NUMBA_CACHE_DIR name a folder that can be written."
            )
            return
        payload = serialize.dumps(data._reduce())
        try:
            _write(folder / name, hashlib.sha256(payload).digest() + payload)
        except OSError as error:
            _warn(f"compiled kernels cannot be kept in {folder}: {error}")
            return
        self._remove_outdated(folder, name)
        _remove_unused(folder)

    def _file_name(self, sig: Any, codegen: Any) -> str | None:
        """The name under which a signature is kept; None if it cannot be."""
        if not self._enabled:
            return None
        kinds = [describe_type(kind) for kind in sig]
        if None in kinds:
            return None
        try:
            made_of = fingerprint(self._kernel)
        except UnknownConstantError as error:
            _warn(f"{error}; this kernel is compiled anew in every process")
            return None
        settings = [getattr(numba.config, name, None) for name in SETTINGS]
        target = (numba.__version__, sys.implementation.cache_tag, codegen.magic_tuple(), settings)
        signature = hashlib.sha256(repr((kinds, target)).encode()).hexdigest()
        return f"{self._name}-{made_of[:20]}-{signature[:20]}{SUFFIX}"

    def _files(self, folder: Path | None) -> list[Path]:
        return [] if folder is None else list(folder.glob(f"{self._name}-*-*{SUFFIX}"))

    def _remove_outdated(self, folder: Path, name: str) -> None:
        """Keep the few contents of this kernel that were used last."""
        used: dict[str, float] = {}
        files = self._files(folder)
        for path in files:
            used[_content(path.name)] = max(used.get(_content(path.name), 0.0), _last_use(path))
        used[_content(name)] = float("inf")
        kept = sorted(used, key=used.__getitem__)[-VERSIONS:]
        for path in files:
            if _content(path.name) not in kept:
                _remove(path)


_compiling: list[str] = []
_said: list[str] = []


def in_peace(work: Callable[..., Any]) -> Callable[..., Any]:
    """Compile without the collection of cyclic garbage, which goes through all that a compiler keeps.

    What cannot be compiled is no longer said to be under way.
    """

    def done(*arguments: Any) -> Any:
        collects, under_way = gc.isenabled(), len(_compiling)
        gc.disable()
        try:
            return work(*arguments)
        finally:
            if collects:
                _count_as_old()
                gc.enable()
            if len(_compiling) > under_way:
                _say()

    return done


def _count_as_old() -> None:
    """Leave what was compiled to the next full collection of garbage.

    As young objects they would be gone through at once, twice: a twelfth of a first step on a new machine.
    """
    if gc.get_freeze_count() == 0:  # what a program has frozen stays so
        gc.freeze()
        gc.unfreeze()


def _say(begun: str | None = None) -> None:
    """Say on standard error what is being compiled: in a terminal while it lasts, else once a process."""
    if begun is None and _compiling:
        _compiling.pop()
    elif begun is not None:
        _compiling.append(begun)
    if sys.stderr is None:
        return
    line = f"compiling, once on this machine: {_compiling[0]}" if _compiling else ""
    if sys.stderr.isatty():
        print(f"\r\x1b[K{line}", end="", file=sys.stderr, flush=True)
    elif line and not _said and multiprocessing.parent_process() is None:  # a worker's parent has said it
        _said.append(line)
        words = f"fieldgym: {line}, ... (some 5 to 15 s a task)"
        print(words, file=sys.stderr, flush=True)


def refuse_array(kernel: Any, data: Any) -> None:
    """Check what a compiled kernel returns.

    Raises:
        TypeError: If one that counts no references returns an array: its memory would be freed too early.
    """
    # A part that does not say whether it counts does as the kernel that calls it first.
    if not data.target_context.enable_nrt and _holds_array(data.signature.return_type):
        name = f"{kernel.py_func.__module__}.{kernel.py_func.__qualname__}"
        raise TypeError(f"{name} returns an array; compile it with compiled")


def _holds_array(kind: Any) -> bool:
    inside = getattr(kind, "types", ()) if isinstance(kind, numba.types.BaseTuple) else ()
    return isinstance(kind, numba.types.Array) or any(_holds_array(one) for one in inside)


def _content(name: str) -> str:
    return name.split("-")[-2]


def _write(path: Path, content: bytes) -> None:
    """Write whole or not at all, whoever else writes the same."""
    temporary = path.with_name(f"{path.name}.{uuid.uuid4().hex[:16]}.tmp")
    try:
        temporary.write_bytes(content)
        temporary.replace(path)
    except OSError:
        _remove(temporary)
        raise


@functools.cache
def _remove_unused(folder: Path) -> None:
    """Once per process: remove what nothing has used for long, and the oldest where all is too much.

    So kernels that are renamed, or generated anew for every change of a machine, do not pile up.
    """
    oldest = time.time() - UNUSED_DAYS * 86400.0
    room = MOST_BYTES
    paths = [path for path in folder.iterdir() if path.name.endswith((SUFFIX, ".tmp"))]
    for used, path in sorted(((_last_use(path), path) for path in paths), reverse=True):
        room -= _size(path)
        if used > 0.0 and (used < oldest or room < 0):
            _remove(path)


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:  # another process removed it
        return 0


def _last_use(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except OSError:  # another process removed it
        return 0.0


def _mark_used(path: Path) -> None:
    try:
        os.utime(path)
    except OSError:  # a folder that can only be read
        return


def _remove(path: Path) -> None:
    try:
        path.unlink()
    except OSError:
        return


@functools.cache
def _warn(message: str) -> None:
    """Say each thing once per process."""
    warnings.warn(message, RuntimeWarning, stacklevel=4)
