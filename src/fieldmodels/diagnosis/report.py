"""The report of a diagnosis: one HTML page, its JSON, its figures, and the extended simulation as YAML."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

from fieldmodels import html
from fieldmodels.diagnosis import answer, figures
from fieldmodels.diagnosis.outcome import Diagnosis
from fieldmodels.diagnosis.result import MissingCurve
from fieldmodels.files import write_text
from fieldmodels.html import FIGURES, Numbers, Picture, columns_of, details, table
from fieldmodels.recording.files import save_recording
from fieldmodels.rounding import percent, with_error, words
from fieldmodels.yaml import save_yaml


def write_results(
    diagnosis: Diagnosis, directory: Path, drawn: Mapping[str, Picture] | None = None
) -> dict[str, Path]:
    """Write ``diagnosis.json``, ``report.html`` and ``extended.yaml``; each appears whole or not at all.

    The folder ``figures`` holds each figure of the report as PNG, and its data as CSV. If a next measurement
    is planned, also its commands, ``next_input.csv``, and ``next_record.yaml``, with which ``fieldgym
    record`` plays them.

    Args:
        diagnosis: The diagnosis.
        directory: Where to.
        drawn: Its ``pictures``, if they stand on other pages, too.

    Returns:
        File name to path.
    """
    paths = {name: directory / name for name in ("diagnosis.json", "report.html", "extended.yaml")}
    content = json.dumps(diagnosis.to_json(), indent=2, allow_nan=False, ensure_ascii=False)
    write_text(paths["diagnosis.json"], content + "\n")
    drawn = pictures(diagnosis) if drawn is None else drawn
    for picture in drawn.values():
        picture.save(directory / FIGURES)
    write_page(diagnosis, paths["report.html"], drawn, FIGURES)
    save_yaml(diagnosis.extended(), paths["extended.yaml"])
    plan = diagnosis.next_measurement.plan if diagnosis.next_measurement else None
    if plan is not None:
        paths |= {name: directory / name for name in ("next_input.csv", "next_record.yaml")}
        save_recording(plan, paths["next_input.csv"])
        save_yaml(
            {
                "name": "next",
                "machine": diagnosis.model,
                "input": str(paths["next_input.csv"]),
                "duration": round(len(plan) * plan.step, 6),
                "step": round(plan.step, 9),
            },
            paths["next_record.yaml"],
        )
    return paths


def write_page(diagnosis: Diagnosis, path: Path, drawn: Mapping[str, Picture], folder: str = "") -> None:
    """Write the report as one self-contained HTML page; arguments as of `report_section`."""
    title = f"Diagnosis of {words(diagnosis.model)}"
    write_text(path, html.page(title, report_section(diagnosis, drawn, folder)))


def report_section(diagnosis: Diagnosis, drawn: Mapping[str, Picture], folder: str) -> str:
    """The report as an HTML fragment with its figures inline.

    Args:
        diagnosis: The diagnosis.
        drawn: Its ``pictures``.
        folder: Where their files are beside the page; "" for no links to them.
    """
    shown = {name: picture.fragment(folder) for name, picture in drawn.items()}
    first = answer.section(diagnosis, shown.get("answer", ""))
    evidence = [
        ("What no listed effect explains", _curves(diagnosis) + shown.get("curves", "")),
        ("Prediction errors", _gains(diagnosis) + shown.get("horizons", "")),
        ("Windows of the test data", shown.get("windows", "")),
        ("Probabilities and frequencies", shown.get("calibration", "")),
        ("Which input would decide", _compared(diagnosis)),
        ("What these data would have shown", _seen(diagnosis)),
        ("Residuals of the refitted simulation", _residual_tests(diagnosis) + shown.get("residuals", "")),
        ("Correlations of the errors", shown.get("correlations", "")),
        ("Best single effects", _ranking(diagnosis)),
        ("Base parameters of the extended simulation", _base(diagnosis)),
        ("Not testable with these data", _not_testable(diagnosis)),
        ("Data", _data(diagnosis)),
    ]
    opened = {"What no listed effect explains"}
    notes = "".join(f'<p class="warn">{html.text(note)}</p>' for note in diagnosis.notes)
    body = "".join(details(title, body, opened=title in opened) for title, body in evidence)
    return f"{first}{notes}<h2>Evidence</h2>{body}"


def pictures(diagnosis: Diagnosis) -> dict[str, Picture]:
    """The report's figures by name."""
    evidence, runs = diagnosis.evidence, diagnosis.runs
    lines = "orange, dashed: the refitted base" + ("; blue: with what was found" if len(runs) > 1 else "")
    residuals = {
        name: {key: rows for key, rows in own.items() if len(rows) > 2}
        for name, own in evidence.residuals.items()
    }
    gain = {name: g for name, g in diagnosis.gain.items() if len(g.horizons) > 1}
    found = [
        evidence.traces and _answer(diagnosis),
        diagnosis.curves and Picture(
            "curves", partial(figures.curves, diagnosis.curves),
            "With two standard errors; what the refitted base parameters take up is not in it.",
            "Curves of what is missing.", _curve_numbers(diagnosis.curves),
        ),
        gain and Picture(
            "horizons", partial(figures.horizons, gain, runs),
            "Prediction error by length of the predicted window, on the test data.",
            "Prediction error by window length.", _horizon_numbers(diagnosis),
        ),
        evidence.traces and diagnosis.free_run and Picture(
            "windows", partial(figures.windows, evidence.traces, diagnosis.gain, runs),
            f"Test windows; the simulation restarts in each ({lines}).", "Measured and simulated windows.",
        ),
        evidence.calibration and Picture(
            "calibration", partial(figures.calibration, evidence.calibration, runs),
            "Observations of the test data in groups of equal size, by their simulated probability, with two "
            "standard errors. Dotted: perfect calibration.", "Observed frequency by simulated probability.",
        ),
        any(residuals.values()) and Picture(
            "residuals", partial(figures.residuals, residuals, runs),
            f"Mean error with two standard errors, on the training data ({lines}).",
            "Mean error over time, signals and inputs.",
        ),
        evidence.correlations and Picture(
            "correlations", partial(figures.correlations, evidence.correlations, runs),
            f"Correlation of the errors on test data ({lines}). Grey: the central 95 % under the null "
            "hypothesis at each lag: for autocorrelations, white noise after the fit of each window's "
            "initial state; for inputs, the errors of other windows. p: probability that chance alone gives "
            "as large a value at any lag. A positive lag means that the input leads.",
            "Correlations of the errors by lag.",
        ),
    ]  # fmt: skip
    return {one.name: one for one in found if isinstance(one, Picture)}


