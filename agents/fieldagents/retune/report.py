"""A closed loop as an HTML page and in the terminal."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd

from fieldagents.evaluation.comparison import mean_interval
from fieldagents.evaluation.report import COLOURS, report_section
from fieldagents.retune.result import Retuning
from fieldmodels import html
from fieldmodels.files import write_text
from fieldmodels.html import GREY, LINE

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.console import Console


INKS = {"nominal": GREY, "retuned": COLOURS["observation"], "oracle": COLOURS["privileged"]}


def write_report(result: Retuning, episodes: pd.DataFrame, path: Path) -> None:
    """Write a self-contained page."""
    body = [
        f'<p class="lead">{html.text(result.sentence())}</p>',
        html.figure(partial(draw, result, episodes), _caption(result), name="retuned", beside=path.parent),
        html.facts(_facts(result)),
        f"<h2>Every agent in every simulation</h2>{report_section(result.evaluation, episodes, path.parent)}",
        f"<h2>What the share means</h2>{_notes(result)}",
    ]
    write_text(path, html.page(f"Re-tuned: {result.name}", "\n".join(body)))


def draw(result: Retuning, episodes: pd.DataFrame, width: float = html.WIDE) -> Figure:
    """Each agent's mean score, with its interval, in each simulation."""
    from matplotlib.figure import Figure

    metric = result.metric
    scale = 100.0 if metric.binary else 1.0
    places = list(reversed(result.evaluation.scenarios))
    figure = Figure(figsize=(width, 3.6))
    axes = figure.subplots()
    for offset, agent in enumerate(result.agents):
        own = episodes[episodes["agent"] == agent]
        scores = [own.loc[own["scenario"] == place, metric.name] for place in places]
        x = [k + 0.14 * (offset - (len(result.agents) - 1) / 2) for k in range(len(places))]
        means = [scale * float(one.mean()) for one in scores]
        axes.plot(x, means, "o", color=INKS[agent], markersize=7, label=agent)
        for at, one in zip(x, scores, strict=True):
            interval = mean_interval(one.to_numpy(), 2, binary=metric.binary)
            if interval is not None:
                axes.plot([at, at], [scale * end for end in interval], color=INKS[agent], linewidth=2)
    axes.set_xticks(range(len(places)), [f"tested in the\n{place}" for place in places])
    axes.set_xlim(-0.5, len(places) - 0.5)
    axes.set_ylabel(metric.label)
    axes.margins(y=0.12)
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(axis="y", color=LINE)
    if width == html.WIDE:
        axes.legend(frameon=False, title="tuned in", loc="upper left", bbox_to_anchor=(1, 1))
    else:
        axes.tick_params(axis="x", labelsize=7)
        axes.legend(frameon=False, ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1))
    figure.tight_layout()
    return figure


def _facts(result: Retuning) -> list[tuple[str, str]]:
    """What was tuned, how sure the share is, what to do next."""
    sure = "" if result.recovered is None else "no interval: too few episodes"
    if result.recovered is not None and (ends := result.recovered.ci95):
        sure = f"{100 * ends[0]:.0f} to {100 * ends[1]:.0f} % at 95 %"
    return [
        ("Tuned", html.text(f"{result.title}; {sum(result.tuning_seconds.values()):.0f} s in all")),
        ("How sure", sure),
    ]


def show(result: Retuning, console: Console) -> None:
    """Print what came out."""
    from rich.markup import escape
    from rich.table import Table

    places = list(result.evaluation.scenarios)
    table = Table(
        "tuned in the",
        *(f"tested in the {place}" for place in places),
        title=escape(f"{result.metric.label}, {result.evaluation.episodes} episodes"),
        title_justify="left",
    )
    scale = 100.0 if result.metric.binary else 1.0
    for agent, place in zip(result.agents, TUNED_IN, strict=False):
        means = [result.mean(agent, where) for where in places]
        table.add_row(place, *("none" if mean is None else f"{scale * mean:.4g}" for mean in means))
    console.print(table)
    console.print(result.sentence(), markup=False)


TUNED_IN = ("nominal simulation", "extended simulation", "hidden reality (oracle)")


def _caption(result: Retuning) -> str:
    better = "lower" if result.metric.lower_is_better else "higher"
    counts = "on the machine itself" if result.recovered is None else "in the hidden reality"
    return (
        f"{result.metric.label}, mean and 95 % interval over the same {result.evaluation.episodes} episodes; "
        f"{better} is better. The grey agent in the nominal simulation is what was predicted; what counts is "
        f"{counts}."
    )


def _notes(result: Retuning) -> str:
    notes = [
        "Each agent is tuned with the same effort on the same tuning seeds; only the simulation differs. "
        "Test seeds were used for nothing but these tests.",
    ]
    if result.recovered is not None:
        notes += [
            "The share of the loss recovered is (nominal - retuned) / (nominal - oracle) of the mean scores "
            "in the hidden reality, with a percentile bootstrap interval over episodes. It does not "
            "hold the chance of the tuning itself: a re-tuned agent can come out a little better than the "
            "oracle.",
            "The oracle is tuned in the hidden reality itself, which no robot knows: a bound, no competitor.",
        ]
    else:
        notes.append(
            "No hidden reality is known here. What the extended simulation says of the agent tuned in it "
            "is a forecast: it holds as far as the extended simulation does."
        )
    return "<ul>" + "".join(f"<li>{html.text(note)}</li>" for note in notes) + "</ul>"
