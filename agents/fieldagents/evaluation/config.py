"""What `fieldgym evaluate` reads."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from fieldagents.config import Config, Name, Problems, TaskEnvironment, TaskName, checked
from fieldagents.evaluation.agents import known_agent
from fieldagents.seeds import LARGEST_SEED, TEST_SEEDS
from fieldmodels.names import did_you_mean


def _wrong_agents(agents: list[str], task: str) -> Problems:
    for i, name in enumerate(agents):
        if name in agents[:i]:
            yield (i,), f"agent {name!r} is listed twice"
        elif problem := known_agent(name, task):
            yield (i,), problem


def _not_among(baseline: str, agents: list[str]) -> Problems:
    if baseline not in agents:
        yield (), f"{baseline!r} is not among the agents{did_you_mean(baseline, agents)}"


def _unknown(baseline: str, task: str) -> Problems:
    if problem := known_agent(baseline, task):
        yield (), problem


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
        first_seed: Seed of the first episode, in place of the first published one: repeats a comparison on
            other episodes.
    """

    name: Name
    task: TaskName
    environments: dict[Name, TaskEnvironment] = Field(min_length=1)
    agents: Annotated[list[str], Field(min_length=1), checked(_wrong_agents, "task")]
    baseline: Annotated[str, checked(_not_among, "agents"), checked(_unknown, "task")]
    trust_pickle: bool = False
    episodes: int = Field(default=100, ge=2, le=10_000)
    first_seed: int = Field(default=TEST_SEEDS.start, ge=TEST_SEEDS.start, le=LARGEST_SEED - 10_000)
