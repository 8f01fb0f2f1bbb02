"""The exam's result: counts with exact intervals, held against the goals, and what is taken for what."""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binomtest

from fieldmodels.exam.run import Row
from fieldmodels.exam.scoring import RIGHT, WRONG
from fieldmodels.files import write_text
from fieldmodels.html import page, table

SECONDS = 10.0
BEGIN, END = "<!-- exam: begin -->", "<!-- exam: end -->"
"""Between these marks ``docs/exam.md`` holds the generated tables."""


@dataclass(frozen=True)
class Goal:
    """A rate that is wanted.

    Attributes:
        name: What is counted, of which cases.
        kind: Kind of the cases.
        size: Their size (or noise).
        counts: Outcomes that are counted.
        limit: The rate [%].
        at_least: Whether the rate should be at least so high, or else at most.
    """

    name: str
    kind: str
    size: str
    counts: tuple[str, ...]
    limit: float
    at_least: bool


GOALS = (
    Goal("moderate singles right", "single", "moderate", RIGHT, 95.0, True),
    Goal("moderate singles wrong", "single", "moderate", WRONG, 2.0, False),
    Goal("hard singles right", "single", "hard", RIGHT, 75.0, True),
    Goal("hard singles wrong", "single", "hard", WRONG, 5.0, False),
    Goal("moderate pairs right", "pair", "moderate", RIGHT, 85.0, True),
    Goal("outside misnamed", "outside", "moderate", ("misnamed",), 10.0, False),
    Goal("false names, white noise", "nothing", "white", ("false name",), 3.0, False),
    Goal("false names, coloured noise", "nothing", "coloured", ("false name",), 3.0, False),
)


@dataclass(frozen=True)
class Rate:
    """A counted share.

    Attributes:
        count: Cases that count.
        cases: Cases counted; those that could not be made are left out.
        percent: Share [%]; NaN without a case.
        interval: Exact 95 % interval (Clopper and Pearson 1934) [%].
    """

    count: int
    cases: int
    percent: float
    interval: tuple[float, float]


def rate(rows: Iterable[Row], goal: Goal) -> Rate:
    """How many cases of a goal's kind count."""
    counted = [
        r for r in rows if (r["kind"], r["size"]) == (goal.kind, goal.size) and r["outcome"] != "out of reach"
    ]
    count = sum(r["outcome"] in goal.counts for r in counted)
    if not counted:
        return Rate(0, 0, float("nan"), (0.0, 100.0))
    interval = binomtest(count, len(counted)).proportion_ci(method="exact")
    return Rate(count, len(counted), 100 * count / len(counted), (100 * interval.low, 100 * interval.high))


def summary(rows: Sequence[Row]) -> dict[str, Any]:
    """The whole result as plain data: what ``exam.json`` holds."""
    models = list(dict.fromkeys(row["model"] for row in rows))
    parts = {"all": list(rows), **{name: [r for r in rows if r["model"] == name] for name in models}}
    return {
        "schema": 1,
        "cases": len(rows),
        "goals": {name: _goals(part) for name, part in parts.items()},
        "outcomes": {name: _outcomes(part) for name, part in parts.items()},
        "effects": _effects(rows),
        "confusions": _confusions(rows),
        "out_of_reach": sorted({r["summary"] for r in rows if r["outcome"] == "out of reach"}),
        "failed": sorted(r["summary"] for r in rows if r["outcome"] == "failed"),
        "parameters": _parameters(rows),
        "seconds": {name: _seconds(part) for name, part in parts.items()},
    }


def _goals(rows: Sequence[Row]) -> list[dict[str, Any]]:
    result = []
    for goal in GOALS:
        found = rate(rows, goal)
        if found.cases:
            met = found.percent >= goal.limit if goal.at_least else found.percent <= goal.limit
            result.append(
                {
                    "name": goal.name, "goal": f"{'>=' if goal.at_least else '<='} {goal.limit:g} %",
                    "count": found.count, "cases": found.cases, "percent": round(found.percent, 2),
                    "ci95": [round(v, 2) for v in found.interval], "met": met,
                }
            )  # fmt: skip
    return result


