"""The straight line: what happens to an aircraft that ignores the radars."""

from __future__ import annotations

import numpy as np

from fieldagents.tasks.uav_route.plan import Plan, Search, make_plan
from fieldmodels.machines.uav_route.parameters import Layout, World


def straight_plan(layout: Layout, world: World | None = None) -> Plan:
    """Plan to fly straight from start to goal; its verification says what comes of that."""
    search = Search("feasible", "a straight line, whatever the radars see", "none")
    return make_plan("straight", layout, world or World(), search, np.array([layout.start, layout.goal]))
