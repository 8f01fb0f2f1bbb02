"""The source's mixed-integer program, eqs (4.8)-(4.33): one waypoint each time step.

Speed and distance are taken on polygons of M sides, whose chosen corners also give heading and line of sight;
an M by M table gives the azimuth, a table of tangents the elevation, and both the safe distance. Printed, the
pair of indices into the table is a binary for each pair (``lookup="pairs"``). ``lookup="sets"`` says the same
without these: for each line of sight, the headings of equal safe distance are added up.

How the printed sums are read: step k = 1..T has made k moves, so that (4.22) charges what is flown; (4.8)
sums from j = 0, which would grant one move for nothing. L is no larger than needed in each place.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from fieldagents.tasks.uav_route.plan import Plan, Search, make_plan
from fieldagents.tasks.uav_route.programs import Solver, choose_solver, modelling, solve
from fieldmodels.arrays import FloatArray
from fieldmodels.machines.uav_route.detection import detection_range
from fieldmodels.machines.uav_route.parameters import Layout, World
from fieldmodels.machines.uav_route.signature import signature_of
from fieldmodels.model import ModelError

Lookup = Literal["pairs", "sets"]
ELEVATIONS = np.radians(np.arange(0.0, 90.0, 10.0))
"""Lower edges of the elevations that the table of tangents distinguishes [rad] (180 / 18, assumed)."""


@dataclass(frozen=True)
class Form:
    """How the program is written.

    Attributes:
        steps: T, number of time steps.
        step_time: T_s [s] (assumed: 12.5 km at 0.25 km/s).
        sides: M, number of sides of the polygons.
        lookup: How the table is looked up.
        slack: Factor of (4.14) and (4.24), printed 1.01 whatever M; None is the polygon's own 1 / cos(pi/M),
            with which a heading is wrong by no more than half a side's angle.
        lock_loss: Consecutive detected steps that destroy the aircraft (4.33); None allows no detection.
        detections: ``exactly`` as printed forces one undetected step at one fixed phase of each period;
            ``at_most`` is what the text means.
    """

    steps: int = 12
    step_time: float = 50.0
    sides: int = 24
    lookup: Lookup = "pairs"
    slack: float | None = 1.01
    lock_loss: int | None = None
    detections: Literal["exactly", "at_most"] = "at_most"

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            ModelError: If one is not possible.
        """
        if self.steps < 1 or self.sides < 4 or not self.step_time > 0:
            raise ModelError("a program needs at least 1 step of positive time and polygons of 4 sides")
        if self.lock_loss is not None and not 2 <= self.lock_loss <= self.steps:
            raise ModelError(f"lock loss takes 2 to {self.steps} (all) steps, not {self.lock_loss}")
        if self.slack is not None and self.slack < 1.0 / math.cos(math.pi / self.sides) - 1e-12:
            least = 1.0 / math.cos(math.pi / self.sides)
            raise ModelError(f"{self.sides} sides need a slack of at least {least:.4f}, not {self.slack}")


def printed_plan(
    layout: Layout,
    world: World | None = None,
    form: Form | None = None,
    *,
    solver: Solver = "auto",
    work: int | None = None,
) -> Plan:
    """Plan as the source does, then simulate the answer in the continuous model.

    Args:
        layout: Start, goal and radars.
        world: The continuous model: threshold, tables, speed and altitude are taken from it.
        form: How the program is written.
        solver: Which solver.
        work: Largest number of the solver's steps, see ``choose_solver``.

    Raises:
        MissingSolverError: If PuLP or the solver is not installed.
        ModelError: If a number is not possible.
    """
    (plan,) = joint_printed_plans((layout,), world, form, solver=solver, work=work)
    return plan


