"""An evaluation as an HTML report and as a table in the terminal."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from fieldagents.evaluation.comparison import MIN_EPISODES, MIN_RUNS, Comparison
from fieldagents.evaluation.metrics import METRICS, Metric
from fieldagents.evaluation.summary import Row, Summary
from fieldmodels import html
from fieldmodels.files import write_text

if TYPE_CHECKING:
    from rich.console import Console

COLOURS = {"observation": "#0b6e99", "model": "#7a5195", "privileged": "#b3402a", "estimator": "#8a8f98"}
"""Colour of an agent by what it sees; an estimator is outside the action space."""


def write_report(summary: Summary, episodes: pd.DataFrame, path: Path) -> None:
    """Write a self-contained ``report.html``."""
    write_text(path, html.page(f"Evaluation: {summary.name}", report_section(summary, episodes)))


def report_section(summary: Summary, episodes: pd.DataFrame | None = None) -> str:
    """The report's body, with its figures inline, to stand alone or inside another report.

    Args:
        summary: What was found.
        episodes: The episodes' table; with it, each figure also shows the single episodes.
    """
    metric = METRICS[summary.task][0]
    caption = "Mean ± half the 95 % interval; the difference is paired, on the same episodes."
    parts = [f'<p class="lead">{_lead(summary, metric)}</p>']
    for scenario, rows in summary.scenarios.items():
        own = None if episodes is None else episodes[episodes["scenario"] == scenario]
        parts += [
            f"<h3>{html.text(scenario)}</h3>",
            f"<p>{html.text(_conditions(summary.environments[scenario]))}</p>",
            html.figure(_figure(rows, summary, metric, own), _caption(metric, own is not None)),
            html.table(*_table(rows, summary), caption),
        ]
    parts.append(_notes(summary))
    return "\n".join(parts)


def _conditions(environment: Mapping[str, Any]) -> str:
    """A scenario's settings and reality in a line."""
    settings = ", ".join(f"{key} = {value}" for key, value in environment["settings"].items())
    reality = ", ".join(
        f"{group} {key} = {value:.4g}"
        for group, values in environment["reality"].items()
        for key, value in values.items()
    )
    return f"Settings: {settings or 'the defaults'}. Reality: {reality or 'the nominal simulation'}."


def show(summary: Summary, console: Console) -> None:
    """Print the results as tables."""
    from rich.markup import escape
    from rich.table import Table

    metric = METRICS[summary.task][0]
    for scenario, rows in summary.scenarios.items():
        title = f"{scenario}: {metric.title} [{metric.unit}], {summary.episodes} episodes (± 95 %)"
        header, body = _table(rows, summary)
        table = Table(*header, title=escape(title), title_justify="left")
        for cells in body:
            table.add_row(*cells)
        console.print(table)


def _table(rows: tuple[Row, ...], summary: Summary) -> tuple[list[str], list[list[str]]]:
    """Header and cells; the last column only where there are trained agents."""
    metric = METRICS[summary.task][0]
    header = ["agent", "sees", metric.name, f"against {summary.baseline}", "%", "verdict", "training runs"]
    body = [_cells(row, metric) for row in rows]
    if not any(row.of_training for row in rows):
        return header[:-1], [cells[:-1] for cells in body]
    return header, body


def _cells(row: Row, metric: Metric) -> list[str]:
    score = _with_interval(row.means[metric.name], row.ci95)
    paired = row.against_baseline
    if paired is None:
        return [row.agent, row.kind, score, "baseline", "", "", ""]
    percent = "" if paired.percent is None else f"{paired.percent:+.1f}"
    difference = _with_interval(paired.difference, paired.ci95, "+.3f")
    runs = f"{row.of_training.n}: {row.of_training.verdict}" if row.of_training else ""
    return [row.agent, row.kind, score, difference, percent, paired.verdict, runs]


def _with_interval(mean: float, interval: tuple[float, float] | None, form: str = ".3f") -> str:
    """A mean and half the length of its interval, which is symmetric."""
    return f"{mean:{form}}" + (f" ± {(interval[1] - interval[0]) / 2:.3f}" if interval else "")


