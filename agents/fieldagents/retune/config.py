"""What `fieldgym diagnose --then-retune` reads, and `fieldgym evaluate` for loops over drawn realities."""

from __future__ import annotations

from typing import Annotated, Any, Literal

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
from fieldagents.record.config import RecordConfig
from fieldagents.retune.trained import Training, tuner_of, wrong_conditioning
from fieldagents.seeds import TEST_SEEDS, TUNING_SEEDS
from fieldagents.sweep.config import changed
from fieldagents.task import get_task
from fieldgym import find_task
from fieldmodels.names import did_you_mean


def _unknown_agent(agent: str, task: str) -> Problems:
    tuner_of(task, agent)
    return ()


def _wrong_options(options: dict[str, Any], task: str, agent: str) -> Problems:
    tuner = tuner_of(task, agent)
    yield from (problems := list(invalid(options, tuner.options)))
    if not problems and tuner.options is Training:
        changed(agent, options.get("change", {}))
    elif not problems and tuner.conditioned and (problem := wrong_conditioning(task, tuner, options)):
        yield (), problem


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
        agent: What is made for each simulation: the name of a tuner of the task, or a config of training.
        options: Effort of the tuning; the tuner says which keys there are.
        settings: Keys of the task's settings, for tuning and for testing.
        hidden: The reality that the recording came from, where it is known (a simulated robot's): effects
            that are on, or a path. Without it the extended simulation stands for it.
        metric: Metric that the loss is counted in; by default the task's first.
        episodes: Number of episodes of every agent in every simulation, the same published seeds for all.
    """

    name: Name
    task: TaskName
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


def _nothing_to_draw(hidden: Any) -> Problems:
    if not isinstance(hidden, dict) or not hidden:
        yield (), "names faults to draw from, with their sizes: {gyro_bias: {rate: {uniform: [0, 0.01]}}}"


def _wrong_recording(record: dict[str, Any], task: str) -> Problems:
    drawn = [key for key in ("name", "machine", "model", "reality", "seed") if key in record]
    yield from (((key,), "follows from the reality that is drawn; leave it out") for key in drawn)
    if not drawn:
        yield from invalid({"name": "record", "machine": find_task(task).model, **record}, RecordConfig)


def _too_few_seeds(seeds: str, realities: int, episodes: int) -> Problems:
    if realities * episodes > (most := len(seeds_of(seeds))):
        yield (), f"{realities} realities of {episodes} episodes each need more than the {most} {seeds} seeds"


def seeds_of(name: str) -> range:
    """Seeds of what is published, or of what is still chosen: those that no search begins with."""
    return TEST_SEEDS if name == "test" else TUNING_SEEDS[5000:]


class RealitiesConfig(RetuneConfig):
    """What `fieldgym evaluate` reads for loops over drawn realities: each is recorded, diagnosed, tuned for.

    Attributes:
        hidden: The faults that realities are drawn from, with samplers in place of their sizes.
        record: How each reality is recorded: keys of a config of `fieldgym record` but name, machine, reality
            and seed.
        episodes: Number of episodes of every agent in each reality, other seeds in each.
        realities: How many are drawn.
        together: Most faults that a reality has; from 1 on each number is as likely.
        seeds: Where realities, recordings and test episodes have their seeds from: ``test`` for what is
            published, ``tuning`` while something is still chosen.
    """

    hidden: Annotated[RealityConfig, checked(_nothing_to_draw), checked(_wrong_hidden, "task")]
    record: Annotated[dict[str, Any], checked(_wrong_recording, "task")]
    episodes: int = Field(default=50, ge=2, le=10_000)
    realities: int = Field(ge=2, le=1000)
    together: int = Field(default=2, ge=1, le=10)
    seeds: Annotated[Literal["test", "tuning"], checked(_too_few_seeds, "realities", "episodes")] = Field(
        default="test", validate_default=True
    )
