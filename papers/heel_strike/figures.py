"""Figures of the heel-strike estimator's source, redone.

Source: A. I. Chaudhry, "Topics in robot locomotion", Cornell University 2015, chapter 2.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any

import numpy as np
import pandas as pd
from pydantic import Field

from fieldagents.progress import Report
from fieldmodels.arrays import FloatArray
from fieldmodels.html import AFTER, AMBER, BEFORE, GREY, LINE
from fieldmodels.machines.heel_strike.parameters import SILENT, Leg, Noise
from fieldmodels.machines.heel_strike.search import record_walks, score_gains
from fieldmodels.machines.heel_strike.strides import Strides
from fieldmodels.machines.heel_strike.walker import TRACES
from papers.claim import Statistic
from papers.heel_strike.basics import BASICS
from papers.heel_strike.gait import GAIT
from papers.heel_strike.sweeps import DECAY, SOURCE, SWEEPS, Seed
from papers.source import Reproduction, reproduces
from papers.statistics import exact, share_of


@reproduces("figure-2.10", processor_s=(1, 1))
def figure_2_10(
    progress: Report,
    *,
    seed: Seed = 0,
    walks: Annotated[int, Field(ge=1, le=10_000)] = 200,
) -> Reproduction:
    """Ranger's estimator under gyro noise and under collision noise (with Fig 2.9)."""
    from matplotlib.figure import Figure

    cases = {
        "gyro noise, 0.0051 rad/s": (replace(SILENT, gyro=0.0051), "2.9", 3e-4),
        "collision noise 0.5 rad/s, low_pass": (replace(SILENT, collision=0.5), "2.10", 1e-3),
        "collision noise 0.5 rad/s, ar1": (
            replace(SILENT, collision=0.5, collision_kind="ar1"),
            "2.10",
            1e-3,
        ),
    }
    figure = Figure(figsize=(10, 2.2 * len(cases)))
    panels = figure.subplots(len(cases), 2, sharex=True)
    rows: list[dict[str, Any]] = []
    statistics: dict[str, Statistic] = {}
    for case, ((title, (noise, number, printed)), (left, right)) in enumerate(
        zip(cases.items(), panels, strict=True)
    ):
        progress(title, case / len(cases))
        time, angle, rate = _ranger_errors(noise, seed, walks)
        largest = np.nanmax(np.abs(angle), axis=1)
        statistics[f"share of walks with at most the printed error, {title}"] = share_of(largest <= printed)
        rows.append(
            {
                "noise": title,
                "figure": number,
                "printed: largest angle error [rad]": printed,
                "ours: median of the walks": float(np.median(largest)),
                "smallest": float(largest.min()),
                "largest": float(largest.max()),
            }
        )
        for axes, errors, unit in ((left, angle, "rad"), (right, rate, "rad/s")):
            axes.plot(time, errors[0], color=AFTER, linewidth=0.8)
            axes.set_ylabel(f"error [{unit}]")
            axes.grid(color=LINE, linewidth=0.8)
        left.set_title(title, loc="left", fontsize=10)
        left.axhspan(-printed, printed, color=AMBER, alpha=0.25, zorder=0)
    sizes = [row["ours: median of the walks"] / row["printed: largest angle error [rad]"] for row in rows]
    panels[-1][0].set_xlabel("time [s]: angle (shaded: what the figure shows)")
    panels[-1][1].set_xlabel("time [s]: angular rate")
    figure.tight_layout()
    return Reproduction(
        SOURCE + "Figs 2.9 and 2.10: S_MS = 1, S_HR = 0.1",
        pd.DataFrame(rows),
        {"figure-2.10": figure},
        (
            f"The median walk's largest error is {sizes[0]:.1f} times that of Fig 2.9, and {sizes[1]:.1f} "
            "times that of Fig 2.10 with low_pass noise; each figure shows one walk.",
            "Collision noise as the text of section 2.4.3 has it (correlation 0.995 from sample to sample, "
            f"amplitude 0.5 rad/s: ar1) gives errors {sizes[2]:.0f} times those of Fig 2.10. Noise of the "
            "figure's size comes from passing uniform draws through x' = 0.995 x + 0.005 u (low_pass). Both "
            "are kinds of collision noise in the environment.",
        ),
        statistics,
    )


