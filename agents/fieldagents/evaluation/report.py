"""An evaluation as an HTML report and as a table in the terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from fieldagents.evaluation.comparison import MIN_EPISODES, MIN_RUNS, Comparison, Interval
from fieldagents.evaluation.ranking import Pair, leading
from fieldagents.evaluation.summary import DecisionTime, Row, Summary
from fieldagents.task import Metric, get_task
from fieldmodels import html
from fieldmodels.files import write_text
from fieldmodels.html import AFTER, BEFORE, GREY, INK, LINE, PURPLE

if TYPE_CHECKING:
    from rich.console import Console

COLOURS = {"observation": AFTER, "diagnosis": AFTER, "model": PURPLE, "privileged": BEFORE, "estimator": GREY}
"""Colour of an agent by what it sees; an estimator is outside the action space."""

COLUMNS = 4
"""Metrics beside each other in a terminal."""


def write_report(summary: Summary, episodes: pd.DataFrame, path: Path) -> None:
    """Write a self-contained ``report.html``."""
    body = report_section(summary, episodes, path.parent)
    write_text(path, html.page(f"Evaluation: {summary.name}", body))


def report_section(summary: Summary, episodes: pd.DataFrame | None = None, beside: Path | None = None) -> str:
    """The report's body, with its figures inline, to stand alone or inside another report.

    Args:
        summary: What was found.
        episodes: The episodes' table; with it, each figure also shows the single episodes.
        beside: The page's folder, for each figure's PNG and CSV.
    """
    first, *others = _of_agents(summary)
    parts = [f'<p class="lead">{lead(summary)}</p>', html.facts(_facts(summary))]
    for scenario, rows in summary.scenarios.items():
        own = None if episodes is None else episodes[episodes["scenario"] == scenario]
        shown = partial(_shown, rows, summary, own, scenario, beside)
        parts += [
            f"<h3>{html.text(scenario)}</h3>",
            f"<p>{html.text(_conditions(summary.environments[scenario]))}</p>",
            shown(first),
            html.table(*_table(rows, summary, first, summary.decision_ms[scenario]), _explained(first)),
        ]
        parts.append(_among_all(rows, summary.pairs[scenario], first, own, beside, scenario))
        if others:
            parts.append(html.table(*_overview(rows, others), "The other metrics, each with its interval."))
        for metric in others:
            parts += [
                f"<details><summary>{html.text(metric.title)}</summary>",
                shown(metric),
                html.table(*_table(rows, summary, metric), _explained(metric)),
                "</details>",
            ]
    parts.append(_notes(summary))
    return "\n".join(parts)


def _facts(summary: Summary) -> list[tuple[str, str]]:
    """What was compared, how sure it is, and what to do where it is not."""
    pairs = [pair for found in summary.pairs.values() for pair in found]
    decided = sum(pair.verdict in ("better", "worse") for pair in pairs)
    agents = {row.agent for rows in summary.scenarios.values() for row in rows}
    more = f"More episodes would decide more: <code>--set episodes={4 * summary.episodes}</code>"
    return [
        ("Compared", f"{len(agents)} agents on the same {summary.episodes} episodes of each scenario"),
        (
            "How sure",
            f"{decided} of {len(pairs)} differences between two agents are significant at 95 % (Holm)",
        ),
        ("Next", more if decided < len(pairs) and summary.episodes < 2500 else ""),
    ]


def show(summary: Summary, console: Console) -> None:
    """Print the results as tables."""
    from rich.markup import escape
    from rich.table import Table

    first, *others = _of_agents(summary)
    for scenario, rows in summary.scenarios.items():
        tables = [(first.label, _table(rows, summary, first, summary.decision_ms[scenario]))]
        for start in range(0, len(others), COLUMNS):
            tables.append(("the other metrics", _overview(rows, others[start : start + COLUMNS])))
        for what, (header, body) in tables:
            title = f"{scenario}: {what}, {summary.episodes} episodes (± 95 %)"
            table = Table(title=escape(title), title_justify="left")
            for number, cell in enumerate(header):
                table.add_column(escape(cell), no_wrap=number == 0)
            for cells in body:
                table.add_row(*(escape(cell) for cell in cells))
            console.print(table)


def _of_agents(summary: Summary) -> list[Metric]:
    """The metrics that depend on the agent."""
    return [metric for metric in get_task(summary.task).metrics if not metric.common]


def _conditions(environment: Mapping[str, Any]) -> str:
    """A scenario's settings and reality in a line."""
    settings = ", ".join(f"{key} = {value}" for key, value in environment["settings"].items())
    reality = ", ".join(
        f"{group} {key} = {value if isinstance(value, Mapping) else format(value, '.4g')}"
        for group, values in environment["reality"].items()
        for key, value in values.items()
    )
    return f"Settings: {settings or 'the defaults'}. Reality: {reality or 'the nominal simulation'}."