def _answer(diagnosis: Diagnosis) -> Picture:
    """The picture that a report shows first."""
    run = diagnosis.free_run
    if run is None:
        return Picture("answer", diagnosis.plot, "Test windows; the simulation restarts in each.",
                       "Measured and simulated windows.")  # fmt: skip
    fits = "; ".join(
        f"{words(name)}: fit {', then '.join(percent(run.fit(key, name)) for key in diagnosis.runs)}"
        for name in run.outputs
    )
    fitted = diagnosis.tested_on and diagnosis.tested_on[0].startswith("held-out")
    return Picture(
        "answer", diagnosis.plot,
        f"{Path(run.measured.source).name}: a free run, which knows its start and the commands "
        "alone. Fit: 100 % is exact, 0 % no better than a constant."
        + (" Most of these data were fitted." if fitted else ""),
        f"Measured signals beside free runs of the simulation. {fits}.", run.table(),
    )  # fmt: skip


def _gains(diagnosis: Diagnosis) -> str:
    curved = bool(diagnosis.curves)
    rows = [
        (
            words(name),
            with_error(g.rmse_before, unit=g.unit),
            with_error(g.rmse_after, unit=g.unit),
            percent(g.gain.percent, g.gain.ci95),
            *((with_error(g.rmse_with_curves, unit=g.unit),) if curved else ()),
            *((percent(g.gain_with_curves.percent, g.gain_with_curves.ci95),) if curved else ()),
            with_error(g.noise_floor, unit=g.unit) if math.isfinite(g.noise_floor) else "–",
        )
        for name, g in diagnosis.gain.items()
    ]
    interval = "gain (95 % interval)"
    header = (
        "signal", "error before", "with the causes", interval,
        *(("and with curves", interval) if curved else ()), "sensor noise",
    )  # fmt: skip
    note = (
        f'<p class="soft">Root mean square error of predicted windows of {diagnosis.horizon:g} s on the test '
        "data: <em>before</em> with the base parameters refitted, then with the named causes added"
        + (", then with the unlisted curves, too" if curved else "")
        + ". Each window starts from the state that fits it best, the same way each time. "
        "Intervals by resampling blocks of windows.</p>"
    )
    return table(header, rows) + note


