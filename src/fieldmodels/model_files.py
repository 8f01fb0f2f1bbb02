"""A user's own model in a Python file: run, found and checked.

Running a file runs its author's code with the user's rights; so only a file that the user names is run, and
never one that a result or a recording mentions.
"""

from __future__ import annotations

import importlib.util
import inspect
import pickle
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

from fieldmodels.contract import check_declarations
from fieldmodels.guard import guard_model, located
from fieldmodels.model import Model, ModelError
from fieldmodels.names import did_you_mean


def is_model_file(name: str) -> bool:
    """Whether a model's name means a Python file: ``my_bench.py``, or ``my_bench.py:MyBench``."""
    return split_class(name)[0].endswith(".py")


def split_class(name: str) -> tuple[str, str]:
    """Split ``my_bench.py:MyBench``; the class is empty if none is named."""
    path, colon, chosen = name.rpartition(":")
    return (path, chosen) if colon and path.endswith(".py") else (name, "")


def load_model_file(name: str, call_limit: float | None = None) -> Model:
    """Run a Python file and return its model: declarations checked, and every later call under guard.

    Args:
        name: Path of the file; if it defines several models, with the class behind a colon.
        call_limit: Processor time that one call into it may take [s]; None for no limit.

    Raises:
        ModelError: If there is no such file, it fails, it has no model or several, or the model misses
            methods or declarations; names the file and, where there is one, the line.
    """
    text, chosen = split_class(name)
    path = Path(text)
    if not path.is_file():
        near = [str(p) for p in path.parent.glob("*.py")] if path.parent.is_dir() else []
        raise ModelError(f"{path}: no such file{did_you_mean(str(path), near) if near else ''}")
    module = _run(path)
    found = {
        key: value
        for key, value in vars(module).items()
        if isinstance(value, type) and issubclass(value, Model) and value.__module__ == module.__name__
    }
    if not found:
        raise ModelError(
            f"{path}: defines no model; write a class that inherits from fieldmodels.model.Model"
        )
    if chosen and chosen not in found:
        raise ModelError(f"{path}: has no model {chosen!r}{did_you_mean(chosen, found)}")
    if not chosen and len(found) > 1:
        names = " or ".join(f"{path}:{key}" for key in found)
        raise ModelError(f"{path}: defines {len(found)} models; say which: {names}")
    kind = found[chosen] if chosen else next(iter(found.values()))
    missing = sorted(getattr(kind, "__abstractmethods__", ()))
    if missing:
        line = inspect.getsourcelines(kind)[1]
        raise ModelError(f"{path}:{line}: {kind.__name__} does not implement {' and '.join(missing)}")
    from fieldmodels.drivers.declaration import Declaration  # Numba takes half a second to be imported
    from fieldmodels.drivers.methods import check_methods

    guard_model(kind, path, call_limit)
    kind.file = f"{path.resolve()}:{kind.__name__}"
    kind.__reduce__ = _reduced  # type: ignore[method-assign, assignment]
    with located(path, f"{kind.__name__}()"):
        model = kind()
        check_declarations(model, str(path))
        if isinstance(model, Declaration):
            check_methods(model)
    return model


def _reduced(model: Model) -> tuple[Any, ...]:
    """A pickle of a model from a file, which loads the file again: no module has its class."""
    if "file" not in vars(type(model)):  # a class made of it at run time
        raise pickle.PicklingError(f"{type(model).__name__} was made at run time; pickle what it was made of")
    return _unpickled, (type(model).file,), model.__getstate__()


def _unpickled(name: str) -> Model:
    return object.__new__(type(load_model_file(name)))


def _run(path: Path) -> ModuleType:
    """Run a file as a module of its own; it may import its neighbours, as a script may."""
    name = f"fieldgym_model_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path.resolve())
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses and caches of compiled functions look it up
    sys.path.insert(0, str(path.resolve().parent))
    try:
        with located(path):
            spec.loader.exec_module(module)
    finally:
        sys.path.remove(str(path.resolve().parent))
    return module