Cells = tuple[list[str], list[list[str]]]


def _table(
    rows: tuple[Row, ...],
    summary: Summary,
    metric: Metric,
    decision_ms: Mapping[str, DecisionTime | None] | None = None,
) -> Cells:
    """Header and cells for one metric; columns that would be empty are left out."""
    header = ["agent", "sees", _headed(metric), "episodes", f"against {summary.baseline}", "%", "verdict"]
    header += ["training runs", "gap closed", "ms a decision", "alone"]
    body = []
    for row in rows:
        score = row.scores[metric.name]
        paired, training = score.against_baseline, score.of_training
        cells = [row.agent, row.kind, _mean(metric, score.mean, score.ci95)]
        cells.append(f"{100 * score.share:.0f} %" if metric.may_miss else "")
        if paired is None:
            cells += ["baseline", "", ""]
        else:
            percent = "" if paired.percent is None else f"{paired.percent:+.1f}"
            cells += [_mean(metric, paired.difference, paired.ci95, "+"), percent, paired.verdict]
        cells.append(f"{training.n}: {training.verdict}" if training else "")
        gap = row.standing.gap if decision_ms is not None else None
        cells.append("" if gap is None else f"{round(100 * gap)} %")
        took = (decision_ms or {}).get(row.agent)
        cells += ["", ""] if took is None else [f"{took.batch:.2g}", f"{took.alone:.2g}"]
        body.append(cells)
    full = [j for j in range(len(header)) if any(cells[j] for cells in body)]
    return [header[j] for j in full], [[cells[j] for j in full] for cells in body]


def _overview(rows: tuple[Row, ...], metrics: Sequence[Metric]) -> Cells:
    """Header and cells for several metrics: mean, interval, verdict."""
    header = ["agent", *(_headed(metric) for metric in metrics)]
    body = []
    for row in rows:
        cells = [row.agent]
        for metric in metrics:
            score = row.scores[metric.name]
            cell = _mean(metric, score.mean, score.ci95)
            if metric.may_miss and score.mean is not None:
                cell += f" in {100 * score.share:.0f} %"
            if score.against_baseline and score.mean is not None:
                cell += f", {score.against_baseline.verdict}"
            cells.append(cell)
        body.append(cells)
    return header, body


def _headed(metric: Metric) -> str:
    """A metric's column: its name and unit."""
    unit = "%" if metric.binary else metric.unit
    return metric.name if unit == "1" else f"{metric.name} [{unit}]"


def _mean(metric: Metric, mean: float | None, interval: Interval | None, sign: str = "") -> str:
    """A mean with its interval: half its length where it is symmetric, both ends for a share."""
    if mean is None:
        return "none"
    if metric.binary:
        ends = f" [{100 * interval[0]:{sign}.1f}, {100 * interval[1]:{sign}.1f}]" if interval else ""
        return f"{100 * mean:{sign}.1f}{ends}"
    if interval is None:
        return f"{mean:{sign}.4g}"
    half = (interval[1] - interval[0]) / 2
    digits = min(max(1 - math.floor(math.log10(half)), 0), 6) if half > 0 else 3
    return f"{mean:{sign}.{digits}f} ± {half:.{digits}f}"


