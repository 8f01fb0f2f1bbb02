"""Excitation: commands decided beforehand, by the error that the filter ends with in any simulation."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from typing import Any

import numpy as np
from pydantic import Field

from fieldagents.config import Config
from fieldagents.seeds import TUNING_SEEDS
from fieldagents.task import Tuner
from fieldagents.tasks.excitation import search as tuning
from fieldagents.tasks.excitation.agents import Schedule
from fieldgym.excitation import ExcitationSettings
from fieldgym.settings import read_settings

CONSTANT = "The constant command of least error on a grid"
SCHEDULE = "A few commands in turn, by CMA-ES on the error at the end, from the best constant command on"

WIDTH = 0.3
"""Standard deviation of the search's first candidates, in the action's units."""


class Grid(Config):
    """On how many experiments a command is judged.

    Attributes:
        experiments: Experiments of the environment's length.
    """

    experiments: int = Field(default=tuning.EPISODES, ge=1, le=5000)


class Search(Grid):
    """How long a schedule is searched.

    Attributes:
        commands: Commands that take turns.
        evaluations: Schedules tried, after the grid of constant ones.
    """

    commands: int = Field(default=tuning.BLOCK, ge=1, le=100)
    evaluations: int = Field(default=400, ge=20, le=1_000_000)


def constant(settings: Mapping[str, Any], reality: Any, options: Grid) -> Schedule:
    """The constant command whose experiments end with the least error in a reality."""
    own = read_settings(settings, ExcitationSettings)
    return Schedule(_best_constant(own, reality, options)[None])


def schedule(settings: Mapping[str, Any], reality: Any, options: Search) -> Schedule:
    """The commands in turn whose experiments end with the least error in a reality."""
    own = read_settings(settings, ExcitationSettings)
    seeds = TUNING_SEEDS[: options.experiments]
    start = np.tile(_best_constant(own, reality, options), (options.commands, 1))
    actions = tuning.evolve(
        lambda tried: tuning.ending_errors(own, tried, seeds, reality),
        start,
        own.decisions,
        WIDTH,
        options.evaluations,
    )
    return Schedule(tuning.repeated(actions[None], own.decisions)[0])


def _best_constant(settings: ExcitationSettings, reality: Any, options: Grid) -> tuning.Floats:
    """The action of the best constant command, shape (3,)."""
    grid = 2.0 * np.array(list(product(*tuning.GRID))) - 1.0
    seeds = TUNING_SEEDS[: options.experiments]
    return np.asarray(grid[np.argmin(tuning.ending_errors(settings, grid[:, None], seeds, reality))])


def constant_command(settings: Mapping[str, Any], *, first: float, second: float, third: float) -> Schedule:
    """One command for the whole experiment as a search tries it, in the action's units."""
    del settings
    return Schedule([[first, second, third]])


TUNERS = (
    Tuner("schedule", SCHEDULE, Search, schedule),
    Tuner("best_constant", CONSTANT, Grid, constant),
)
"""In the order of presentation."""