def joint_printed_plans(
    layouts: Sequence[Layout],
    world: World | None = None,
    form: Form | None = None,
    *,
    solver: Solver = "auto",
    work: int | None = None,
) -> tuple[Plan, ...]:
    """Plan several aircraft in one program, as the source does for two (section 4.5.1).

    Its radars see each aircraft by itself and nothing couples them, so that the sum of their costs is least
    where each cost is: planning each alone gives as much, sooner.

    Args:
        layouts: Start, goal and radars of each aircraft.
        world: As for ``printed_plan``, like the others.
        form: How the program is written.
        solver: Which solver.
        work: Largest number of the solver's steps, see ``choose_solver``.

    Returns:
        A plan for each aircraft; ``search`` describes the common program, whose objective is the sum.

    Raises:
        MissingSolverError: If PuLP or the solver is not installed.
        ModelError: If a number is not possible, or there is no aircraft.
    """
    if not layouts:
        raise ModelError("plans are made for at least one aircraft")
    world, form = world or World(), form or Form()
    engine, pulp = choose_solver(solver, work), modelling()
    begun = time.perf_counter()
    problem = pulp.LpProblem("printed", pulp.LpMinimize)
    programs = [_Program(problem, f"u{i}_", layout, world, form) for i, layout in enumerate(layouts)]
    problem += pulp.lpSum(program.cost for program in programs)
    search = solve(problem, engine, begun)
    name = "printed" if form.lookup == "pairs" else "printed-sets"
    if form.lock_loss is not None:
        name += f"-lock-loss-{form.lock_loss}"
    if search.status in ("infeasible", "no plan"):
        if search.status == "infeasible":
            search = _explained(search, form)
        return tuple(make_plan(name, layout, world, search) for layout in layouts)
    paths = [program.path() for program in programs]
    return tuple(
        make_plan(name, layout, world, search, *path) for layout, path in zip(layouts, paths, strict=True)
    )


def safe_distances(world: World, sides: int) -> FloatArray:
    """Safe distance by elevation, heading and line of sight [km], shape (elevations, M, M).

    Within a row of elevations the largest signature counts, the one at its upper edge.
    """
    angle = 2.0 * math.pi * np.arange(1, sides + 1) / sides
    azimuth = np.abs((angle[:, None] - angle[None, :]) % (2.0 * math.pi) - math.pi)
    upper = ELEVATIONS + (ELEVATIONS[1] - ELEVATIONS[0])
    signature = signature_of(np.round(azimuth, 9)[None], upper[:, None, None])
    return detection_range(signature, world.detection.threshold, world.detection.interpolation)


def _explained(search: Search, form: Form) -> Search:
    flown = form.steps * form.step_time
    return replace(
        search,
        reason=f"proven that no such route of {form.steps} steps ({flown:g} s) reaches the goal: "
        "more steps, or a higher probability of detection",
    )