def _lead(summary: Summary, metric: Metric) -> str:
    """The result in a sentence for every scenario: who is best among those that play by the rules."""
    sentences = []
    for scenario, rows in summary.scenarios.items():
        fair = [row for row in rows if row.kind == "observation"]
        if fair:
            best = fair[0]
            versus = ""
            if best.against_baseline is not None:
                versus = f", {_against(best.against_baseline)} {summary.baseline}"
            sentences.append(
                f"<b>{html.text(scenario)}</b>: of the agents that see only the observation, "
                f"<b>{html.text(best.agent)}</b> comes first with "
                f"{best.means[metric.name]:.3f} {html.text(metric.unit)}{html.text(versus)}."
            )
    return "<br>".join(sentences)


def _against(paired: Comparison) -> str:
    share = "" if paired.percent is None else f" ({paired.percent:+.1f} %)"
    return {
        "better": f"better{share} than",
        "worse": f"worse{share} than",
        "cannot tell": "not to be told apart from",
        "insufficient": "with too few episodes to tell it from",
    }[paired.verdict]


def _caption(metric: Metric, single: bool) -> str:
    dots = " Faint dots: single episodes." if single else ""
    return (
        f"Left: {metric.title} [{metric.unit}], mean and 95 % interval.{dots} Right: difference to the "
        "baseline on the same episodes, in per cent. Blue: sees the observation; purple: also the settings; "
        "red: privileged; grey: an estimator outside the action space."
    )


def _notes(summary: Summary) -> str:
    last = summary.first_seed + summary.episodes - 1
    return f"""<h3>How to read this</h3>
<ul>
<li>Every agent meets the same {summary.episodes} episodes, seeds {summary.first_seed} to {last}; the noise
does not depend on the agent (checked in every evaluation). Nothing was tuned or trained on these seeds.</li>
<li>Differences are paired, with Student's t interval over episodes; each verdict is about one comparison
at 95 %. Below {MIN_EPISODES} episodes there is no interval and no verdict.</li>
<li>A verdict on a trained agent is about the policies that were scored. About its algorithm only several
training runs can say something (last column): below {MIN_RUNS} runs they are insufficient.</li>
<li><i>privileged</i> agents see the hidden truth, <i>estimators</i> do not act but read the same sensors on
the same strides: both are bounds, no competitors.</li>
</ul>
<p class="soft">{summary.seconds:g} s in all.</p>"""


def _colour(row: Row) -> str:
    return COLOURS["estimator" if row.kind.startswith("estimator") else row.kind]


def _figure(rows: tuple[Row, ...], summary: Summary, metric: Metric, episodes: pd.DataFrame | None) -> Any:
    from matplotlib.figure import Figure
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    figure = Figure(figsize=(10, 1.2 + 0.36 * len(rows)))
    left, right = figure.subplots(1, 2, sharey=True, width_ratios=(3, 2))
    for y, row in enumerate(rows):
        colour = _colour(row)
        mean = row.means[metric.name]
        if episodes is not None:
            single = episodes.loc[episodes["agent"] == row.agent, metric.name]
            left.plot(single, [y] * len(single), ".", color=colour, alpha=0.12, markersize=5, mew=0)
        if row.ci95:
            left.plot(row.ci95, [y, y], "-", color=colour, linewidth=3, solid_capstyle="butt")
        left.plot([mean], [y], "o", color=colour, markersize=6)
        paired = row.against_baseline
        if paired is None or paired.percent is None:
            right.plot([0], [y], "D", color="#1c2430", markersize=5)
            continue
        scale = paired.percent / paired.difference if paired.difference else 0.0
        if paired.ci95:
            ends = [end * scale for end in paired.ci95]
            right.plot(ends, [y, y], "-", color=colour, linewidth=3, solid_capstyle="butt")
        right.plot([paired.percent], [y], "o", color=colour, markersize=6)
    left.set_yticks(range(len(rows)), [row.agent for row in rows])
    left.invert_yaxis()
    left.set_xscale("log")
    left.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    left.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    left.xaxis.set_minor_formatter(NullFormatter())
    left.set_xlabel(f"{metric.title} [{metric.unit}]")
    right.axvline(0, color="#1c2430", linewidth=1)
    right.set_xlabel(f"difference to {summary.baseline} [%]")
    for axes in (left, right):
        axes.grid(axis="x", color="#d9dee6", linewidth=0.8)
        axes.set_axisbelow(True)
        axes.spines[["top", "right", "left"]].set_visible(False)
        axes.tick_params(axis="y", length=0)
    figure.tight_layout()
    return figure
