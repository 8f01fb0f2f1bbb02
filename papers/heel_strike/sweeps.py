"""The sweeps of the estimator's three gains over kinds and sizes of noise: Figs 2.13 to 2.23 and section 2.7.

Source: A. I. Chaudhry, "Topics in robot locomotion", Cornell University 2015, chapter 2.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import pandas as pd
from pydantic import Field

from fieldagents.progress import Report
from fieldmodels.arrays import FloatArray
from fieldmodels.html import AFTER, LINE
from fieldmodels.machines.heel_strike.parameters import Noise
from fieldmodels.machines.heel_strike.search import Walks, record_walks, score_gains, stride_errors
from papers.claim import Statistic
from papers.source import Reproduction, reproduces
from papers.statistics import exact, mean_of, share_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SOURCE = "A. I. Chaudhry, Topics in robot locomotion, Cornell University 2015, "
DECAY = 1000 / 3
SCORES = {"error of the estimate": False, "floor added to the error": True}
"""Section 2.4.5: the floor's height "is added to estimators' error at heel-strike": to what the reset takes
for the angle, or to the error that is scored."""

Seed = Annotated[int, Field(ge=0)]
Strides = Annotated[int, Field(ge=10, le=100_000)]
Levels = Annotated[int, Field(ge=1, le=9)]


def gain_sets(shares: Any, resets: Any, decays: Any) -> FloatArray:
    """All combinations of S_MS, S_HR and S_FD, shape (sets, 4)."""
    return np.array([(s, s, r, d) for s, r, d in product(shares, resets, decays)], dtype=np.float64)


def walked(seed: tuple[int, ...], noise: Noise, strides: int, walks: int = 1) -> Walks:
    """Walks under stationary noise, of their own random numbers each."""
    return record_walks([np.random.default_rng([*seed, i]) for i in range(walks)], strides, noise=noise)


def per_walk(errors: FloatArray, walks: Walks, floor_added: bool) -> FloatArray:
    """Mean |error| of each walk [mm], shape (..., walks), from signed errors of shape (..., strides)."""
    if floor_added:
        errors = errors + walks.height * 1000 * walks.leg.step_length
    starts = np.flatnonzero(np.diff(walks.walk, prepend=-1))
    counts = np.diff(np.append(starts, len(walks)))
    return np.asarray(np.add.reduceat(np.abs(errors), starts, axis=-1) / counts)


def _ratio_sweep(
    curves: list[tuple[float, float, Noise]], shares: FloatArray, strides: int, seed: int, progress: Report
) -> tuple[pd.DataFrame, FloatArray, dict[tuple[float, float], tuple[FloatArray, FloatArray]]]:
    """Error against S_MS for noises named by panel and curve.

    Returns:
        What is best of each; all errors [mm]; the errors of ten walks at the best S_MS, and what it saves
        there against the sensor alone [%]. All noises meet the same random numbers.
    """
    rows, errors, walk_by_walk = [], [], {}
    for i, (panel, curve, noise) in enumerate(curves):
        progress(f"noise {i + 1} of {len(curves)}", i / len(curves))
        walks = walked((seed,), noise, max(strides // 10, 10), 10)
        found = stride_errors(walks, gain_sets(shares, [0.1], [DECAY]))
        means = np.abs(found).mean(axis=1)
        best = int(np.argmin(means))
        least, alone = per_walk(found[[best, -1]], walks, floor_added=False)
        saved = 100 * (1 - least / alone)
        walk_by_walk[panel, curve] = least, saved
        rows.append((panel, curve, shares[best], means[best], means[-1], saved.mean()))
        errors.append(means)
    names = ["panel", "curve", "best S_MS", "its error [mm]", "error of the sensor alone [mm]", "less by [%]"]
    return pd.DataFrame(rows, columns=names), np.array(errors), walk_by_walk


def _ratio_figure(
    table: pd.DataFrame, errors: FloatArray, shares: FloatArray, panel: str, curve: str, summary: str
) -> Figure:
    """One panel for each value of the first noise, and the best S_MS of all."""
    from matplotlib.figure import Figure

    values = table["panel"].unique()
    figure = Figure(figsize=(12, 4.2), layout="constrained")
    panels = figure.subplots(1, len(values) + 1, width_ratios=[1] * len(values) + [1.3])
    for (_, row), found in zip(table.iterrows(), errors, strict=True):
        axes = panels[list(values).index(row["panel"])]
        (line,) = axes.plot(shares, found, label=f"{row['curve']:g}")
        axes.plot(row["best S_MS"], row["its error [mm]"], "*", color=line.get_color(), markersize=10)
    for value, axes in zip(values, panels, strict=False):
        axes.set(title=panel.format(value), xlabel="S_MS", ylim=(0, 2))
        part = table[table["panel"] == value]
        panels[-1].plot(part["curve"], part["best S_MS"], "o-", label=panel.format(value))
    panels[0].set_ylabel("mean |error| at heel strike [mm]")
    panels[0].legend(title=curve, fontsize=8)
    panels[-1].set(title=summary, xlabel=curve)
    panels[-1].legend(fontsize=8)
    for axes in panels:
        axes.grid(color=LINE, linewidth=0.8)
    return figure


@reproduces("figure-2.14", quick={"strides": 1500}, processor_s=(7, 4))
def figures_2_13_to_2_15(
    progress: Report,
    *,
    strides: Strides = 3000,
    seed: Seed = 0,
) -> Reproduction:
    """Model or sensor: the best share of each under process noise (Figs 2.13 to 2.15)."""
    shares = np.linspace(0, 1, 11)
    holds, amplitudes = (0.1, 0.2, 0.3, 0.4), (0.1, 0.3, 0.5, 0.7, 0.9)
    noises = [(h, a, Noise(process=a, hold=h, floor=0.0)) for h, a in product(holds, amplitudes)]
    table, errors, walks = _ratio_sweep(noises, shares, strides, seed, progress)
    figure = _ratio_figure(
        table, errors, shares, "hold {:g} s", "process noise [rad/s2]", "Fig 2.15: best S_MS"
    )
    best = table.pivot_table(index="panel", columns="curve", values="best S_MS")
    return Reproduction(
        SOURCE + "Figs 2.13 to 2.15: S_HR = 0.1, nominal gyro and collision noise (low_pass), flat floor",
        table.rename(columns={"panel": "hold [s]", "curve": "process noise [rad/s2]"}),
        {"figure-2.14": figure},
        statistics={
            "best S_MS at 0.9 less that at 0.1 rad/s2": mean_of(best[0.9] - best[0.1]),
            "best S_MS held for 0.4 s less that for 0.1 s": mean_of(best.loc[0.4] - best.loc[0.1]),
            "error held for 0.4 s over that for 0.1 s": mean_of(
                np.mean([walks[0.4, a][0] / walks[0.1, a][0] for a in amplitudes], axis=0)
            ),
            "error without sensor over the least": mean_of(errors[:, 0] / errors.min(axis=1)),
            "saved at 0.5 rad/s2 for 0.1 s [%]": mean_of(walks[0.1, 0.5][1]),
            "saved at 0.1 rad/s2 for 0.1 s [%]": mean_of(walks[0.1, 0.1][1]),
            "saved at 0.5 rad/s2, all times [%]": mean_of(
                np.mean([walks[hold, 0.5][1] for hold in holds], axis=0)
            ),
            "saved at 0.1 rad/s2, all times [%]": mean_of(
                np.mean([walks[hold, 0.1][1] for hold in holds], axis=0)
            ),
        },
    )


@reproduces("figure-2.16", quick={"strides": 1500}, processor_s=(7, 4))
def figures_2_16_and_2_17(
    progress: Report,
    *,
    strides: Strides = 3000,
    seed: Seed = 0,
) -> Reproduction:
    """Model or sensor: the best share of each under sensor noise (Figs 2.16 and 2.17)."""
    shares = np.linspace(0, 1, 21)
    gyros, collisions = (0.001, 0.003, 0.005, 0.007), (0.1, 0.3, 0.5, 0.7, 0.9)
    noises = [(g, c, Noise(gyro=g, collision=c, floor=0.0)) for g, c in product(gyros, collisions)]
    table, errors, walks = _ratio_sweep(noises, shares, strides, seed, progress)
    figure = _ratio_figure(
        table, errors, shares, "gyro {:g} rad/s", "collision noise [rad/s]", "Fig 2.17: best S_MS"
    )
    best = table.pivot_table(index="panel", columns="curve", values="best S_MS")
    by_collision, by_gyro = best[0.1] - best[0.9], best.loc[0.001] - best.loc[0.007]
    return Reproduction(
        SOURCE + "Figs 2.16 and 2.17: S_HR = 0.1, process noise 0.5 rad/s2 for 0.25 s, flat floor",
        table.rename(columns={"panel": "gyro noise [rad/s]", "curve": "collision noise [rad/s]"}),
        {"figure-2.16": figure},
        statistics={
            "best S_MS at 0.1 less that at 0.9 rad/s of collision noise": mean_of(by_collision),
            "fall of the best S_MS over the collision noise, over that over the gyro noise": mean_of(
                by_collision / max(float(np.mean(by_gyro.to_numpy(dtype=np.float64))), 0.01)
            ),
            "least best S_MS": exact(float(np.min(table["best S_MS"].to_numpy(dtype=np.float64)))),
            "saved at collision noise up to 0.5 rad/s [%]": mean_of(
                np.mean([walks[g, c][1] for g, c in product(gyros, collisions[:3])], axis=0)
            ),
            "saved at collision noise of 0.9 rad/s [%]": mean_of(
                np.mean([walks[g, 0.9][1] for g in gyros], axis=0)
            ),
        },
    )


@reproduces("figure-2.18", quick={"strides": 1500}, processor_s=(6, 3))
def figure_2_18(
    progress: Report,
    *,
    strides: Strides = 3000,
    seed: Seed = 0,
) -> Reproduction:
    """How much of the geometry to take at a strike."""
    from matplotlib.figure import Figure

    grid = np.linspace(0, 1, 21)
    process = {"low process": (0.1, 0.1), "high process": (0.5, 0.25)}
    sensor = {"low sensor": (0.001, 0.1), "high sensor": (0.004, 0.5)}
    figure = Figure(figsize=(10, 4), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    best: dict[tuple[float, str, str], FloatArray] = {}
    for i, (floor, p, s) in enumerate(product((0.001, 0.004), process, sensor)):
        progress(f"floor {1000 * floor:g} mm, {p} noise, {s} noise", i / 8)
        (amplitude, hold), (gyro, collision) = process[p], sensor[s]
        noise = Noise(process=amplitude, hold=hold, gyro=gyro, collision=collision, floor=floor)
        walks = walked((seed,), noise, strides)
        errors = score_gains(walks, gain_sets(grid, grid, [DECAY])).reshape(21, 21)
        best[floor, p, s] = grid[errors.argmin(axis=1)]
        axes = panels[int(floor > 0.002)]
        axes.plot(
            grid,
            best[floor, p, s],
            "-" if p.startswith("high") else "--",
            label=f"{p}, {s}",
            color=f"C{i % 2}",
        )
        axes.set(title=f"floor {1000 * floor:g} mm", xlabel="S_MS")
        axes.grid(color=LINE, linewidth=0.8)
    panels[0].set_ylabel("best S_HR")
    panels[0].legend(fontsize=8)
    names = [f"{1000 * floor:g} mm, {p}, {s}" for floor, p, s in best]
    table = pd.DataFrame({"S_MS": grid, **dict(zip(names, best.values(), strict=True))})
    early, late = grid <= 0.2, grid >= 0.3

    def more(floor: float, which: Any, kind: int) -> Statistic:
        """Best S_HR at high less that at low process (kind 1) or sensor noise (kind 2)."""
        pairs = (
            [((floor, "high process", s), (floor, "low process", s)) for s in sensor]
            if kind == 1
            else [((floor, p, "high sensor"), (floor, p, "low sensor")) for p in process]
        )
        return mean_of(np.concatenate([(best[high] - best[low])[which] for high, low in pairs]))

    rough = np.array([values for (floor, _, _), values in best.items() if floor == 0.004])
    return Reproduction(
        SOURCE + "Fig 2.18: S_MS and S_HR from 0 to 1 by 0.05, floors of 1 and 4 mm",
        table,
        {"figure-2.18": figure},
        statistics={
            "share of best S_HR up to 0.1, floor 4 mm": share_of(rough <= 0.1),
            "best S_HR at high less that at low process noise, S_MS to 0.2, floor 1 mm": more(
                0.001, early, 1
            ),
            "best S_HR at high less that at low process noise, S_MS to 0.2, floor 4 mm": more(
                0.004, early, 1
            ),
            "best S_HR at high less that at low sensor noise, S_MS from 0.3, floor 1 mm": more(
                0.001, late, 2
            ),
            "best S_HR for the sensor alone, floor 4 mm": mean_of(rough[:, -1]),
        },
    )


@reproduces("figure-2.19", quick={"strides": 100}, processor_s=(50, 16))
def figure_2_19(
    progress: Report,
    *,
    strides: Strides = 300,
    most_process: Annotated[float, Field(gt=0, le=2)] = 0.8,
    seed: Seed = 0,
) -> Reproduction:
    """The best decay of the gyro filter over all kinds of noise."""
    from matplotlib.figure import Figure

    noises = list(
        product(
            (0.0, 0.4, 0.8),
            (0.1, 0.3, 0.5),
            np.linspace(0, most_process, 3),
            (0.0, 0.004, 0.008),
            (0.0, 0.002, 0.004),
        )
    )
    decays, tenths = np.arange(33.0, 634.0, 50.0), np.linspace(0, 1, 11)
    sets = gain_sets(tenths, tenths, decays)
    rows = []
    for i, (collision, hold, process, gyro, floor) in enumerate(noises):
        progress(f"noise {i + 1} of {len(noises)}", i / len(noises))
        noise = Noise(collision=collision, hold=hold, process=process, gyro=gyro, floor=floor)
        walks = walked((seed, i), noise, strides)
        row = {"collision": collision, "hold": hold, "process": process, "gyro": gyro, "floor": floor}
        signed = stride_errors(walks, sets)
        for score, added in SCORES.items():
            errors = per_walk(signed, walks, added)[:, 0]
            best = int(np.argmin(errors))
            share = sets[best, 0]
            row |= {
                f"S_FD, {score}": sets[best, 3],
                f"S_MS, {score}": share,
                f"error [mm], {score}": errors[best],
            }
        rows.append(row)
    table = pd.DataFrame(rows)
    figure = Figure(figsize=(9, 4), layout="constrained")
    for axes, score in zip(figure.subplots(1, 2, sharey=True), SCORES, strict=True):
        axes.plot(table[f"S_FD, {score}"], table[f"error [mm], {score}"], "+", color=AFTER)
        axes.set(xlabel="best S_FD [1/s]", ylabel="its error [mm]", title=score)
        axes.grid(color=LINE, linewidth=0.8)
    statistics = {}
    for score in SCORES:
        free = table[table[f"S_MS, {score}"] > 0]  # with the model alone S_FD has no effect
        near = np.abs(free[f"S_FD, {score}"] - DECAY) <= 51
        statistics[f"share of noises with the best S_FD within 50 / s of 333, {score}"] = share_of(near)
    return Reproduction(
        SOURCE
        + f"Fig 2.19: {len(noises)} noises, process noise to {most_process:g} rad/s2, {len(sets)} gain sets",
        table,
        {"figure-2.19": figure},
        statistics=statistics,
    )


@reproduces("figure-2.20", quick={"levels": 2, "strides": 400, "tests": 20}, processor_s=(54, 20))
def figures_2_20_to_2_23(
    progress: Report,
    *,
    levels: Levels = 4,
    strides: Strides = 400,
    tests: Annotated[int, Field(ge=2, le=100)] = 20,
    seed: Seed = 0,
) -> Reproduction:
    """The best model-based against the best sensor-based estimator (Figs 2.20 to 2.23)."""
    amplitudes = (0.0, 0.2, 0.5, 0.8)
    collision = np.linspace(0.8 / levels, 0.8, levels)
    cases = [
        ("2.20", "collision", collision, 0.0),
        ("2.21", "collision", collision, 0.004),
        ("2.22", "gyro", 0.01 * collision, 0.0),
        ("2.23", "gyro", 0.01 * collision, 0.004),
    ]
    rows = []
    for j, (number, kind, sizes, floor) in enumerate(cases):
        for k, (process, size) in enumerate(product(amplitudes, sizes)):
            progress(f"Fig {number}", (j + k / (len(amplitudes) * len(sizes))) / len(cases))
            noise = replace(Noise(collision=0.0, gyro=0.0, process=process, floor=floor), **{kind: size})
            for row in _model_against_sensor((seed, j, k), noise, strides, tests):
                rows.append({"figure": number, "process": process, kind: size} | row)
    gains = np.array([row.pop("gains of the walks") for row in rows])
    table = pd.DataFrame(rows).drop(columns="over Ranger as it is")
    statistics = {}
    for score in SCORES:
        for number, *_ in cases:
            chosen = (table["figure"] == number) & (table["score"] == score)
            for process in amplitudes:
                walk_by_walk = gains[chosen & (table["process"] == process)].mean(axis=0)
                statistics[f"Fig {number}, gain at {process:g} rad/s2, {score} [%]"] = mean_of(walk_by_walk)
        for rough, flat in (("2.21", "2.20"), ("2.23", "2.22")):
            errors = [
                table[(table["figure"] == n) & (table["score"] == score) & (table["process"] > 0)][
                    "sensor [mm]"
                ]
                for n in (rough, flat)
            ]
            ratio = errors[0].to_numpy() / errors[1].to_numpy()
            statistics[f"Fig {rough}, error of the sensor over that on a flat floor, {score}"] = mean_of(
                ratio
            )
    return Reproduction(
        SOURCE
        + f"Figs 2.20 to 2.23: all gains free, tuned on {strides} strides, tested on {tests} other walks",
        table,
        {"figures-2.20-2.23": _dashes(table, cases)},
        statistics=statistics,
    )


def _model_against_sensor(
    seed: tuple[int, ...], noise: Noise, strides: int, tests: int
) -> list[dict[str, Any]]:
    """Both estimators tuned under each score and tested on other walks: errors [mm] and the gain [%]."""
    tuned, tested = walked((*seed, 0), noise, strides), walked((*seed, 1), noise, 150, tests)
    sets = gain_sets(np.linspace(0, 1, 21), np.linspace(0, 1, 11), np.arange(33.0, 634.0, 50.0))
    signed, rows = stride_errors(tuned, sets), []
    for score, added in SCORES.items():
        errors = per_walk(signed, tuned, added)[:, 0]
        alone = np.flatnonzero(sets[:, 0] == 1)
        chosen = sets[[int(np.argmin(errors)), alone[int(np.argmin(errors[alone]))]]]
        model, sensor = per_walk(stride_errors(tested, chosen), tested, added)
        ranger = per_walk(tested.estimator_mm[:, 1], tested, added)
        rows.append(
            {
                "score": score,
                "S_MS": chosen[0, 0],
                "S_HR": chosen[0, 2],
                "model [mm]": model.mean(),
                "sensor [mm]": sensor.mean(),
                "gain [%]": 100 * (1 - model.mean() / sensor.mean()),
                "gains of the walks": 100 * (1 - model / sensor),
                "over Ranger as it is": 100 * (1 - model / ranger),
            }
        )
    return rows


def _dashes(table: pd.DataFrame, cases: list[tuple[str, str, FloatArray, float]]) -> Figure:
    """For each noise a dash from the sensor-based to the model-based error, as the source draws it."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 6.5), layout="constrained")
    for row, score in zip(figure.subplots(2, 4), SCORES, strict=True):
        for axes, (number, kind, _, floor) in zip(row, cases, strict=True):
            part = table[(table["figure"] == number) & (table["score"] == score)]
            for i, (_, group) in enumerate(part.groupby(kind)):
                x = group["process"] + 0.01 * i
                axes.vlines(x, group["model [mm]"], group["sensor [mm]"], color=f"C{i}")
                axes.plot(x, group["model [mm]"], "*", color=f"C{i}")
                axes.plot(x, group["sensor [mm]"], "s", color=f"C{i}", markersize=4, fillstyle="none")
            axes.set(
                title=f"Fig {number}, {1000 * floor:g} mm, by {kind}",
                xlabel="process noise [rad/s2]",
                ylim=(0, None),
            )
            axes.grid(color=LINE, linewidth=0.8)
        row[0].set_ylabel(f"{score} [mm]")
    return figure


