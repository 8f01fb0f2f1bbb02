"""What a result rests on: hashes over the code that it can reach, and over all of it."""

from __future__ import annotations

import ast
import hashlib
import sys
import sysconfig
from collections.abc import Iterable, Iterator
from functools import cache
from importlib.util import find_spec
from pathlib import Path

PACKAGES = ("fieldmodels", "fieldgym", "fieldagents")
DATA = (".json", ".yaml", ".csv", ".onnx")


@cache
def reached_code(roots: tuple[str, ...], without: tuple[str, ...] = ()) -> str:
    """Hash over all modules, ours and a user's own, that some modules import, wherever in them they do.

    Args:
        roots: Modules or packages; of a package every module counts. What does not exist is left out.
        without: Modules that do not count.
    """
    return _hashed(files_reached(roots, without))


@cache
def whole_code(*also: str) -> str:
    """Hash over the source of all of our packages that are installed, and of further ones."""
    folders = [
        Path(place)
        for name in dict.fromkeys((*PACKAGES, *also))
        if (spec := find_spec(name))
        for place in spec.submodule_search_locations or ()
    ]
    return _hashed(path for folder in folders for path in folder.rglob("*") if path.suffix == ".py")


def files_reached(roots: Iterable[str], without: Iterable[str] = ()) -> set[Path]:
    """The files behind `reached_code`, with the data files beside each module."""
    waiting = [module for root in roots for module in (root, *_modules(root))]
    files: set[Path] = set()
    seen = set(without)
    while waiting:
        name = waiting.pop()
        if name in seen:
            continue
        seen.add(name)
        if (path := _source(name)) is not None:
            files.add(path)
            if name.split(".")[0] in PACKAGES:
                files.update(beside for beside in path.parent.iterdir() if beside.suffix in DATA)
            waiting += _imports(path)
    return files


def _hashed(files: Iterable[Path]) -> str:
    digest = hashlib.sha256()
    for path in sorted(files):
        digest.update(path.name.encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


def _modules(root: str) -> list[str]:
    """Every module of a package; none where nothing, or a single module, has the name."""
    try:
        spec = find_spec(root)
    except ModuleNotFoundError:
        return []
    places = spec.submodule_search_locations if spec else None
    return [f"{root}.{path.stem}" for place in places or () for path in Path(place).glob("*.py")]


def _source(name: str) -> Path | None:
    """The file of one of our modules, found without importing any; None for a name inside a module."""
    first, *rest = name.split(".")
    spec = find_spec(first)
    if spec is None or not rest:
        return Path(spec.origin) if spec is not None and spec.origin is not None else None
    for place in spec.submodule_search_locations or ():
        inside = Path(place, *rest)
        for path in (inside / "__init__.py", inside.with_suffix(".py")):
            if path.is_file():
                return path
    return None


@cache
def _is_ours(package: str) -> bool:
    """Whether a package is of this project, or of a user's own that is not installed."""
    if package in PACKAGES:
        return True
    spec = None if package in sys.stdlib_module_names else find_spec(package)
    if spec is None or spec.origin is None:
        return False
    installed = (Path(sysconfig.get_path(name)) for name in ("purelib", "platlib"))
    return not any(Path(spec.origin).is_relative_to(folder) for folder in installed)


@cache
def _imports(path: Path) -> tuple[str, ...]:
    return tuple(
        found
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        for found in _imported(node)
        if _is_ours(found.split(".")[0])
    )


def _imported(node: ast.AST) -> Iterator[str]:
    """What a statement may import: a name after ``import`` may be a module or stand in one."""
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names)
    elif isinstance(node, ast.ImportFrom) and node.module is not None:
        yield node.module
        yield from (f"{node.module}.{alias.name}" for alias in node.names)
