"""Figures 4.4 to 4.6 of the UAV route's source, redone, with undetected routes beside the printed ones.

Source: A. I. Chaudhry, "Topics in robot locomotion", Cornell University 2015, chapter 4.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
import pandas as pd
from pydantic import Field as Bounded

from fieldagents.progress import Report
from fieldagents.tasks.uav_route.lattice import lattice_plan
from fieldagents.tasks.uav_route.legs import leg_plan
from fieldagents.tasks.uav_route.limits import limits_of
from fieldagents.tasks.uav_route.plan import Counts, Plan
from fieldagents.tasks.uav_route.printed import Form, joint_printed_plans, printed_plan
from fieldmodels.html import AFTER, BEFORE, GREEN, GREY
from fieldmodels.machines.uav_route.detection import probability_of_detection
from fieldmodels.machines.uav_route.parameters import EXAMPLE, SECOND_UAV, Detection, Layout, World
from papers.claim import Statistic
from papers.source import Reproduction, reproduces
from papers.statistics import exact, share_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SOURCE = "A. I. Chaudhry, Topics in robot locomotion, Cornell University 2015, chapter 4, Figs 4.4 to 4.6"
COLOURS = {0.5: AFTER, 0.6: BEFORE, 0.7: GREEN}
PRINTED_COUNTS = {"binaries (source)": 15363, "linear (source)": 72, "constraints (source)": 10359}
"""Section 4.5.1, for one aircraft at 0.5."""


@dataclass(frozen=True)
class DrawnPlan:
    """A plan in a figure.

    Attributes:
        figure: Number of the figure.
        threshold: Probability of detection that is accepted.
        plan: The plan.
    """

    figure: str
    threshold: float
    plan: Plan


@reproduces("figure-4.5", quick={"lookup": "sets"})
def figures_4_4_to_4_6(
    progress: Report,
    *,
    sides: Annotated[int, Bounded(ge=24, le=72)] = 24,
    lookup: Literal["pairs", "sets"] = "pairs",
    work: Annotated[int, Bounded(ge=1)] = 200_000,
) -> Reproduction:
    """Paths under detection and lock loss (Figs 4.4 to 4.6)."""
    form, drawn = Form(sides=sides, lookup=lookup), []
    for i, threshold in enumerate(COLOURS):
        progress("planning", i / 4)
        world = World(detection=Detection(threshold=threshold))
        figure = "4.4" if threshold == 0.5 else "4.5"
        drawn.append(DrawnPlan(figure, threshold, printed_plan(EXAMPLE, world, form, work=work)))
        drawn.append(DrawnPlan(figure, threshold, leg_plan(EXAMPLE, world, work=work)))
    progress("planning", 3 / 4)
    lock_loss = replace(form, lock_loss=4)
    drawn.append(DrawnPlan("4.6", 0.5, printed_plan(EXAMPLE, form=lock_loss, work=work)))
    drawn.append(DrawnPlan("4.6", 0.5, lattice_plan(EXAMPLE, lock_loss=True)))
    rows = [_row(s) for s in drawn]
    rows[0] |= PRINTED_COUNTS
    return Reproduction(
        source=SOURCE,
        table=pd.DataFrame(rows),
        figures={
            "figure-4.4": _figure(drawn[:2], "Fig 4.4: probability of detection 0.5"),
            "figure-4.5": _figure(drawn[:6], "Fig 4.5: probabilities 0.5, 0.6, 0.7"),
            "figure-4.6": _figure([*drawn[:2], *drawn[6:]], "Fig 4.6: with lock loss"),
        },
        remarks=(
            "The source prints its paths as pictures without numbers; ours are drawn in their axes.",
            "The printed program is solved, but its plans are detected in the continuous model. Whole legs "
            "are not, and the lattice's lock-loss path is detected but not hit.",
            "The printed cost counts steps, so that many paths cost the same: which one a solver returns, "
            "and so its shape and length, is arbitrary.",
        ),
        statistics=_statistics(drawn),
    )


def _statistics(drawn: list[DrawnPlan]) -> dict[str, Statistic]:
    """What decides the claims: the printed program's plans, and undetected routes, at 0.5 and at 0.7."""
    printed, pardoned, legs, pardoned_lattice = drawn[0].plan, drawn[6].plan, drawn[1].plan, drawn[7].plan
    program = _counted((EXAMPLE,)), _counted((EXAMPLE, SECOND_UAV))
    flown = printed.verification
    values = {
        "linear variables, one aircraft": program[0].continuous,
        "linear variables, two aircraft": program[1].continuous,
        "kilometres saved by 0.7 instead of 0.5, printed program": _flown_cost(printed)
        - _flown_cost(drawn[4].plan),
        "kilometres saved by 0.7 instead of 0.5, undetected legs": legs.length - drawn[5].plan.length,
        "kilometres saved by lock loss, printed program": _flown_cost(printed) - _flown_cost(pardoned),
        "kilometres saved by lock loss, lattice": legs.length - pardoned_lattice.length,
        "detected time of the printed plan [s]": flown.time_over if flown else math.nan,
        "missile hits the printed plan with lock loss": _hit(pardoned),
        "missile hits the lattice's plan with lock loss": _hit(pardoned_lattice),
        "detour of the undetected route [km]": legs.length - math.dist(EXAMPLE.start, EXAMPLE.goal),
    }
    return {name: exact(value) for name, value in values.items() if not math.isnan(value)}


