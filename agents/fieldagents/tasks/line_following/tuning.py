"""Line following: laws searched on walks of any simulation, and a regulator designed for its plant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import Field

from fieldagents.config import Config
from fieldagents.seeds import TUNING_SEEDS
from fieldagents.task import Tuner
from fieldagents.tasks.line_following import search as tuning
from fieldagents.tasks.line_following.agents import LQG_TITLE, MEMORY_TITLE, TUNED_TITLE, Linear, Lqg, tuned
from fieldgym.line_following import LineFollowingSettings
from fieldgym.settings import read_settings
from fieldmodels.drivers.named import apply_reality
from fieldmodels.machines.line_following.declaration import as_plants
from fieldmodels.machines.line_following.model import LineFollowing


class Walks(Config):
    """On how many walks a law is judged.

    Attributes:
        walks: Walks along the environment's own line.
    """

    walks: int = Field(default=tuning.WALKS, ge=1, le=5000)


class Search(Walks):
    """How long weights are searched.

    Attributes:
        rounds: Rounds of the evolution strategy, of 16 candidates each.
    """

    rounds: int = Field(default=100, ge=1, le=10_000)


def law(settings: Mapping[str, Any], reality: Any, options: Search) -> Linear:
    """Weights of the law (3.1), searched in a reality."""
    return _searched(list(tuning.RANGES), settings, reality, options)


def memory(settings: Mapping[str, Any], reality: Any, options: Search) -> Linear:
    """Weights of the last four places and turns, searched in a reality."""
    return _searched([*tuning.PLACES, *tuning.TURNS], settings, reality, options)


def _searched(entries: Sequence[int], settings: Mapping[str, Any], reality: Any, options: Search) -> Linear:
    """A linear law from the nominal law (3.1) on: every simulation's search begins there."""
    start = {int(entry): weight for entry, weight in tuned()["printed"]["weights"].items()}
    trials = _trials(tuning.CANDIDATES, settings, reality, options)
    weights = tuning.evolve_linear(entries, start, options.rounds, trials)
    return Linear(settings, weights)


def lqg(settings: Mapping[str, Any], reality: Any, options: Walks) -> Lqg:
    """Filter and regulator for a reality's plant, its two free numbers searched in that reality.

    The design knows the model's own effects; what stock effects do shows in the search only.
    """
    model, truth = apply_reality(LineFollowing(), reality)
    plant = as_plants(truth.vector(model)[: len(LineFollowing().names)])
    trials = _trials(1, settings, reality, options)

    def make(bend: float, effort: float) -> Lqg:
        return Lqg(settings, bend, effort, plant)

    return make(*min(tuning.LQG_CHOICES, key=lambda choice: tuning.agent_loss(make(*choice), trials)))


def regulator(settings: Mapping[str, Any], *, bend: float, effort: float) -> Lqg:
    """The regulator with the line's bend and the turns' cost as a search tries them."""
    return Lqg(settings, bend, effort)


def _trials(candidates: int, settings: Mapping[str, Any], reality: Any, options: Walks) -> tuning.Trials:
    own = read_settings(dict(settings), LineFollowingSettings)
    seeds = TUNING_SEEDS[: options.walks]
    return tuning.Trials(candidates, seeds, (own.track,), reality, **settings)


TUNERS = (
    Tuner("lqg", LQG_TITLE, Walks, lqg),
    Tuner("memory", MEMORY_TITLE, Search, memory),
    Tuner("tuned", TUNED_TITLE, Search, law),
)
"""In the order of presentation."""
