"""The tasks that exist: one small module each, apart from the environment so that a list of them is cheap."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

from fieldgym.foreign import foreign_task, is_foreign
from fieldgym.task import BenchTask, Task
from fieldmodels.model_files import split_class


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


def find_task(name: str) -> Task:
    """A task, a bench of one's own or a third-party environment as a task; nothing is imported or run for it.

    Args:
        name: Of ``TASKS``; of an environment of Gymnasium, such as ``Pendulum-v1`` or ``module:Id``; or else
            of a machine, as ``fieldmodels.registry.get_model`` takes it.
    """
    if name in TASKS:
        return TASKS[name]
    if is_foreign(name):
        return foreign_task(name)
    stem = Path(split_class(name)[0]).stem
    return BenchTask(
        stem, stem, "Follow a reference.", module="bench", settings_name="BenchSettings", model=name
    )