def lead(summary: Summary) -> str:
    """The result in a sentence or two for every scenario, as HTML: who is best by the rules."""
    metric, sentences = _of_agents(summary)[0], []
    for scenario, rows in summary.scenarios.items():
        scored = [row for row in rows if row.first.mean is not None]
        only = [row for row in scored if row.kind == "observation"]
        informed = [row for row in scored if row.kind in ("observation", "model")]
        parts = []
        if informed and informed[0].kind == "model":
            parts.append(
                "of the agents that see the observation and the settings, "
                + _first(informed, summary, metric, summary.pairs[scenario])
            )
        if only:
            parts.append(
                "of the agents that see only the observation, "
                + _first(only, summary, metric, summary.pairs[scenario])
            )
        if parts:
            sentences.append(f"<b>{html.text(scenario)}</b>: {'; '.join(parts)}.")
    return "<br>".join(sentences)


def _first(rows: Sequence[Row], summary: Summary, metric: Metric, pairs: tuple[Pair, ...]) -> str:
    """Who leads some rows, best first: alone only if its lead over the second is significant."""
    best = rows[0]
    lead = leading([row.agent for row in rows], pairs)
    unit = "%" if metric.binary else metric.unit.removeprefix("1")
    score = html.text(f"{_mean(metric, best.first.mean, best.ci95)} {unit}".strip())
    versus = ""
    if best.against_baseline is not None:
        versus = html.text(f", {_against(best.against_baseline)} {summary.baseline}")
    name = f"<b>{html.text(best.agent)}</b>"
    if len(lead) == 1:
        return f"{name} is best with {score}{versus}"
    others = " and ".join(f"<b>{html.text(other)}</b>" for other in lead[1:])
    return f"{name} has the best mean, {score}{versus}; its lead over {others} is not significant"


def _among_all(
    rows: tuple[Row, ...],
    pairs: tuple[Pair, ...],
    metric: Metric,
    episodes: pd.DataFrame | None,
    beside: Path | None,
    scenario: str,
) -> str:
    """Every agent among all: interquartile means, probabilities of improvement, profiles, all pairs."""
    standing = [
        [
            row.agent,
            "none" if row.standing.middle is None else f"{row.standing.middle:.4g}",
            "" if row.standing.improvement is None else f"{100 * row.standing.improvement:.0f} %",
            "" if row.standing.gap is None else f"{round(100 * row.standing.gap)} %",
        ]
        for row in rows
    ]
    place = {row.agent: i for i, row in enumerate(rows)}
    compared = [
        [
            pair.agent,
            pair.other,
            _mean(metric, pair.difference, pair.ci95, "+"),
            "" if pair.p is None else f"{pair.p:.2g}",
            pair.verdict,
            "algorithms" if pair.of_algorithms else "policies",
        ]
        for pair in sorted(pairs, key=lambda pair: (place[pair.agent], place[pair.other]))
    ]
    parts = ["<details><summary>All agents against each other</summary>"]
    if episodes is not None and not metric.binary:
        better = "left" if metric.lower_is_better else "right"
        parts.append(
            html.figure(
                partial(_profiles, rows, metric, episodes),
                f"Performance profiles: share of the episodes with at most this {metric.label}; further "
                f"{better} is better.",
                name=f"{scenario}-profiles",
                beside=beside,
            )
        )
    parts += [
        html.table(
            ["agent", "interquartile mean", "better than the baseline in", "gap closed"],
            standing,
            "The interquartile mean is that of the middle half of all episodes; ties count half; the gap is "
            "that from the baseline to the best privileged agent.",
        ),
        html.table(
            ["agent", "other", _headed(metric), "p", "verdict", "about"],
            compared,
            "Agent minus other on the same episodes, with an interval over training runs and episodes "
            "together; p and verdict are corrected for the number of pairs (Holm).",
        ),
        "</details>",
    ]
    return "\n".join(parts)


