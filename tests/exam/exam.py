"""The exam on all three sets, by the diagnosis or by a rival.

    python tests/exam/exam.py develop|report|field|field-report [--by diagnosis|evidence|forward|sindy]
        [--cases N] [--kind KIND ...] [--fresh NUMBER] [--workers 2] [--out FOLDER] [--publish PAGE]

A line a finished case in ``cases.jsonl``: an interrupted run goes on. ``field`` is the part of the field set
to develop on, ``field-report`` the one to report on.
"""

from __future__ import annotations

import argparse
import math
import re
import statistics
import sys
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))  # this file has the name of its package

from exam import rivals, run, table
from exam.answers import ask
from exam.benches import bench_names
from exam.cases import cases_of, examined
from exam.field import judge
from exam.field.cases import FieldCase, field_cases
from exam.field.kinds import LATER
from exam.field.plants import PLANTS
from exam.run import Row
from exam.scoring import FALSE, SAID
from fieldagents.progress import progress
from fieldmodels.diagnosis.options import DiagnosisOptions
from fieldmodels.engine import Engine

EVIDENCE = DiagnosisOptions(engine="evidence")
BY = {
    "diagnosis": ask,
    "evidence": partial(ask, options=EVIDENCE),
    "forward": rivals.forward,
    "sindy": rivals.sindy,
}
FIELD = {"field": "develop", "field-report": "report"}
MARK = "{} by {}"
PUBLISHED = ("All machines", "Stated probabilities")
NOT_PUBLISHED = re.compile("regained, median|silent at twice|smallest curve stated|log score")
"""Rates that are left out of the docs."""


def run_set(
    which: str, by: str, count: int | None, kinds: Sequence[str], fresh: int, out: Path, engine: Engine
) -> list[Row]:
    """Run a set, or a sample of it, or what is left of that."""
    with progress() as report:
        if which in FIELD:
            askable = machines_of(by, PLANTS)
            cases = [c for c in field_cases(FIELD[which], kinds, fresh) if c.machine in askable]
            return judge.run_cases(sample(cases, count), out, engine, report, BY[by])
        machines = machines_of(by, examined() if by == "diagnosis" else bench_names())
        chosen = cases_of(which, machines, kinds, count, fresh)
        if by == "sindy":
            chosen = [c for c in chosen if "velocity" not in c.conditions.without and c.kind != "log"]
        return run.run_cases(chosen, out, engine=engine, progress=report, by=BY[by])


def machines_of(by: str, machines: Iterable[str]) -> list[str]:
    """Those of some machines of which somebody can be asked."""
    return [name for name in machines if by != "sindy" or name in rivals.CAN_BE_ASKED]


