"""The report of a diagnosis: one HTML page, its JSON, and the extended simulation as YAML."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fieldmodels import html
from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.outcome import Diagnosis
from fieldmodels.diagnosis.result import Estimate, MissingCurve
from fieldmodels.files import write_text
from fieldmodels.recording.files import save_recording
from fieldmodels.yaml import save_yaml

COLUMNS = 3  # axes beside each other
INK, BEFORE, AFTER = "#1c2430", "#c8553d", "#0b6e99"
TONE = {"consistent": "good", "named": "good", "ambiguous": "warn", "unknown": "bad"}


def write_results(diagnosis: Diagnosis, directory: Path) -> dict[str, Path]:
    """Write ``diagnosis.json``, ``report.html`` and ``extended.yaml``; each appears whole or not at all.

    If a next measurement is planned, also its commands, ``next_input.csv``, and ``next_record.yaml``, with
    which ``fieldgym record`` plays them.

    Returns:
        File name to path.
    """
    paths = {name: directory / name for name in ("diagnosis.json", "report.html", "extended.yaml")}
    text = json.dumps(diagnosis.to_json(), indent=2, allow_nan=False, ensure_ascii=False)
    write_text(paths["diagnosis.json"], text + "\n")
    title = f"What the simulation {diagnosis.model!r} gets wrong"
    write_text(paths["report.html"], html.page(title, report_section(diagnosis)))
    save_yaml(diagnosis.extended(), paths["extended.yaml"])
    plan = diagnosis.next_measurement.plan if diagnosis.next_measurement else None
    if plan is not None:
        paths |= {name: directory / name for name in ("next_input.csv", "next_record.yaml")}
        save_recording(plan, paths["next_input.csv"])
        save_yaml(
            {
                "name": "next",
                "model": diagnosis.model,
                "input": str(paths["next_input.csv"]),
                "duration": round(len(plan) * plan.step, 6),
                "step": round(plan.step, 9),
            },
            paths["next_record.yaml"],
        )
    return paths


def report_section(diagnosis: Diagnosis) -> str:
    """The report as an HTML fragment with its figures inline."""
    verdict = diagnosis.verdict
    parts = [
        f'<p class="lead"><strong class="{TONE[verdict]}">{verdict.capitalize()}.</strong> '
        f"{html.text(diagnosis.summary())}</p>",
        _data(diagnosis),
        _causes(diagnosis),
        _curves(diagnosis),
        _gains(diagnosis),
        _traces(diagnosis),
        _calibration(diagnosis),
        _next(diagnosis),
        _seen(diagnosis),
        _residual_tests(diagnosis),
        _ranking(diagnosis),
        _base(diagnosis),
        _not_testable(diagnosis),
    ]
    return "\n".join(part for part in parts if part)


def _data(diagnosis: Diagnosis) -> str:
    train, test = (", ".join(names) for names in (diagnosis.trained_on, diagnosis.tested_on))
    return (
        f'<p class="soft">Fitted and chosen on {html.text(train)} ({diagnosis.windows[0]} windows); gains '
        f"measured on {html.text(test)} ({diagnosis.windows[1]} windows), which could only veto a cause. "
        f"{diagnosis.seconds:.1f} s.</p>"
    ) + "".join(f'<p class="warn">{html.text(note)}</p>' for note in diagnosis.notes)


def _causes(diagnosis: Diagnosis) -> str:
    if not diagnosis.causes:
        return ""
    rows = []
    for cause in diagnosis.causes:
        values = "; ".join(f"{name} = {_estimate(e)}" for name, e in cause.parameters.items())
        rows.append(
            (
                cause.effect.replace("_", " "),
                cause.cause,
                cause.equation,
                cause.where,
                values,
                f"{cause.signal}: {_share(cause.gain.percent, cause.gain.ci95)}",
                ", ".join(a.replace("_", " ") for a in cause.alternatives) or "–",
            )
        )
    header = ("effect", "what happens", "term", "where", "fitted", "gain (95 % interval)", "or instead")
    return "<h2>Causes</h2>" + html.table(header, rows)


def _gains(diagnosis: Diagnosis) -> str:
    rows = [
        (
            name,
            f"{_short(g.rmse_before)} {g.unit}",
            f"{_short(g.rmse_after)} {g.unit}",
            _share(g.gain.percent, g.gain.ci95),
            f"{_short(g.rmse_with_curves)} {g.unit}" if diagnosis.curves else "–",
            _share(g.gain_with_curves.percent, g.gain_with_curves.ci95) if diagnosis.curves else "–",
            f"{_short(g.noise_floor)} {g.unit}" if math.isfinite(g.noise_floor) else "–",
        )
        for name, g in diagnosis.gain.items()
    ]
    header = (
        "signal", "error before", "with the causes", "gain (95 % interval)", "and with curves",
        "gain (95 % interval)", "sensor noise",
    )  # fmt: skip
    horizon = next((f"{g.horizon:g} s" for g in diagnosis.gain.values()), "")
    note = (
        f'<p class="soft">Root mean square error of predicted windows of {horizon} on the test data: '
        "<em>before</em> with the base parameters refitted, then with the named causes added, then with the "
        "unlisted curves, too. Each window starts from the state that fits it best, the same way each time. "
        "Intervals by resampling blocks of windows.</p>"
    )
    return "<h2>Gain</h2>" + html.table(header, rows) + note + _horizons(diagnosis)


def _horizons(diagnosis: Diagnosis) -> str:
    curves = {name: g.horizons for name, g in diagnosis.gain.items() if len(g.horizons) > 1}
    if not curves:
        return ""
    figure, grid = _grid(len(curves))
    for axis, (name, rows) in zip(grid, curves.items(), strict=False):
        length = [row.horizon for row in rows]
        top = max(row.rmse_before for row in rows)
        axis.plot(length, [row.rmse_before for row in rows], "o-", color=BEFORE, label="before")
        if diagnosis.causes:
            axis.plot(length, [row.rmse_after for row in rows], "o-", color=AFTER, label="after")
        floor = diagnosis.gain[name].noise_floor
        if math.isfinite(floor):
            axis.axhline(floor, color=INK, lw=0.8, ls=":", label="sensor noise")
        axis.set(xlabel="window [s]", ylabel=f"error of {name} [{diagnosis.gain[name].unit}]")
        axis.set_ylim(0, 1.1 * max(top, floor if math.isfinite(floor) else 0.0) + 1e-12)
    grid[0].legend(frameon=False)
    drawn = html.figure(figure, "Prediction error by length of the predicted window, on the test data.")
    if not diagnosis.causes:
        return drawn
    table = [
        (name, f"{row.horizon:g} s", row.windows, _short(row.rmse_before), _short(row.rmse_after),
         _share(row.gain.percent, row.gain.ci95))
        for name, rows in curves.items() for row in rows
    ]  # fmt: skip
    header = ("signal", "window", "number", "error before", "error after", "gain (95 % interval)")
    return drawn + html.table(header, table)


def _traces(diagnosis: Diagnosis) -> str:
    traces = diagnosis.evidence.traces
    if not traces:
        return ""
    figure = Figure(figsize=(10, 3.6 * len(traces)), layout="constrained")
    axes = figure.subplots(2 * len(traces), 1, sharex=True, height_ratios=[2, 1] * len(traces))
    drawn = [("before", "simulated before", BEFORE)]
    if diagnosis.causes or diagnosis.curves:
        drawn.append(("after", "simulated after", AFTER))
    for (top, below), (name, trace) in zip(axes.reshape(-1, 2), traces.items(), strict=True):
        known = np.isfinite(trace["measured"])
        sparse = bool(known.sum(axis=1).max() < 12 or known.mean() < 0.5)
        line = {"marker": ".", "linestyle": "none"} if sparse else {"lw": 1.0}
        top.plot(*_joined(trace["time"], trace["measured"], sparse), color=INK, label="measured", **line)
        for key, label, colour in drawn:
            error = trace["measured"] - trace[key]
            top.plot(*_joined(trace["time"], trace[key], sparse), color=colour, label=label, **line)
            below.plot(*_joined(trace["time"], error, sparse), color=colour, **line)
        top.set_ylabel(f"{name} [{diagnosis.gain[name].unit}]")
        below.set_ylabel("error")
        _plain(top)
        _plain(below)
    axes[0].legend(frameon=False, ncols=3, loc="lower left", bbox_to_anchor=(0, 1))
    axes[-1].set_xlabel("time [s]")
    return "<h2>Measured and simulated</h2>" + html.figure(
        figure, "Test windows; the simulation restarts in each."
    )


def _calibration(diagnosis: Diagnosis) -> str:
    curves = diagnosis.evidence.calibration
    if not curves:
        return ""
    figure, grid = _grid(len(curves))
    for axis, (name, (before, after)) in zip(grid, curves.items(), strict=False):
        axis.plot([0, 1], [0, 1], color=INK, lw=0.8, ls=":")
        drawn = [(before, "before", BEFORE)] + ([(after, "after", AFTER)] if diagnosis.causes else [])
        for curve, label, colour in drawn:
            predicted, observed, error = curve[:, :3].T
            axis.errorbar(
                predicted, observed, yerr=2 * error, fmt="o-", color=colour, label=label, ms=4, lw=1
            )
        axis.set(xlabel=f"simulated probability of {name}", ylabel="observed frequency")
    grid[0].legend(frameon=False)
    return "<h2>Probabilities and frequencies</h2>" + html.figure(
        figure,
        "Observations of the test data in groups of equal size, by their simulated probability, with two "
        "standard errors. Dotted: perfect calibration.",
    )


def _joined(time: FloatArray, values: FloatArray, sparse: bool) -> tuple[FloatArray, FloatArray]:
    """Windows in a row, with a gap between them."""
    if sparse:
        known = np.isfinite(values)
        return time[known], values[known]
    gap = np.full((len(time), 1), np.nan)
    return np.hstack([time, gap]).ravel(), np.hstack([values, gap]).ravel()


def _next(diagnosis: Diagnosis) -> str:
    if diagnosis.next_measurement is None:
        return ""
    compared = diagnosis.next_measurement.input.get("compared", {})
    rows = [(name, f"{value:g}") for name, value in compared.items()] if isinstance(compared, Mapping) else []
    table = html.table(("input within what was recorded", "separation [nats]"), rows) if rows else ""
    return f"<h2>Measure next</h2><p>{html.text(diagnosis.next_measurement.why)}</p>{table}"


def _curves(diagnosis: Diagnosis) -> str:
    if not diagnosis.curves:
        return ""
    figure, axes = _grid(len(diagnosis.curves))
    for axis, curve in zip(axes, diagnosis.curves, strict=False):
        at, value, error = curve.curve.T
        axis.fill_between(at, value - 2 * error, value + 2 * error, color=BEFORE, alpha=0.2, lw=0)
        axis.plot(at, value, "-" if len(at) > 40 else "o-", color=BEFORE)
        axis.axhline(0, color=INK, lw=0.5)
        axis.set(xlabel=f"{curve.over} [{curve.over_unit}]", ylabel=f"missing [{curve.unit}]")
        axis.set_title(curve.direction.partition(", ")[2] or "force", fontsize=9)
    words = [_curve_words(curve) for curve in diagnosis.curves]
    note = "With two standard errors; what the refitted base parameters take up is not in it."
    if diagnosis.not_runnable:
        note += f" Not in extended.yaml: {'; '.join(diagnosis.not_runnable)}."
    return f"<h2>What no listed effect explains</h2><p>{' '.join(words)}</p>" + html.figure(figure, note)


def _curve_words(curve: MissingCurve) -> str:
    if not curve.certain:
        return (
            "No curve is certain, but the error is far above the sensor's noise: something is missing. "
            f"The one that helps most depends on {html.text(curve.direction)}."
        )
    shape = f" It runs as: {html.text(curve.formula)}." if curve.formula else ""
    return (
        f"A curve depends on {html.text(curve.direction)}: it removes {curve.percent:.1f} % of the remaining "
        f"loss on held-out windows (p = {_p(curve.p_value)}).{shape}"
    )


def _seen(diagnosis: Diagnosis) -> str:
    if not diagnosis.seen:
        return ""
    rows = [(v.what, f"{_short(v.size)} {v.unit}", v.over) for v in diagnosis.seen]
    note = (
        '<p class="soft">Root mean square, over these data, of the smallest curve that would have been '
        "found, over the variable where it is hardest to see. What is smaller may be missing unseen.</p>"
    )
    return "<h2>What these data would have shown</h2>" + html.table(("what", "from", "over"), rows) + note


def _residual_tests(diagnosis: Diagnosis) -> str:
    rows = [(m.signal, m.test, m.where, _p(m.p_value)) for m in diagnosis.misfit]
    table = html.table(("signal", "failed test", "where", "p"), rows) if rows else "<p>No test fails.</p>"
    return (
        "<h2>Residuals of the refitted simulation</h2>"
        + table
        + _residuals(diagnosis)
        + _correlations(diagnosis)
    )


def _residuals(diagnosis: Diagnosis) -> str:
    residuals = {
        name: {key: rows for key, rows in own.items() if len(rows) > 2}
        for name, own in diagnosis.evidence.residuals.items()
    }
    residuals = {name: own for name, own in residuals.items() if own}
    if not residuals:
        return ""
    columns = max(len(own) for own in residuals.values())
    figure = Figure(figsize=(2.8 * columns, 2.2 * len(residuals)), layout="constrained")
    axes = figure.subplots(len(residuals), columns, squeeze=False)
    for row, (name, own) in zip(axes, residuals.items(), strict=True):
        for axis in row[len(own) :]:
            axis.set_visible(False)
        for axis, (key, rows) in zip(row, own.items(), strict=False):
            for column, colour in ((1, BEFORE), (3, AFTER)):
                if column == 3 and not diagnosis.causes:
                    continue
                mean, band = rows[:, column], 2 * rows[:, column + 1]
                axis.fill_between(rows[:, 0], mean - band, mean + band, color=colour, alpha=0.2, lw=0)
                axis.plot(rows[:, 0], mean, color=colour, lw=1.2)
            axis.axhline(0, color=INK, lw=0.5)
            axis.set_xlabel(key)
            _plain(axis)
        row[0].set_ylabel(f"error of {name}")
    after = " and with the causes (blue)" if diagnosis.causes else ""
    return html.figure(
        figure, f"Mean error with two standard errors: refitted base (red){after}, on the training data."
    )


def _correlations(diagnosis: Diagnosis) -> str:
    curves = diagnosis.evidence.correlations
    if not curves:
        return ""
    figure, grid = _grid(len(curves))
    for axis, c in zip(grid, curves, strict=False):
        axis.fill_between(c.lags, c.low, c.high, color=INK, alpha=0.12, lw=0)
        axis.plot(c.lags, c.before, ".-", color=BEFORE, lw=1)
        if diagnosis.causes:
            axis.plot(c.lags, c.after, ".-", color=AFTER, lw=1)
        axis.axhline(0, color=INK, lw=0.5)
        p = f"p {_p(c.p_before)}" + (f", then {_p(c.p_after)}" if diagnosis.causes else "")
        with_what = "itself" if c.other == c.signal else c.other
        axis.set_title(f"{c.signal} with {with_what}: {p}", fontsize=9)
        axis.set_xlabel("lag [s]")
    after = "; with the causes (blue)" if diagnosis.causes else ""
    caption = (
        f"Correlation of the errors on test data, of the refitted base (red){after}. Grey: the central "
        "95 % under the null hypothesis at each lag: for autocorrelations, white noise after the fit of each "
        "window's initial state; for inputs, the errors of other windows. p: probability that chance alone "
        "gives as large a value at any lag. A positive lag means that the input leads."
    )
    return "<h3>Correlations of the errors</h3>" + html.figure(figure, caption)


def _ranking(diagnosis: Diagnosis) -> str:
    rows = [
        (name.replace("_", " "), f"{nats:.1f}", _p(p), values)
        for name, nats, p, values in diagnosis.evidence.ranking
    ]
    if not rows:
        return ""
    table = html.table(("effect, alone", "held-out gain [nats]", "p", "fitted"), rows)
    return f"<h2>Best single effects</h2><details open><summary>Ranking</summary>{table}</details>"


def _base(diagnosis: Diagnosis) -> str:
    rows = [(name, _estimate(e)) for name, e in diagnosis.parameters.items()]
    return "<h2>Base parameters of the extended simulation</h2>" + html.table(("parameter", "value"), rows)


def _not_testable(diagnosis: Diagnosis) -> str:
    if not diagnosis.not_testable:
        return ""
    rows = [(name.replace("_", " "), reason) for name, reason in diagnosis.not_testable.items()]
    return "<h2>Not testable with these data</h2>" + html.table(("effect", "why"), rows)


def _grid(count: int) -> tuple[Figure, list[Axes]]:
    """A figure with axes in rows of at most three."""
    columns = min(count, COLUMNS)
    rows = math.ceil(count / columns)
    figure = Figure(figsize=(3.6 * columns + 0.6, 2.7 * rows), layout="constrained")
    axes = list(figure.subplots(rows, columns, squeeze=False).ravel())
    for axis in axes[:count]:
        _plain(axis)
    for axis in axes[count:]:
        axis.set_visible(False)
    return figure, axes[:count]


def _plain(axis: Axes) -> None:
    axis.spines[["top", "right"]].set_visible(False)
    axis.grid(alpha=0.25)


def _short(value: float) -> str:
    return f"{value:.3g}" if math.isfinite(value) else "–"


def _p(value: float) -> str:
    return "–" if not math.isfinite(value) else f"{value:.2g}" if value >= 1e-12 else "< 1e-12"


def _share(percent: float, interval: tuple[float, float]) -> str:
    if not math.isfinite(percent):
        return "–"
    low, high = interval
    return f"{percent:.1f} % ({low:.1f} to {high:.1f})"


def _estimate(estimate: Estimate) -> str:
    unit = "" if estimate.unit == "1" else f" {estimate.unit}"
    spread = f" ± {estimate.std:.2g}" if math.isfinite(estimate.std) and estimate.std > 0 else ""
    return f"{estimate.value:.4g}{spread}{unit}"
