"""Draw the learning curves of the zoo.

python docs/curves.py
"""

from __future__ import annotations

from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

from fieldagents.policies.zoo import Training, list_zoo
from fieldmodels.files import replacing

FOLDER = Path(__file__).parent
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


def entries() -> list[Training]:
    """All entries of the zoo, each in every scenario that it was trained in."""
    return [training for entry in list_zoo() for training in entry.trainings]


def main() -> None:
    """Renew the figure."""
    with replacing(FOLDER / "learning_curves.png") as path:
        draw([one for one in entries() if one.card["config"]["steps"]]).savefig(path, dpi=72)


if __name__ == "__main__":
    main()
