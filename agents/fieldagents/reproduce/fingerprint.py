"""What a run's result rests on: a hash over the code that a task's figures can reach."""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterator
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from fieldagents.task import FOLDERS

PACKAGES = ("fieldmodels", "fieldgym", "fieldagents")
DATA = (".json", ".yaml", ".csv", ".j2", ".onnx")


@cache
def fingerprint(task: str) -> str:
    """Hash over the source of all modules that a task's folder imports, wherever in them the import stands.

    Beside the agents' folder those of the task's environment and models count, since these are found by name,
    and the data files beside each module. A claim's text and bounds do not count: verdicts are computed anew
    each time.
    """
    digest = hashlib.sha256()
    for path in sorted(_files(task)):
        digest.update(path.name.encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


def _files(task: str) -> set[Path]:
    waiting = [
        module
        for root in (f"{FOLDERS}.{task}", f"fieldmodels.machines.{task}", f"fieldgym.{task}")
        for module in (root, *_modules(root))
    ]
    waiting.append(f"fieldgym.tasks.{task}")
    files: set[Path] = set()
    seen = {f"{FOLDERS}.{task}.claims"}
    while waiting:
        name = waiting.pop()
        if name in seen:
            continue
        seen.add(name)
        if (path := _source(name)) is not None:
            files.add(path)
            files.update(beside for beside in path.parent.iterdir() if beside.suffix in DATA)
            waiting += _imports(path)
    return files


def _modules(root: str) -> list[str]:
    """Every module of a package; none where nothing, or a single module, has the name."""
    spec = find_spec(root)
    places = spec.submodule_search_locations if spec else None
    return [f"{root}.{path.stem}" for place in places or () for path in Path(place).glob("*.py")]


def _source(name: str) -> Path | None:
    """The file of one of our modules; None for a name inside a module."""
    try:
        spec = find_spec(name)
    except ModuleNotFoundError:
        return None
    return Path(spec.origin) if spec is not None and spec.origin is not None else None


@cache
def _imports(path: Path) -> tuple[str, ...]:
    return tuple(
        found
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        for found in _imported(node)
        if found.split(".")[0] in PACKAGES
    )


def _imported(node: ast.AST) -> Iterator[str]:
    """What a statement may import: a name after ``import`` may be a module or stand in one."""
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names)
    elif isinstance(node, ast.ImportFrom) and node.module is not None:
        yield node.module
        yield from (f"{node.module}.{alias.name}" for alias in node.names)
