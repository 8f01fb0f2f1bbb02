"""Heel strike: the estimator's gains, searched on walks of any simulation."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import Field

from fieldagents.config import Config
from fieldagents.seeds import TUNING_SEEDS
from fieldagents.task import Tuner
from fieldagents.tasks.heel_strike import search as tuning
from fieldagents.tasks.heel_strike.agents import ADAPTIVE, FIXED_TUNED, GATED_TUNED, FixedGains, LinearRule
from fieldgym.heel_strike import HeelStrikeSettings
from fieldgym.settings import read_settings
from fieldmodels.machines.heel_strike import search


class Walks(Config):
    """On how many walks gains are searched.

    Attributes:
        walks: Walks of the environment's length.
    """

    walks: int = Field(default=tuning.WALKS, ge=1, le=5000)


class Search(Walks):
    """How long gains are searched.

    Attributes:
        evaluations: Candidates of the evolution strategy.
    """

    evaluations: int = Field(default=1500, ge=24, le=1_000_000)


class RuleSearch(Search):
    """How long a rule of the features is searched, after the fixed gains that it starts from.

    Attributes:
        rules: Candidates of the evolution strategy.
    """

    rules: int = Field(default=8000, ge=24, le=1_000_000)


def fixed(settings: Mapping[str, Any], reality: Any, options: Walks) -> FixedGains:
    """The best fixed S_MS and S_HR in a reality."""
    own = read_settings(settings, HeelStrikeSettings)
    return FixedGains(tuning.fixed_gains(_walks(own, reality, options), own.decay))


def gated(settings: Mapping[str, Any], reality: Any, options: Search) -> FixedGains:
    """The best fixed gains in a reality, S_MS apart for the time of the collision noise."""
    own = read_settings(settings, HeelStrikeSettings)
    return FixedGains(tuning.gated_gains(_walks(own, reality, options), own.decay, options.evaluations))


def adaptive(settings: Mapping[str, Any], reality: Any, options: RuleSearch) -> LinearRule:
    """The best linear rule of the features in a reality."""
    own = read_settings(settings, HeelStrikeSettings)
    walks = _walks(own, reality, options)
    start = tuning.gated_gains(walks, own.decay, options.evaluations)
    return LinearRule(*tuning.linear_rule(walks, start, own.decay, evaluations=options.rules))


def _walks(settings: HeelStrikeSettings, reality: Any, options: Walks) -> search.Walks:
    return tuning.recorded(settings, TUNING_SEEDS[: options.walks], reality)


def fixed_gains(settings: Mapping[str, Any], *, early: float, late: float, reset: float) -> FixedGains:
    """Fixed gains as a search tries them: S_MS early and late in the stride, and S_HR."""
    del settings
    return FixedGains((early, late, reset))


TUNERS = (
    Tuner("gated_tuned", GATED_TUNED, Search, gated),
    Tuner("fixed_tuned", FIXED_TUNED, Walks, fixed),
    Tuner("adaptive", ADAPTIVE, RuleSearch, adaptive),
)
"""In the order of presentation."""
