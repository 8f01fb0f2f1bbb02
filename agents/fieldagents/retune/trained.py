"""What is tuned in a simulation: a tuner of the task, or a policy of any training config."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from pydantic import Field

from fieldagents.config import Config, EnvironmentConfig
from fieldagents.policies.policy import OnnxAgent
from fieldagents.sweep.config import changed
from fieldagents.task import Tuner, code_of, get_task
from fieldmodels.names import did_you_mean


class Training(Config):
    """How a policy is trained.

    Attributes:
        change: Keys of the training config (``steps``, ``learner.gamma``) to other values.
    """

    change: dict[str, Any] = Field(default_factory=dict)


def tuner_of(task: str, agent: str) -> Tuner:
    """The tuner of an agent that the task can tune, or of a training config such as ``heel_strike/ppo``.

    Raises:
        ValueError: If there is neither.
    """
    tuners = get_task(task).tuners
    if agent in tuners:
        return tuners[agent]
    if "/" not in agent and not agent.endswith(".yaml"):
        raise ValueError(
            f"no agent {agent!r} can be tuned anew{did_you_mean(agent, tuners)}; there are "
            f"{', '.join([*tuners, 'configs of training'])}"
        )
    if (config := changed(agent, {})).task != task:
        raise ValueError(f"{agent} trains for {config.task}, not for {task}")
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
    return [code_of(task, "fieldagents.learned", *modules), changed(agent, options.get("change", {})).hash]
