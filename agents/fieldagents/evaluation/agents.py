"""Who can take part in an evaluation: reference agents, trained policies of the zoo, policy files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fieldagents.agent import Agent
from fieldagents.policies import zoo
from fieldagents.policies.policy import OnnxAgent
from fieldagents.task import get_task


@dataclass(frozen=True)
class AgentRuns:
    """A participant.

    Attributes:
        name: Its name in the results.
        runs: Its policies: one for each training run; a reference agent has a single one.
        learned: Whether it comes from training, so that the training run is the unit of replication.
    """

    name: str
    runs: tuple[Agent, ...]
    learned: bool = False

    @property
    def kind(self) -> str:
        """How its result is to be read: what it sees, or that it does not act at all."""
        return self.runs[0].kind


def agent_names(task: str) -> list[str]:
    """Names that an evaluation of this task knows."""
    return [*get_task(task).agents, *(entry.name for entry in zoo.list_zoo(task))]


def describe_agents(task: str) -> list[dict[str, str]]:
    """Name, rights and title of every agent of a task."""
    described = [
        {"name": one.name, "sees": one.kind, "title": one.title} for one in get_task(task).agents.values()
    ]
    for entry in zoo.list_zoo(task):
        described.append({"name": entry.name, "sees": "observation", "title": entry.title})
    return described


def make_agent(name: str, task: str, settings: Mapping[str, Any]) -> AgentRuns:
    """Build a participant.

    Args:
        name: Name of a reference agent or of a zoo entry, or the path of a ``policy.onnx``.
        task: Name of the task.
        settings: The environment's settings: which tuned values or which training fits them best.
    """
    if name.endswith(".onnx"):
        return AgentRuns(name, (OnnxAgent(Path(name)),), learned=True)
    if name in (known := get_task(task).agents):
        return AgentRuns(name, (known[name].make(settings),))
    return AgentRuns(name, zoo.get_entry(task, name).agents(settings), learned=True)
