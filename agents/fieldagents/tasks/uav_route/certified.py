"""Undetected routes with a proven gap: whole legs and polished lattice paths, and a bound with banks."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from itertools import pairwise

import numpy as np

from fieldagents.tasks.uav_route.banked_bound import banked_bound
from fieldagents.tasks.uav_route.lattice import lattice_plan
from fieldagents.tasks.uav_route.legs import improved, leg_plan
from fieldagents.tasks.uav_route.limits import limits_of
from fieldagents.tasks.uav_route.plan import Plan, Search, make_plan
from fieldagents.tasks.uav_route.polish import Kind, Mode, length_of
from fieldmodels.arrays import FloatArray
from fieldmodels.machines.uav_route.parameters import Layout, LegRules, World
from fieldmodels.machines.uav_route.plan_simulation import simulate_plan
from fieldmodels.model import ModelError

LATTICES = ((10.0, 3), (16.0, 3), (28.0, 2))
"""Lattices in the order in which they are tried: nodes along the straight line, and refinements."""
SPACING = 2.0
"""Smallest spacing of a lattice [km]."""
LEGS = 5
"""Legs up to which a lattice's path is divided when its waypoints move."""


def certified_plan(
    layout: Layout,
    world: World | None = None,
    *,
    gap: float = 0.01,
    least_leg: float = LegRules.least_leg,
    heading: float | None = None,
    work: int | None = None,
) -> Plan:
    """Plan an undetected route and say by how much a shorter one could at most be shorter.

    Two whole legs are planned first, then lattices from coarse to fine, each path with its needless waypoints
    left out and the others moved to their best places, until the gap is small enough. What is returned is the
    shortest route that the continuous model, sampled every 25 m, finds undetected.

    Args:
        layout: Start, goal and radars.
        world: The continuous model.
        gap: Gap to the bound at which the search ends.
        least_leg: Shortest leg [km], but for one that ends at the goal.
        heading: Heading before the first leg [rad]; None begins without a turn.
        work: Largest number of the solver's steps for each program, see ``choose_solver``.

    Raises:
        MissingSolverError: If PuLP or the solver is not installed.
        ModelError: If a number is not possible.
    """
    if not gap >= 0:
        raise ModelError(f"the gap must not be negative, not {gap}")
    world, begun = world or World(), time.perf_counter()
    bound = banked_bound(layout, world, least_leg)
    first = leg_plan(layout, world, directions=72, polish=4, heading=heading, work=work)
    done, best = first.search.work, first.waypoints
    if first.search.status == "infeasible" and not first.search.counts.constraints:
        return replace(first, planner="certified")  # the start or the goal is seen whatever flies there
    straight = math.dist(layout.start, layout.goal)
    for nodes, refinements in LATTICES:
        if len(best) and length_of(best) * (1.0 - gap) <= bound:
            break
        rough = lattice_plan(
            layout, world, spacing=max(straight / nodes, SPACING), refinements=refinements,
            least_leg=least_leg, heading=heading,
        )  # fmt: skip
        done += rough.search.work
        if rough.found:
            best = _shorter(best, rough.waypoints, layout, world, heading, least_leg)
    length = length_of(best) if len(best) else math.nan
    search = Search(
        status="feasible" if len(best) else "no plan",
        reason="the shortest undetected route found, and a bound that none is below"
        if len(best)
        else "neither two legs nor a lattice of these spacings finds a route",
        solver="legs and lattice",
        objective=length,
        bound=bound,
        work=done,
        seconds=time.perf_counter() - begun,
        counts=first.search.counts,
    )
    return make_plan("certified", layout, world, search, best if len(best) else None, heading=heading)


def _shorter(
    best: FloatArray, path: FloatArray, layout: Layout, world: World, heading: float | None, least_leg: float
) -> FloatArray:
    """The best route so far, or a lattice's path, as it is or improved, if that is undetected and shorter."""

    def holds(route: FloatArray) -> bool:
        flown = simulate_plan(route, layout.radars, world, heading=heading).verification
        legs = np.hypot(*np.diff(route, axis=0).T)
        return flown.undetected and bool((legs[:-1] >= least_leg - 1e-9).all())

    i = 1
    while i < len(path) - 1:  # waypoints that are not needed
        without = np.delete(path, i, axis=0)
        path, i = (without, max(i - 1, 1)) if holds(without) else (path, i + 1)
    spans = [(least_leg, math.inf)] * (len(path) - 2) + [(0.0, math.inf)]
    modes = _modes(path, layout, world)
    tried = [path, improved(path, modes, spans, layout, world, heading, max(len(modes), LEGS))]
    for route in tried:
        if holds(route) and (not len(best) or length_of(route) < length_of(best)):
            best = route
    return best


def _modes(path: FloatArray, layout: Layout, world: World) -> list[list[Mode]]:
    """How each leg of a route passes each radar."""
    side, modes = limits_of(world).side, []
    for start, end in pairwise(path):
        leg, course = [], end - start
        for site in np.array(layout.radars).reshape(-1, 2):
            share = np.clip((site - start) @ course / (course @ course), 0.0, 1.0)
            nearest = start + share * course - site
            inside = np.hypot(*nearest) < side - 0.5
            towards = course @ (0.5 * (start + end) - site) < 0.0
            kind: Kind = ("nose" if towards else "tail") if inside else "outside"
            leg.append(Mode(kind, math.atan2(nearest[1], nearest[0]), 0.0))
        modes.append(leg)
    return modes
