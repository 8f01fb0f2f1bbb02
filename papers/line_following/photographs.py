"""Chapter 3's tapes in front of a camera: histograms, exposure, thresholds, and the sensors before it.

A photograph here is the model's camera without its perspective: each patch of a chart reflects its share of
the light, the sensor adds a pedestal, the exposure a gain (`fieldmodels...parameters.Exposure`).
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pydantic import Field
from scipy.ndimage import gaussian_filter1d
from scipy.signal import find_peaks

from fieldagents.progress import Report
from fieldmodels.html import AFTER, BEFORE, GREEN, GREY
from fieldmodels.machines.line_following.firmware import calibrate, line_position
from fieldmodels.machines.line_following.parameters import (
    FLOORS,
    FULL_LIGHT_GAIN,
    TAPES,
    Camera,
    Exposure,
    Lighting,
)
from fieldmodels.machines.line_following.renderer import Renderer, make_view
from fieldmodels.machines.line_following.sensor import make_optics, see_line
from fieldmodels.machines.line_following.tracks import oval, straight
from papers.source import Reproduction, reproduces
from papers.statistics import exact, mean_of, share_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SOURCE = "A. I. Chaudhry, Topics in robot locomotion, Cornell University 2015, "
INK, RED, MUTED = AFTER, BEFORE, GREY
SIDE = 60
"""Pixels along each side of a patch of a chart."""
HAND_HELD = Exposure(mean=110.0, gain=1e4)
"""A photo camera with the robot's sensor, exposed so that nothing is clipped (assumed)."""
STUDIO = Exposure(mean=60.0, gain=1e4, pedestal=0.0, noise=0.4)
"""A photo camera with little noise that reads nothing without light (assumed)."""


def photograph(
    patches: NDArray[np.float64], exposure: Exposure, rng: np.random.Generator, light: float = 1.0
) -> NDArray[np.float64]:
    """Levels of a chart's patches, of equal size, not rounded.

    Args:
        patches: Share of the light that each reflects, shape (patches,).
        exposure: Of the camera.
        rng: Source of the pixels' noise.
        light: On the chart.

    Returns:
        Levels, shape (patches, pixels), not beyond 255.
    """
    bright = patches * light + exposure.pedestal
    gain = min(exposure.mean / bright.mean(), exposure.gain)
    noise = exposure.noise * gain / FULL_LIGHT_GAIN * rng.standard_normal((len(patches), SIDE * SIDE))
    return np.asarray(np.clip(gain * bright[:, None] + noise, 0.0, 255.0))


def peaks(levels: NDArray[np.float64]) -> int:
    """Number of distinct peaks in a histogram, by a kernel of one level; each has 2 % of the pixels."""
    counts = np.histogram(levels, bins=np.arange(-10, 266))[0]
    smooth = gaussian_filter1d(counts / counts.sum(), 1.0, mode="constant")
    return len(find_peaks(smooth, prominence=0.1 * smooth.max() / 2, distance=3)[0])


def _histogram(axes: Axes, levels: NDArray[np.float64], title: str) -> None:
    axes.hist(levels.ravel(), bins=list(range(0, 257, 2)), color=INK)
    axes.set_yticks([])
    axes.set_title(title, loc="left", fontsize=10)


