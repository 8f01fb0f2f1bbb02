"""The exam's result: counts with intervals, held against the goals, and what is taken for what."""

from __future__ import annotations

import itertools
import json
import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from exam.run import Row
from exam.scoring import FALSE, RANKS, RIGHT, SAID, WRONG
from fieldmodels.files import write_text
from fieldmodels.html import page, table, text
from fieldmodels.model import ModelError

NOT_COUNTED = ("out of reach", "skipped")
QUANTILE = 1.959964
"""Of the normal distribution: intervals are of 95 %."""


@dataclass(frozen=True)
class Goal:
    """A rate that is wanted.

    Attributes:
        name: What is counted, of which cases.
        kind: Kind of the cases; empty for all.
        counts: Outcomes that are counted.
        limit: The rate [%]; None where it is told without one.
        at_least: Whether the rate should be at least so high, or else at most.
    """

    name: str
    kind: str
    counts: tuple[str, ...]
    limit: float | None
    at_least: bool = False


GOALS = (
    Goal("singles right, alone or in a set", "single", RIGHT, 95.0, True),
    Goal("singles wrong", "single", WRONG, 1.0),
    Goal("pairs right", "pair", RIGHT, 90.0, True),
    Goal("triples right", "triple", RIGHT, 75.0, True),
    Goal("unlisted faults misnamed", "unlisted", ("misnamed",), 5.0),
    Goal("unlisted faults silent", "unlisted", ("silent",), 15.0),
    Goal("unlisted faults: a curve at their place", "unlisted", ("curve", "near name"), None),
    Goal("unlisted faults: a curve elsewhere", "unlisted", ("elsewhere",), None),
    Goal("beside an unlisted fault: effects named", "mixed", ("both", "in part"), None),
    Goal("beside an unlisted fault: misnamed", "mixed", ("misnamed",), None),
    Goal("nothing hidden: false names", "nothing", ("false name",), 1.0),
    Goal("nothing hidden: anything said", "nothing", ("false name", "doubted"), 2.0),
    Goal("cases that ended in an error", "", ("failed",), 0.0),
    Goal("statements on real logs that hold", "log", ("held",), 100.0, True),
)
SILENT = {
    "silence": ("silent beyond the stated power", 0.0),
    "silence_of_anything": ("silent beyond what it says anything may add", 5.0),
}
"""What a silent answer's fault is compared with: the name of the rate, and its goal [%].

A curve, wherever the fault acts; or whatever may be missing, which is an upper limit of 95 %.
"""
SECONDS = 2.0
REGAINED = {"single": None, "pair": None, "triple": None, "unlisted": 50.0, "mixed": None}
"""Of which kinds it is counted how much is regained, and how often that should be most of it [%]."""
MOST = 0.8
"""Of what can be regained."""
MORE, WORSE = 1.3, 1.1
"""An error in the stated one, and in that before, beyond which an extended simulation is none."""
CERTAIN, SEEN = 0.95, 20.0
"""Stated probability that counts as certain; evidence [nats] with which a fault should be found."""
BINS = (0.0, 0.5, 0.8, 0.95, 0.999, 1.0)
"""Of stated probabilities."""
SUREST = 0.999
"""Probability as which a larger one counts in the log score, or one false answer would be all of it."""
COVERAGE = ((1.0, 68.0, 4.0), (2.0, 95.0, 3.0))
"""Standard errors, how many parameters should be within them, and how exactly [%]."""


def wilson(count: int, cases: int) -> tuple[float, float]:
    """Interval of 95 % of a rate [%] (Wilson 1927)."""
    if cases == 0:
        return 0.0, 100.0
    share, z2 = count / cases, QUANTILE**2 / cases
    middle = (share + 0.5 * z2) / (1.0 + z2)
    half = QUANTILE * math.sqrt(share * (1.0 - share) / cases + 0.25 * z2 / cases) / (1.0 + z2)
    return max(100.0 * (middle - half), 0.0), min(100.0 * (middle + half), 100.0)


