"""The walking robot's vision and steering, redone.

Source: A. I. Chaudhry, "Topics in robot locomotion", Cornell University 2015, chapter 3.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import pandas as pd
from pydantic import Field

from fieldagents.config import EnvironmentConfig
from fieldagents.evaluation.agents import make_agent
from fieldagents.evaluation.comparison import mean_interval
from fieldagents.evaluation.episodes import run_episodes
from fieldagents.progress import Report
from fieldagents.seeds import TEST_SEEDS
from fieldagents.task import get_task
from fieldmodels.html import AFTER, AMBER, LINE, PURPLE
from papers.line_following import photographs, venues
from papers.line_following.photographs import SOURCE
from papers.source import Reproduction, reproduces

if TYPE_CHECKING:
    from matplotlib.figure import Figure

GIVEN = {
    "one band": ("printed", "tuned", "memory", "lqg"),
    "two bands": ("two_bands",),
    "place, curvature and bias": ("ceiling",),
}
"""What agents are given to the agents that are given it."""
TRACKS = ("straight", "s", "oval")


@reproduces("information")
def information(
    progress: Report,
    *,
    episodes: Annotated[int, Field(ge=20, le=10_000)] = 100,
) -> Reproduction:
    """What one band of the image does not hold."""
    rows: list[dict[str, Any]] = []
    runs = [(name, track) for names in GIVEN.values() for name in names for track in TRACKS]
    for k, (name, track) in enumerate(runs):
        progress(f"{name}, {track}", k / len(runs))
        environment = EnvironmentConfig(settings={"track": track})
        agent = make_agent(name, "line_following", environment.settings).runs[0]
        table = run_episodes(agent, "line_following", environment, TEST_SEEDS[:episodes])
        distances = table["mean_offset"].to_numpy() * 1000
        low, high = mean_interval(distances, 20) or (np.nan, np.nan)
        rows.append(
            {
                "given": next(what for what, names in GIVEN.items() if name in names),
                "agent": name,
                "line": track,
                "mean distance [mm]": float(distances.mean()),
                "low": low,
                "high": high,
                "within 0.10 m [%]": float(100 * table["near"].mean()),
                "change of turn [mrad]": float(1000 * table["effort"].mean()),
            }
        )
    found = pd.DataFrame(rows)
    means = found.groupby("given")["mean distance [mm]"].min()
    return Reproduction(
        SOURCE + "section 3.5.3; the question is ours",
        found,
        {"information": _information_figure(found)},
        (
            "One centroid mixes up offset, heading, curvature and bias: whatever is done with it, the robot "
            "stays about as far from the line. A second band distinguishes curvature from offset, and here "
            "it also has noise of its own; on images, where a swaying body moves both alike, it gains less.",
            f"Best agent and line: {means['one band']:.0f} mm with one band, {means['two bands']:.0f} with "
            f"two, {means['place, curvature and bias']:.0f} with everything.",
        ),
    )


def _information_figure(found: pd.DataFrame) -> Figure:
    """Mean distances by agent and line, grouped by what the agents are given."""
    from matplotlib.figure import Figure

    known = get_task("line_following").agents
    figure = Figure(figsize=(9, 4))
    axes = figure.subplots()
    names = [name for group in GIVEN.values() for name in group]
    width = 0.25
    for j, track in enumerate(TRACKS):
        part = found[found["line"] == track].set_index("agent").loc[names]
        mean = part["mean distance [mm]"].to_numpy()
        errors = np.abs(np.stack([mean - part["low"], part["high"] - mean]))
        axes.bar(
            np.arange(len(names)) + (j - 1) * width, mean, 0.9 * width, yerr=errors,
            color=(AFTER, AMBER, PURPLE)[j], label=track, error_kw={"linewidth": 0.8},
        )  # fmt: skip
    edges = np.cumsum([len(group) for group in GIVEN.values()])[:-1] - 0.5
    for edge in edges:
        axes.axvline(edge, color=LINE)
    axes.set_xticks(range(len(names)), [f"{name}\n({known[name].sees})" for name in names], fontsize=8)
    axes.set_ylabel("mean distance from the line [mm]")
    axes.legend(frameon=False)
    figure.tight_layout()
    return figure


FIGURES = (
    photographs.side_sensors,
    photographs.figure_3_5,
    photographs.figure_3_8,
    photographs.figure_3_11,
    photographs.figure_3_13,
    venues.law,
    venues.figure_3_16,
    venues.figure_3_17,
    information,
)
"""In the order of presentation."""
