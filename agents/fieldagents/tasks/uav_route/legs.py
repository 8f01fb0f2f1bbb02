"""Whole legs that are verified, by a mixed-integer program over waypoints: no time steps, no heading tables.

Each leg is in one mode towards each radar, and each mode is a convex set of pairs of ends:

- *outside*: both ends, so the whole leg, lie beyond a line that touches the circle in which the side is seen;
- *nose* (*tail*): both ends lie in one sector of bearings about the radar, and the leg's direction lies in
  the low cone about the nose (tail), narrowed by half the sector. So the radar stays in the cone all along;
- *free*, with lock loss only: detected or not, but shorter than what the radar needs to launch its missile.
  Between two free legs there is one that is not, long enough for the radar to lose its lock.

A leg that begins with a turn begins with a bank, which raises the signature outside the cones: an *outside*
leg then begins *far* away, beyond the larger circle in which a banked side is seen by as much as the longest
bank takes; or nearer, but *slanted* towards the radar or away from it, so that the bank shows it less.
Lengths are those of a polygon, as in (4.13).
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, get_args

import numpy as np

from fieldagents.tasks.uav_route.limits import NOSE, TAIL, banked_limits, limits_of
from fieldagents.tasks.uav_route.plan import Plan, Search, make_plan
from fieldagents.tasks.uav_route.polish import (
    Kind,
    Mode,
    Span,
    bank_length,
    free_length,
    length_of,
    lock_length,
    polished,
    split,
)
from fieldagents.tasks.uav_route.programs import Solver, choose_solver, modelling, solve
from fieldmodels.arrays import FloatArray
from fieldmodels.machines.uav_route.parameters import Layout, World
from fieldmodels.machines.uav_route.plan_simulation import simulate_plan
from fieldmodels.model import ModelError

Rows = list[tuple[FloatArray, FloatArray, float]]
"""Constraints a . p + b . q >= c on a leg from p to q."""

MARGIN = 1e-6
"""What is kept from every limit [km], so that a solver's tolerance breaks none."""
MARGINS = (2e-6, 0.1)
"""The same when the waypoints move, larger so that what is flown can be planned on; the second if need be."""
FINER = 3
"""How many lines touch a circle for each sector about it."""
LENGTH_SIDES = 72
"""Sides of the polygons that stand for lengths: within 0.1 %."""
FAR_SIDES = 36
"""Sides of the polygons beyond which, and number of sectors in which, a turn may begin."""
SLANTS: tuple[tuple[Kind, float], ...] = tuple(
    (kind, math.radians(steep)) for kind in get_args(Kind)[1:3] for steep in (45.0, 60.0, 75.0)
)
"""How near to nose or tail the radar may stay in a bank [rad]."""
LONG_SIDES = 12
"""Directions along which a leg's length may be proved to be enough for a lock to be lost."""


