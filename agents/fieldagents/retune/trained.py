"""What is made for a simulation: by a tuner of the task, by any training config, or a policy that is told."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, ClassVar

from pydantic import Field

from fieldagents.agent import Agent
from fieldagents.config import Config, EnvironmentConfig
from fieldagents.evaluation.agents import known_agent, make_agent, policies
from fieldagents.policies import zoo
from fieldagents.policies.conditioned import known
from fieldagents.policies.policy import OnnxAgent
from fieldagents.sweep.config import changed
from fieldagents.task import Tuner, code_of, get_task
from fieldmodels.names import did_you_mean
from fieldmodels.yaml import load_yaml


class Training(Config):
    """How a policy is trained.

    Attributes:
        change: Keys of the training config (``steps``, ``learner.gamma``) to other values.
    """

    change: dict[str, Any] = Field(default_factory=dict)


class Conditioning(Config):
    """How a policy is told of a reality.

    Attributes:
        conditioned: Whether it is given what a diagnosis has found: without, what training in random
            realities wins back by itself is measured.
        nominal: An agent of the nominal simulation, whose loss it is; by default the policy itself, which is
            told that nothing is missing.
        run: Which training run; over drawn realities, all of them unless one is given.
    """

    was: ClassVar[Mapping[str, str]] = {"told": "conditioned"}
    conditioned: bool = True
    nominal: str | None = None
    run: int = Field(default=0, ge=0)


def tuner_of(task: str, agent: str) -> Tuner:
    """What makes an agent for a reality.

    Args:
        task: Name of the task.
        agent: One that the task can tune; a training config such as ``heel_strike/ppo``; or a policy that is
            told of its machine: an entry of the zoo, a policy's file, or the folder of a run.

    Raises:
        ValueError: If there is none.
    """
    tuners = get_task(task).tuners
    if agent in tuners:
        return tuners[agent]
    if _conditioned_files(task, agent):
        title = "Policy of random realities, which is told the diagnosis"
        runs = len(make_agent(agent, task, {}).runs)
        return Tuner(agent, title, Conditioning, partial(condition, task, agent), conditioned=True, runs=runs)
    if "/" not in agent and not agent.endswith(".yaml"):
        raise ValueError(
            f"no agent {agent!r} can be tuned anew{did_you_mean(agent, tuners)}; there are "
            f"{', '.join([*tuners, 'configs of training'])}"
        )
    if (config := changed(agent, {})).task != task:
        raise ValueError(f"{agent} trains for {config.task}, not for {task}")
    if config.conditioned:
        raise ValueError(f"{agent} trains a policy that is told: train it, and name its run's folder here")
    title = f"Policy of {config.algorithm.rpartition(':')[2]}, trained as {agent} says"
    return Tuner(agent, title, Training, partial(train_in, agent))


def train_in(base: str, settings: Mapping[str, Any], reality: Any, options: Training) -> OnnxAgent:
    """A policy that is trained in a reality, from nothing.

    Args:
        base: The training config.
        settings: Of the environment, in place of the config's.
        reality: In place of the config's.
        options: What else is changed.
    """
    from fieldagents.learned.training import train

    where = EnvironmentConfig(settings=dict(settings), reality=reality)
    config = changed(base, options.change).model_copy(update={"environment": where})
    with TemporaryDirectory() as folder:
        run = train(config, progress=False, out=Path(folder) / "run")
        return OnnxAgent((run / "policy.onnx").read_bytes(), name=config.name)


def condition(
    task: str, agent: str, settings: Mapping[str, Any], reality: Any, options: Conditioning
) -> Agent:
    """A policy that is told of a reality.

    Args:
        task: Name of the task.
        agent: See `tuner_of`.
        settings: Of the environment.
        reality: The truth, a mapping; the path of an ``extended.yaml`` with a diagnosis' estimates and
            standard errors; or None for the nominal simulation.
        options: How it is told.
    """
    if reality is None and options.nominal is not None:
        runs = make_agent(options.nominal, task, settings).runs
        return runs[options.run % len(runs)]
    policy = make_agent(agent, task, settings).runs[options.run]
    assert isinstance(policy, OnnxAgent)
    if reality is None or isinstance(reality, Mapping):
        policy.diagnosis = known(policy.conditions, reality or {})
    elif options.conditioned:
        found = load_yaml(Path(reality))
        policy.condition({"parameters": found.get("parameters", {}), **found.get("effects", {})})
    return policy


def wrong_conditioning(task: str, tuner: Tuner, options: Mapping[str, Any]) -> str:
    """What is wrong with options that are of the right kinds; empty if nothing is."""
    asked = Conditioning.model_validate(options)
    if asked.nominal is not None and (problem := known_agent(asked.nominal, task)):
        return problem
    wrong = asked.run >= tuner.runs
    return f"{tuner.name} has {tuner.runs} training runs, numbered from 0" if wrong else ""


def _conditioned_files(task: str, agent: str) -> list[Path]:
    """The files of a policy that is told of its machine; none if it is no such policy."""
    for entry in zoo.list_zoo(task):
        if entry.name == agent and entry.sees == "diagnosis":
            return [training.policy(seed) for training in entry.trainings for seed in training.seeds]
    files = policies(agent)
    return files if files and OnnxAgent(files[0]).conditions else []


def code_behind(task: str, agent: str, options: Mapping[str, Any], *modules: str) -> list[str]:
    """Hashes of all that a tuned agent rests on beside its settings and reality.

    Args:
        task: Name of the task.
        agent: See `tuner_of`.
        options: Of its tuner.
        modules: Further modules that count.
    """
    if agent in get_task(task).tuners:
        return [code_of(task, *modules)]
    if files := _conditioned_files(task, agent):
        return [code_of(task, *modules), *(hashlib.sha256(one.read_bytes()).hexdigest() for one in files)]
    return [code_of(task, "fieldagents.learned", *modules), changed(agent, options.get("change", {})).hash]
