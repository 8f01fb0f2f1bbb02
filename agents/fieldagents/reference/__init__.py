"""The published algorithms and the strongest classical answers, one file a task."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pkgutil import resolve_name
from typing import Any

from fieldagents.agent import Agent, Sees


@dataclass(frozen=True)
class Reference:
    """How a reference agent is made.

    Attributes:
        name: Its name in configs and tables.
        sees: What it may see.
        title: One line that says what it does.
        make: Builds it for an environment's settings.
        estimator: Whether it is an estimator outside the action space, scored on the same strides.
    """

    name: str
    sees: Sees
    title: str
    make: Callable[[Mapping[str, Any]], Agent]
    estimator: bool = False

    @property
    def kind(self) -> str:
        """How its results are to be read, as ``Agent.kind``."""
        return f"estimator, {self.sees}" if self.estimator else self.sees


TABLES = {
    "excitation": "fieldagents.reference.excitation:REFERENCES",
    "heel_strike": "fieldagents.reference.heel_strike:REFERENCES",
    "line_following": "fieldagents.reference.line_following:REFERENCES",
    "line_following_pixels": "fieldagents.reference.line_following:PIXEL_REFERENCES",
    "pose_reaching": "fieldagents.reference.pose_reaching:REFERENCES",
    "uav_route": "fieldagents.reference.uav_route.agents:REFERENCES",
}
"""Where each task's reference agents are listed, in the order of presentation; imported when asked for."""


def references(task: str) -> dict[str, Reference]:
    """The reference agents of a task by name, in the order of presentation."""
    if task not in TABLES:
        return {}
    return {reference.name: reference for reference in resolve_name(TABLES[task])}
