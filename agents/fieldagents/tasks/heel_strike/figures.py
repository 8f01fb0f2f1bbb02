"""Figures of the heel-strike estimator's source, redone.

Source: A. I. Chaudhry, "Topics in robot locomotion", Cornell University 2015, chapter 2.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
from pydantic import Field

from fieldagents.claim import Statistic
from fieldagents.progress import Report
from fieldagents.reproduce.statistics import exact, share_of
from fieldagents.task import Reproducible, Reproduction
from fieldmodels.arrays import FloatArray
from fieldmodels.machines.heel_strike.parameters import SILENT, Leg, Noise
from fieldmodels.machines.heel_strike.search import record_walks, score_gains
from fieldmodels.machines.heel_strike.strides import Strides
from fieldmodels.machines.heel_strike.walker import TRACES

SOURCE = "A. I. Chaudhry, Topics in robot locomotion, Cornell University 2015, "
DECAY = 1000 / 3
Seed = Annotated[int, Field(ge=0)]


def figure_2_10(
    out: Path,  # noqa: ARG001 - nothing of its own to save
    progress: Report,
    *,
    seed: Seed = 0,
    walks: Annotated[int, Field(ge=1, le=10_000)] = 200,
) -> Reproduction:
    """Angle and rate errors of Ranger's estimator over four strides, by kind of noise."""
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
            axes.plot(time, errors[0], color="#0b6e99", linewidth=0.8)
            axes.set_ylabel(f"error [{unit}]")
            axes.grid(color="#d9dee6", linewidth=0.8)
        left.set_title(title, loc="left", fontsize=10)
        left.axhspan(-printed, printed, color="#e2b54d", alpha=0.25, zorder=0)
    sizes = [row["ours: median of the walks"] / row["printed: largest angle error [rad]"] for row in rows]
    panels[-1][0].set_xlabel("time [s]: angle (shaded: what the figure shows)")
    panels[-1][1].set_xlabel("time [s]: angular rate")
    figure.tight_layout()
    return Reproduction(
        "Ranger's estimator under gyro noise and under collision noise",
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


def figure_2_12(
    out: Path,  # noqa: ARG001
    progress: Report,
    *,
    strides: Annotated[int, Field(ge=10, le=100_000)] = 3000,
) -> Reproduction:
    """Error without any noise against the filter's decay S_FD."""
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
    axes.plot(fine, curve, color="#0b6e99", linewidth=1)
    axes.plot(decays, ours, "o", color="#0b6e99", label="estimator (2.14), S_MS = 1")
    axes.axhline(ranger, color="#b3402a", label="Ranger's own, without a filter")
    axes.axvline(best, color="#8a8f98", linestyle=":")
    axes.set_yscale("log")
    axes.set_xlabel("S_FD [1/s]")
    axes.set_ylabel("mean |error| at heel strike [mm]")
    axes.grid(color="#d9dee6", linewidth=0.8)
    axes.legend()
    figure.tight_layout()
    table = pd.DataFrame({"S_FD [1/s]": decays, "ours: mean |error| [mm]": ours})
    table["printed best"] = np.where(decays == 333.0, "best", "")
    return Reproduction(
        "The best decay of the gyro filter",
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


def figure_2_14(
    out: Path,  # noqa: ARG001
    progress: Report,
    *,
    strides: Annotated[int, Field(ge=10, le=100_000)] = 3000,
    seed: Seed = 0,
) -> Reproduction:
    """Error against S_MS for process noise of several amplitudes and hold times."""
    from matplotlib.figure import Figure

    shares = np.linspace(0, 1, 11)
    fine = np.concatenate([[0.0], np.geomspace(0.001, 1, 61)])
    holds, amplitudes = (0.1, 0.2, 0.3, 0.4), (0.1, 0.3, 0.5, 0.7, 0.9)
    figure = Figure(figsize=(11, 4.2))
    panels = figure.subplots(1, len(holds) + 1, width_ratios=(1, 1, 1, 1, 1.3))
    rows: list[dict[str, Any]] = []
    for i, hold in enumerate(holds):
        for j, amplitude in enumerate(amplitudes):
            progress(f"process noise {amplitude:g} rad/s2 for {hold:g} s", (5 * i + j) / 20)
            noise = Noise(process=amplitude, hold=hold, floor=0.0)
            walks = record_walks([np.random.default_rng([seed, i, j])], strides, noise=noise)
            gains = np.array([[s, s, 0.1, DECAY] for s in (*shares, *fine)])
            errors = score_gains(walks, gains)
            coarse, curve = errors[:11], errors[11:]
            best = int(np.argmin(coarse))
            colour = f"C{j}"
            panels[i].plot(shares, coarse, color=colour, label=f"{amplitude:g}")
            panels[i].plot(shares[best], coarse[best], "*", color=colour, markersize=10)
            rows.append(
                {
                    "hold [s]": hold,
                    "process noise [rad/s2]": amplitude,
                    "best S_MS of the figure's grid": shares[best],
                    "its error [mm]": coarse[best],
                    "error of the sensor alone [mm]": coarse[-1],
                    "best S_MS of a fine grid": fine[np.argmin(curve)],
                    "error there [mm]": curve.min(),
                }
            )
        panels[i].set_title(f"hold {hold:g} s", fontsize=10)
        panels[i].set_xlabel("S_MS")
        panels[i].set_ylim(0, 2)
        panels[i].grid(color="#d9dee6", linewidth=0.8)
    panels[0].set_ylabel("mean |error| at heel strike [mm]")
    panels[0].legend(title="rad/s2", fontsize=8)
    table = pd.DataFrame(rows)
    for time, part in table.groupby("hold [s]"):
        panels[-1].plot(part["process noise [rad/s2]"], part[table.columns[2]], "o-", label=f"{time} s")
    panels[-1].set_title("Fig 2.15: best S_MS", fontsize=10)
    panels[-1].set_xlabel("process noise [rad/s2]")
    panels[-1].legend(title="hold", fontsize=8)
    panels[-1].grid(color="#d9dee6", linewidth=0.8)
    figure.tight_layout()
    gained = 100 * (1 - table[table.columns[6]] / table[table.columns[3]])
    saved = 100 * (1 - table[table.columns[3]] / table[table.columns[4]])
    return Reproduction(
        "Model or sensor: the best share of each under process noise",
        SOURCE + "Figs 2.13 to 2.15: S_HR = 0.1, nominal gyro and collision noise (low_pass), flat floor",
        table,
        {"figure-2.14": figure},
        (
            "As printed: more process noise, and noise held for longer, want more of the sensor, and the "
            f"curves are flat. At the best S_MS of the figure's grid the error is {saved.min():.0f} to "
            f"{saved.max():.0f} % below that of the sensor alone.",
            f"A logarithmic grid from 0.001 finds at most {gained.max():.1f} % less error than the figure's "
            "grid of 0.1: for this noise that grid is fine enough.",
        ),
    )


FIGURES = (
    Reproducible(
        "figure-2.10",
        "Ranger's estimator under gyro noise and under collision noise (with Fig 2.9)",
        figure_2_10,
        quick={"walks": 60},
        processor_s=(1, 1),
    ),
    Reproducible(
        "figure-2.12",
        "The best decay of the gyro filter",
        figure_2_12,
        quick={"strides": 300},
        processor_s=(2, 1),
    ),
    Reproducible(
        "figure-2.14",
        "Model or sensor: the best share of each under process noise (with Figs 2.13 and 2.15)",
        figure_2_14,
    ),
)
"""In the order of presentation."""