def leg_plan(
    layout: Layout,
    world: World | None = None,
    *,
    legs: int = 2,
    directions: int = 24,
    polish: int = 3,
    lock_loss: bool = False,
    guide: FloatArray | None = None,
    window: float = math.radians(25.0),
    heading: float | None = None,
    solver: Solver = "auto",
    work: int | None = None,
) -> Plan:
    """Plan a route of a few straight legs of any lengths, undetected as a whole, banked turns included.

    The program chooses the modes and proves that no other choice of its form is shorter; then the waypoints
    move to their best places for these modes, with legs in a cone divided where that shortens the route.
    Radars come into the program once they see its route; ``search`` describes the last one.

    Args:
        layout: Start, goal and radars.
        world: The continuous model.
        legs: Largest number of legs of the program.
        directions: Number of sectors about each radar; three times as many lines touch its circle.
        polish: Number of legs up to which the route is divided when its waypoints move; 0 leaves them.
        lock_loss: True allows detections as long as no radar launches its missile; False allows none.
        guide: A route from start to goal [km], shape (n, 2): the program then has its n - 1 legs, each with
            the modes about its own only; what is proven then holds among these.
        window: How far the bearing of a mode may lie from the guide's leg [rad].
        heading: Heading before the first leg [rad]; None begins without a turn.
        solver: Which solver.
        work: Largest number of the solver's steps for each program, see ``choose_solver``.

    Raises:
        MissingSolverError: If PuLP or the solver is not installed.
        ModelError: If a number is not possible.
    """
    world = world or World()
    if guide is not None:
        legs = len(guide) - 1
    if legs < 1 or directions < 12 or polish < 0:
        raise ModelError("a route has at least 1 leg, and at least 12 directions, for a sector in each cone")
    engine = choose_solver(solver, work)
    name, begun = f"legs-{legs}" + ("-lock-loss" if lock_loss else ""), time.perf_counter()
    blocked = _blocked(layout, world, lock_loss)
    if blocked:
        return make_plan(name, layout, world, Search("infeasible", blocked, engine.name), heading=heading)
    waypoints = np.array([layout.start, layout.goal])
    known: tuple[int, ...] = ()
    seen = _seeing(waypoints, layout, world, heading)
    while True:  # a best route past some radars that holds for all is a best one past all
        known = tuple(sorted({*known, *seen}))
        part = replace(layout, radars=tuple(layout.radars[r] for r in known))
        modes = [
            [
                _about(_all_around(radar, layout, directions, heading), radar, guide, i, window)
                for radar in part.radars
            ]
            for i in range(legs)
        ]
        program = _Program(part, world, modes, heading, lock_loss=lock_loss)
        search = replace(solve(program.pulp, engine, begun), seconds=time.perf_counter() - begun)
        if search.status in ("infeasible", "no plan"):
            return make_plan(name, layout, world, search, heading=heading)
        waypoints, chosen, spans = _cleared(program.waypoints(), program.chosen(), program.spans())
        if polish:
            waypoints = improved(waypoints, chosen, spans, part, world, heading, max(polish, legs))
        flown = simulate_plan(waypoints, layout.radars, world, heading=heading).verification
        seen = _seeing(waypoints, layout, world, heading)
        if flown.undetected or (lock_loss and flown.survived) or seen <= set(known):
            break
    if guide is not None and search.status == "optimal":
        search = replace(search, reason="proven optimal among the modes about the guiding route")
    search = replace(search, seconds=time.perf_counter() - begun)
    return make_plan(name, layout, world, search, waypoints, heading=heading)


def _seeing(waypoints: FloatArray, layout: Layout, world: World, heading: float | None) -> set[int]:
    """The radars that detect a route."""
    detected = simulate_plan(waypoints, layout.radars, world, heading=heading).detected
    return set(np.flatnonzero(detected.any(axis=0)).tolist())


def _blocked(layout: Layout, world: World, lock_loss: bool) -> str:
    """Why there can be no plan at all, in words; empty if nothing is against it."""
    if lock_loss and free_length(world) > 0.0:
        return ""
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
    kinds: tuple[tuple[Kind, int], ...] = (
        ("outside", FINER * directions),
        ("nose", directions),
        ("tail", directions),
    )
    modes = [
        Mode(kind, first + (m + 0.5) * 2.0 * math.pi / count, math.pi / count)
        for kind, count in kinds
        for m in range(count)
    ]
    if heading is not None:  # a line along which the aircraft may fly on
        modes += [Mode("outside", heading + side * 0.5 * math.pi, 0.0) for side in (-1.0, 1.0)]
    return modes


def _about(
    modes: list[Mode], radar: tuple[float, float], guide: FloatArray | None, leg: int, window: float
) -> list[Mode]:
    """The modes whose bearing some place on the guide's leg has, or nearly so."""
    if guide is None:
        return modes
    along = np.linspace(guide[leg], guide[leg + 1], 33) - np.array(radar)
    bearings = np.arctan2(along[:, 1], along[:, 0])
    return [m for m in modes if np.cos(bearings - m.bearing).max() >= math.cos(window)]


def _cleared(
    waypoints: FloatArray, modes: list[list[Mode]], spans: list[Span]
) -> tuple[FloatArray, list[list[Mode]], list[Span]]:
    """A route without its legs of no length."""
    ahead = np.hypot(*np.diff(waypoints, axis=0).T)
    legs = [i for i in range(len(modes)) if ahead[i] > 1e-3] or [0]
    path = np.concatenate([waypoints[legs], waypoints[-1:]])
    path[0] = waypoints[0]
    return path, [modes[i] for i in legs], [spans[i] for i in legs]