def _outcomes(rows: Sequence[Row]) -> dict[str, dict[str, int]]:
    result: dict[str, Counter[str]] = {}
    for row in rows:
        result.setdefault(f"{row['kind']}, {row['size']}", Counter())[row["outcome"]] += 1
    return {name: dict(counts.most_common()) for name, counts in result.items()}


def _effects(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Outcomes of the single effects and of the faults from outside, one by one."""
    result: dict[tuple[str, str], dict[str, Counter[str]]] = {}
    for row in rows:
        if row["kind"] in ("single", "outside"):
            of_size = result.setdefault((row["model"], row["hidden"][0]), {})
            of_size.setdefault(row["size"], Counter())[row["outcome"]] += 1
    return [
        {"model": model, "hidden": hidden, **{size: dict(c) for size, c in sizes.items()}}
        for (model, hidden), sizes in result.items()
    ]


def _confusions(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """What is named instead of, or beside, what is hidden; the commonest first."""
    seen: dict[tuple[str, str, str], list[str]] = {}
    for row in rows:
        if row["outcome"] in (*WRONG, "misnamed", "false name"):
            names = " + ".join("|".join(sorted(one)) for one in row["named"])
            hidden = " + ".join(row["hidden"]) or f"nothing, {row['size']} noise"
            seen.setdefault((row["model"], hidden, names), []).append(row["key"])
    order = sorted(seen.items(), key=lambda item: (-len(item[1]), item[0]))
    return [{"model": m, "hidden": h, "named": n, "cases": keys} for (m, h, n), keys in order]


def _parameters(rows: Sequence[Row]) -> dict[str, Any]:
    """How far the parameters of rightly named single effects are from the truth, in standard errors."""
    values = [
        abs(value)
        for row in rows
        if row["kind"] == "single" and row["outcome"] == "right alone"
        for value in row["deviations"].values()
    ]
    if not values:
        return {"count": 0}
    below = [float(np.mean(np.array(values) < limit)) for limit in (1.0, 2.0, 3.0)]
    return {
        "count": len(values),
        "median": round(float(np.median(values)), 3),
        "within_1_2_3": [round(100 * share, 1) for share in below],
    }


def _seconds(rows: Sequence[Row]) -> dict[str, float]:
    times = np.array([row["seconds"] for row in rows if row["outcome"] != "out of reach"])
    if not len(times):
        return {}
    return {
        "median": round(float(np.median(times)), 2),
        "longest": round(float(times.max()), 2),
        "share_below_10_s": round(100 * float(np.mean(times < SECONDS)), 1),
    }


Table = tuple[str, list[str], list[list[str]]]


def tables(found: dict[str, Any]) -> list[Table]:
    """Tables of a summary: title, header, rows."""
    return [
        ("Rates against the goals, all models", *_goal_table(found["goals"]["all"])),
        ("Rates by model", *_model_table(found)),
        ("Outcomes", *_outcome_table(found["outcomes"])),
        ("What is taken for what", *_confusion_table(found["confusions"])),
        ("Effect by effect", *_effect_table(found["effects"])),
    ]


def _goal_table(goals: list[dict[str, Any]]) -> tuple[list[str], list[list[str]]]:
    header = ["what", "cases", "counted", "rate", "95 % interval", "goal", ""]
    return header, [
        [
            goal["name"], str(goal["cases"]), str(goal["count"]), f"{goal['percent']:.1f} %",
            f"{goal['ci95'][0]:.1f} to {goal['ci95'][1]:.1f} %", goal["goal"],
            "met" if goal["met"] else "missed",
        ]
        for goal in goals
    ]  # fmt: skip


def _model_table(found: dict[str, Any]) -> tuple[list[str], list[list[str]]]:
    names = [goal.name for goal in GOALS]
    body = []
    for model, goals in found["goals"].items():
        by_name = {goal["name"]: f"{goal['count']}/{goal['cases']}" for goal in goals}
        seconds = found["seconds"][model]
        times = f"{seconds['median']:.1f} ({seconds['longest']:.1f})" if seconds else "-"
        body.append([model, *(by_name.get(name, "-") for name in names), times])
    return ["model", *names, "seconds: median (longest)"], body


def _outcome_table(outcomes: dict[str, Any]) -> tuple[list[str], list[list[str]]]:
    rows = []
    for model, kinds in outcomes.items():
        for kind, counts in kinds.items():
            text = ", ".join(f"{n} {outcome}" for outcome, n in counts.items())
            rows.append([model, kind, str(sum(counts.values())), text])
    return ["model", "hidden", "cases", "outcomes"], rows


def _confusion_table(confusions: list[dict[str, Any]]) -> tuple[list[str], list[list[str]]]:
    return ["model", "hidden", "named", "times"], [
        [c["model"], c["hidden"], c["named"], str(len(c["cases"]))] for c in confusions
    ]


def _effect_table(effects: list[dict[str, Any]]) -> tuple[list[str], list[list[str]]]:
    def text(counts: dict[str, int] | None) -> str:
        return ", ".join(f"{n} {outcome}" for outcome, n in (counts or {}).items()) or "-"

    rows = [[e["model"], e["hidden"], text(e.get("moderate")), text(e.get("hard"))] for e in effects]
    return ["model", "hidden", "moderate", "hard"], rows


def _notes(found: dict[str, Any]) -> list[str]:
    """What the tables leave unsaid."""
    seconds, errors = found["seconds"]["all"], found["parameters"]
    notes = []
    if seconds:
        notes.append(
            f"{found['cases']} cases; one diagnosis takes {seconds['median']:.1f} s (median, one core), "
            f"{seconds['longest']:.1f} s at most; {seconds['share_below_10_s']:.1f} % take less than 10 s."
        )
    if errors["count"]:
        one, two, three = errors["within_1_2_3"]
        notes.append(
            f"Of {errors['count']} parameters of effects that were named alone, {one:.0f}, {two:.0f} and "
            f"{three:.0f} % are within 1, 2 and 3 standard errors of the truth."
        )
    notes += [f"Out of reach: {text}." for text in found["out_of_reach"]]
    notes += [f"Ended in an error: {text}." for text in found["failed"]]
    return notes


def markdown(found: dict[str, Any]) -> str:
    """The result as Markdown."""
    parts = ["\n".join(_notes(found))]
    for title, header, rows in tables(found):
        lines = [f"**{title}**", "", _line(header), _line(["---"] * len(header))]
        parts.append("\n".join(lines + [_line(row) for row in rows]))
    return "\n\n".join(parts) + "\n"


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", " or ") for cell in cells) + " |"


def report(found: dict[str, Any]) -> str:
    """The result as a page of HTML."""
    notes = "".join(f"<p>{_escape(note)}</p>" for note in _notes(found))
    body = [f"<h2>{title}</h2>{table(header, rows)}" for title, header, rows in tables(found)]
    return page("Exam of the diagnosis", notes + "".join(body))


def _escape(note: str) -> str:
    from fieldmodels.html import text

    return text(note)


def write(rows: Sequence[Row], out: Path) -> dict[str, Path]:
    """Write ``exam.json``, ``exam.md`` and ``report.html``; returns where each is."""
    found = summary(rows)
    texts: dict[str, Callable[[], str]] = {
        "exam.json": lambda: json.dumps(found, indent=1, allow_nan=False) + "\n",
        "exam.md": lambda: markdown(found),
        "report.html": lambda: report(found),
    }
    for name, text in texts.items():
        write_text(out / name, text())
    return {name: out / name for name in texts}


def into_page(page_text: str, found: dict[str, Any]) -> str:
    """A page of the docs with the tables of a result between its marks.

    Raises:
        ValueError: If the page lacks the marks.
    """
    if BEGIN not in page_text or END not in page_text:
        raise ValueError(f"the page has no {BEGIN} ... {END}")
    before, rest = page_text.split(BEGIN, 1)
    after = rest.split(END, 1)[1]
    return f"{before}{BEGIN}\n\n{markdown(found)}\n{END}{after}"


def main() -> None:
    """Put a result into a page: ``python -m fieldmodels.exam.table results/exam/exam.json docs/exam.md``."""
    source, target = (Path(name) for name in sys.argv[1:])
    found = json.loads(source.read_text(encoding="utf-8"))
    write_text(target, into_page(target.read_text(encoding="utf-8"), found))


if __name__ == "__main__":
    main()