def _ranger_errors(noise: Noise, seed: int, walks: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Time [s], and errors of angle [rad] and rate [rad/s] of Ranger's estimator, shape (walks, samples)."""
    leg = Leg()
    strides = Strides(walks, leg, noise)
    strides.restart(range(walks), [np.random.default_rng([seed, walk]) for walk in range(walks)])
    column = {name: i for i, name in enumerate(TRACES)}
    parts = []
    for _ in range(4):
        result = strides.advance((1.0, 1.0, 0.1, DECAY), traces=True)
        assert result.traces is not None
        parts.append(result.traces)
    trace = np.concatenate(parts, axis=1)
    angle = trace[:, :, column["theta"]] - trace[:, :, column["theta_ranger"]]
    rate = trace[:, :, column["omega"]] - trace[:, :, column["gyro"]]  # (2.2): its rate is the gyro's
    return trace[0, :, column["time"]], angle, rate


@reproduces("figure-2.12", quick={"strides": 300}, processor_s=(2, 1))
def figure_2_12(
    progress: Report,
    *,
    strides: Annotated[int, Field(ge=10, le=100_000)] = 3000,
) -> Reproduction:
    """The best decay of the gyro filter."""
    from matplotlib.figure import Figure

    progress("walking without noise", 0.0)
    walks = record_walks([np.random.default_rng(0)], strides, noise=SILENT)
    decays = np.arange(33.0, 984.0, 50.0)
    fine = np.linspace(33, 983, 400)
    sets = np.array([[1.0, 1.0, 0.1, decay] for decay in (*decays, *fine, DECAY)])
    progress("scoring every decay", 0.3)
    errors = score_gains(walks, sets)
    ours, curve = errors[: len(decays)], errors[len(decays) : -1]
    ranger = float(np.abs(walks.estimator_mm[:, 1]).mean())
    best = float(decays[np.argmin(ours)])
    beside = float(ours[np.abs(np.abs(decays - best) - 50) < 1].min())
    figure = Figure(figsize=(7, 4))
    axes = figure.subplots()
    axes.plot(fine, curve, color=AFTER, linewidth=1)
    axes.plot(decays, ours, "o", color=AFTER, label="estimator (2.14), S_MS = 1")
    axes.axhline(ranger, color=BEFORE, label="Ranger's own, without a filter")
    axes.axvline(best, color=GREY, linestyle=":")
    axes.set_yscale("log")
    axes.set_xlabel("S_FD [1/s]")
    axes.set_ylabel("mean |error| at heel strike [mm]")
    axes.grid(color=LINE, linewidth=0.8)
    axes.legend()
    figure.tight_layout()
    table = pd.DataFrame({"S_FD [1/s]": decays, "ours: mean |error| [mm]": ours})
    table["printed best"] = np.where(decays == 333.0, "best", "")
    return Reproduction(
        SOURCE + "Fig 2.12: no noise, S_HR = 0.1",
        table,
        {"figure-2.12": figure},
        (
            f"Printed: best around 333 / s. Ours: best of the same grid at {best:g} / s, and on a continuous "
            f"scale at {fine[np.argmin(curve)]:.0f} / s.",
            f"333 is 2 / (3 dt) = {1 / (1.5 * walks.leg.step):.1f} / s: there the filter's lag cancels the "
            "lead of Euler-Cromer. It is a matter of the sampling rate and scales with it. The minimum "
            f"is not shallow: 50 / s beside it the error is {beside / ours.min():.0f} times as large.",
        ),
        {
            "best decay of the printed grid [1/s]": exact(best),
            "error 50 / s beside the best, over the least": exact(beside / ours.min()),
        },
    )


FIGURES = (*BASICS, *GAIT, figure_2_10, figure_2_12, *SWEEPS)
"""In the order of presentation."""
