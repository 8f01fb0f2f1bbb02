"""The tasks that exist: one small module each, apart from the environment so that a list of them is cheap."""

from __future__ import annotations

from importlib import import_module
from pkgutil import iter_modules

from fieldgym.task import Task


def _declared(name: str) -> Task:
    """The task that a module of this package declares.

    Raises:
        ValueError: If it is not named as its module is.
    """
    task: Task = import_module(f"{__name__}.{name}").TASK
    if task.name != name:
        raise ValueError(f"{__name__}.{name}: TASK is named {task.name!r}; a task is named as its module is")
    return task


TASKS: dict[str, Task] = {name: _declared(name) for name in sorted(m.name for m in iter_modules(__path__))}
"""By name."""
