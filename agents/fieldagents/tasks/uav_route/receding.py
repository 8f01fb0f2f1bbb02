"""Planning again and again as radars come into sight, as the source proposes in section 4.6."""

from __future__ import annotations

import math
import time

import numpy as np

from fieldagents.tasks.uav_route.legs import leg_plan
from fieldagents.tasks.uav_route.plan import Counts, Plan, Search, make_plan
from fieldagents.tasks.uav_route.programs import Solver
from fieldmodels.arrays import FloatArray
from fieldmodels.machines.uav_route.parameters import Layout, World
from fieldmodels.machines.uav_route.plan_simulation import simulate_plan
from fieldmodels.model import ModelError

SCAN = 1.0
"""Length between two scans for new radars [km]."""


def receding_plan(
    layout: Layout,
    world: World | None = None,
    *,
    sensing: float = math.inf,
    advance: float = 50.0,
    legs: int = 3,
    solver: Solver = "auto",
    work: int | None = None,
) -> Plan:
    """Fly part of a plan in whole legs, see which radars are in sight, and plan again.

    A new plan is made when a new radar comes into sight or the next ``advance`` is flown, and starts with the
    heading that the aircraft has. It replaces the old one if that is detected by the radars now known, or is
    longer. If there is none then, the aircraft keeps the old one and the answer says so: the verification
    shows what that costs.

    Args:
        layout: Start, goal and all radars.
        world: The continuous model.
        sensing: Distance within which a radar is in sight, and remembered from then on [km].
        advance: Length that is flown before the next plan is made [km].
        legs: Legs of each plan.
        solver: Which solver.
        work: Largest number of the solver's steps for each program, see ``choose_solver``.

    Raises:
        MissingSolverError: If PuLP or the solver is not installed.
        ModelError: If a number is not possible.
    """
    world = world or World()
    if not advance > 0 or not sensing > 0:
        raise ModelError("advance and sensing are positive [km]")
    begun, path, ahead = time.perf_counter(), [np.array(layout.start)], np.array([layout.start, layout.goal])
    known: set[int] = set()
    course: float | None = None
    failures: list[str] = []
    largest = Counts()
    while len(ahead) > 1:
        known |= _in_sight(ahead[0], layout, sensing)
        seen = Layout(
            (float(ahead[0, 0]), float(ahead[0, 1])),
            layout.goal,
            tuple(layout.radars[i] for i in sorted(known)),
        )
        plan = leg_plan(seen, world, legs=legs, heading=course, solver=solver, work=work)
        largest = max(largest, plan.search.counts, key=lambda c: c.constraints)
        still = simulate_plan(ahead, seen.radars, world, heading=course).verification
        if plan.found and not (still.undetected and still.path_length <= plan.length):
            ahead = plan.waypoints
        elif not plan.found and not still.undetected:
            failures.append(plan.search.reason)
        flown, ahead = _fly(ahead, advance, layout, sensing, known)
        path += flown
        last = path[-1] - path[-2]
        course = math.atan2(last[1], last[0])
    reason = "planned anew along the way, every time with an answer"
    if failures:
        reason = f"planned anew along the way, {len(failures)} times without an answer: {failures[0]}"
    seconds = time.perf_counter() - begun
    search = Search("feasible", reason, "receding", seconds=seconds, counts=largest)
    return make_plan("receding", layout, world, search, np.array(path))


def _in_sight(place: FloatArray, layout: Layout, sensing: float) -> set[int]:
    """Radars within sight of a place."""
    return {i for i, radar in enumerate(layout.radars) if math.dist(place, radar) <= sensing}


def _fly(
    ahead: FloatArray, advance: float, layout: Layout, sensing: float, known: set[int]
) -> tuple[list[FloatArray], FloatArray]:
    """Fly along waypoints until ``advance`` is used up or a new radar is in sight.

    Returns:
        The places where legs ended on the way, and what lies ahead, from the place that was reached.
    """
    flown: list[FloatArray] = []
    for i in range(len(ahead) - 1):
        start, length = ahead[i], math.dist(ahead[i], ahead[i + 1])
        reach = min(length, advance)
        for k in range(1, math.ceil(reach / SCAN) + 1):
            way = min(k * SCAN, reach)
            place = start + (ahead[i + 1] - start) * (way / length)
            if way < length and (way == advance or _in_sight(place, layout, sensing) - known):
                return [*flown, place], np.concatenate([place[None], ahead[i + 1 :]])
        flown.append(ahead[i + 1])
        advance -= length
        if advance <= 0.0:
            return flown, ahead[i + 1 :]
    return flown, ahead[-1:]
