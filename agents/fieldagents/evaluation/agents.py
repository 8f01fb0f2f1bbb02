"""Who can take part in an evaluation: reference agents, trained policies, agents of one's own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from fieldagents.agent import Agent, AgentError, own_agent
from fieldagents.policies import zoo
from fieldagents.policies.policy import OnnxAgent
from fieldagents.task import Drives, get_task
from fieldmodels.names import did_you_mean

DRIVES = (".csv", ".parquet")
"""Endings of recorded drives."""


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
        described.append({"name": entry.name, "sees": entry.sees, "title": entry.title})
    return described


def known_agent(name: str, task: str) -> str:
    """What is wrong with the name of a participant; empty if it can be made.

    Args:
        name: See `make_agent`.
        task: Name of the task.
    """
    if name in agent_names(task):
        return ""
    if is_import_path(name):
        try:
            resolve_name(name)
        except (Exception, SystemExit) as error:  # of a user's module, which may do anything
            return f"{name!r} cannot be imported: {type(error).__name__}: {error}"
        return ""
    if name.endswith(DRIVES):
        if not get_task(task).drives:
            return f"{name}: task {task!r} has no agent that learns from recorded drives"
        return "" if Path(name).is_file() else f"no such file: {name}"
    if name.endswith((".zip", ".onnx", ".pkl")):
        missing = [one for one in saved(name) if not Path(one).is_file()]
        return f"no such file: {missing[0]}" if missing else ""
    if Path(name).is_dir():
        return "" if policies(name) else f"no policy.onnx in this folder: {name}"
    return f"there is no agent {name!r}{did_you_mean(name, agent_names(task))}"


def make_agent(name: str, task: str, settings: Mapping[str, Any], trust_pickle: bool = False) -> AgentRuns:
    """Build a participant.

    Args:
        name: Name of a reference agent or of a zoo entry; the path of a ``policy.onnx``, of a training run's
            folder, of a folder of such runs (one participant, whose verdicts are over its runs), of a
            ``.zip`` of Stable-Baselines3, alone or with the statistics of its ``VecNormalize``
            (``policy.zip+vecnormalize.pkl``), or of recorded drives (``.csv``, ``.parquet``) that teach; or
            ``module:Class`` of an ``Agent`` of one's own, called with the settings.
        task: Name of the task.
        settings: The environment's settings: which tuned values or which training fits them best.
        trust_pickle: Whether files of Stable-Baselines3 may be loaded: they hold pickles, which run whatever
            code their author has put there.

    Raises:
        AgentError: If there is no such agent, or a ``.zip`` is not trusted.
        RecordingError: If recorded drives cannot teach.
    """
    if problem := known_agent(name, task):
        raise AgentError(problem)
    if name in (known := get_task(task).agents):
        return AgentRuns(name, (known[name].make(settings),))
    if is_import_path(name):
        return AgentRuns(name, (own_agent(name, settings),))
    if name.endswith(DRIVES):
        return AgentRuns(name, (keep_drives(task, Path(name), settings).agent(),))
    if name.endswith((".zip", ".pkl")):
        if not trust_pickle:
            raise AgentError(
                f"{name}: files of Stable-Baselines3 hold pickles, which run any code that their author has"
                " put there; if you trust them, say --trust-pickle"
            )
        from fieldagents.policies.sb3 import Sb3Agent

        return AgentRuns(name, (Sb3Agent(*map(Path, saved(name))),), learned=True)
    if paths := policies(name):
        return AgentRuns(name, tuple(OnnxAgent(path, name=name) for path in paths), learned=True)
    return AgentRuns(name, zoo.get_entry(task, name).agents(settings), learned=True)


def saved(name: str) -> list[str]:
    """The files that a name stands for: of a policy, and of the statistics beside it if it names these."""
    policy, plus, statistics = name.rpartition("+")
    return [policy, statistics] if plus and statistics.endswith(".pkl") else [name]


def keep_drives(task: str, path: Path, settings: Mapping[str, Any]) -> Drives:
    """The drives of a file, which may not exist yet.

    Raises:
        AgentError: If the task has no agent that learns from drives.
        RecordingError: If the file is no recording of drives.
    """
    if not get_task(task).drives:
        raise AgentError(f"task {task!r} has no agent that learns from recorded drives")
    made: Drives = resolve_name(get_task(task).drives)(path, settings)
    return made


def is_import_path(name: str) -> bool:
    """Whether a name is ``module:Class``."""
    module, colon, attribute = name.partition(":")
    return bool(colon) and attribute.isidentifier() and all(part.isidentifier() for part in module.split("."))


def policies(name: str) -> list[Path]:
    """The policy files that a path stands for, in order."""
    path = Path(name)
    if path.is_file():
        return [path]
    whole = path / "policy.onnx"
    return [whole] if whole.is_file() else sorted(path.glob("*/policy.onnx"))
