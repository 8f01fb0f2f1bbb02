"""Field-robot tasks as Gymnasium environments, and the diagnosis of measured logs: ``import fieldgym as fg``.

Importing it registers the environments; a name of ``__all__`` is imported where it is first used.
"""

from pkgutil import resolve_name
from typing import Any

from gymnasium.envs.registration import register as _register
from gymnasium.envs.registration import registry

from fieldgym.settings import SettingsError as SettingsError
from fieldgym.task import BENCH
from fieldgym.task import Task as Task
from fieldgym.tasks import TASKS
from fieldgym.tasks import find_task as find_task

_PLACES = {
    "Agent": "fieldagents.agent:Agent",
    "Diagnosis": "fieldagents.estimator:Diagnosis",
    "Effect": "fieldmodels.model:Effect",
    "Force": "fieldmodels.machine:Force",
    "Machine": "fieldmodels.machine:Machine",
    "Model": "fieldmodels.model:Model",
    "Parameter": "fieldmodels.model:Parameter",
    "Recording": "fieldmodels.recording:Recording",
    "Signal": "fieldmodels.model:Signal",
    "agents": "fieldagents.evaluation.agents:agent_names",
    "datasets": "fieldmodels.recording.datasets:dataset_names",
    "diagnose": "fieldagents.estimator:diagnose",
    "effects": "fieldmodels.effects",
    "evaluate": "fieldagents.api:evaluate",
    "get_machine": "fieldmodels.registry:get_model",
    "load": "fieldagents.logs:load",
    "machines": "fieldmodels.registry:model_names",
    "make_env": "fieldgym.bench:as_env",
    "make_sb3_vec": "fieldgym.sb3:make_sb3_vec",
    "number": "fieldmodels.machine:number",
    "reality": "fieldagents.api:reality",
    "retune": "fieldagents.api:retune",
    "save": "fieldmodels.recording.files:save_recording",
    "synthesise": "fieldmodels.synthesis:synthesise",
    "train": "fieldagents.api:train",
}
"""Public name to where it is; ``__init__.pyi`` says the same to type checkers."""
__all__ = [*_PLACES, "tasks"]


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    if name == "make_sb3_vec":
        from fieldmodels.extras import needed

        needed("stable_baselines3")
    found = globals()[name] = resolve_name(_PLACES[name])
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


def tasks() -> tuple[str, ...]:
    """Names of the tasks."""
    return tuple(TASKS)


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