@reproduces("section-2.7", quick={"strides": 3000, "tests": 150}, processor_s=(14, 6))
def section_2_7(
    progress: Report,
    *,
    strides: Strides = 4000,
    tests: Annotated[int, Field(ge=6, le=1000)] = 400,
    process: Annotated[float, Field(ge=0, le=2)] = 0.5,
    seed: Seed = 0,
) -> Reproduction:
    """What a model gains."""
    progress("walking", 0.0)
    noise = Noise(process=process)  # the rest of its defaults is nominal, the floor 4 mm
    rows = _model_against_sensor((seed,), noise, strides, tests)
    statistics = {}
    for row in rows:
        statistics[f"gain over the tuned sensor-based estimator, {row['score']} [%]"] = mean_of(
            row.pop("gains of the walks")
        )
        statistics[f"gain over Ranger's estimator, {row['score']} [%]"] = mean_of(
            row.pop("over Ranger as it is")
        )
    return Reproduction(
        SOURCE
        + f"section 2.7: nominal sensor noise, 4 mm, process noise {process:g} rad/s2, {tests} other walks",
        pd.DataFrame(rows),
        statistics=statistics,
    )


SWEEPS = (
    figures_2_13_to_2_15,
    figures_2_16_and_2_17,
    figure_2_18,
    figure_2_19,
    figures_2_20_to_2_23,
    section_2_7,
)
"""In the order of presentation."""
