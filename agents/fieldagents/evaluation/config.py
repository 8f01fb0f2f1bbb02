"""What `fieldgym evaluate` reads."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field, ValidationInfo, field_validator

from fieldagents.config import (
    Config,
    EnvironmentConfig,
    Location,
    Name,
    ProblemsError,
    check_environment,
    check_task,
)
from fieldagents.evaluation.agents import agent_names
from fieldmodels.names import did_you_mean


class EvaluateConfig(Config):
    """What `fieldgym evaluate` reads: which agents, on which environments, how many episodes.

    Attributes:
        name: Name of the result folder.
        task: Name of the task.
        environments: The scenarios: a name of one's own to settings and reality.
        agents: Names of reference or learned agents, or paths of ``policy.onnx`` files.
        baseline: The agent that all others are compared with; it is in ``agents`` too.
        episodes: Number of episodes of every agent in every scenario, the same published seeds for all.
    """

    name: Name
    task: str
    environments: dict[Name, EnvironmentConfig] = Field(min_length=1)
    agents: list[str] = Field(min_length=1)
    baseline: str
    episodes: int = Field(default=100, ge=2, le=10_000)

    @field_validator("task")
    @classmethod
    def _task_exists(cls, task: str) -> str:
        return check_task(task)

    @field_validator("environments")
    @classmethod
    def _environments_fit(
        cls, environments: dict[str, EnvironmentConfig], info: ValidationInfo
    ) -> dict[str, EnvironmentConfig]:
        problems: list[tuple[Location, str]] = []
        for name, environment in environments.items() if "task" in info.data else ():
            try:
                check_environment(info.data["task"], environment)
            except ProblemsError as error:
                problems += [((name, *at), message) for at, message in error.problems]
        if problems:
            raise ProblemsError(problems)
        return environments

    @field_validator("agents")
    @classmethod
    def _agents_exist(cls, agents: list[str], info: ValidationInfo) -> list[str]:
        problems: list[tuple[Location, str]] = []
        for i, name in enumerate(agents):
            if name in agents[:i]:
                problems.append(((i,), f"agent {name!r} is listed twice"))
            elif name.endswith(".onnx"):
                if not Path(name).is_file():
                    problems.append(((i,), f"no such file: {name}"))
            elif "task" in info.data and name not in (known := agent_names(info.data["task"])):
                problems.append(((i,), f"there is no agent {name!r}{did_you_mean(name, known)}"))
        if problems:
            raise ProblemsError(problems)
        return agents

    @field_validator("baseline")
    @classmethod
    def _baseline_takes_part(cls, baseline: str, info: ValidationInfo) -> str:
        agents = info.data.get("agents")
        if agents is not None and baseline not in agents:
            raise ValueError(f"{baseline!r} is not among the agents{did_you_mean(baseline, agents)}")
        if agents is None and "task" in info.data and not baseline.endswith(".onnx"):
            known = agent_names(info.data["task"])
            if baseline not in known:
                raise ValueError(f"there is no agent {baseline!r}{did_you_mean(baseline, known)}")
        return baseline
