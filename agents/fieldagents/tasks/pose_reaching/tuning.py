"""Pose reaching: the table of own training data, made in any simulation."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import Field

from fieldagents.agent import Agent
from fieldagents.config import Config
from fieldagents.seeds import TRAINING_SEEDS
from fieldagents.task import Tuner
from fieldagents.tasks.pose_reaching.agents import table_driver
from fieldagents.tasks.pose_reaching.path_memory.practice import own_data
from fieldgym.pose_reaching import PoseReachingSettings
from fieldgym.settings import read_settings

PRACTISED = "Table of own training data, made by random motion and practice"


class Practice(Config):
    """How long the robot practises.

    Attributes:
        seconds: Robot time of the random motion, and again of each round of practice [s].
        rounds: Rounds of practice.
    """

    seconds: float = Field(default=300.0, ge=15.0, le=1e6)
    rounds: int = Field(default=6, ge=0, le=1000)


def practised(settings: Mapping[str, Any], reality: Any, options: Practice) -> Agent:
    """A table of what happened in a reality."""
    own = read_settings(settings, PoseReachingSettings)
    table = own_data(own, reality, seconds=options.seconds, rounds=options.rounds, seed=TRAINING_SEEDS[0])
    return table_driver(own, table)


TUNERS = (Tuner("own_data_practised", PRACTISED, Practice, practised),)
"""In the order of presentation."""