def improved(
    waypoints: FloatArray,
    modes: list[list[Mode]],
    spans: list[Span],
    layout: Layout,
    world: World,
    heading: float | None,
    legs: int,
) -> FloatArray:
    """The polished route, if the continuous model finds it as good and shorter; else the one given."""
    path, kinds, spans = split(waypoints, modes, spans, legs)
    if len(path) == 2 or not layout.radars:
        return waypoints
    sites = np.array(layout.radars).reshape(-1, 2)
    detected = any(mode.kind == "free" for leg in modes for mode in leg)
    for margin in MARGINS:
        better = polished(path, kinds, spans, sites, world, heading, margin)
        flown = simulate_plan(better, layout.radars, world, heading=heading).verification
        holds = flown.survived if detected else flown.undetected
        if holds and flown.path_length < length_of(waypoints):
            return better
    return waypoints


class _Program:
    """The program for given modes of each leg towards each radar."""

    def __init__(
        self,
        layout: Layout,
        world: World,
        modes: Sequence[Sequence[Sequence[Mode]]],
        heading: float | None,
        *,
        lock_loss: bool,
    ) -> None:
        pulp = modelling()
        self.pulp = pulp.LpProblem("legs", pulp.LpMinimize)
        self.layout, self.world, self.heading = layout, world, heading
        ends = np.array([layout.start, layout.goal])
        reach = limits_of(world).banked_side + bank_length(world, math.pi)
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
        self.lengths = [pulp.LpVariable(f"length{i}", 0.0) for i in range(n)]
        self.polygon = math.cos(math.pi / LENGTH_SIDES)
        self.pulp += pulp.lpSum(self.lengths)
        for i in range(n):
            p, q = self.points[i], self.points[i + 1]
            for a in 2.0 * math.pi * np.arange(LENGTH_SIDES) / LENGTH_SIDES:
                self.pulp += self.lengths[i] >= math.cos(a) * (q[0] - p[0]) + math.sin(a) * (q[1] - p[1])
        self.free: dict[tuple[int, int], Any] = {}
        self.long: dict[int, Any] = {}
        if lock_loss and free_length(world) > 0.0:
            self.free = {
                (i, r): pulp.LpVariable(f"free{i}_{r}", cat="Binary")
                for i in range(n)
                for r in range(len(sites))
            }
            self._lock_loss(n, len(sites))
        self.choices: list[list[list[tuple[Mode, Any]]]] = [
            [self._choose(i, r, modes[i][r]) for r in range(len(sites))] for i in range(n)
        ]

    def _choose(self, leg: int, radar: int, modes: Sequence[Mode]) -> list[tuple[Mode, Any]]:
        """Make a leg take exactly one mode towards a radar."""
        pulp, site = modelling(), np.array(self.layout.radars[radar])
        turns = (leg > 0 or self.heading is not None) and self.world.aircraft.bank > 0.0
        choices: list[tuple[Mode, Any]] = []
        banked = []  # outside, and begun with a turn
        for k, mode in enumerate(modes):
            rows = _rows(mode, site, self.world)
            taken = self._option(f"mode{leg}_{radar}_{k}", leg, rows)
            if taken is not None:
                choices.append((mode, taken))
            if taken is not None and mode.kind == "outside" and turns:
                banked.append(taken)
            if mode.kind == "outside" and leg == 0 and self.heading is not None:
                on = self._option(f"mode{leg}_{radar}_{k}_on", leg, rows + _straight_on(self.heading))
                if on is not None:
                    choices.append((mode, on))
        if banked:
            near = np.array([mode.bearing for mode in modes])
            every = 2.0 * math.pi * np.arange(FAR_SIDES) / FAR_SIDES
            bearings = [
                float(b) for b in every if np.cos(near - b).max() >= math.cos(2.0 * math.pi / FAR_SIDES)
            ]
            ways = [_far(b, site, self.world) for b in bearings]
            ways += [_slanted(b, *steep, site, self.world) for b in bearings for steep in SLANTS]
            begun = [self._option(f"begun{leg}_{radar}_{k}", leg, rows) for k, rows in enumerate(ways)]
            self.pulp += pulp.lpSum(x for x in begun if x is not None) >= pulp.lpSum(banked)
        if (leg, radar) in self.free:
            choices.append((Mode("free", 0.0, 0.0), self.free[leg, radar]))
        if choices:
            self.pulp += pulp.lpSum(taken for _, taken in choices) == 1
        else:
            self.pulp += pulp.LpVariable(f"impossible{leg}_{radar}", 0.0, 0.0) >= 1  # no mode fits this leg
        return choices

    def _option(self, name: str, leg: int, rows: Rows) -> Any:
        """A binary that is 1 only if the rows hold; None where they cannot."""
        if any(self._extreme(leg, row, max) < 0.0 for row in rows):
            return None
        taken = modelling().LpVariable(name, cat="Binary")
        for row in rows:
            slack = max(0.0, -self._extreme(leg, row, min))
            self.pulp += self._value(leg, row) >= -slack * (1 - taken)
        return taken

    def _lock_loss(self, legs: int, radars: int) -> None:
        """Free legs are short, and between two of them one that is not is long; see the module's text."""
        pulp = modelling()
        most, least = self.polygon * free_length(self.world), lock_length(self.world)
        largest = float(np.hypot(*(self.high - self.low)))
        bearings = 2.0 * math.pi * np.arange(LONG_SIDES) / LONG_SIDES
        for i in range(1, legs - 1):
            rows = [[(-_unit(float(b)), _unit(float(b)), least)] for b in bearings]
            options = [self._option(f"long{i}_{k}", i, one) for k, one in enumerate(rows)]
            self.long[i] = pulp.lpSum(x for x in options if x is not None)
            self.pulp += self.long[i] <= 1
        for r in range(radars):
            for i in range(legs):
                self.pulp += self.lengths[i] <= most + (largest - most) * (1 - self.free[i, r])
                for j in range(i + 1, legs):
                    between = [self.long[k] + self.free[k, r] for k in range(i + 1, j)]
                    self.pulp += self.free[i, r] + self.free[j, r] <= 1 + pulp.lpSum(between)

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

    def spans(self) -> list[Span]:
        """Shortest and longest length of each leg in the solution's modes [km]."""
        value = modelling().value
        free = {i for (i, _), taken in self.free.items() if taken.value() > 0.5}
        long = {i for i, taken in self.long.items() if value(taken) > 0.5}
        return [
            (
                lock_length(self.world) if i in long else 0.0,
                free_length(self.world) if i in free else math.inf,
            )
            for i in range(len(self.lengths))
        ]

    def waypoints(self) -> FloatArray:
        """Start, waypoints and goal of the solution."""
        value = modelling().value
        return np.array([[float(value(x)) for x in point] for point in self.points])


