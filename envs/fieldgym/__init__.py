"""The tasks as Gymnasium environments over the models; importing this package registers them."""

from typing import TYPE_CHECKING, Any

from gymnasium.envs.registration import register as _register
from gymnasium.envs.registration import registry

from fieldgym.settings import SettingsError
from fieldgym.task import BENCH, Task
from fieldgym.tasks import TASKS, find_task
from fieldmodels.extras import needed

if TYPE_CHECKING:
    from fieldgym.sb3 import make_sb3_vec

__all__ = [
    "BENCH",
    "TASKS",
    "SettingsError",
    "Task",
    "find_task",
    "make_sb3_vec",
    "register",
]


def __getattr__(name: str) -> Any:
    """What needs an extra is imported where it is asked for."""
    if name == "make_sb3_vec":
        needed("stable_baselines3")
        from fieldgym.sb3 import make_sb3_vec

        return make_sb3_vec
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def register() -> None:
    """Register every task with Gymnasium; a second call does nothing."""
    for task in TASKS.values():
        if task.env_id not in registry:
            _register(
                task.env_id,
                task.entry_point,
                reward_threshold=task.reward_threshold,
                vector_entry_point=task.vector_entry_point,
            )
    if BENCH not in registry:
        _register(BENCH, "fieldgym.bench:make_bench", vector_entry_point="fieldgym.bench:make_bench")


register()
