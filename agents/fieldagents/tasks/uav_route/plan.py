"""What a planner answers: waypoints, how they were found, and what the continuous model says of them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from fieldagents.tasks.uav_route.lower_bound import lower_bound
from fieldmodels.arrays import FloatArray
from fieldmodels.machines.uav_route.parameters import Layout, World
from fieldmodels.machines.uav_route.plan_simulation import PlanVerification, simulate_plan

Status = Literal["optimal", "feasible", "infeasible", "no plan"]


@dataclass(frozen=True)
class Counts:
    """Size of a program: constraints, and integer and continuous variables."""

    constraints: int = 0
    integers: int = 0
    continuous: int = 0


@dataclass(frozen=True)
class Search:
    """How a search ended.

    Attributes:
        status: ``optimal``: proven within the planner's own formulation; ``feasible``: a plan without a
            proof; ``infeasible``: proven that the formulation has no plan; ``no plan``: none was found
            within the work limit, and nothing is proven.
        reason: The same in words, with the remedy where there is one.
        solver: Which solver, or which other method.
        objective: Value of the plan in the formulation's own objective; NaN without a plan.
        bound: No plan of the formulation has a lower objective; NaN where nothing is known.
        work: Steps of the solver, or labels of a search.
        seconds: Wall-clock time of the search [s], the building of programs included.
        counts: Size of the (largest) program.
    """

    status: Status
    reason: str
    solver: str
    objective: float = float("nan")
    bound: float = float("nan")
    work: int = 0
    seconds: float = 0.0
    counts: Counts = field(default_factory=Counts)

    @property
    def gap(self) -> float:
        """By what part of itself the objective may be above the best; NaN without a plan or a bound."""
        gap = 1.0 - self.bound / self.objective if self.objective else math.nan
        return 0.0 if gap < 0.0 else gap


@dataclass(frozen=True)
class Plan:
    """A planner's answer.

    Attributes:
        planner: Name of the planner.
        layout: What was asked.
        search: How the search ended.
        waypoints: North and east of start, waypoints and goal [km], shape (n, 2); (0, 2) without a plan.
        durations: Time of each leg [s], shape (n - 1,); None at the aircraft's speed.
        verification: What the continuous model says; None without a plan.
        lower_bound: No path that is nowhere detected is shorter [km], bank ignored (see ``lower_bound``).
    """

    planner: str
    layout: Layout
    search: Search
    waypoints: FloatArray
    durations: FloatArray | None
    verification: PlanVerification | None
    lower_bound: float

    @property
    def found(self) -> bool:
        """Whether there is a plan."""
        return self.verification is not None

    @property
    def length(self) -> float:
        """Length of the path [km]; NaN without a plan."""
        return self.verification.path_length if self.verification else float("nan")

    @property
    def excess(self) -> float:
        """Length over the lower bound, less one; negative if it is detected, or hidden by a bank."""
        return self.length / self.lower_bound - 1.0


def make_plan(
    planner: str,
    layout: Layout,
    world: World,
    search: Search,
    waypoints: FloatArray | None = None,
    durations: FloatArray | None = None,
    heading: float | None = None,
) -> Plan:
    """Simulate waypoints in the continuous model and put them together with how they were found."""
    points = np.zeros((0, 2)) if waypoints is None else np.array(waypoints, dtype=np.float64)
    verification = None
    if len(points):
        verification = simulate_plan(
            points, layout.radars, world, durations=durations, heading=heading
        ).verification
    return Plan(planner, layout, search, points, durations, verification, lower_bound(layout, world))