@reproduces("figure-3.8", quick={"photos": 50}, processor_s=(1, 1))
def figure_3_8(
    progress: Report,
    *,
    photos: Annotated[int, Field(ge=10, le=1000)] = 100,
) -> Reproduction:
    """Black tape on grey and white, and what exposure does to it (Figs 3.8, 3.9)."""
    from matplotlib.figure import Figure

    tape, grey, white = 0.0125, FLOORS["dark_grey"], FLOORS["white"]
    charts = {"3.8": np.array([tape, grey, white]), "3.9": np.array([tape, grey, grey])}
    found: list[dict[str, float]] = []
    for k in range(photos):
        progress("photographs", k / photos)
        rng = np.random.default_rng([38, k])
        first, second = (photograph(chart, HAND_HELD, rng) for chart in charts.values())
        found.append(
            {
                "three peaks": float(peaks(first) == 3 and (np.diff(np.median(first, axis=1)) > 0).all()),
                "grey": float(np.median(second[1]) - np.median(first[1])),
                "tape": float(np.median(second[0]) - np.median(first[0])),
                "wider": float(second[0].std() / first[0].std()),
            }
        )
    table = pd.DataFrame(found)
    perfect = {}
    for pedestal in (0.0, HAND_HELD.pedestal):
        camera = Exposure(mean=110.0, gain=1e4, pedestal=pedestal, noise=0.0)
        chart, rng = np.array([0.0, grey, grey]), np.random.default_rng(0)
        perfect[pedestal] = max(
            float(photograph(chart, camera, rng, light).max(axis=1)[0]) for light in (1, 0.1)
        )
    figure = Figure(figsize=(9, 5))
    rng = np.random.default_rng([38, 0])
    for row, (name, chart) in zip(figure.subplots(2, 2, width_ratios=(1, 2)), charts.items(), strict=True):
        levels = photograph(chart, HAND_HELD, rng)
        row[0].imshow(np.hstack([p.reshape(SIDE, SIDE) for p in levels]), cmap="gray", vmin=0, vmax=255)
        row[0].set_axis_off()
        _histogram(row[1], levels, f"Fig {name}")
    figure.tight_layout()
    return Reproduction(
        SOURCE + "Figs 3.8 and 3.9, section 3.4.1",
        table.mean().rename("mean of photographs").rename_axis("what").reset_index(),
        {"figure-3.8": figure},
        (
            "Without the white background the exposure grows: grey and tape move to the right, and the "
            "tape's peak widens. Of a perfectly black tape the camera's own reading without light remains.",
        ),
        {
            "photographs with three peaks in order [1]": share_of(table["three peaks"]),
            "shift of the grey peak [levels]": mean_of(table["grey"]),
            "shift of the tape's peak [levels]": mean_of(table["tape"]),
            "width of the tape's peak, Fig 3.9 to 3.8 [1]": mean_of(table["wider"]),
            "level of a perfectly black tape, no pedestal [levels]": exact(perfect[0.0]),
            "level of a perfectly black tape, the pedestal of Fig 3.13 [levels]": exact(
                perfect[HAND_HELD.pedestal]
            ),
        },
    )


@reproduces("figure-3.11", quick={"photos": 50}, processor_s=(1, 1))
def figure_3_11(
    progress: Report,
    *,
    photos: Annotated[int, Field(ge=10, le=1000)] = 100,
) -> Reproduction:
    """Four tapes in one photograph, as taken and with altered levels (Figs 3.11, 3.12)."""
    from matplotlib.figure import Figure

    names = ("duvetyne", "shurtape", "masking", "gaffer")
    chart = np.array([*(float(np.mean(TAPES[name].reflectance)) for name in names), 0.3])
    rows = []
    for k in range(photos):
        progress("photographs", k / photos)
        levels = photograph(chart, STUDIO, np.random.default_rng([311, k]))
        middle = np.median(levels, axis=1)
        # section 3.4.1: the lightest level just right of the darkest peak, middle grey just left of it
        black, white = 0.5 * middle[0], 1.25 * middle[0]
        altered = np.clip(255.0 * (levels - black) / (white - black), 0.0, 255.0)
        rows.append(
            {
                "five peaks": float(peaks(levels) == 5),
                "others white": float((altered[1:4] >= 250).mean()),
                "duvetyne": float(np.median(altered[0])),
            }
        )
    table = pd.DataFrame(rows)
    figure = Figure(figsize=(9, 5))
    shown = (("Fig 3.11", levels, (0.0, 255.0)), ("Fig 3.12", altered, (black, white)))
    for row, (name, picture, ends) in zip(figure.subplots(2, 2, width_ratios=(1, 2)), shown, strict=True):
        row[0].imshow(np.hstack([p.reshape(SIDE, SIDE) for p in picture]), cmap="gray", vmin=0, vmax=255)
        row[0].set_axis_off()
        row[1].hist(np.log2(np.maximum(levels.ravel(), 1.0)), bins=200, color=INK)
        for end in ends:
            row[1].axvline(np.log2(max(end, 1.0)), color=RED)
        row[1].set_yticks([])
        row[1].set_title(f"{name}: black and white in red", loc="left", fontsize=10)
        row[1].set_xlabel("level as taken, in powers of two")
    figure.tight_layout()
    return Reproduction(
        SOURCE + "Figs 3.10 to 3.12, section 3.4.1",
        table.mean().rename("mean of photographs").rename_axis("what").reset_index(),
        {"figure-3.11": figure},
        ("What the tapes reflect is read off the source's figure; what a camera makes of it is computed.",),
        {
            "photographs with five peaks [1]": share_of(table["five peaks"]),
            "pixels of the three other tapes that are white [1]": mean_of(table["others white"]),
            "level of Duvetyne, altered [levels]": mean_of(table["duvetyne"]),
        },
    )