def _profiles(rows: tuple[Row, ...], metric: Metric, episodes: pd.DataFrame, width: float) -> Any:
    """Empirical distribution of every agent's episodes."""
    from matplotlib.figure import Figure

    wide = width == html.WIDE
    figure = Figure(figsize=(width, 4.0 if wide else 3.2 + 0.1 * len(rows)))
    axes = figure.subplots()
    for number, row in enumerate(rows):
        values = np.sort(episodes.loc[episodes["agent"] == row.agent, metric.name].dropna().to_numpy())
        if len(values):
            style = ("-", "--", ":", "-.")[number // len(html.CYCLE) % 4]
            axes.step(
                values,
                np.arange(1, len(values) + 1) / len(values),
                style,
                where="post",
                label=_labelled(row.agent),
            )
    if _positive(rows, metric, episodes):
        _logarithmic(axes)
    axes.set_xlabel(metric.label)
    axes.set_ylabel("share of the episodes")
    axes.set_ylim(0, 1)
    axes.grid(color=LINE, linewidth=0.8)
    if wide:
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize=8)
    else:
        axes.legend(loc="upper left", bbox_to_anchor=(-0.15, -0.2), ncols=2, frameon=False, fontsize=8)
    figure.tight_layout()
    return figure


def _against(paired: Comparison) -> str:
    share = "" if paired.percent is None else f" ({paired.percent:+.1f} %)"
    return {
        "better": f"better{share} than",
        "worse": f"worse{share} than",
        "cannot tell": "indistinguishable from",
        "insufficient": "with too few episodes to distinguish it from",
    }[paired.verdict]


def _explained(metric: Metric) -> str:
    """What a table's numbers are."""
    better = "lower" if metric.lower_is_better else "higher"
    kind = "with its 95 % interval" if metric.binary else "± half the 95 % interval"
    pairs = (
        "The column episodes says in how many of them there is a value; the difference is paired, "
        "on the episodes in which both agents have one."
        if metric.may_miss
        else "The difference is paired, on the same episodes."
    )
    return f"{_capital(metric.label)}, mean {kind}; {better} is better. {pairs}"


def _capital(words: str) -> str:
    return words[:1].upper() + words[1:]


def _caption(metric: Metric, single: bool) -> str:
    dots = " Faint dots: single episodes." if single and not metric.binary else ""
    return (
        f"First panel: {metric.label}, mean and 95 % interval.{dots} Second: difference from the "
        "baseline on the same episodes. Blue: sees the observation; purple: also the settings; orange: "
        "privileged; grey: an estimator outside the action space."
    )


def _notes(summary: Summary) -> str:
    last = summary.first_seed + summary.episodes - 1
    metrics = get_task(summary.task).metrics
    seeds = (
        f"Every agent meets the same {summary.episodes} episodes, seeds {summary.first_seed} to {last}. "
        "Nothing was tuned or trained on these seeds."
    )
    if common := ", ".join(metric.title for metric in metrics if metric.common):
        seeds += f" What does not depend on the agent was the same for all, to the bit: {common}."
    notes = [
        seeds,
        "Differences are paired, with Student's t interval over episodes; each verdict in the first table "
        "is about one comparison at 95 %; those of all pairs are corrected for their number, and decide "
        f"whether a lead is significant. Below {MIN_EPISODES} episodes there is no interval and no "
        "verdict.",
        "A verdict on a trained agent is about the policies that were scored. About its algorithm only "
        "several training runs can say something (column training runs): below "
        f"{MIN_RUNS} runs they are insufficient.",
        "<i>privileged</i> agents see the hidden truth, <i>estimators</i> do not act but read the same "
        "sensors on the same episodes: both are bounds, not competitors.",
        f"A decision's time is that of a call for the batch of {summary.episodes} episodes, divided by their "
        "number; alone: of a call for a single robot. Medians over an episode's calls, on the machine that "
        "wrote this page.",
    ]
    if any(metric.binary for metric in metrics):
        notes.insert(2, "A share has Wilson's interval, a difference of shares that of Agresti and Min.")
    if any(metric.may_miss for metric in metrics):
        notes.insert(
            2,
            "A metric that an episode may lack is averaged over the episodes that have it, and two agents "
            "are compared where both have it: it says nothing of the episodes that lack it.",
        )
    items = "\n".join(f"<li>{note}</li>" for note in notes)
    return (
        f'<h3>How to read this</h3>\n<ul>\n{items}\n</ul>\n<p class="soft">{summary.seconds:g} s in all.</p>'
    )


def _colour(row: Row) -> str:
    return COLOURS["estimator" if row.kind.startswith("estimator") else row.kind]


