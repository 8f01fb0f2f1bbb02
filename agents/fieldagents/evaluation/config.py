"""What `fieldgym evaluate` reads."""

from __future__ import annotations

from pydantic import Field, ValidationInfo, field_validator

from fieldagents.config import (
    Config,
    Location,
    Name,
    ProblemsError,
    TaskEnvironment,
    TaskName,
)
from fieldagents.evaluation.agents import known_agent
from fieldmodels.names import did_you_mean


class EvaluateConfig(Config):
    """What `fieldgym evaluate` reads: which agents, on which environments, how many episodes.

    Attributes:
        name: Name of the result folder.
        task: Name of the task.
        environments: The scenarios: a name of one's own to settings and reality.
        agents: Names of reference or learned agents; paths of policies or of folders of training runs; or
            ``module:Class`` of an agent of one's own (see ``make_agent``).
        baseline: The agent that all others are compared with; it is in ``agents`` too.
        trust_pickle: Whether agents may be ``.zip`` files of Stable-Baselines3, whose pickles run any code
            that their author has put there.
        episodes: Number of episodes of every agent in every scenario, the same published seeds for all.
    """

    name: Name
    task: TaskName
    environments: dict[Name, TaskEnvironment] = Field(min_length=1)
    agents: list[str] = Field(min_length=1)
    baseline: str
    trust_pickle: bool = False
    episodes: int = Field(default=100, ge=2, le=10_000)

    @field_validator("agents")
    @classmethod
    def _agents_exist(cls, agents: list[str], info: ValidationInfo) -> list[str]:
        problems: list[tuple[Location, str]] = []
        for i, name in enumerate(agents):
            if name in agents[:i]:
                problems.append(((i,), f"agent {name!r} is listed twice"))
            elif "task" in info.data and (problem := known_agent(name, info.data["task"])):
                problems.append(((i,), problem))
        if problems:
            raise ProblemsError(problems)
        return agents

    @field_validator("baseline")
    @classmethod
    def _baseline_takes_part(cls, baseline: str, info: ValidationInfo) -> str:
        agents = info.data.get("agents")
        if agents is not None and baseline not in agents:
            raise ValueError(f"{baseline!r} is not among the agents{did_you_mean(baseline, agents)}")
        if agents is None and "task" in info.data and (problem := known_agent(baseline, info.data["task"])):
            raise ValueError(problem)
        return baseline