@reproduces("figure-3.5", quick={"views": 60}, processor_s=(1, 1))
def figure_3_5(
    progress: Report,
    *,
    views: Annotated[int, Field(ge=20, le=5000)] = 400,
) -> Reproduction:
    """The firmware's view of the line, and its centroid."""
    from matplotlib.figure import Figure

    camera, track, limit = Camera(), oval(), Exposure().threshold
    renderer, optics = Renderer(track, camera), make_optics(camera)
    rng, errors, image = np.random.default_rng(35), [], np.zeros((camera.rows, camera.width), np.uint8)
    for k in range(views):
        progress("views", k / views)
        arc, offset, askew = rng.uniform(5, 55), rng.uniform(-0.3, 0.3), rng.uniform(-0.2, 0.2)
        x, y, along = track.at(arc)
        x, y, heading = x - offset * np.sin(along), y + offset * np.cos(along), along + askew
        image = renderer.image((x, y, heading), arc, k)
        seen, found = line_position(image, camera, limit)
        meant, there = see_line(
            track.table, track.spacing, track.closed, TAPES["duvetyne"].width, x, y,
            np.cos(heading), np.sin(heading), arc, 0.0, camera.height, optics,
        )  # fmt: skip
        if found and there:
            errors.append(abs(seen - meant) * 1000.0)
    figure = Figure(figsize=(8, 3.2))
    column = camera.width / 2 - seen / camera.metres_per_pixel
    for axes, picture, title in zip(
        figure.subplots(1, 2), (image, 255 * (image < limit)), ("the view", "on the monitor"), strict=True
    ):
        axes.imshow(picture, cmap="gray", vmin=0, vmax=255)
        axes.axhspan(camera.first_row, camera.last_row, color=INK, alpha=0.2)
        axes.plot(column, 0.5 * (camera.first_row + camera.last_row), "+", color=RED, markersize=16)
        axes.set_axis_off()
        axes.set_title(title, loc="left", fontsize=10)
    return Reproduction(
        SOURCE + "Figs 3.5 and 3.6, section 3.3.2",
        pd.DataFrame({"views": [len(errors)], "mean error of the centroid [mm]": [np.mean(errors)]}),
        {"figure-3.5": figure},
        ("The geometry shares no code with image and firmware.",),
        {"mean error of the centroid [mm]": mean_of(errors)},
    )