def _shown(
    rows: tuple[Row, ...],
    summary: Summary,
    episodes: pd.DataFrame | None,
    scenario: str,
    beside: Path | None,
    metric: Metric,
) -> str:
    """The figure of a metric in a scenario."""
    drawing, caption = _figure(rows, summary, metric, episodes), _caption(metric, episodes is not None)
    return html.figure(drawing, caption, name=f"{scenario}-{metric.name}", beside=beside)


def _figure(rows: tuple[Row, ...], summary: Summary, metric: Metric, episodes: pd.DataFrame | None) -> Any:
    """Each agent's mean, and beside it the difference from the baseline."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(html.WIDE, 1.2 + 0.36 * len(rows)))
    left, right = figure.subplots(1, 2, sharey=True, width_ratios=(3, 2))
    scale = 100.0 if metric.binary else 1.0
    percent = _in_percent(rows, metric)
    for y, row in enumerate(rows):
        colour, score = _colour(row), row.scores[metric.name]
        if episodes is not None and not metric.binary:
            single = episodes.loc[episodes["agent"] == row.agent, metric.name]
            left.plot(single, [y] * len(single), ".", color=colour, alpha=0.12, markersize=5, mew=0)
        _dot(left, y, score.mean, score.ci95, scale, colour)
        paired = score.against_baseline
        if paired is None:
            right.plot([0], [y], "D", color=INK, markersize=5)
        elif not percent:
            _dot(right, y, paired.difference, paired.ci95, scale, colour)
        elif paired.difference:
            of_base = (paired.percent or 0.0) / paired.difference
            _dot(right, y, paired.difference, paired.ci95, of_base, colour)
        else:
            _dot(right, y, paired.difference, None, 1.0, colour)
    left.set_yticks(range(len(rows)), [_labelled(row.agent) for row in rows])
    left.set_ylim(len(rows) - 0.5, -0.5)
    if metric.binary:
        left.set_xlim(-2, 102)
    elif _positive(rows, metric, episodes):
        _logarithmic(left)
    left.set_xlabel(metric.label)
    right.axvline(0, color=INK, linewidth=1)
    unit = "%" if percent else "percentage points" if metric.binary else metric.unit
    right.set_xlabel(f"difference from {summary.baseline}" + ("" if unit == "1" else f" [{unit}]"))
    for axes in (left, right):
        axes.grid(axis="x", color=LINE, linewidth=0.8)
        axes.set_axisbelow(True)
        axes.spines[["top", "right", "left"]].set_visible(False)
        axes.tick_params(axis="y", length=0)
    figure.tight_layout()
    return figure


def _labelled(agent: str, length: int = 36) -> str:
    """An agent's name in a figure: of a long path its end, or the label would take the room of the axes."""
    return agent if len(agent) <= length else f"…{agent[1 - length :]}"


def _dot(axes: Any, y: int, mean: float | None, interval: Interval | None, scale: float, colour: str) -> None:
    """A mean with its interval."""
    if interval:
        ends = [end * scale for end in interval]
        axes.plot(ends, [y, y], "-", color=colour, linewidth=3, solid_capstyle="butt")
    if mean is not None:
        axes.plot([mean * scale], [y], "o", color=colour, markersize=6)


def _in_percent(rows: tuple[Row, ...], metric: Metric) -> bool:
    """Whether all differences can be given in per cent of the baseline."""
    paired = [row.scores[metric.name].against_baseline for row in rows]
    return all(one is None or one.percent is not None for one in paired if one is None or one.n)


def _positive(rows: tuple[Row, ...], metric: Metric, episodes: pd.DataFrame | None) -> bool:
    """Whether a logarithmic axis can show everything, and helps."""
    means = [score.mean for row in rows if (score := row.scores[metric.name]).mean is not None]
    ends = [end for row in rows for end in row.scores[metric.name].ci95 or ()]
    single = [] if episodes is None else episodes[metric.name].dropna().tolist()
    shown = [*means, *ends, *single]
    return bool(shown) and min(shown) > 0 and max(shown) > 3 * min(shown)


def _logarithmic(axes: Any) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axes.set_xscale("log")
    low, high = axes.get_xlim()
    axes.xaxis.set_major_locator(LogLocator(subs=(1,) if high > 100 * low else (1, 2, 5)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
