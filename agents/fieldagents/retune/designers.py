"""Who can be tuned, planned or designed in a given simulation: one table a task."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pkgutil import resolve_name
from typing import Any

from fieldagents.agent import Agent
from fieldagents.config import Config


@dataclass(frozen=True)
class Designer:
    """How an agent is made for a simulation.

    Attributes:
        name: Name of the agent in configs: that of the reference agent which it makes anew.
        title: What is designed, and how, in a line.
        options: What a config may say of the effort.
        design: Makes the agent from the environment's settings, the reality in which it is simulated, and the
            options, with tuning seeds alone. Equal arguments give equal agents, so that what is designed in
            the right simulation is the oracle to the bit.
    """

    name: str
    title: str
    options: type[Config]
    design: Callable[[Mapping[str, Any], Any, Any], Agent]


TABLES = {
    "excitation": "fieldagents.retune.excitation:DESIGNERS",
    "heel_strike": "fieldagents.retune.heel_strike:DESIGNERS",
    "line_following": "fieldagents.retune.line_following:DESIGNERS",
    "pose_reaching": "fieldagents.retune.pose_reaching:DESIGNERS",
    "uav_route": "fieldagents.retune.uav_route:DESIGNERS",
}
"""Where each task's designers are listed, the first being the most telling; imported when asked for."""


def designers(task: str) -> dict[str, Designer]:
    """The designers of a task by name, in the order of presentation."""
    if task not in TABLES:
        return {}
    return {designer.name: designer for designer in resolve_name(TABLES[task])}