@reproduces("figure-3.13", processor_s=(2, 2))
def figure_3_13(
    progress: Report,
    *,
    lights: tuple[Annotated[float, Field(ge=0, le=2)], ...] = (1.0, 0.4, 0.2, 0.12),
    frames: Annotated[int, Field(ge=10, le=1000)] = 40,
) -> Reproduction:
    """Levels of tape and floor in red, green and blue by light, and the thresholds between them."""
    from matplotlib.figure import Figure

    camera = Camera()
    figure = Figure(figsize=(10, 2.1 * len(lights)))
    panels = np.atleast_2d(figure.subplots(len(lights), 2, width_ratios=(1, 2)))
    mask = np.zeros((camera.rows, camera.width), dtype=np.bool_)
    mask[camera.first_row : camera.last_row, camera.width // 2 - 2 : camera.width // 2 + 2] = True
    floor = np.ones_like(mask)
    floor[:, camera.width // 2 - 10 : camera.width // 2 + 10] = False
    taken: dict[tuple[float, str], list[NDArray[np.uint8]]] = {}
    for k, (light, tape) in enumerate(product(lights, ("duvetyne", "duvetyne_wide"))):
        progress(f"light {light:g}", k / len(lights) / 2)
        view = make_view(camera, tape, lighting=Lighting(light=light), colour=True)
        renderer = Renderer(straight(), camera, view)
        taken[light, tape] = [renderer.image((20.0, 0.0, 0.0), 20.0, key) for key in range(frames)]
    kept = [taken[light, "duvetyne"][0] for light in lights if light >= min(lights[:2])]
    # section 3.4.2: a threshold for each component, from photos in several lights; the seam is neither
    chosen = tuple(
        calibrate([np.where(mask | floor, image[..., c], 165) for image in kept], [mask] * len(kept))
        for c in range(3)
    )
    found = {key: [line_position(one, camera, chosen)[1] for one in shots] for key, shots in taken.items()}
    rows: list[dict[str, Any]] = []
    for light, (left, right) in zip(lights, panels, strict=True):
        first = taken[light, "duvetyne"][0]
        left.set_title(f"light {light:g}", loc="left", fontsize=10)
        _components(left, right, first, chosen)
        rows.append(
            {
                "light": light,
                "tape: median level": float(np.median(first[mask])),
                "floor: median level": float(np.median(first[floor])),
                "line found, 2 inches of tape [%]": 100 * np.mean(found[light, "duvetyne"]),
                "line found, 4 inches [%]": 100 * np.mean(found[light, "duvetyne_wide"]),
            }
        )
    panels[-1][1].set_xlabel("level")
    figure.tight_layout()
    full, dim = (taken[light, "duvetyne"] for light in (lights[0], lights[len(lights) // 2]))
    rises = [np.median(b[mask]) - np.median(a[mask]) for a, b in zip(full, dim, strict=True)]
    return Reproduction(
        SOURCE + "Fig 3.13 and sections 3.4.2, 3.6",
        pd.DataFrame(rows),
        {"figure-3.13": figure},
        (
            "Calibrated on the two brightest lights (section 3.4.2), the thresholds are "
            + ", ".join(f"{level:.0f}" for level in chosen)
            + f"; the default is {Exposure().threshold:.0f} in each.",
            "As the light goes, exposure lifts the tape's level towards the floor's until too few pixels "
            "stay below the thresholds; twice the tape has twice the pixels and lasts longer.",
            "Levels at full light are matched by pedestal and gain, which the source does not give; "
            "how they move with the light is what the model then predicts.",
        ),
        {
            "tape in full light [levels]": mean_of([np.median(one[mask]) for one in full]),
            "floor in full light [levels]": mean_of([np.median(one[floor]) for one in full]),
            f"rise of the tape's level at light {lights[len(lights) // 2]:g} [levels]": mean_of(rises),
            **{
                f"line found at light {light:g}, {words} [1]": share_of(found[light, tape])
                for light in lights
                for tape, words in (("duvetyne", "2 inches"), ("duvetyne_wide", "4 inches"))
            },
        },
    )


def _components(left: Axes, right: Axes, image: NDArray[np.uint8], chosen: tuple[float, ...]) -> None:
    """Draw an image, and its components' histograms with their thresholds."""
    left.imshow(image)
    left.set_axis_off()
    for c, name in enumerate(("red", "green", "blue")):
        right.hist(image[..., c].ravel(), bins=list(range(0, 257, 4)), histtype="step", color=name)
        right.axvline(chosen[c], color=name, linestyle=":")
    right.set_yscale("log")


LAMPS: Mapping[str, tuple[float, float, float]] = {
    "daylight": (1.0, 1.0, 1.0),
    "incandescent": (1.5, 1.0, 0.5),
    "fluorescent": (0.9, 1.1, 0.8),
}
"""Red, green and blue in the light of lamps, relative to daylight (assumed)."""


@reproduces("side-sensors", quick={"readings": 500}, processor_s=(1, 1))
def side_sensors(
    progress: Report,
    *,
    readings: Annotated[int, Field(ge=50, le=100_000)] = 2000,
    noise: Annotated[float, Field(ge=0, le=0.1)] = 0.005,
) -> Reproduction:
    """Colour sensors that look aside."""
    from matplotlib.figure import Figure

    grounds = np.array([FLOORS["track_red"], FLOORS["track_green"]])

    def distances(read: NDArray[np.float64], by: str) -> NDArray[np.float64]:
        """Distance of readings, shape (n, 3), from what each ground gave at calibration, shape (n, 2)."""
        if by == "components":
            return np.asarray(np.linalg.norm(read[:, None] - grounds, axis=2))
        ratio = np.log(np.maximum(read[:, 0], 1e-4) / np.maximum(read[:, 1], 1e-4))
        return np.asarray(np.abs(ratio[:, None] - np.log(grounds[:, 0] / grounds[:, 1])))

    rng, rows, statistics = np.random.default_rng(312), [], {}
    for k, (case, low, lamps) in enumerate(
        (
            ("as calibrated", 1.0, ("daylight",)),
            ("light from a tenth to full", 0.1, ("daylight",)),
            ("light and lamps change", 0.1, tuple(LAMPS)),
        )
    ):
        progress(case, k / 3)
        which = rng.integers(0, 2, readings)
        light = np.exp(rng.uniform(np.log(low), 0.0, readings))[:, None]
        lamp = np.array([LAMPS[name] for name in lamps])[rng.integers(0, len(lamps), readings)]
        read = light * lamp * grounds[which] + noise * rng.standard_normal((readings, 3))
        for by in ("components", "ratio of red to green"):
            right = distances(read, by).argmin(axis=1) == which
            statistics[f"right, {case}, by {by} [1]"] = share_of(right)
            rows.append({"conditions": case, "compared": by, "right [%]": 100 * right.mean()})
    figure = Figure(figsize=(5, 4))
    axes = figure.subplots()
    axes.scatter(read[:, 0], read[:, 1], s=4, c=np.array([RED, GREEN])[which])
    axes.plot(*grounds[:, :2].T, "k+", markersize=14, label="at calibration")
    axes.set_xlabel("red component")
    axes.set_ylabel("green component")
    axes.legend(frameon=False)
    figure.tight_layout()
    return Reproduction(
        SOURCE + "section 3.1.2",
        pd.DataFrame(rows),
        {"side-sensors": figure},
        (
            "The colours of the ground, the lamps and the noise are assumed; what decides is whether levels "
            "are compared, which go with the light, or their ratio, which does not.",
        ),
        statistics,
    )