def _counted(layouts: Sequence[Layout]) -> Counts:
    """Size of the source's program of twelve steps."""
    return joint_printed_plans(layouts, form=Form(lookup="sets"), work=1)[0].search.counts


def _flown_cost(plan: Plan) -> float:
    """The cost (4.22) of a plan as a length [km]."""
    return plan.search.objective * World().aircraft.speed


def _hit(plan: Plan) -> float:
    return math.nan if plan.verification is None else float(not plan.verification.survived)


@reproduces("section-4.2")
def equations_of_4_2(
    _progress: Report,
    *,
    cases: Annotated[int, Bounded(ge=100)] = 20_000,
) -> Reproduction:
    """The side of a turn, and Table 4.2."""
    rng = np.random.default_rng(0)
    place, velocity, waypoint = rng.uniform(-500.0, 500.0, (3, cases, 2))
    ahead = waypoint - place
    right = velocity[:, 0] * ahead[:, 1] - velocity[:, 1] * ahead[:, 0] > 0.0  # east of north is clockwise
    printed = waypoint[:, 1] * velocity[:, 0] - waypoint[:, 0] * velocity[:, 1] < 0.0
    signature, slant = 10.0 ** rng.uniform(-6.0, 0.0, cases), rng.uniform(10.0, 700.0, cases)
    least = probability_of_detection(signature, slant)
    nearer = probability_of_detection(signature, 0.9 * slant)
    larger = probability_of_detection(np.minimum(1.2 * signature, 1.0), slant)
    numbers = {
        "share of turns whose printed side is right": share_of(printed == right),
        "share of cases in which Table 4.2 rises with signature and falls with range": share_of(
            (nearer >= least) & (larger >= least)
        ),
    }
    table = pd.DataFrame([{"what": name, "share": one.value} for name, one in numbers.items()])
    return Reproduction(source=SOURCE, table=table, statistics=numbers)


def _row(drawn: DrawnPlan) -> dict[str, object]:
    """A plan as a row of the table."""
    s, c = drawn.plan.search, drawn.plan.verification
    row: dict[str, object] = {
        "figure": drawn.figure,
        "Pd": drawn.threshold,
        "planner": drawn.plan.planner,
        "status": s.status,
        "gap": s.gap,
        "seconds": s.seconds,
        "binaries": s.counts.integers,
        "linear": s.counts.continuous,
        "constraints": s.counts.constraints,
        "length [km]": drawn.plan.length,
        "lower bound [km]": drawn.plan.lower_bound,
    }
    if c is not None:
        row |= {
            "over the threshold [s]": c.time_over,
            "longest detection [s]": c.longest_detection,
            "largest Pd": c.largest_probability,
            "missile hits": not c.survived,
        }
    return row


def _figure(drawn: list[DrawnPlan], title: str) -> Figure:
    """Paths and the circles in which the side is seen, in the source's unequal axes."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 6.4), layout="constrained")
    axes = figure.subplots()
    bearing = np.linspace(-0.2, 0.7, 300)
    for threshold in sorted({s.threshold for s in drawn}):
        circle = limits_of(World(detection=Detection(threshold=threshold))).side
        axes.plot(
            circle * np.cos(bearing), circle * np.sin(bearing), color=COLOURS[threshold], lw=0.8, ls=":",
            label=f"side seen at {threshold}",
        )  # fmt: skip
    for s in drawn:
        lost = "lock-loss" in s.plan.planner
        style = "o--" if s.plan.planner.startswith("printed") else "s-"
        axes.plot(
            *s.plan.waypoints.T, style, color=GREY if lost else COLOURS[s.threshold],
            ms=4 if style == "o--" else 5, lw=1.0 if style == "o--" else 2.0,
            label=f"{s.plan.planner}, Pd {s.threshold}: {s.plan.length:.1f} km",
        )  # fmt: skip
    axes.set(xlim=(315, 375), ylim=(-10, 135), xlabel="north x [km]", ylabel="east y [km]", title=title)
    axes.legend(fontsize=7, loc="lower left")
    return figure


FIGURES = (figures_4_4_to_4_6, equations_of_4_2)
"""In the order of presentation."""
