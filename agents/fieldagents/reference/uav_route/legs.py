"""Whole legs that are certified, by a mixed-integer program over waypoints: no time steps, no heading tables.

Each leg is in one mode towards each radar, and each mode is a convex set of pairs of ends:

- *outside*: both ends, so the whole leg, lie beyond a line that touches the circle in which the side is seen;
- *nose* (*tail*): both ends lie in one sector of bearings about the radar, and the leg's direction lies in
  the low cone about the nose (tail), narrowed by half the sector. So the radar stays in the cone all along.

A leg that begins with a turn begins with a bank, which raises the signature outside the cones: then *outside*
means beyond the larger circle in which a banked side is seen. Lengths are those of a polygon, as in (4.13).
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from fieldagents.reference.uav_route.limits import NOSE, TAIL, limits_of
from fieldagents.reference.uav_route.plan import Plan, Search, make_plan
from fieldagents.reference.uav_route.polish import Kind, Mode, length_of, polished, split
from fieldagents.reference.uav_route.programs import Solver, choose_solver, modelling, solve
from fieldmodels.model import FloatArray, ModelError
from fieldmodels.uav_route.parameters import Layout, World
from fieldmodels.uav_route.refly import refly

Rows = list[tuple[FloatArray, FloatArray, float]]
"""Constraints a . p + b . q >= c on a leg from p to q."""

MARGIN = 1e-6
"""What is kept from every limit [km], so that a solver's tolerance breaks none."""


def leg_plan(
    layout: Layout,
    world: World | None = None,
    *,
    legs: int = 3,
    directions: int = 72,
    polish: bool = True,
    heading: float | None = None,
    solver: Solver = "auto",
    time_limit: float | None = None,
) -> Plan:
    """Plan a route of a few straight legs of any lengths, undetected as a whole, banked turns included.

    The program chooses the modes and proves that no other choice of its form is shorter; then the waypoints
    move to their best places for these modes. ``search`` tells of the program.

    Args:
        layout: Start, goal and radars.
        world: The continuous model; its lock loss is not used, since nothing is ever detected.
        legs: Largest number of legs.
        directions: Number of sides of the polygons that stand for circles, and of sectors.
        polish: Whether the waypoints move afterwards.
        heading: Heading before the first leg [rad]; None begins without a turn.
        solver: Which solver.
        time_limit: For each program [s].

    Raises:
        MissingSolverError: If PuLP or the solver is not installed.
        ModelError: If a number is not possible.
    """
    world = world or World()
    if legs < 1 or directions < 12:
        raise ModelError("a route has at least 1 leg, and at least 12 directions, for a sector in each cone")
    engine = choose_solver(solver, time_limit)
    name, begun = f"legs-{legs}", time.perf_counter()
    blocked = _blocked(layout, world)
    if blocked:
        return make_plan(name, layout, world, Search("infeasible", blocked, engine.name), heading=heading)
    modes = [[_all_around(radar, layout, directions, heading) for radar in layout.radars]] * legs
    program = _Program(layout, world, modes, directions, heading)
    search = solve(program.pulp, engine, begun)
    if search.status in ("infeasible", "no answer"):
        return make_plan(name, layout, world, search, heading=heading)
    waypoints, chosen = _cleared(program.waypoints(), program.chosen())
    if polish:
        waypoints = _better(waypoints, chosen, layout, world, heading, legs)
    search = replace(search, seconds=time.perf_counter() - begun)
    return make_plan(name, layout, world, search, waypoints, heading=heading)


def _blocked(layout: Layout, world: World) -> str:
    """Why there can be no undetected plan at all, in words; empty if nothing is against it."""
    limits = limits_of(world)
    nearest = min(limits.nose, limits.tail, limits.side)
    for what, place in (("start", layout.start), ("goal", layout.goal)):
        for i, radar in enumerate(layout.radars):
            distance = math.dist(place, radar)
            if distance < nearest:
                return (
                    f"the {what} is {distance:.1f} km from radar {i}, which detects even nose and tail "
                    f"within {nearest:.1f} km at this threshold: move it, or accept a higher probability"
                )
    return ""


