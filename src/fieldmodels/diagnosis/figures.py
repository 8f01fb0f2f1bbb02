"""The figures of a diagnosis, each as wide as it is asked to be [inches]."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.free_run import FreeRun
from fieldmodels.diagnosis.result import Correlation, MissingCurve, SignalGain
from fieldmodels.html import AFTER, BEFORE, INK
from fieldmodels.rounding import percent, words

COLUMN = 3.0  # inches that axes beside each other need at least
SHOWN = 3  # signals of a free run
STRUCTURED = 1.5  # times the sensor's noise, above which an error is drawn
MARGIN = 0.5  # of what was measured, that a simulation may leave it by before it is cut off
LINES: Mapping[str, Mapping[str, Any]] = {
    "measured": {"color": INK, "lw": 1.1},
    "before": {"color": BEFORE, "lw": 1.5, "ls": "--"},
    "after": {"color": AFTER, "lw": 1.5},
}
"""How a line is drawn: colour and stroke, so that either alone tells it from the others."""
BENEATH: Mapping[str, Any] = {"lw": 5.0, "alpha": 0.35}
"""What was measured where a simulation may lie on it: a broad band, seen beside the line."""


def free(
    run: FreeRun,
    gain: Mapping[str, SignalGain],
    units: Mapping[str, str],
    names: Mapping[str, str],
    runs: Sequence[str],
    width: float,
) -> Figure:
    """Signals measured and simulated from one start, the error where it has a structure, the commands below.

    Args:
        run: The data.
        gain: Errors and noise of the signals; which of them are drawn first.
        units: Of all signals.
        names: What a simulation is called.
        runs: Which simulations are drawn.
        width: Width [inches].
    """
    chosen = [name for name in gain if name in run.outputs][:SHOWN]
    with_error = [n for n in chosen if gain[n].rmse_before > STRUCTURED * gain[n].noise_floor]
    rows = [(kind, n) for n in chosen for kind in ("signal", "error") if kind == "signal" or n in with_error]
    rows += [("input", name) for name in run.inputs[:SHOWN]]
    height = {"signal": 2.3, "error": 1.0, "input": 0.9}
    figure = Figure(figsize=(width, sum(height[kind] for kind, _ in rows) + 0.5), layout="constrained")
    axes = figure.subplots(
        len(rows), 1, sharex=True, squeeze=False, height_ratios=[height[k] for k, _ in rows]
    )
    time = run.measured.time
    for axis, (kind, name) in zip(axes[:, 0], rows, strict=True):
        _plain(axis)
        values = run.measured[name]
        unit = units[name]
        label = name.replace("_", " ")
        if kind == "input":
            axis.plot(time, values, color=INK, lw=0.9, drawstyle="steps-post")
        elif kind == "error":
            label = "error"
            for key in runs:
                axis.plot(time, values - run.simulated[key][name], **{**LINES[key], "lw": 1.0})
            axis.axhline(0, color=INK, lw=0.5)
            _limit(axis, np.concatenate([values - run.simulated[key][name] for key in runs[-1:]]), values)
        else:
            axis.plot(time, values, label="measured", **{**LINES["measured"], **BENEATH})
            for key in runs:
                axis.plot(time, run.simulated[key][name], label=names[key], **LINES[key])
            _limit(axis, values, values)
            axis.set_title(f"fit {_fits(run, name, runs)}", loc="right", fontsize=9)
        between = " " if kind == "signal" else "\n"  # a low panel has no room for one line
        axis.set_ylabel(label + (f"{between}[{unit}]" if unit not in ("", "1") else ""))
    axes[-1, 0].set_xlabel("time [s]")
    labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(*labels, frameon=False, ncols=3, loc="outside upper left")
    figure.align_ylabels()
    return figure


def _fits(run: FreeRun, name: str, runs: Sequence[str]) -> str:
    """The fit of each simulation in per cent."""
    fits = [run.fit(key, name) for key in runs]
    return " → ".join(percent(fit) if fit >= 0 else "below 0 %" for fit in fits)


def _limit(axis: Axes, shown: FloatArray, measured: FloatArray) -> None:
    """Show what was measured and a margin; a simulation that leaves it for good is cut off."""
    known = measured[np.isfinite(measured)]
    span = float(np.ptp(known)) or 1.0
    inside = shown[np.isfinite(shown)]
    if not len(inside):
        return
    low, high = max(float(inside.min()), -10 * span + float(known.min())), float(inside.max())
    high = min(high, 10 * span + float(known.max()))
    room = MARGIN * max(high - low, 1e-3 * span)
    now = axis.get_ylim()
    axis.set_ylim(max(now[0], low - room), min(now[1], high + room))


def windows(
    traces: Mapping[str, Mapping[str, FloatArray]],
    gain: Mapping[str, SignalGain],
    runs: Sequence[str],
    width: float,
) -> Figure:
    """Measured and simulated windows, each from its own start, and the errors.

    Args:
        traces: As of ``Evidence``.
        gain: Units of the signals.
        runs: Which simulations are drawn.
        width: Width [inches].
    """
    figure = Figure(figsize=(width, 3.2 * len(traces) + 0.4), layout="constrained")
    axes = figure.subplots(2 * len(traces), 1, sharex=True, height_ratios=[2, 1] * len(traces))
    for (top, below), (name, trace) in zip(axes.reshape(-1, 2), traces.items(), strict=True):
        known = np.isfinite(trace["measured"])
        sparse = bool(known.sum(axis=1).max() < 12 or known.mean() < 0.5)
        dots = {"marker": ".", "ls": "none"} if sparse else {}
        top.plot(
            *_joined(trace["time"], trace["measured"], sparse),
            label="measured",
            **{**LINES["measured"], **dots},
        )
        for key in runs:
            error, style = trace["measured"] - trace[key], {**LINES[key], "lw": 1.0, **dots}
            top.plot(*_joined(trace["time"], trace[key], sparse), label=key, **style)
            below.plot(*_joined(trace["time"], error, sparse), **style)
        top.set_ylabel(f"{name} [{gain[name].unit}]")
        below.set_ylabel("error")
        _plain(top)
        _plain(below)
    figure.legend(*axes[0].get_legend_handles_labels(), frameon=False, ncols=3, loc="outside upper left")
    axes[-1].set_xlabel("time [s]")
    return figure


def _joined(time: FloatArray, values: FloatArray, sparse: bool) -> tuple[FloatArray, FloatArray]:
    """Windows in a row, with a gap between them."""
    if sparse:
        known = np.isfinite(values)
        return time[known], values[known]
    gap = np.full((len(time), 1), np.nan)
    return np.hstack([time, gap]).ravel(), np.hstack([values, gap]).ravel()


def horizons(gain: Mapping[str, SignalGain], runs: Sequence[str], width: float) -> Figure:
    """Prediction error of each signal by the length of the window."""
    figure, grid = _grid(len(gain), width)
    for axis, (name, one) in zip(grid, gain.items(), strict=True):
        rows = one.horizons
        length = [row.horizon for row in rows]
        for key in runs:
            axis.plot(
                length, [getattr(row, f"rmse_{key}") for row in rows], marker="o", label=key, **LINES[key]
            )
        if math.isfinite(one.noise_floor):
            axis.axhline(one.noise_floor, color=INK, lw=0.8, ls=":", label="sensor noise")
        axis.set(xlabel="window [s]", ylabel=f"error of {name} [{one.unit}]")
        axis.set_ylim(bottom=0)
    grid[0].legend(frameon=False)
    return figure


def calibration(
    curves: Mapping[str, tuple[FloatArray, FloatArray]], runs: Sequence[str], width: float
) -> Figure:
    """Observed frequency by simulated probability of every event."""
    figure, grid = _grid(len(curves), width)
    for axis, (name, pair) in zip(grid, curves.items(), strict=True):
        axis.plot([0, 1], [0, 1], color=INK, lw=0.8, ls=":")
        for key, curve in zip(runs, pair, strict=False):
            predicted, observed, error = curve[:, :3].T
            axis.errorbar(predicted, observed, yerr=2 * error, marker="o", ms=4, label=key, **LINES[key])
        axis.set(xlabel=f"simulated probability of {name}", ylabel="observed frequency")
    grid[0].legend(frameon=False)
    return figure


def curves(missing: Sequence[MissingCurve], width: float) -> Figure:
    """Unlisted curves with two standard errors."""
    figure, grid = _grid(len(missing), width)
    for axis, curve in zip(grid, missing, strict=True):
        at, value, error = curve.curve.T
        axis.fill_between(at, value - 2 * error, value + 2 * error, color=BEFORE, alpha=0.2, lw=0)
        axis.plot(at, value, "-" if len(at) > 40 else "o-", color=BEFORE)
        axis.axhline(0, color=INK, lw=0.5)
        axis.set(xlabel=f"{curve.over} [{curve.over_unit}]", ylabel=f"missing [{curve.unit}]")
        axis.set_title(curve.direction.partition(", ")[2] or "force", fontsize=9)
    return figure


def residuals(own: Mapping[str, Mapping[str, FloatArray]], runs: Sequence[str], width: float) -> Figure:
    """Mean error over time, signals and inputs, with two standard errors; see ``Evidence.residuals``."""
    pairs = [(name, key, rows) for name, by in own.items() for key, rows in by.items()]
    figure, grid = _grid(len(pairs), width)
    for axis, (name, key, rows) in zip(grid, pairs, strict=True):
        for run, column in zip(runs, (1, 3), strict=False):
            mean, band = rows[:, column], 2 * rows[:, column + 1]
            style = LINES[run]
            axis.fill_between(rows[:, 0], mean - band, mean + band, color=style["color"], alpha=0.2, lw=0)
            axis.plot(rows[:, 0], mean, **style)
        axis.axhline(0, color=INK, lw=0.5)
        axis.set(xlabel=key, ylabel=f"error of {name}")
    return figure


def correlations(found: Sequence[Correlation], runs: Sequence[str], width: float) -> Figure:
    """Correlations of the errors by lag, and what chance gives."""
    figure, grid = _grid(len(found), width)
    for axis, c in zip(grid, found, strict=True):
        axis.fill_between(c.lags, c.low, c.high, color=INK, alpha=0.12, lw=0)
        for run in runs:
            axis.plot(c.lags, getattr(c, run), marker=".", **{**LINES[run], "lw": 1.0})
        axis.axhline(0, color=INK, lw=0.5)
        chances = ", then ".join(chance(getattr(c, f"p_{run}")) for run in runs)
        with_what = "itself" if c.other == c.signal else words(c.other)
        axis.set_title(f"{words(c.signal)} with {with_what}: p {chances}", fontsize=9)
        axis.set_xlabel("lag [s]")
    return figure


def chance(value: float) -> str:
    """A probability in figures."""
    return "–" if not math.isfinite(value) else f"{value:.2g}" if value >= 1e-12 else "< 1e-12"


def _grid(count: int, width: float) -> tuple[Figure, list[Axes]]:
    """A figure with as many axes in a row as find room."""
    columns = max(1, min(count, int(width / COLUMN)))
    rows = math.ceil(count / columns)
    used = width if columns > 1 else min(width, 1.8 * COLUMN)
    figure = Figure(figsize=(used, 2.6 * rows), layout="constrained")
    axes = list(figure.subplots(rows, columns, squeeze=False).ravel())
    for axis in axes[:count]:
        _plain(axis)
    for axis in axes[count:]:
        axis.set_visible(False)
    return figure, axes[:count]


def _plain(axis: Axes) -> None:
    axis.spines[["top", "right"]].set_visible(False)
    axis.grid(alpha=0.25)