def sample(cases: Sequence[FieldCase], count: int | None) -> Sequence[FieldCase]:
    """Every so many, so that all kinds are among them."""
    return cases if count is None else [cases[i * len(cases) // count] for i in range(min(count, len(cases)))]


def by_kind(rows: Sequence[Row]) -> str:
    """A table of the field set: how many are right, false, silent; of each kind not all right, and of all."""
    kinds: dict[str, list[Row]] = {}
    for row in rows:
        kinds.setdefault(row["hidden"][0], []).append(row)
    lines = ["| kind | right | false | silent | falsely certain |", "|---|---|---|---|---|"]
    counted = [row for name, own in kinds.items() if name not in LATER for row in own]
    right = {name for name, own in kinds.items() if name not in LATER and all(map(_is_right, own))}
    parts = [
        *((name, own) for name, own in sorted(kinds.items()) if name not in right),
        (f"the {len(right)} other kinds", [row for row in rows if row["hidden"][0] in right]),
        *(
            (f"**all, {size}**", [r for r in counted if r["size"] == size])
            for size in ("usual", "large", "none")
        ),
    ]
    for name, own in [*parts, ("**all that count**", counted)]:
        if own:
            later = " (counts later)" if name in LATER else ""
            lines.append(f"| {name}{later} | {' | '.join(_rates(own))} |")
    return "\n".join(lines) + "\n"


def published(rows: Sequence[Row]) -> str:
    """What stands in the docs of a set: its kinds if it is of the field, rates, stated probabilities."""
    found = table.summary(rows)
    wanted = [
        (title, header, [row for row in cells if not NOT_PUBLISHED.search(row[0])])
        for title, header, cells in table.tables(found, single_cases=False)
        if title in PUBLISHED
    ]
    of_field = [by_kind(rows)] if rows[0]["set"].startswith("field") else []
    return "\n".join([*of_field, table.of_tables(wanted)])


def _is_right(row: Row) -> bool:
    return row["outcome"] in (*SAID, "consistent")


def _rates(rows: Sequence[Row]) -> list[str]:
    right = sum(map(_is_right, rows))
    false = [row for row in rows if row["outcome"] in FALSE]
    certain = sum((row.get("stated") or 0.0) >= table.CERTAIN for row in false)
    silent = sum(row["outcome"] == "silent" for row in rows)
    return [_rate(right, len(rows)), *(str(n) for n in (len(false), silent, certain))]


COLUMNS = ("right", "false", "falsely certain", "regain 80 % of what can be", "worse than before")


def versus(answers: Mapping[str, Sequence[Row]]) -> str:
    """A table of what several make of the same cases, a line for each of them."""
    lines = [f"| by | {' | '.join(COLUMNS)} | processor s |", "|---" * (len(COLUMNS) + 2) + "|"]
    for by, rows in answers.items():
        counted = [r for r in rows if r["outcome"] not in table.NOT_COUNTED and not {*r["hidden"]} & {*LATER}]
        false = [r for r in counted if r["outcome"] in FALSE]
        known = (r for r in counted if r["outcome"] == "failed" or r.get("regained") is not None)
        sought = [r for r in known if r["kind"] != "nothing"]
        extended = [r for r in counted if r.get("extended")]
        cells = [
            _rate(sum(map(_is_right, counted)), len(counted)),
            _rate(len(false), len(counted)),
            _rate(sum((r.get("stated") or 0.0) >= table.CERTAIN for r in false), len(counted)),
            _rate(sum((r["regained"] or 0.0) >= table.MOST for r in sought), len(sought)),
            _rate(sum((r["over_before"] or math.inf) > table.WORSE for r in extended), len(extended)),
            f"{statistics.median(r['seconds'] for r in counted):.1f}",
        ]
        lines.append(f"| {by} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _rate(count: int, cases: int) -> str:
    low, high = table.wilson(count, cases)
    return f"{count}/{cases} ({low:.0f} to {high:.0f} %)"


def main() -> None:
    """Run a set and write its tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("set", choices=["develop", "report", *FIELD])
    parser.add_argument("--by", choices=list(BY), default="diagnosis")
    parser.add_argument("--cases", type=int)
    parser.add_argument("--kind", action="append", default=[])
    parser.add_argument("--fresh", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--publish", type=Path)
    given = parser.parse_args()
    name = (
        f"exam-{given.set}"
        + (f"-{given.fresh}" if given.fresh else "")
        + ("" if given.by == "diagnosis" else f"-{given.by}")
    )
    out = given.out or Path("results") / name
    rows = run_set(
        given.set, given.by, given.cases, given.kind, given.fresh, out, Engine(workers=given.workers)
    )
    table.write(rows, out)
    text = published(rows)
    if given.by != "diagnosis":  # beside what the diagnosis has made of the same cases
        keys, log = {row["key"] for row in rows}, Path("results") / f"exam-{given.set}" / "cases.jsonl"
        own = {row["key"]: row for row in run.read_rows(log) if row["key"] in keys}
        same = [r for r in rows if r["key"] in own]
        text = versus({"diagnosis": [*own.values()], given.by: same} if own else {given.by: rows})
    print(text)
    if given.publish:
        table.put(text, given.publish, MARK.format(given.set, given.by))


if __name__ == "__main__":
    main()