def _unit(bearing: float) -> FloatArray:
    return np.array([math.cos(bearing), math.sin(bearing)])


def _rows(mode: Mode, radar: FloatArray, world: World) -> Rows:
    """A mode as linear constraints on the ends of a leg."""
    limits, none = limits_of(world), np.zeros(2)
    out = _unit(mode.bearing)

    def both(normal: FloatArray, distance: float) -> Rows:
        c = float(normal @ radar) + distance + MARGIN
        return [(normal, none, c), (none, normal, c)]

    if mode.kind == "outside":
        return both(out, limits.side)
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


def _far(bearing: float, radar: FloatArray, world: World) -> Rows:
    """A leg that begins so far away that its bank, as long as that of a reversal, ends outside, too."""
    out = _unit(bearing)
    least = limits_of(world).banked_side + bank_length(world, math.pi)
    return [(out, np.zeros(2), float(out @ radar) + least + MARGIN)]


def _slanted(bearing: float, kind: Kind, steep: float, radar: FloatArray, world: World) -> Rows:
    """A leg that begins so steeply to or from the radar that its bank shows it less than a side."""
    azimuths, distances = banked_limits(world)
    nose, width, bank = kind == "nose", math.pi / FAR_SIDES, bank_length(world, math.pi)
    least = float(distances[azimuths <= steep if nose else azimuths >= math.pi - steep].max()) + bank
    out, none, rows = _unit(bearing), np.zeros(2), []
    rows.append((out, none, float(out @ radar) + least + MARGIN))
    course = bearing + (math.pi if nose else 0.0)
    for side in (-1.0, 1.0):
        edge = bearing + side * width
        inward = side * np.array([math.sin(edge), -math.cos(edge)])
        rows.append((inward, none, float(inward @ radar)))
        edge = course + side * (steep - width - bank / least)  # the radar's bearing changes in the bank
        inward = side * np.array([math.sin(edge), -math.cos(edge)])
        rows.append((-inward, inward, 0.0))
    return rows


def _straight_on(heading: float) -> Rows:
    """A leg that goes on in the same direction."""
    along, across = _unit(heading), _unit(heading + 0.5 * math.pi)
    return [(-along, along, 0.0), (-across, across, 0.0), (across, -across, 0.0)]
