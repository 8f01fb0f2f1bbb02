"""The sets of the exam: their cases, who answers, and what the docs tell of the answers."""

from __future__ import annotations

import math
import re
import statistics
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from exam import rivals, run, table
from exam.answers import ask
from exam.cases import cases_of, examined
from exam.field import judge
from exam.field.cases import field_cases, set_of
from exam.field.kinds import KINDS, LATER
from exam.field.plants import PLANTS
from exam.run import Ask, Row
from exam.scoring import FALSE, SAID
from fieldmodels.diagnosis.options import DiagnosisOptions
from fieldmodels.model import ModelError
from fieldmodels.names import did_you_mean

BY: Mapping[str, Ask] = {
    "diagnosis": ask,
    "evidence": partial(ask, options=DiagnosisOptions(engine="evidence")),
    "forward": rivals.forward,
    "sindy": rivals.sindy,
}
FIELD = {"field": "develop", "field-report": "report"}
PUBLISHED = ("All machines", "Stated probabilities")
NOT_PUBLISHED = re.compile("regained, median|silent at twice|smallest curve stated|log score")
"""Rates that are left out of the docs."""


def chosen(
    which: str, by: str, machines: Sequence[str], kinds: Sequence[str], count: int | None, fresh: int
) -> tuple[list[str], Callable[..., list[Row]]]:
    """The machine of each case of a set, or of a sample; and what runs them: see ``run.run_cases``.

    Raises:
        ModelError: For a name that there is none of, or if there are no such cases.
    """
    names, alone = list(machines or (PLANTS if which in FIELD else examined())), ""
    if by == "sindy":
        if find_spec("pysindy") is None:
            raise ModelError("--by sindy: PySINDy is not installed: pip install pysindy")
        names = [name for name in names if name in rivals.CAN_BE_ASKED]
        alone = f"; PySINDy can be asked of {', '.join(rivals.CAN_BE_ASKED)} alone"
    cases: Sequence[Any]
    if which in FIELD:
        _check(which, names, kinds)
        cases = [case for case in field_cases(FIELD[which], kinds, fresh) if case.machine in names]
        size = len(cases) if count is None else min(count, len(cases))
        cases = [cases[i * len(cases) // size] for i in range(size)]  # of all kinds
    else:
        cases = cases_of(which, names, kinds, count, fresh)  # type: ignore[arg-type]
        if by == "sindy":
            cases = [c for c in cases if "velocity" not in c.conditions.without and c.kind != "log"]
    if not cases:
        raise ModelError(f"--set {which}: no such cases: leave out --kind or --machine{alone}")
    them: Callable[..., list[Row]] = judge.run_cases if which in FIELD else run.run_cases
    return [case.machine for case in cases], partial(them, cases, by=BY[by])


def _check(which: str, machines: Sequence[str], kinds: Sequence[str]) -> None:
    """Make sure that a part of the field set has these."""
    for name in machines:
        if name not in PLANTS:
            raise ModelError(f"--set {which}: no machine {name!r}{did_you_mean(name, PLANTS)}")
    place = {kind: part for part, name in FIELD.items() for kind in KINDS if set_of(kind) == name}
    for kind in kinds:
        if place.get(kind) != which:
            known = did_you_mean(kind, [k for k in KINDS if place[k] == which])
            there = f": it is of --set {place[kind]}" if kind in place else known
            raise ModelError(f"--set {which}: no kind of cases {kind!r}{there}")


def by_kind(rows: Sequence[Row]) -> str:
    """A table of the field set: how many are right, false, silent; of each kind not all right, and of all."""
    kinds: dict[str, list[Row]] = {}
    for row in rows:
        kinds.setdefault(row["hidden"][0], []).append(row)
    lines = ["| kind | right | false | silent | falsely certain |", "|---|---|---|---|---|"]
    counted = [row for row in rows if row["hidden"][0] not in LATER]
    right = {name for name, own in kinds.items() if name not in LATER and all(map(_is_right, own))}
    parts = {
        name + " (counts later)" * (name in LATER): own
        for name, own in sorted(kinds.items())
        if name not in right
    }
    parts[f"the {len(right)} other kinds"] = [row for row in rows if row["hidden"][0] in right]
    for size in ("usual", "large", "none"):
        parts[f"**all, {size}**"] = [row for row in counted if row["size"] == size]
    parts["**all that count**"] = counted
    lines += [f"| {name} | {' | '.join(_rates(own))} |" for name, own in parts.items() if own]
    return "\n".join(lines) + "\n"


def published(rows: Sequence[Row]) -> str:
    """What stands in the docs of a set: its kinds if it is of the field, rates, stated probabilities."""
    found = table.summary(rows)
    wanted = [
        (title, header, [row for row in cells if not NOT_PUBLISHED.search(row[0])])
        for title, header, cells in table.tables(found, single_cases=False)
        if title in PUBLISHED and cells
    ]
    of_field = [by_kind(rows)] if rows[0]["set"].startswith("field") else []
    return "\n".join([*of_field, table.of_tables(wanted)])


def _is_right(row: Row) -> bool:
    return row["outcome"] in (*SAID, "consistent", "held")


def _rates(rows: Sequence[Row]) -> list[str]:
    right = sum(map(_is_right, rows))
    false = [row for row in rows if row["outcome"] in FALSE]
    certain = sum((row.get("stated") or 0.0) >= table.CERTAIN for row in false)
    silent = sum(row["outcome"] == "silent" for row in rows)
    return [_rate(right, len(rows)), *(str(n) for n in (len(false), silent, certain))]


COLUMNS = ("right", "false", "falsely certain", "regain 80 % of what can be", "worse than before")


def beside(by: str, rows: Sequence[Row], log: Path) -> str:
    """The table of a rival, beside what the diagnosis has made of the same cases, if a log has them."""
    keys = {row["key"] for row in rows}
    own = {row["key"]: row for row in run.read_rows(log) if row["key"] in keys}
    same = [row for row in rows if row["key"] in own]
    return versus({"diagnosis": [*own.values()], by: same} if own else {by: rows})


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
            f"{statistics.median(r['seconds'] for r in counted):.1f}" if counted else "-",
        ]
        lines.append(f"| {by} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _rate(count: int, cases: int) -> str:
    low, high = table.wilson(count, cases)
    return f"{count}/{cases} ({low:.0f} to {high:.0f} %)"