def _horizon_numbers(diagnosis: Diagnosis) -> Numbers:
    return columns_of([
        {"signal": name, "window_s": row.horizon, "windows": row.windows, "rmse_before": row.rmse_before,
         "rmse_after": row.rmse_after, "gain_percent": row.gain.percent, "low": row.gain.ci95[0],
         "high": row.gain.ci95[1]}
        for name, g in diagnosis.gain.items() for row in g.horizons
    ])  # fmt: skip


def _curve_numbers(curves: Sequence[MissingCurve]) -> Numbers:
    return columns_of([
        {"curve": curve.direction, "at": at, "at_unit": curve.over_unit, "value": value, "error": error,
         "unit": curve.unit}
        for curve in curves for at, value, error in curve.curve
    ])  # fmt: skip


def _curves(diagnosis: Diagnosis) -> str:
    if not diagnosis.curves:
        return ""
    return f"<p>{' '.join(map(_curve_words, diagnosis.curves))}</p>"


def _curve_words(curve: MissingCurve) -> str:
    if not curve.certain:
        return (
            "No curve is certain, but the error is far above the sensor's noise, so something is missing. "
            f"The curve that helps most depends on {html.text(curve.words)}."
        )
    removes = (
        f"it removes {percent(curve.percent)} of the remaining loss on held-out windows "
        f"(p = {figures.chance(curve.p_value)})"
    )
    if not curve.confirmed:
        return (
            f"A curve may be missing that depends on {html.text(curve.words)}: {removes}, "
            "but predicts the test data no better."
        )
    return f"A curve is missing that depends on {html.text(curve.words)}: {removes}."


def _compared(diagnosis: Diagnosis) -> str:
    plan = diagnosis.next_measurement
    compared = plan.input.get("compared", {}) if plan else {}
    rows = (
        [(name, f"{value:.3g}") for name, value in compared.items()] if isinstance(compared, Mapping) else []
    )
    return table(("input within what was recorded", "separation [nats]"), rows) if rows else ""


def _seen(diagnosis: Diagnosis) -> str:
    if not diagnosis.seen:
        return ""
    rows = [
        (v.what, with_error(v.size, unit=v.unit) if v.errors else "nothing", v.over) for v in diagnosis.seen
    ]
    note = (
        '<p class="soft">Root mean square, over these data, of the smallest curve of which nine in ten '
        "would have been found, over the variable where it is hardest to see. What is smaller may be missing "
        "unseen, and so may what is no curve of one variable, or acts in few parts of the data:</p>"
    )
    most = [
        (words(name), with_error(v, unit=diagnosis.gain[name].unit)) for name, v in diagnosis.unseen.items()
    ]
    rest = (
        '<p class="soft">Root mean square by which the error on the test data exceeds its white noise, as an '
        "upper limit of 95 %. What changes at random from sample to sample counts as noise.</p>"
    )
    unseen = table(("error of", "anything may add"), most) + rest if most else ""
    return table(("what", "seen from", "over"), rows) + note + unseen


def _residual_tests(diagnosis: Diagnosis) -> str:
    rows = [(m.signal, m.test, m.where, figures.chance(m.p_value)) for m in diagnosis.misfit]
    return table(("signal", "failed test", "where", "p"), rows) if rows else "<p>No test fails.</p>"


def _ranking(diagnosis: Diagnosis) -> str:
    rows = [
        (words(name), f"{nats:.1f}", figures.chance(p), values)
        for name, nats, p, values in diagnosis.evidence.ranking
    ]
    return table(("effect, alone", "held-out gain [nats]", "p", "fitted"), rows) if rows else ""


def _base(diagnosis: Diagnosis) -> str:
    rows = [(words(name), with_error(e.value, e.std, e.unit)) for name, e in diagnosis.parameters.items()]
    return table(("parameter", "value"), rows)


def _not_testable(diagnosis: Diagnosis) -> str:
    rows = [(words(name), reason) for name, reason in diagnosis.not_testable.items()]
    return table(("effect", "why"), rows) if rows else ""


def _data(diagnosis: Diagnosis) -> str:
    train, test = (", ".join(names) for names in (diagnosis.trained_on, diagnosis.tested_on))
    return (
        f'<p class="soft">Fitted and chosen on {html.text(train)} ({diagnosis.windows[0]} windows); gains '
        f"measured on {html.text(test)} ({diagnosis.windows[1]} windows), which could only veto a cause. "
        f"{diagnosis.seconds:.1f} s in all, {diagnosis.simulations:.0f} simulations of the fitted "
        "windows.</p>"
    )
