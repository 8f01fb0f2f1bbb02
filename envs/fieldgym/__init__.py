"""The tasks as Gymnasium environments over the models; importing this package registers them."""

from gymnasium.envs.registration import register as _register
from gymnasium.envs.registration import registry

from fieldgym.film import RecordVideo
from fieldgym.settings import SettingsError
from fieldgym.task import BENCH, Task
from fieldgym.tasks import TASKS, find_task

__all__ = ["BENCH", "TASKS", "RecordVideo", "SettingsError", "Task", "find_task", "register"]


def register() -> None:
    """Register every task with Gymnasium; a second call does nothing."""
    for task in TASKS.values():
        if task.env_id not in registry:
            _register(task.env_id, task.entry_point, vector_entry_point=task.vector_entry_point)
    if BENCH not in registry:
        _register(BENCH, "fieldgym.bench:make_bench", vector_entry_point="fieldgym.bench:make_bench")


register()
