"""What `fieldgym diagnose --then-retune` reads."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field

from fieldagents.config import (
    Config,
    Name,
    Problems,
    RealityConfig,
    TaskName,
    TaskSettings,
    checked,
    invalid,
    wrong_reality,
)
from fieldagents.task import all_tasks, get_task
from fieldgym import find_task
from fieldmodels.names import did_you_mean


def _without_tuners(task: str) -> Problems:
    if not get_task(task).tuners:
        others = ", ".join(one.name for one in all_tasks() if one.tuners)
        yield (), f"no agent of {task} can be tuned anew; tasks: {others}"


def _unknown_agent(agent: str, task: str) -> Problems:
    if agent not in (known := get_task(task).tuners):
        hint = did_you_mean(agent, known)
        yield (), f"no agent {agent!r} can be tuned anew{hint}; there are {', '.join(known)}"


def _wrong_options(options: dict[str, Any], task: str, agent: str) -> Problems:
    return invalid(options, get_task(task).tuners[agent].options)


def _wrong_hidden(hidden: Any, task: str) -> Problems:
    return wrong_reality(hidden, find_task(task).model)


def _does_not_count(metric: str | None, task: str) -> Problems:
    known = {one.name: one for one in get_task(task).metrics if not one.common}
    if metric is not None and metric not in known:
        yield (), f"there is no metric {metric!r}{did_you_mean(metric, known)}"
    elif metric is not None and known[metric].may_miss:
        yield (), f"{metric!r} has no value in some episodes; choose a metric that has one in all"


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
    task: Annotated[TaskName, checked(_without_tuners)]
    agent: Annotated[str, checked(_unknown_agent, "task")]
    options: Annotated[dict[str, Any], checked(_wrong_options, "task", "agent")] = Field(default_factory=dict)
    settings: TaskSettings = Field(default_factory=dict)
    hidden: Annotated[RealityConfig, checked(_wrong_hidden, "task")] = None
    metric: Annotated[str | None, checked(_does_not_count, "task")] = None
    episodes: int = Field(default=100, ge=2, le=10_000)

    @property
    def counted(self) -> str:
        """Name of the metric that the loss is counted in."""
        return self.metric or get_task(self.task).metrics[0].name
