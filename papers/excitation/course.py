"""What an agent's experiments go through, decision by decision."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from gymnasium.utils.seeding import np_random
from numpy.typing import NDArray
from pydantic import Field

from fieldagents.agent import Agent
from fieldagents.seeds import TEST_SEEDS
from fieldagents.tasks.excitation.agents import to_command
from fieldgym.excitation import ExcitationSettings, known
from fieldmodels.machines.excitation.parameters import LIMITS
from fieldmodels.machines.excitation.shaker import Shakers

Floats = NDArray[np.float64]
SOURCE = "V. A. Sujan and S. Dubowsky, An optimal information method, IEEE/ASME TMech 8(2), 2003, "
Episodes = Annotated[int, Field(ge=3, le=1000)]


@dataclass(frozen=True)
class Course:
    """What an agent's experiments went through, decision by decision.

    Attributes:
        angle: Of the arm in the first experiment [rad], at the samples, shape (samples,).
        mean: Estimates of the compensated filter, shape (decisions + 1, episodes, 22).
        naive: Of the filter as published, of that shape.
        bits: Information about each parameter [bits], of that shape.
        command: Amplitude [rad], frequency [rad/s] and offset [rad] of each decision, shape (decisions,
            episodes, 3).
        truth: True values, shape (22,).
    """

    angle: Floats
    mean: Floats
    naive: Floats
    bits: Floats
    command: Floats
    truth: Floats

    def average(self, when: int | slice = -1, naive: bool = False) -> Floats:
        """Average |error| of the parameters that are not zero [%], as in Table I, shape (..., episodes)."""
        counted = self.truth != 0
        found = (self.naive if naive else self.mean)[when][..., counted]
        return np.asarray(
            100 * (np.abs(found - self.truth[counted]) / np.abs(self.truth[counted])).mean(axis=-1)
        )

    def percent(self, naive: bool = False) -> Floats:
        """Mean |error| over the episodes in percent of the true value, shape (22,); NaN where it is 0."""
        last = (self.naive if naive else self.mean)[-1]
        with np.errstate(divide="ignore", invalid="ignore"):
            error = 100 * np.abs(last - self.truth).mean(axis=0) / np.abs(self.truth)
        return np.where(self.truth == 0, np.nan, error)


def play(agent: Agent, settings: ExcitationSettings, vehicle: Floats, episodes: int) -> Course:
    """Let an agent shake a vehicle on the published test seeds.

    Args:
        agent: Who chooses the commands.
        settings: Of the experiment; the vehicle takes the place of its preset.
        vehicle: Its true parameters, shape (22,).
        episodes: Number of experiments side by side.
    """
    limits = LIMITS[settings.limits]
    shakers = Shakers(
        episodes,
        replace(settings, truth_spread=0.0),
        vehicle,
        nominal=vehicle,
    )
    shakers.restart(range(episodes), [np_random(seed)[0] for seed in TEST_SEEDS[:episodes]])
    agent.reset(TEST_SEEDS.start)
    agent.begin_episodes(np.ones(episodes, dtype=np.bool_))
    shaken, course, angles = shakers.observe(), [shakers.observe()], []
    for _ in range(settings.decisions):
        action = agent.act(np.zeros((episodes, 0), dtype=np.float32), known(shaken))
        shaken = shakers.advance(to_command(action, limits), traces=True)
        assert shaken.motion is not None
        course.append(shaken)
        angles.append(shaken.motion[0, 1:, 0])
    return Course(
        np.concatenate(angles),
        np.array([one.mean for one in course]),
        np.array([one.mean_naive for one in course]),
        np.array([one.bits for one in course]),
        np.array([one.command for one in course[1:]]),
        vehicle,
    )
