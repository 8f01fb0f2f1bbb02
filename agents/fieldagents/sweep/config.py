"""What `fieldgym sweep` reads."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import cached_property
from itertools import product
from pathlib import Path
from pkgutil import resolve_name
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from fieldagents.config import (
    Config,
    ConfigError,
    EnvironmentConfig,
    Name,
    Problems,
    TaskEnvironment,
    TaskName,
    checked,
    load_config,
)
from fieldagents.learned.config import VALIDATION_SEEDS, TrainConfig
from fieldagents.seeds import LARGEST_SEED
from fieldmodels.sampling import Normal, Sampler, read_sampler

GridRun = tuple[str, dict[str, Any], TrainConfig]
"""A run's base config by name, what it differs in, and its whole config."""


def _cannot_be_trained(
    grid: dict[str, list[Any]], train: tuple[str, ...], change: dict[str, Any]
) -> Problems:
    _expanded(train, change, grid)
    return ()


class SweepConfig(Config):
    """Training runs of every combination of some values.

    Attributes:
        name: Name of the result folder.
        train: Configs of training, files or names of shipped ones such as ``heel_strike/ppo``.
        change: Keys of these configs (``learner.gamma``) to the value that all runs have.
        grid: Keys to the values that runs differ in: seeds, hyper-parameters, settings, realities.
    """

    name: Name
    train: tuple[str, ...] = Field(min_length=1)
    change: dict[str, Any] = Field(default_factory=dict)
    grid: Annotated[dict[str, list[Any]], checked(_cannot_be_trained, "train", "change")] = Field(
        default_factory=dict, validate_default=True
    )

    @cached_property
    def runs(self) -> tuple[GridRun, ...]:
        """Each run of the grid."""
        return _expanded(self.train, self.change, self.grid)


def _cannot_be_searched(search: dict[str, Any]) -> Problems:
    for key, value in search.items():
        if isinstance(read_sampler(value, key), Normal):
            yield (), f"{key}: a search needs ends: uniform, log_uniform or choice"


class StudyConfig(Config):
    """A search: of a learner's hyper-parameters, or of a reference agent's numbers.

    Attributes:
        train: Config of training that is varied; or
        agent: ``module:function`` that makes an agent of settings and, by keyword, of what is searched.
        change: Keys of the training config to the value that all trials have.
        search: Keys to the samplers ``uniform``, ``log_uniform`` or ``choice``.
        seeds: Training runs of each trial, whose mean counts.
    """

    train: str | None = None
    agent: str | None = None
    change: dict[str, Any] = Field(default_factory=dict)
    search: Annotated[dict[str, Any], Field(min_length=1), checked(_cannot_be_searched)]
    seeds: int = Field(default=1, ge=1, le=20)

    @property
    def space(self) -> dict[str, Sampler]:
        """What is searched."""
        return {key: read_sampler(value, key) for key, value in self.search.items()}

    @model_validator(mode="after")
    def _one_of_both(self) -> StudyConfig:
        if (self.train is None) == (self.agent is None):
            raise ValueError("a study varies either a config (train) or an agent (agent)")
        if self.agent is not None:
            try:
                resolve_name(self.agent)
            except (ImportError, AttributeError, ValueError) as error:
                raise ValueError(f"agent {self.agent!r} cannot be imported: {error}") from None
        return self


def _no_rungs(rungs: tuple[float, ...]) -> Problems:
    if list(rungs) != sorted(set(rungs)) or any(not 0 < rung < 1 for rung in rungs):
        yield (), "parts between 0 and 1, each larger than the one before"


def _wrong_studies(studies: dict[str, StudyConfig], task: str) -> Problems:
    for name, study in studies.items():
        if study.train is not None:
            typical = {key: sampler.typical for key, sampler in study.space.items()}
            try:
                trained = changed(study.train, study.change | typical).task
            except ValueError as error:
                yield (name,), str(error)
                continue
            if trained != task:
                yield (name, "train"), f"trains {trained}, not {task}"


class TuneConfig(Config):
    """Searches with equal budgets, by the task's first metric on tuning seeds.

    Attributes:
        name: Name of the result folder.
        task: Name of the task.
        environment: Where all are trained and scored.
        budget: Environment steps of each study, beside those of scoring a learner; no trial begins that could
            exceed it.
        episodes: Tuning episodes that score a trial.
        batch: Trials that are drawn at once and done side by side. The result depends on it, and never on who
            does them or how fast.
        rungs: Parts of a training run after which the trials of a batch may be pruned.
        pruner: ``halving``, ``median`` or ``none``.
        sampler: ``tpe`` or ``random``.
        seed: Of the sampler.
        studies: A name of one's own to each search.
    """

    name: Name
    task: TaskName
    environment: TaskEnvironment = EnvironmentConfig()
    budget: int = Field(ge=1)
    episodes: int = Field(default=32, ge=1, le=len(VALIDATION_SEEDS))
    batch: int = Field(default=4, ge=1, le=1000)
    rungs: Annotated[tuple[float, ...], checked(_no_rungs)] = (0.25, 0.5)
    pruner: Literal["halving", "median", "none"] = "halving"
    sampler: Literal["tpe", "random"] = "tpe"
    seed: int = Field(default=0, ge=0, le=LARGEST_SEED)
    studies: Annotated[dict[Name, StudyConfig], Field(min_length=1), checked(_wrong_studies, "task")]


def _expanded(
    train: Sequence[str], change: Mapping[str, Any], grid: Mapping[str, list[Any]]
) -> tuple[GridRun, ...]:
    combinations = [dict(zip(grid, values, strict=True)) for values in product(*grid.values())]
    return tuple(
        (base, differs, changed(base, {**change, **differs})) for base in train for differs in combinations
    )


def changed(base: str, changes: Mapping[str, Any]) -> TrainConfig:
    """A training config with some of its keys changed.

    Raises:
        ValueError: With every mistake.
    """
    try:
        overrides = [f"{key}={json.dumps(value)}" for key, value in changes.items()]
        return load_config(Path(base), TrainConfig, overrides)
    except ConfigError as error:
        raise ValueError("; ".join(error.problems)) from None
