"""Draw the pictures of pages whose numbers are published: each out of the tables on its own page.

python docs/pictures.py
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from textwrap import shorten

from leaderboard import HEADLINES
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from fieldmodels.html import AFTER, BEFORE, GREEN, PURPLE

FOLDER = Path(__file__).parent
DARK, LIGHT, GOOD, BAD = AFTER, PURPLE, GREEN, BEFORE
Rows = list[list[str]]


def tables(page: str) -> list[Rows]:
    """All tables of a page's text, header first, cells without marks."""
    found: list[Rows] = []
    before = ""
    for line in page.splitlines():
        if line.startswith("|"):
            if not before.startswith("|"):
                found.append([])
            cells = [cell.strip().strip("*`") for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
            if not set("".join(cells)) <= set("-: "):
                found[-1].append(cells)
        before = line
    return found


def numbers(text: str) -> list[float]:
    """All numbers of a text."""
    return [float(n) for n in re.findall(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?", text.replace(",", ""))]


def exam(page: str) -> Figure:
    """Rates with their intervals and goals."""
    header = ["what", "counted", "value", "95 % interval", "goal", ""]
    rows = next(t for t in tables(page) if t[0] == header)[1:]
    rows = [row for row in rows if "%" in row[2] and "/" in row[1]][::-1]
    figure, axes = bars(len(rows), "% of cases")
    for k, (_, _, value, interval, goal, met) in enumerate(rows):
        colour = {"met": GOOD, "missed": BAD}.get(met, "grey")  # some rates have no goal
        axes.plot(numbers(interval)[:2], [k, k], color=colour, linewidth=3, alpha=0.35)
        axes.plot(numbers(value)[0], k, "D" if met == "missed" else "o", color=colour)
        if goal:
            axes.plot(numbers(goal)[0], k, "|", color="black", markersize=14)
    axes.set_yticks(range(len(rows)), [shorten(row[0], 50, placeholder=" ...") for row in rows])
    for marker, colour, label in (("o", GOOD, "goal met"), ("D", BAD, "missed"), ("|", "black", "goal")):
        axes.plot([], [], marker, color=colour, label=label)
    figure.legend(frameon=False, ncols=3, loc="outside upper left")
    return figure


def licences(page: str) -> Figure:
    """Packages by the kind of their licence."""
    rows = tables(page)[0][1:]
    return counted([(kind, int(count)) for kind, count in rows][::-1], "packages that it runs with")


def faults(page: str) -> Figure:
    """What became of hostile input."""
    rows = next(t for t in tables(page) if t[0][:3] == ["kind", "answered", "refused"])
    header, rows = rows[0], [row for row in rows[1:] if row[0] != "all"][::-1]
    figure, axes = bars(len(rows), "cases")
    left = [0.0] * len(rows)
    for column, colour in ((1, DARK), (2, LIGHT), (0, BAD)):
        values = [numbers(r[column])[0] if column else sum(numbers(" ".join(r[3:]))) for r in rows]
        label = header[column] if column else "traceback, hang, torn file, false name"
        axes.barh(
            [row[0] for row in rows], values, left=left, color=colour, label=f"{label}: {sum(values):.0f}"
        )
        left = [a + b for a, b in zip(left, values, strict=True)]
    figure.legend(frameon=False, ncols=3, loc="outside upper left")
    return figure


def speed(page: str) -> Figure:
    """Steps of the environments, one alone and a row of many."""
    rows = {row[0]: [numbers(cell)[0] for cell in row[1:3]] for row in tables(page)[0][1:]}
    names = list(rows)[::-1]
    figure, axes = bars(len(names), "steps of CartPole that one step takes")
    for k, name in enumerate(names):
        alone, many = rows[name][0], rows[name][0] * rows[name][1]
        axes.plot([many, alone], [k, k], color=LIGHT, linewidth=3, zorder=1)
        axes.plot(many, k, "D", color=GOOD, label="" if k else "one of many rows in a vector")
        axes.plot(alone, k, "o", color=DARK, label="" if k else "one alone")
    axes.set_yticks(range(len(names)), names)
    axes.set_xscale("log")
    axes.axvline(1.0, color="black", linewidth=0.8)
    figure.legend(frameon=False, ncols=2, loc="outside upper left")
    return figure


def leaderboard(page: str) -> Figure:
    """Every agent's mean and interval in each task's scenario of the README, by what it sees."""
    colours = {"learned": GOOD, "observation": DARK, "settings, too": LIGHT, "not a competitor": "grey"}
    names = re.findall(r"^## (\w+)", page, re.M)
    figure = Figure(figsize=(11, 8.5), layout="constrained")
    for axes, name, rows in zip(figure.subplots(2, 3).flat, names, tables(page), strict=True):
        scenario, label = HEADLINES[name]
        column = rows[0].index(scenario)
        for k, row in enumerate(rows[:0:-1]):
            *share, value = row[column].strip("*").split(", ")  # the last metric decides
            if value == "–":
                continue
            mean, *more = numbers(value)
            half = more[0] if "±" in value else 0.0
            few = bool(share) and numbers(share[0])[0] < 90.0
            colour = colours[_kind(row)]
            axes.errorbar(mean, k, xerr=half, fmt="o", color=colour, mfc="none" if few else colour, ms=5)
        axes.set_yticks(range(len(rows) - 1), [re.split(r"\W+", f" {row[0]}")[1] for row in rows[:0:-1]])
        low, high = axes.get_xlim()
        if high > 8.0 * abs(low):
            axes.set_xscale("log")
            axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axes.xaxis.set_major_formatter("{x:g}")
            axes.xaxis.set_minor_formatter(NullFormatter())
        axes.tick_params(axis="y", labelsize=8)
        axes.set_title(f"{name}, {scenario}", fontsize=10)
        axes.set_xlabel(label, fontsize=9)
        axes.grid(axis="x", alpha=0.3)
    for kind, colour in colours.items():
        axes.plot([], [], "o", color=colour, label=kind)
    axes.plot([], [], "o", color="grey", mfc="none", label="has a value in under 90 % of the episodes")
    figure.legend(frameon=False, ncols=5, loc="outside upper left")
    return figure


def _kind(row: list[str]) -> str:
    if row[-1]:  # its training
        return "learned"
    if "hidden" in row[1] or "does not act" in row[1]:
        return "not a competitor"
    return "observation" if row[1] == "observation" else "settings, too"


def installation(page: str) -> Figure:
    """Size and time of each installation, by the build of torch."""
    rows = [row for row in next(t for t in tables(page) if t[0][0] == "step")[1:] if "install" in row[0]][
        ::-1
    ]
    figure, axes = bars(2 * len(rows), "GB")
    for offset, column, colour, label in ((0.2, 2, DARK, "torch of PyPI"), (-0.2, 4, LIGHT, "CPU build")):
        places = [2 * k + 0.5 + 2 * offset for k in range(len(rows))]
        values = [numbers(row[column])[0] for row in rows]
        axes.bar_label(axes.barh(places, values, 0.75, color=colour, label=label), padding=3, fontsize=8)
    axes.set_yticks([2 * k + 0.5 for k in range(len(rows))], [row[0] for row in rows])
    figure.legend(frameon=False, ncols=2, loc="outside upper left")
    return figure


def sweeps(page: str) -> Figure:
    """How long many jobs take on many processors."""
    rows = next(t for t in tables(page) if t[0][0] == "jobs on processors")[1:]
    figure, axes = bars(len(rows), "seconds until all jobs are done")
    names = [row[0].replace("on", "jobs on") + " processors" for row in rows][::-1]
    for offset, column, colour, label in ((0.2, 2, DARK, "processes"), (-0.2, 3, LIGHT, "Ray")):
        places = [k + offset for k in range(len(rows))]
        values = [numbers(row[column])[0] for row in rows][::-1]
        axes.barh(places, values, height=0.38, color=colour, label=label)
    alone = [numbers(row[1])[0] for row in rows][::-1]
    axes.plot(alone, range(len(rows)), "|", color="black", markersize=22, label="the jobs alone")
    axes.set_yticks(range(len(rows)), names)
    figure.legend(frameon=False, ncols=3, loc="outside upper left")
    return figure


def api(page: str) -> Figure:
    """What is made of what: the page's own names, from a log to a task."""
    places = {
        "log": (0, 1), "load": (1, 1), "diagnose": (2, 1), "Machine": (2, 0), "Diagnosis": (3, 1),
        "report": (4, 2), "make_env": (4, 1), "save": (4, 0),
    }  # fmt: skip
    arrows = (
        "log load", "load diagnose", "Machine diagnose", "diagnose Diagnosis", "Diagnosis report",
        "Diagnosis make_env", "Diagnosis save",
    )  # fmt: skip
    missing = [name for name in places if name != "log" and name not in page]
    if missing:
        raise ValueError(f"api.md does not name {', '.join(missing)}")
    figure = Figure(figsize=(9, 2.8), layout="constrained")
    axes = figure.subplots()
    for first, second in map(str.split, arrows):
        (a, b), (c, d) = places[first], places[second]
        arrow = {"arrowstyle": "->", "color": DARK, "shrinkA": 26, "shrinkB": 26}
        axes.annotate("", (c, d), (a, b), arrowprops=arrow)
    for name, place in places.items():
        face = LIGHT if name in ("log", "Diagnosis") else "white"
        box = {"boxstyle": "round,pad=0.4", "facecolor": face, "edgecolor": DARK}
        axes.annotate(name, place, ha="center", va="center", fontsize=10, bbox=box)
    axes.set(xlim=(-0.4, 4.6), ylim=(-0.5, 2.5))
    axes.set_axis_off()
    return figure


def bars(count: int, label: str) -> tuple[Figure, Axes]:
    """An empty panel for so many rows."""
    figure = Figure(figsize=(8, 1.2 + 0.26 * count), layout="constrained")
    axes = figure.subplots()
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(axis="y", length=0, labelsize=9)
    axes.set_xlabel(label)
    axes.set_ylim(-0.7, count - 0.3)
    return figure, axes


def counted(counts: list[tuple[str, int]], label: str) -> Figure:
    """A bar for each of several numbers."""
    figure, axes = bars(len(counts), label)
    axes.bar_label(
        axes.barh([n for n, _ in counts], [c for _, c in counts], color=DARK), padding=3, fontsize=8
    )
    return figure


PAGES: tuple[Callable[[str], Figure], ...] = (
    exam,
    licences,
    faults,
    installation,
    leaderboard,
    speed,
    sweeps,
    api,
)


def main() -> None:
    """Renew all pictures."""
    for draw in PAGES:
        figure = draw((FOLDER / f"{draw.__name__}.md").read_text(encoding="utf-8"))
        with rc_context({"svg.hashsalt": draw.__name__}):
            figure.savefig(
                FOLDER / "pictures" / f"{draw.__name__}.svg", metadata={"Date": None}, facecolor="white"
            )


if __name__ == "__main__":
    main()
