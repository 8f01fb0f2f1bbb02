"""Figures 4.4 to 4.6 of the UAV route's source, redone, with undetected routes beside the printed ones.

Source: A. I. Chaudhry, "Topics in robot locomotion", Cornell University 2015, chapter 4.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import pandas as pd
from pydantic import Field as Bounded

from fieldagents.progress import Report
from fieldagents.task import Reproducible, Reproduction
from fieldagents.tasks.uav_route.lattice import lattice_plan
from fieldagents.tasks.uav_route.legs import leg_plan
from fieldagents.tasks.uav_route.limits import limits_of
from fieldagents.tasks.uav_route.plan import Plan
from fieldagents.tasks.uav_route.printed import Form, printed_plan
from fieldmodels.machines.uav_route.parameters import EXAMPLE, Detection, World

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SOURCE = "A. I. Chaudhry, Topics in robot locomotion, Cornell University 2015, chapter 4, Figs 4.4 to 4.6"
COLOURS = {0.5: "#0b6e99", 0.6: "#b3402a", 0.7: "#5b7f2b"}
GREY = "#8a8f98"
PRINTED_COUNTS = {"binaries (source)": 15363, "linear (source)": 72, "constraints (source)": 10359}
"""Section 4.5.1, for one aircraft at 0.5."""


@dataclass(frozen=True)
class Drawn:
    """A plan in a figure.

    Attributes:
        figure: Number of the figure.
        threshold: Probability of detection that is accepted.
        plan: The plan.
    """

    figure: str
    threshold: float
    plan: Plan


def figures_4_4_to_4_6(
    out: Path,  # noqa: ARG001 - nothing of its own to save
    progress: Report,
    *,
    sides: Annotated[int, Bounded(ge=24, le=72)] = 24,
    work: Annotated[int, Bounded(ge=1)] = 200_000,
) -> Reproduction:
    """Plan the source's example as it does, in whole legs, and with lock loss; M is ``sides``."""
    form, drawn = Form(sides=sides), []
    for i, threshold in enumerate(COLOURS):
        progress("planning", i / 4)
        world = World(detection=Detection(threshold=threshold))
        figure = "4.4" if threshold == 0.5 else "4.5"
        drawn.append(Drawn(figure, threshold, printed_plan(EXAMPLE, world, form, work=work)))
        drawn.append(Drawn(figure, threshold, leg_plan(EXAMPLE, world, work=work)))
    progress("planning", 3 / 4)
    lock_loss = replace(form, lock_loss=4)
    drawn.append(Drawn("4.6", 0.5, printed_plan(EXAMPLE, form=lock_loss, work=work)))
    drawn.append(Drawn("4.6", 0.5, lattice_plan(EXAMPLE, lock_loss=True)))
    rows = [_row(s) for s in drawn]
    rows[0] |= PRINTED_COUNTS
    return Reproduction(
        title="Paths under radar detection and lock loss: the source's program, and routes that hold",
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
    )


def _row(drawn: Drawn) -> dict[str, object]:
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


def _figure(drawn: list[Drawn], title: str) -> Figure:
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


FIGURES = (
    Reproducible("figure-4.5", "Paths under detection and lock loss (Figs 4.4 to 4.6)", figures_4_4_to_4_6),
)
"""In the order of presentation."""