class _Program:
    """One aircraft's part of the program; indices m and n are 0-based for the source's 1..M."""

    def __init__(self, problem: Any, prefix: str, layout: Layout, world: World, form: Form) -> None:
        self.pulp, self.prefix = problem, prefix
        self.layout, self.form, self.sum = layout, form, modelling().lpSum
        self.pardons: list[list[Any]] = [[] for _ in layout.radars]
        self.altitude, self.speed = world.aircraft.altitude, world.aircraft.speed
        angle = 2.0 * math.pi * np.arange(1, form.sides + 1) / form.sides
        self.sines, self.cosines = np.sin(angle).tolist(), np.cos(angle).tolist()
        self.slack = form.slack or 1.0 / math.cos(math.pi / form.sides)
        self.table = safe_distances(world, form.sides)
        flown = self.speed * form.step_time * form.steps
        self.box = [(c - flown, c + flown) for c in layout.start]
        steps = range(1, form.steps + 1)
        self.position = [
            [self._real(f"{a}{k}", *b) for a, b in zip("xy", self.box, strict=True)] for k in steps
        ]
        self.velocity = [[self._real(f"v{a}{k}", -self.speed, self.speed) for a in "xy"] for k in steps]
        self.arrived = [self._binary(f"bf{k}") for k in steps]
        for k in range(form.steps):
            self._move(k)
            heading = self._speed(k)
            for r in range(len(layout.radars)):
                self._radar(k, r, heading)
        self.pulp += self.sum(self.arrived) == 1  # (4.21)
        self.cost = self.sum(
            k * form.step_time * b for k, b in zip(steps, self.arrived, strict=True)
        )  # (4.22)
        if form.lock_loss is not None:
            self._lock_loss(form.lock_loss)

    def _real(self, name: str, low: float, high: float) -> Any:
        return modelling().LpVariable(self.prefix + name, low, high)

    def _binary(self, name: str) -> Any:
        return modelling().LpVariable(self.prefix + name, cat="Binary")

    def _move(self, k: int) -> None:
        """(4.8), (4.9), written from step to step, and the goal, (4.17)-(4.20)."""
        for j in range(2):
            x, goal = self.position[k][j], self.layout.goal[j]
            before = self.position[k - 1][j] if k else self.layout.start[j]
            self.pulp += x == before + self.form.step_time * self.velocity[k][j]
            low, high = self.box[j]
            self.pulp += x - goal <= (high - goal) * (1 - self.arrived[k])
            self.pulp += x - goal >= (low - goal) * (1 - self.arrived[k])

    def _magnitude(self, name: str, x: Any, y: Any, largest: float) -> tuple[Any, list[Any]]:
        """(4.13)-(4.15), (4.23)-(4.25): a length on the polygon, and the binaries of its corner."""
        length = self._real(name, 0.0, largest)
        corners = [self._binary(f"b{name}_{m + 1}") for m in range(self.form.sides)]
        room = (1.0 + self.slack) * largest  # L
        for sine, cosine, corner in zip(self.sines, self.cosines, corners, strict=True):
            part = sine * x + cosine * y
            self.pulp += part <= length
            self.pulp += self.slack * part >= length - room * (1 - corner)
        self.pulp += self.sum(corners) == 1
        return length, corners

    def _speed(self, k: int) -> list[Any]:
        """(4.11), (4.13)-(4.15); (4.16) is the index of the binary that is 1."""
        x, y = self.velocity[k]
        limit = self.speed * math.cos(math.pi / self.form.sides)
        for sine, cosine in zip(self.sines, self.cosines, strict=True):
            self.pulp += sine * x + cosine * y <= limit
        return self._magnitude(f"v{k + 1}", x, y, self.speed)[1]

    def _radar(self, k: int, r: int, heading: list[Any]) -> None:
        """(4.23)-(4.32) for one radar."""
        site, name = self.layout.radars[r], f"{k + 1}_{r}"
        x, y = (self.position[k][j] - site[j] for j in range(2))
        sides = [max(abs(edge - site[j]) for edge in self.box[j]) for j in range(2)]
        largest = math.hypot(*sides)
        distance, sight = self._magnitude(f"d{name}", x, y, largest)
        bands = [self._binary(f"el{name}_{d}") for d in range(len(ELEVATIONS))]
        tangents = np.tan(ELEVATIONS).tolist()
        for d, band in enumerate(bands):  # (4.28), (4.29)
            if d + 1 < len(bands):
                self.pulp += self.altitude <= distance * tangents[d + 1] + self.altitude * (1 - band)
            self.pulp += self.altitude >= distance * tangents[d] - tangents[d] * largest * (1 - band)
        self.pulp += self.sum(bands) == 1  # (4.30)
        pardon: Any = 0
        if self.form.lock_loss is not None:
            pardon = self._binary(f"bll{name}")
            self.pardons[r].append(pardon)
        pairs = self._pairs(name, heading, sight) if self.form.lookup == "pairs" else None
        for d, band in enumerate(bands):
            table = self.table[d]
            excuse = float(table.max()) * (1 - band) + float(table.max()) * pardon
            if pairs is not None:
                looked_up = self.sum(
                    float(table[m, n]) * pair for m, row in enumerate(pairs) for n, pair in enumerate(row)
                )
                self.pulp += distance + excuse >= looked_up  # (4.32)
            else:
                self._look_up_sets(distance + excuse, table, heading, sight)

    def _pairs(self, name: str, heading: list[Any], sight: list[Any]) -> list[list[Any]]:
        """The binary of each pair of heading and line of sight: 1 where both are."""
        sides = range(self.form.sides)
        pairs = [[self._binary(f"p{name}_{m + 1}_{n + 1}") for n in sides] for m in sides]
        for m in sides:
            self.pulp += self.sum(pairs[m]) == heading[m]
            self.pulp += self.sum(row[m] for row in pairs) == sight[m]
        return pairs

    def _look_up_sets(self, distance: Any, table: FloatArray, heading: list[Any], sight: list[Any]) -> None:
        """The table, with the headings added up that a line of sight gives equal distances."""
        for n in range(self.form.sides):
            levels = np.unique(table[:, n])
            for lower, level in zip(np.concatenate([[0.0], levels]), levels, strict=False):
                at_least = np.flatnonzero(table[:, n] >= level)
                less = self.sum(heading[m] for m in range(self.form.sides) if m not in set(at_least.tolist()))
                if lower == 0.0 and len(levels) > 1:
                    self.pulp += distance >= float(level) * sight[n]
                else:
                    self.pulp += distance >= float(level) * (sight[n] - less)

    def _lock_loss(self, count: int) -> None:
        """(4.33)."""
        for pardons in self.pardons:
            for k in range(self.form.steps - count + 1):
                window = self.sum(pardons[k : k + count])
                if self.form.detections == "exactly":
                    self.pulp += window == count - 1
                else:
                    self.pulp += window <= count - 1

    def path(self) -> tuple[FloatArray, FloatArray]:
        """Waypoints until the goal [km], and the time of each leg [s]."""
        last = max(range(self.form.steps), key=lambda k: self.arrived[k].value())
        points = [self.layout.start, *([v.value() for v in p] for p in self.position[: last + 1])]
        return np.array(points, dtype=np.float64), np.full(last + 1, self.form.step_time)
