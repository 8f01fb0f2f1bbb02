"""What becomes of a case of the field set: asked, judged by ``answers.yaml``, and written down."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from exam import scoring
from exam.answers import CURVE, Answer, ask
from exam.places import read
from exam.run import (
    Ask,
    Progress,
    Row,
    answer_code,
    answered,
    current_rows,
    failed,
    hash_of,
    regained_of,
    write_row,
)
from fieldmodels.engine import Engine, Job, run_jobs

from .answers import Right, right
from .cases import FieldCase, make


def run_cases(
    cases: Sequence[FieldCase], out: Path, engine: Engine, progress: Progress, by: Ask = ask
) -> list[Row]:
    """Run the cases, or what is left of them; see ``exam.run.run_cases``."""
    out.mkdir(parents=True, exist_ok=True)
    log, code = out / "cases.jsonl", f"{answer_code(by)} {hash_of([*Path(__file__).parent.glob('*.*')])}"
    done = {row["key"]: row for row in current_rows(log, code)}
    jobs = {Job(c.key, c.key, run_case, (c, by)): c for c in cases if c.key not in done}
    with log.open("a", encoding="utf-8") as lines:
        for one in run_jobs(list(jobs), engine, progress):
            case = jobs[one.job]
            row = _named(case) | failed(case.key, one.error) if one.error else one.result
            done[case.key] = row | {"code": code}
            write_row(lines, done[case.key])
    return [done[case.key] for case in cases]


def run_case(case: FieldCase, by: Ask = ask) -> Row:
    """Record a case, ask, and judge."""
    try:
        made = make(case)
    except Exception as error:  # of a plant: the others go on
        return _named(case) | failed(case.key, f"{type(error).__name__}: {error}")
    given = _named(case) | {"shown": [round(made.nats, 3)]}
    answer = answered(case.key, by, made.model, made.train, made.test, made.fixed, made.third)
    wanted = right(case)
    if isinstance(answer, dict):
        refused = wanted.refusal and wanted.refusal in answer["summary"]
        return given | answer | ({"outcome": "refused"} if refused else {})
    return given | judged(case, wanted, made.possible, answer)


def judged(case: FieldCase, wanted: Right, possible: Mapping[str, float], answer: Answer) -> Row:
    """All that the table needs of an answer."""
    regained, delivery = None, answer.delivery
    if case.size != "none" and delivery is not None and not wanted.unexplained:
        name = max(delivery.before, key=lambda n: delivery.before[n] / possible[n])
        attainable = {"output": name, "third": 1.0 - possible[name] / delivery.before[name]}
        regained = regained_of(attainable, delivery)
    return {
        "outcome": outcome_of(case, wanted, answer),
        "verdict": answer.verdict,
        "named": [list(cause) for cause in answer.named],
        "missing": answer.missing,
        "curves": [list(curve) for curve in answer.curves],
        "deviations": {},
        "regained": regained,
        "stated": answer.stated,
        **({} if delivery is None else scoring.of_delivery(delivery)),
        "seconds": round(answer.seconds, 3),
        "summary": answer.summary,
    }


def outcome_of(case: FieldCase, wanted: Right, answer: Answer) -> scoring.Outcome:
    """The best of what an answer is by each of the acceptable ones."""
    places = [*map(_as_read, wanted.curves)]
    answer = replace(answer, curves=tuple(one for c in answer.curves for one in _in_words(c, places)))
    if answer.verdict == "unrelated":
        return "refused" if wanted.refusal else "wrong"
    if case.size == "none" and not wanted.refusal:
        return scoring.of_nothing(answer, sum(map(tuple, wanted.names), ()))
    found: list[scoring.Outcome] = [scoring.of_listed(answer, tuple(names)) for names in wanted.names]
    unlisted = scoring.of_unlisted(answer, (), places)
    if unlisted == "abstained" and wanted.unexplained:
        return "unexplained"
    if not any(set(cause) - {CURVE} for cause in answer.named) or not found:
        return unlisted  # no name: what counts is the place
    return max(found, key=lambda one: RANKS.get(one, 0))


def _in_words(curve: tuple[str, str, str], places: Sequence[str]) -> Iterator[tuple[str, str, str]]:
    """A curve as ``answers.yaml`` has it: a force adds to a state's rate, the only one if none is said."""
    place, target, over = curve
    known = target.removeprefix("force on ").removeprefix("rate of ")
    only = {t for line in map(read, places) if line.place == place for t in line.targets}
    yield from ((place, name, over) for name in ([known] if known or not only else sorted(only)))


def _as_read(line: str) -> str:
    """A line as ``places`` reads it: what an actuator does is a force over its command."""
    where, _, over = line.partition(" over ")
    return f"{'force' if where.startswith('actuator ') else where} over {over}".replace(
        "memory of ", "past of "
    )


RANKS: Mapping[str, int] = {**scoring.RANKS, "unexplained": 5, "refused": 5}


def kind_of(case: FieldCase) -> str:
    """Of which kind of the exam's tables a case is."""
    names = right(case).names
    if case.size == "none" and not right(case).refusal:
        return "nothing"
    return {0: "unlisted", 1: "single", 2: "pair"}.get(min(map(len, names), default=0), "triple")


def _named(case: FieldCase) -> dict[str, Any]:
    return {
        "key": case.key, "set": f"field {case.set}", "machine": case.machine, "kind": kind_of(case),
        "hidden": [case.kind], "size": case.size, "seed": case.seed, "conditions": {}, "shown": [],
    }  # fmt: skip