def _all_around(
    radar: tuple[float, float], layout: Layout, directions: int, heading: float | None
) -> list[Mode]:
    """Modes all around a radar; the goal lies on an edge between sectors, as most routes end on one."""
    first = math.atan2(layout.goal[1] - radar[1], layout.goal[0] - radar[0])
    step = 2.0 * math.pi / directions
    kinds: tuple[Kind, ...] = ("outside", "nose", "tail")
    modes = [Mode(kind, first + (m + 0.5) * step, 0.5 * step) for kind in kinds for m in range(directions)]
    if heading is not None:  # a line along which the aircraft may fly on
        modes += [Mode("outside", heading + side * 0.5 * math.pi, 0.5 * step) for side in (-1.0, 1.0)]
    return modes


def _cleared(waypoints: FloatArray, modes: list[list[Mode]]) -> tuple[FloatArray, list[list[Mode]]]:
    """A route without its legs of no length."""
    ahead = np.hypot(*np.diff(waypoints, axis=0).T)
    legs = [i for i in range(len(modes)) if ahead[i] > 1e-3] or [0]
    path = np.concatenate([waypoints[legs], waypoints[-1:]])
    path[0] = waypoints[0]
    return path, [modes[i] for i in legs]


def _better(
    waypoints: FloatArray,
    modes: list[list[Mode]],
    layout: Layout,
    world: World,
    heading: float | None,
    legs: int,
) -> FloatArray:
    """The polished route, if the continuous model finds it undetected and shorter; else the one given."""
    path, kinds = split(waypoints, modes, legs)
    if len(path) == 2 or not layout.radars:
        return waypoints
    better = polished(path, kinds, np.array(layout.radars).reshape(-1, 2), world, heading)
    flown = refly(better, layout.radars, world, heading=heading).certificate
    return better if flown.undetected and flown.path_length < length_of(waypoints) else waypoints


