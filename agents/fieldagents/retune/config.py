"""What `fieldgym diagnose --then-retune` reads."""

from __future__ import annotations

from typing import Any

from pydantic import Field, ValidationError, ValidationInfo, field_validator

from fieldagents.config import (
    Config,
    EnvironmentConfig,
    Name,
    ProblemsError,
    RealityConfig,
    TaskName,
    check_environment,
    check_reality,
    readable,
)
from fieldagents.task import all_tasks, get_task
from fieldgym import find_task
from fieldmodels.names import did_you_mean


class RetuneConfig(Config):
    """What `fieldgym diagnose --then-retune` reads: which agent is tuned anew, and where it is tested.

    Attributes:
        name: Name of the loop.
        task: Name of the task.
        agent: Name of a tuner of the task: the agent that is made for each simulation.
        options: Effort of the tuning; the tuner says which keys there are.
        settings: Keys of the task's settings, for tuning and for testing.
        hidden: The reality that the recording came from, where it is known (a simulated robot's): effects
            that are on, or a path. Without it the extended simulation stands for it.
        metric: Metric that the loss is counted in; by default the task's first.
        episodes: Number of episodes of every agent in every simulation, the same published seeds for all.
    """

    name: Name
    task: TaskName
    agent: str
    options: dict[str, Any] = Field(default_factory=dict)
    settings: dict[str, Any] = Field(default_factory=dict)
    hidden: RealityConfig = None
    metric: str | None = None
    episodes: int = Field(default=100, ge=2, le=10_000)

    @property
    def counted(self) -> str:
        """Name of the metric that the loss is counted in."""
        return self.metric or get_task(self.task).metrics[0].name

    @field_validator("task")
    @classmethod
    def _task_has_tuners(cls, task: str) -> str:
        if not get_task(task).tuners:
            others = ", ".join(one.name for one in all_tasks() if one.tuners)
            raise ValueError(f"no agent of {task} can be tuned anew; tasks: {others}")
        return task

    @field_validator("agent")
    @classmethod
    def _agent_exists(cls, agent: str, info: ValidationInfo) -> str:
        if "task" in info.data and agent not in (known := get_task(info.data["task"]).tuners):
            raise ValueError(
                f"no agent {agent!r} can be tuned anew{did_you_mean(agent, known)}; there are "
                f"{', '.join(known)}"
            )
        return agent

    @field_validator("options")
    @classmethod
    def _options_fit(cls, options: dict[str, Any], info: ValidationInfo) -> dict[str, Any]:
        if "task" in info.data and "agent" in info.data:
            kind = get_task(info.data["task"]).tuners[info.data["agent"]].options
            try:
                kind.model_validate(options)
            except ValidationError as error:
                raise ProblemsError(list(readable(error, kind))) from None
        return options

    @field_validator("settings")
    @classmethod
    def _settings_fit(cls, settings: dict[str, Any], info: ValidationInfo) -> dict[str, Any]:
        if "task" in info.data:
            try:
                check_environment(info.data["task"], EnvironmentConfig(settings=settings))
            except ProblemsError as error:
                raise ProblemsError([(at[1:], message) for at, message in error.problems]) from None
        return settings

    @field_validator("hidden")
    @classmethod
    def _hidden_fits(cls, hidden: Any, info: ValidationInfo) -> Any:
        if "task" in info.data:
            check_reality(find_task(info.data["task"]).model, hidden)
        return hidden

    @field_validator("metric")
    @classmethod
    def _metric_counts(cls, metric: str | None, info: ValidationInfo) -> str | None:
        if metric is None or "task" not in info.data:
            return metric
        known = {one.name: one for one in get_task(info.data["task"]).metrics if not one.common}
        if metric not in known:
            raise ValueError(f"there is no metric {metric!r}{did_you_mean(metric, known)}")
        if known[metric].may_miss:
            raise ValueError(f"{metric!r} has no value in some episodes; choose a metric that has one in all")
        return metric
