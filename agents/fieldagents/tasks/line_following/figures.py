"""The walking robot's vision and steering, redone.

Source: A. I. Chaudhry, "Topics in robot locomotion", Cornell University 2015, chapter 3.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pydantic import Field

from fieldagents.config import EnvironmentConfig
from fieldagents.evaluation.agents import make_agent
from fieldagents.evaluation.comparison import mean_interval
from fieldagents.evaluation.episodes import run_episodes
from fieldagents.progress import Report
from fieldagents.seeds import TEST_SEEDS
from fieldagents.task import Reproducible, Reproduction, get_task
from fieldmodels.machines.line_following.firmware import calibrate, line_position
from fieldmodels.machines.line_following.parameters import Camera, Exposure, Lighting
from fieldmodels.machines.line_following.renderer import Renderer, make_view
from fieldmodels.machines.line_following.tracks import straight

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SOURCE = "A. I. Chaudhry, Topics in robot locomotion, Cornell University 2015, "
TAPE, FLOOR, INK = "#263240", "#e2b54d", "#0b6e99"
PRINTED = {"tape": "mid-30s", "floor": "160 to 170"}


def figure_3_13(
    out: Path,  # noqa: ARG001 - nothing of its own to save
    progress: Report,
    *,
    lights: tuple[Annotated[float, Field(ge=0, le=2)], ...] = (1.0, 0.4, 0.2, 0.12),
    frames: Annotated[int, Field(ge=2, le=1000)] = 40,
) -> Reproduction:
    """Levels of tape and floor in the camera's image, by light, and the threshold between them."""
    from matplotlib.figure import Figure

    camera, threshold = Camera(), Exposure().threshold
    figure = Figure(figsize=(10, 2.1 * len(lights)))
    panels = np.atleast_2d(figure.subplots(len(lights), 2, width_ratios=(1, 2)))
    mask = np.zeros((camera.rows, camera.width), dtype=np.bool_)
    mask[camera.first_row : camera.last_row, camera.width // 2 - 2 : camera.width // 2 + 2] = True
    floor = np.ones_like(mask)
    floor[:, camera.width // 2 - 10 : camera.width // 2 + 10] = False
    rows: list[dict[str, Any]] = []
    kept: list[NDArray[np.uint8]] = []
    for k, (light, (left, right)) in enumerate(zip(lights, panels, strict=True)):
        progress(f"light {light:g}", k / len(lights))
        found = {}
        for tape in ("duvetyne", "duvetyne_wide"):
            renderer = Renderer(straight(), camera, make_view(camera, tape, lighting=Lighting(light=light)))
            images = [renderer.image((20.0, 0.0, 0.0), 20.0, key) for key in range(frames)]
            found[tape] = float(np.mean([line_position(image, camera, threshold)[1] for image in images]))
            if tape == "duvetyne":
                first = images[0]
        if light >= min(lights[:2]):
            kept.append(first)
        left.imshow(first, cmap="gray", vmin=0, vmax=255)
        left.set_axis_off()
        left.set_title(f"light {light:g}", loc="left", fontsize=10)
        bins = np.arange(0, 257, 4)
        right.hist(first[floor], bins=bins, color=FLOOR, label="floor", density=True)
        right.hist(first[mask], bins=bins, color=TAPE, label="tape", density=True)
        right.axvline(threshold, color=INK, label="threshold")
        right.set_yticks([])
        rows.append(
            {
                "light": light,
                "tape: median level": float(np.median(first[mask])),
                "floor: median level": float(np.median(first[floor])),
                "printed": f"tape {PRINTED['tape']}, floor {PRINTED['floor']}" if k == 0 else "",
                "line found, 2 inches of tape [%]": 100 * found["duvetyne"],
                "line found, 4 inches [%]": 100 * found["duvetyne_wide"],
            }
        )
    panels[0][1].legend(frameon=False)
    panels[-1][1].set_xlabel("level")
    figure.tight_layout()
    chosen = calibrate([np.where(mask | floor, image, 165) for image in kept], [mask] * len(kept))
    return Reproduction(
        "Levels of tape and floor by light",
        SOURCE + "Fig 3.13 and sections 3.4.2, 3.6",
        pd.DataFrame(rows),
        {"figure-3.13": figure},
        (
            f"Calibrated on the two brightest lights (section 3.4.2), the threshold is {chosen:.0f};"
            f" the default is {threshold:.0f}.",
            "As the light goes, exposure lifts the tape's level towards the floor's until too few pixels "
            "stay below the threshold; twice the tape has twice the pixels and lasts longer, as in the dark "
            "corner of section 3.6.",
            "Levels at full light are matched by the model's pedestal and gain, which the source does not "
            "give; how the levels move with the light is what the model then predicts.",
        ),
    )


GIVEN = {
    "one band": ("printed", "tuned", "memory", "lqg"),
    "two bands": ("two_bands",),
    "place, curvature and bias": ("ceiling",),
}
"""What agents are given to the agents that are given it."""
TRACKS = ("straight", "s", "oval")


def information(
    out: Path,  # noqa: ARG001 - nothing of its own to save
    progress: Report,
    *,
    episodes: Annotated[int, Field(ge=20, le=10_000)] = 100,
) -> Reproduction:
    """Distance from the line by what an agent is given: one band, two bands, everything."""
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
        "What one band of the image does not hold",
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
            color=("#0b6e99", "#e2b54d", "#b070b0")[j], label=track, error_kw={"linewidth": 0.8},
        )  # fmt: skip
    edges = np.cumsum([len(group) for group in GIVEN.values()])[:-1] - 0.5
    for edge in edges:
        axes.axvline(edge, color="#d9dee6")
    axes.set_xticks(range(len(names)), [f"{name}\n({known[name].sees})" for name in names], fontsize=8)
    axes.set_ylabel("mean distance from the line [mm]")
    axes.legend(frameon=False)
    figure.tight_layout()
    return figure


FIGURES = (
    Reproducible(
        "figure-3.13", "Levels of tape and floor by light, and the threshold between them", figure_3_13
    ),
    Reproducible("information", "What one band of the image does not hold", information),
)
"""In the order of presentation."""