class _Program:
    """The program for given modes of each leg towards each radar."""

    def __init__(
        self,
        layout: Layout,
        world: World,
        modes: Sequence[Sequence[Sequence[Mode]]],
        directions: int,
        heading: float | None,
    ) -> None:
        pulp = modelling()
        self.pulp = pulp.LpProblem("legs", pulp.LpMinimize)
        self.layout, self.world, self.heading = layout, world, heading
        ends = np.array([layout.start, layout.goal])
        reach = limits_of(world).banked_side
        sites = np.array(layout.radars).reshape(-1, 2)
        around = np.concatenate([ends, sites + reach, sites - reach]) if len(sites) else ends
        self.low, self.high = around.min(axis=0), around.max(axis=0)
        n = len(modes)
        inner = [
            [
                pulp.LpVariable(f"{axis}{i}", self.low[j], self.high[j])
                for j, axis in enumerate(("north", "east"))
            ]
            for i in range(1, n)
        ]
        self.points: list[list[Any]] = [list(layout.start), *inner, list(layout.goal)]
        lengths = [pulp.LpVariable(f"length{i}", 0.0) for i in range(n)]
        self.pulp += pulp.lpSum(lengths)
        for i in range(n):
            p, q = self.points[i], self.points[i + 1]
            for a in 2.0 * math.pi * np.arange(directions) / directions:
                self.pulp += lengths[i] >= math.cos(a) * (q[0] - p[0]) + math.sin(a) * (q[1] - p[1])
        self.choices: list[list[list[tuple[Mode, Any]]]] = [
            [self._choose(i, r, modes[i][r]) for r in range(len(sites))] for i in range(n)
        ]

    def _choose(self, leg: int, radar: int, modes: Sequence[Mode]) -> list[tuple[Mode, Any]]:
        """Make a leg take exactly one mode towards a radar."""
        pulp = modelling()
        turns = leg > 0 or self.heading is not None
        choices = []
        for k, mode in enumerate(modes):
            options = [(_rows(mode, np.array(self.layout.radars[radar]), self.world, turns), "")]
            if mode.kind == "outside" and leg == 0 and self.heading is not None:
                rows = _rows(mode, np.array(self.layout.radars[radar]), self.world, False)
                options.append((rows + _straight_on(self.heading), "_on"))
            for rows, suffix in options:
                if all(self._extreme(leg, row, max) >= 0.0 for row in rows):
                    taken = pulp.LpVariable(f"mode{leg}_{radar}_{k}{suffix}", cat="Binary")
                    for row in rows:
                        slack = max(0.0, -self._extreme(leg, row, min))
                        self.pulp += self._value(leg, row) >= -slack * (1 - taken)
                    choices.append((mode, taken))
        if choices:
            self.pulp += pulp.lpSum(taken for _, taken in choices) == 1
        else:
            self.pulp += pulp.LpVariable(f"impossible{leg}_{radar}", 0.0, 0.0) >= 1  # no mode fits this leg
        return choices

    def _value(self, leg: int, row: tuple[FloatArray, FloatArray, float]) -> Any:
        """Left side less right side of a constraint on a leg."""
        (p, q), (a, b, c) = self.points[leg : leg + 2], row
        return modelling().lpSum([a[0] * p[0], a[1] * p[1], b[0] * q[0], b[1] * q[1], -c])

    def _extreme(
        self, leg: int, row: tuple[FloatArray, FloatArray, float], pick: Callable[[float, float], float]
    ) -> float:
        """Largest or smallest value of that over the box of the waypoints."""
        total = -row[2]
        for point, weights in zip(self.points[leg : leg + 2], row[:2], strict=True):
            for j in range(2):
                w = float(weights[j])
                fixed = isinstance(point[j], float | int)
                total += w * point[j] if fixed else pick(w * float(self.low[j]), w * float(self.high[j]))
        return total

    def chosen(self) -> list[list[Mode]]:
        """Mode of each leg towards each radar in the solution."""
        return [[max(choices, key=lambda c: c[1].value())[0] for choices in leg] for leg in self.choices]

    def waypoints(self) -> FloatArray:
        """Start, waypoints and goal of the solution."""
        value = modelling().value
        return np.array([[float(value(x)) for x in point] for point in self.points])


def _rows(mode: Mode, radar: FloatArray, world: World, turns: bool) -> Rows:
    """A mode as linear constraints on the ends of a leg."""
    limits, none = limits_of(world), np.zeros(2)
    out = np.array([math.cos(mode.bearing), math.sin(mode.bearing)])

    def both(normal: FloatArray, distance: float) -> Rows:
        c = float(normal @ radar) + distance + MARGIN
        return [(normal, none, c), (none, normal, c)]

    if mode.kind == "outside":
        return both(out, limits.banked_side if turns else limits.side)
    cone, least = (NOSE, limits.nose) if mode.kind == "nose" else (TAIL, limits.tail)
    course = mode.bearing + (math.pi if mode.kind == "nose" else 0.0)
    rows = both(out, least)
    for side in (-1.0, 1.0):
        edge = mode.bearing + side * mode.width
        rows += both(side * np.array([math.sin(edge), -math.cos(edge)]), -2.0 * MARGIN)
        edge = course + side * (cone - mode.width)
        inward = side * np.array([math.sin(edge), -math.cos(edge)])
        rows.append((-inward, inward, 0.0))
    return rows


def _straight_on(heading: float) -> Rows:
    """A leg that goes on in the same direction."""
    along, across = (
        np.array([math.cos(heading), math.sin(heading)]),
        np.array([-math.sin(heading), math.cos(heading)]),
    )
    return [(-along, along, 0.0), (-across, across, 0.0), (across, -across, 0.0)]
