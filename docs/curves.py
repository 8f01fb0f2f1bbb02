"""Draw the learning curves of the zoo, and write their table into the page on training.

python docs/curves.py
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from fieldagents.policies.zoo import Training, list_zoo
from fieldagents.task import get_task
from fieldmodels.files import replacing, write_text

FOLDER = Path(__file__).parent
BEGIN, END = "<!-- learning curves: begin -->", "<!-- learning curves: end -->"
COLUMNS = 3


def seconds(training: Training) -> tuple[float, str]:
    """Mean seconds of a run, and what they are of: runs of older versions knew those on the clock alone."""
    runs = pd.DataFrame(training.card["runs"])
    name = "processor_seconds" if "processor_seconds" in runs else "seconds"
    return float(runs[name].mean()), "processor" if name == "processor_seconds" else "clock"


def draw(trainings: list[Training]) -> Figure:
    """A panel for each entry that learned by reward: the validation returns of its runs, and their mean."""
    rows = -(-len(trainings) // COLUMNS)
    figure = Figure(figsize=(4 * COLUMNS, 2.7 * rows), layout="constrained")
    for axes, training in zip(figure.subplots(rows, COLUMNS, squeeze=False).flat, trainings, strict=False):
        curve = pd.read_csv(training.folder / "curve.csv")
        runs = curve.pivot_table(index="steps", columns="seed", values="validation_return")
        axes.plot(runs.index / 1e6, runs, color="#9db4d6", linewidth=0.8)
        axes.plot(runs.index / 1e6, runs.mean(axis=1), color="#1f4e9c")
        low, high = runs.iloc[len(runs) // 4 :].min().min(), runs.max().max()
        margin = 0.1 * (high - low) or 1.0
        axes.set_ylim(low - margin, high + margin)  # the first quarter would hide the rest
        axes.set_title(str(training), fontsize=9)
        axes.set_xlabel("million steps", fontsize=8)
        axes.set_ylabel("validation return", fontsize=8)
        axes.tick_params(labelsize=7)
        spent, clock = seconds(training)
        factor = spent / (runs.index[-1] / 1e6)
        scales = (lambda x, f=factor: x * f, lambda x, f=factor: x / f)
        above = axes.secondary_xaxis("top", functions=scales)
        above.set_xlabel(f"{clock} seconds", fontsize=7)
        above.tick_params(labelsize=7)
    for axes in figure.axes[len(trainings) :]:
        axes.set_axis_off()
    return figure


def table(trainings: list[Training]) -> str:
    """What each entry reached: a Markdown table; the figure has steps and seconds."""
    lines = ["| entry | flat at the end | test score of its runs |", "|---|---|---|"]
    for training in trainings:
        runs = training.card["runs"]
        flat = [run["plateau"] for run in runs if "plateau" in run]
        known = f"{sum(flat)} of {len(flat)}" if flat else ""
        lines.append(f"| `{training}` | {known} | {scores(training.task, runs)} |")
    return "\n".join(lines)


def scores(task: str, runs: list[dict[str, Any]]) -> str:
    """The range over the runs of the first metric, and of what follows it where that one is a share."""
    told = []
    for metric in get_task(task).metrics:
        values = [run["test_scores"][metric.name] for run in runs]
        low, high = (f"{100 * v if metric.binary else v:.4g}" for v in (min(values), max(values)))
        told.append(f"`{metric.name}` {low} to {high}{' %' * metric.binary}")
        if not metric.binary:
            break
    return "; ".join(told)


def entries() -> list[Training]:
    """All entries of the zoo, each in every scenario that it was trained in."""
    return [training for entry in list_zoo() for training in entry.trainings]


def page(text: str) -> str:
    """The page on training with the present table in its place."""
    before, rest = text.split(BEGIN)
    _, after = rest.split(END)
    return f"{before}{BEGIN}\n{table(entries())}\n{END}{after}"


def main() -> None:
    """Renew the figure and the table."""
    with replacing(FOLDER / "learning_curves.png") as path:
        draw([one for one in entries() if one.card["config"]["steps"]]).savefig(path, dpi=72)
    training = FOLDER / "training.md"
    write_text(training, page(training.read_text(encoding="utf-8")))


if __name__ == "__main__":
    main()