def goals(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Every goal with what was counted for it."""
    rows = [row for row in rows if row["outcome"] not in NOT_COUNTED]
    result = []
    for goal in GOALS:
        of_kind = [row for row in rows if goal.kind in ("", row["kind"])]
        count = sum(row["outcome"] in goal.counts for row in of_kind)
        if of_kind:
            result.append(_rate(goal.name, count, len(of_kind), goal.limit, goal.at_least))
    worse = _worse(rows)
    if worse is not None:
        result.append(_rate("growing records: answers that get worse", *worse, 0.0, False))
    silent = [row for row in rows if row["outcome"] == "silent"]
    for key, (name, limit) in SILENT.items() if silent else ():
        above = sum(row.get(key) is None or row[key] > 1.0 for row in silent)
        result.append(_rate(name, above, len(silent), limit, False))
    twice = sum(row.get("silence") is not None and row["silence"] > 2.0 for row in silent)
    result += [_rate("silent at twice the stated power", twice, len(silent), None, False)] if silent else []
    powers = [row["power"] for row in silent if row.get("power") is not None]
    result += _quartiles("silent: the smallest curve stated to show, in the error", powers, "")
    result += _coverage(rows) + _delivered(rows) + _certain(rows) + _seconds_goal(rows)
    return result


def _rate(name: str, count: int, cases: int, limit: float | None, at_least: bool) -> dict[str, Any]:
    percent, goal, met = 100.0 * count / cases, "", None
    if limit is not None:
        goal = f"{'>=' if at_least else '<='} {limit:g} %"
        met = percent >= limit if at_least else percent <= limit
    return {
        "name": name, "goal": goal, "count": count, "cases": cases,
        "value": f"{percent:.1f} %", "ci95": [round(v, 1) for v in wilson(count, cases)], "met": met,
    }  # fmt: skip


def _coverage(rows: Iterable[Row]) -> list[dict[str, Any]]:
    """How many parameters of rightly named effects are within one and two standard errors of the truth."""
    off = np.abs([
        value for row in rows if row["outcome"] in RIGHT for value in row["deviations"].values()
    ])  # fmt: skip
    result = []
    for limit, wanted, near in COVERAGE if len(off) else ():
        within = int(np.sum(off < limit))
        one = _rate(f"parameters within {limit:g} standard errors", within, len(off), wanted, True)
        percent = 100.0 * within / len(off)
        result.append(one | {"goal": f"{wanted:g} +- {near:g} %", "met": abs(percent - wanted) <= near})
    return result


def _coverages(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """The same by machine, by kind of noise, and in open and closed loop."""
    parts: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        noise = row["conditions"].get("noise", "white")
        loop = "closed" if row["conditions"].get("closed") else "open"
        for part in (("machine", row["machine"]), ("noise", noise), ("loop", loop)):
            parts.setdefault(part, []).append(row)
    found = {part: _coverage(of) for part, of in parts.items()}
    return [
        {"by": by, "part": name, "coverage": found[by, name]} for by, name in sorted(found) if found[by, name]
    ]


def _delivered(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """What the extended simulations do on a third record."""
    result = []
    for kind, limit in REGAINED.items():
        of_kind = [row for row in rows if row["kind"] == kind]
        shares = [
            row["regained"] or 0.0
            for row in of_kind
            if row["outcome"] == "failed" or row.get("regained") is not None
        ]
        if shares:
            most = sum(share >= MOST for share in shares)
            name = f"{kind}: delivered simulations that regain {100 * MOST:g} % of what can be"
            result.append(_rate(name, most, len(shares), limit, True))
            result += _quartiles(f"{kind}: regained, median (quartiles)", [100.0 * s for s in shares], "%")
    extended = [row for row in rows if row.get("extended")]
    for key, limit, name, goal in (
        ("over_stated", MORE, "delivered: an output errs {:g} times as stated", 3.0),
        ("over_before", WORSE, "delivered: an output errs {:g} times as before", 1.0),
    ):
        beyond = sum(row[key] is None or row[key] > limit for row in extended)
        result += [_rate(name.format(limit), beyond, len(extended), goal, False)] if extended else []
    broken = sum(bool(row["broken"]) for row in extended)
    if extended:
        result.append(_rate("delivered files that do not run", broken, len(extended), 0.0, False))
    return result


def _certain(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """How far stated probabilities can be trusted."""
    answers = [row for row in rows if "stated" in row]
    if not answers:
        return []
    sure = [row for row in answers if (row["stated"] or 0.0) >= CERTAIN]
    false = sum(row["outcome"] in FALSE for row in sure)
    result = [_rate("falsely certain, of all cases", false, len(answers), None, False)]
    plain = [row for row in answers if row["kind"] in REGAINED and min(row["shown"], default=0.0) >= SEEN]
    right = sum(row in sure and row["outcome"] in SAID for row in plain)
    if plain:
        result.append(
            _rate(f"certain and right, of faults with {SEEN:g} nats", right, len(plain), None, True)
        )
    scores = [
        math.log(p if row["outcome"] not in FALSE else 1.0 - p)
        for row in answers
        if row["stated"] is not None
        for p in [min(max(row["stated"], 1.0 - SUREST), SUREST)]
    ]
    return result + _quartiles("log score of stated answers, mean (quartiles)", scores, "nats", np.mean)


def _reliability(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Of answers in bins of the stated probability, how many are not false."""
    result, stated = [], [row for row in rows if row.get("stated") is not None]
    for low, high in itertools.pairwise(BINS):
        own = [r for r in stated if low <= r["stated"] and (r["stated"] < high or high == 1.0)]
        if own:
            right = sum(row["outcome"] not in FALSE for row in own)
            rate = _rate(f"{low:g} to {high:g}", right, len(own), None, True)
            result.append(rate | {"stated": round(float(np.mean([row["stated"] for row in own])), 4)})
    return result


def _quartiles(
    name: str, values: Sequence[float], unit: str, middle: Callable[[Sequence[float]], Any] = np.median
) -> list[dict[str, Any]]:
    """A row that is no rate, if there are values: the median, or another middle, with quartiles."""
    if not values:
        return []
    return [{
        "name": name, "goal": "", "count": None, "cases": len(values),
        "value": f"{float(middle(values)):.3g} {unit}".strip(),
        "ci95": [round(float(q), 3) for q in np.quantile(values, [0.25, 0.75])], "met": None,
    }]  # fmt: skip


def _seconds_goal(rows: Sequence[Row]) -> list[dict[str, Any]]:
    seconds = [row["seconds"] for row in rows if row["kind"] not in ("growing", "log")]
    if not seconds:
        return []
    low, middle, high = (float(q) for q in np.quantile(seconds, [0.05, 0.5, 0.95]))
    return [{
        "name": "processor time a case, median (5 to 95 %) [s]", "goal": f"<= {SECONDS:g} s", "count": None,
        "cases": len(seconds), "value": f"{middle:.1f} s", "ci95": [round(low, 1), round(high, 1)],
        "met": middle <= SECONDS,
    }]  # fmt: skip


def _worse(rows: Iterable[Row]) -> tuple[int, int] | None:
    """Of records of growing length: how many answers are worse than one to a shorter beginning."""
    groups: dict[tuple[str, int], list[tuple[float, int]]] = {}
    for row in rows:
        if row["kind"] == "growing":
            of = groups.setdefault((row["machine"], row["seed"]), [])
            of.append((row["conditions"]["cut"], _rank(row)))
    count = cases = 0
    for found in groups.values():
        best = -1
        for _, rank in sorted(found):
            count += rank < best
            cases += best >= 0
            best = max(best, rank)
    return (count, cases) if cases else None


def _rank(row: Row) -> int:
    """How good an answer is; a near name in a set says as much as any other one in a set."""
    in_a_set = row["outcome"] == "near name" and any(len(cause) > 1 for cause in row["named"])
    return RANKS["in a set" if in_a_set else row["outcome"]]


def summary(rows: Sequence[Row]) -> dict[str, Any]:
    """The whole result as plain data: what ``exam.json`` holds."""
    machines = list(dict.fromkeys(row["machine"] for row in rows))
    parts = {"all": list(rows), **{name: [r for r in rows if r["machine"] == name] for name in machines}}
    return {
        "schema": 4,
        "set": "+".join(sorted({row["set"] for row in rows})),
        "cases": len(rows),
        "goals": {name: goals(part) for name, part in parts.items()},
        "coverage": _coverages(rows),
        "reliability": _reliability(rows),
        "outcomes": {name: _outcomes(part) for name, part in parts.items()},
        "hidden": _by_hidden(rows),
        "confusions": _confusions(rows),
        "out_of_reach": sorted({r["summary"] for r in rows if r["outcome"] == "out of reach"}),
        "not_held": [
            f"{row['hidden'][0]}: {'; '.join(row['missed'])}" for row in rows if row["outcome"] == "not held"
        ],
        "skipped": sorted({r["summary"] for r in rows if r["outcome"] == "skipped"}),
        "failed": sorted(r["summary"] for r in rows if r["outcome"] == "failed"),
    }


def _outcomes(rows: Iterable[Row]) -> dict[str, dict[str, int]]:
    result: dict[str, Counter[str]] = {}
    for row in rows:
        result.setdefault(row["kind"], Counter())[row["outcome"]] += 1
    return {name: dict(counts.most_common()) for name, counts in result.items()}


def _by_hidden(rows: Iterable[Row]) -> list[dict[str, Any]]:
    """Outcomes of singles and of faults that are not listed, one by one."""
    result: dict[tuple[str, str, str], Counter[str]] = {}
    for row in rows:
        if row["kind"] in ("single", "unlisted", "log"):
            result.setdefault((row["kind"], row["machine"], row["hidden"][0]), Counter())[row["outcome"]] += 1
    return [
        {"kind": kind, "machine": machine, "hidden": hidden, "outcomes": dict(counts)}
        for (kind, machine, hidden), counts in sorted(result.items())
    ]


def _confusions(rows: Iterable[Row]) -> list[dict[str, Any]]:
    """What is named instead of, or beside, what is hidden; the commonest first."""
    seen: dict[tuple[str, str, str], list[str]] = {}
    for row in rows:
        if row["outcome"] in (*WRONG, "misnamed", "false name"):
            names = " + ".join(" or ".join(one) for one in row["named"])
            hidden = " + ".join(row["hidden"]) or f"nothing {json.dumps(row['conditions'])}"
            seen.setdefault((row["machine"], hidden, names), []).append(row["key"])
    order = sorted(seen.items(), key=lambda item: (-len(item[1]), item[0]))
    return [{"machine": m, "hidden": h, "named": n, "cases": keys} for (m, h, n), keys in order]


Table = tuple[str, list[str], list[list[str]]]


def tables(found: Mapping[str, Any], single_cases: bool = True) -> list[Table]:
    """Tables of a summary: title, header, rows.

    Args:
        found: The summary.
        single_cases: Whether to say what was taken for what, and what became of each effect and fault.
    """
    goals, machines = found["goals"]["all"], [name for name in found["goals"] if name != "all"]
    of = {name: {g["name"]: _with_interval(g) for g in found["goals"][name]} for name in machines}
    made: list[Table] = [
        (
            "All machines", ["what", "counted", "value", "95 % interval", "goal", ""],
            [[
                g["name"], _counted(g), g["value"], f"{g['ci95'][0]:.1f} to {g['ci95'][1]:.1f}",
                g["goal"], {None: "", True: "met", False: "missed"}[g["met"]],
            ] for g in goals],
        ),
        (
            "By machine", ["what", *machines],
            [[g["name"], *(of[m].get(g["name"], "-") for m in machines)] for g in goals],
        ),
        (
            "Stated standard errors", ["by", "", *(f"within {limit:g}" for limit, _, _ in COVERAGE)],
            [[one["by"], one["part"], *map(_with_interval, one["coverage"])] for one in found["coverage"]],
        ),
        (
            "Stated probabilities", ["stated", "on average", "not false"],
            [[one["name"], f"{one['stated']:.4g}", _with_interval(one)] for one in found["reliability"]],
        ),
        (
            "Outcomes", ["machine", "hidden", "cases", "outcomes"],
            [[machine, kind, str(sum(counts.values())), _listed(counts)]
             for machine, kinds in found["outcomes"].items() for kind, counts in kinds.items()],
        ),
        (
            "What is taken for what", ["machine", "hidden", "named", "times"],
            [[c["machine"], c["hidden"], c["named"], str(len(c["cases"]))] for c in found["confusions"]],
        ),
        (
            "One by one", ["kind", "machine", "hidden", "outcomes"],
            [[h["kind"], h["machine"], h["hidden"], _listed(h["outcomes"])] for h in found["hidden"]],
        ),
    ]  # fmt: skip
    return made if single_cases else made[:-2]


def _counted(goal: Mapping[str, Any]) -> str:
    count, cases = goal["count"], goal["cases"]
    return f"{goal['value']} of {cases}" if count is None else f"{count}/{cases}"


def _with_interval(goal: Mapping[str, Any]) -> str:
    low, high = goal["ci95"]
    return f"{_counted(goal)} ({low:.3g} to {high:.3g})"


def _listed(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{n} {outcome}" for outcome, n in counts.items())


def notes_of(found: Mapping[str, Any]) -> list[str]:
    """What the tables leave unsaid."""
    notes = [f"{found['cases']} cases of the set {found['set']}."]
    notes += [f"Out of reach: {one}." for one in found["out_of_reach"]]
    notes += [f"Skipped: {one}." for one in found["skipped"]]
    notes += [f"Not held on {one}." for one in found["not_held"]]
    return notes + [f"Ended in an error: {one}." for one in found["failed"]]


def markdown(found: Mapping[str, Any]) -> str:
    """The rates as Markdown, without single cases."""
    notes = "\n".join(f"- {note}" for note in notes_of(found))
    return f"{notes}\n\n{of_tables(tables(found, single_cases=False))}"


def of_tables(made: Sequence[Table]) -> str:
    """Tables as Markdown."""
    parts = []
    for title, header, rows in made:
        lines = [f"**{title}**", "", _line(header), _line(["---"] * len(header))]
        parts.append("\n".join(lines + [_line(row) for row in rows]))
    return "\n\n".join(parts) + "\n"


def put(result: str, page_path: Path, what: str = "result of the exam") -> None:
    """Put a result into a page, in place of the one that stands there.

    Args:
        result: As Markdown.
        page_path: A page of Markdown with two lines, ``<!-- WHAT: begin -->`` and ``<!-- WHAT: end -->``.
        what: What it is, as the lines say.

    Raises:
        ModelError: If the page has no such lines.
    """
    whole = page_path.read_text(encoding="utf-8")
    first, last = (f"<!-- {what}: {edge} -->" for edge in ("begin", "end"))
    before, begin, rest = whole.partition(first)
    _, end, after = rest.partition(last)
    if not (begin and end):
        raise ModelError(f"{page_path}: no place for the result: it needs the lines {first!r} and {last!r}")
    write_text(page_path, f"{before}{begin}\n{result}{end}{after}")


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", " or ") for cell in cells) + " |"


def report(found: Mapping[str, Any]) -> str:
    """The result as a page of HTML."""
    notes = "".join(f"<p>{text(note)}</p>" for note in notes_of(found))
    body = [f"<h2>{title}</h2>{table(header, rows)}" for title, header, rows in tables(found)]
    return page("Exam of the diagnosis", notes + "".join(body))


def write(rows: Sequence[Row], out: Path) -> dict[str, Path]:
    """Write ``exam.json``, ``exam.md`` and ``report.html``; returns where each is."""
    found = summary(rows)
    texts = {
        "exam.json": json.dumps(found, indent=1, allow_nan=False) + "\n",
        "exam.md": markdown(found),
        "report.html": report(found),
    }
    for name, written in texts.items():
        write_text(out / name, written)
    return {name: out / name for name in texts}
