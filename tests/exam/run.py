"""Running cases in parallel, one line a finished case, so that a run can be interrupted."""

from __future__ import annotations

import hashlib
import inspect
import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from copy import copy
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import fieldmodels
from exam import scoring
from exam.answers import Answer, ask
from exam.benches import TEST, THIRD, Bench, Hidden, get_bench
from exam.cases import Case
from exam.delivery import Delivery
from exam.logs import STATEMENTS, NoDataError, failures
from exam.plants.noise import WANDERING
from exam.sizes import LEAST_SHOWN, errors, find_size, shown, with_third
from fieldmodels.arrays import FloatArray
from fieldmodels.code import files_reached
from fieldmodels.engine import HERE, Engine, Job, run_jobs
from fieldmodels.files import write_text
from fieldmodels.limits import TooLongError, processor_limit
from fieldmodels.model import Model
from fieldmodels.registry import get_model

Row = dict[str, Any]
Progress = Callable[[str, float], None]
Ask = Callable[..., Answer]
"""Takes what ``answers.ask`` takes."""
LIMIT = 180.0
"""Processor time after which a diagnosis counts as failed [s]."""
LEAST_REGAINED = -10.0
"""What a simulation that runs away counts as having regained."""
DATA = ("cases.py", "sizes.py", "plants", "benches")
"""Of what the data of a case depend on."""


def run_cases(
    cases: Sequence[Case],
    out: Path,
    *,
    engine: Engine = HERE,
    progress: Progress | None = None,
    by: Ask = ask,
) -> list[Row]:
    """Run the cases, or what is left of them.

    ``sizes.jsonl`` keeps how large each fault is, ``cases.jsonl`` one line a finished case. Both are kept
    with a hash of the code that they depend on; a case whose code has changed is done again.

    Args:
        cases: The cases.
        out: Folder of the results; earlier ones in it are used.
        engine: Who does them.
        progress: Called with what is being done and the share done.
        by: Who answers: the diagnosis, or a rival of it.

    Returns:
        One row a case, in the order of ``cases``.
    """
    out.mkdir(parents=True, exist_ok=True)
    log, kept = out / "cases.jsonl", out / "sizes.jsonl"
    done = {row["key"]: row for row in current_rows(log, answer_code(by))}
    made = {row["key"]: row for row in current_rows(kept, data_code())}
    left = [case for case in cases if case.key not in done]
    with log.open("a", encoding="utf-8") as lines, kept.open("a", encoding="utf-8") as to:
        jobs = {
            Job(
                case.key,
                f"{case.machine}: {case.kind}",
                run_case,
                (case, made.get(case.key), out / "records", by),
            ): case
            for case in left
        }
        for one in run_jobs(list(jobs), engine, progress or (lambda _what, _share: None)):
            case = jobs[one.job]
            row = case.to_json() | failed(case.key, one.error) if one.error else one.result
            if case.key not in made and all(name in row for name in MADE):
                fresh = {name: row[name] for name in ("key", *MADE)}
                write_row(to, fresh | {"code": data_code()})
            done[case.key] = row | {"code": answer_code(by)}
            if not one.error:  # of the disk, or of a process that was killed: it is done again
                write_row(lines, done[case.key])
    return [done[case.key] for case in cases]


MADE = ("sizes", "percents", "shown", "attainable")
"""What a row keeps of how a case was made."""


def run_case(
    case: Case, made: Mapping[str, Any] | None = None, kept: Path | None = None, by: Ask = ask
) -> Row:
    """Hide what a case says, diagnose, and judge.

    Args:
        case: The case.
        made: Sizes, percentages and attainable gain, as found before.
        kept: Folder in which records are kept, by a hash of all that they depend on; None to keep none.
        by: Who answers.

    Returns:
        The case with what was hidden and the outcome, beside those of ``scoring``: ``out of reach`` if no
        size adds the percentage or the record to fit does not show it, ``failed`` if the case ended in an
        error or took too long.

    Raises:
        OSError: If its record cannot be read or written.
    """
    row: Row = case.to_json() | {"key": case.key}
    try:
        if case.kind == "log":
            return row | _of_log(get_model(case.machine), case, by)
        bench = get_bench(case.machine)
        row |= {name: made[name] for name in MADE} if made is not None else make(bench, case)
        with nullcontext(kept) if kept else TemporaryDirectory() as folder:
            return row | _examined(bench, case, row, Path(folder), by)
    except OSError:
        raise
    except Exception as error:  # of a plant: the others go on
        return row | failed(case.key, f"{type(error).__name__}: {error}")


def _examined(bench: Bench, case: Case, row: Row, kept: Path, by: Ask) -> Row:
    """What becomes of a case whose sizes are known."""
    if None in row["sizes"] or min(row["shown"], default=LEAST_SHOWN) < LEAST_SHOWN:
        return {"outcome": "out of reach", "seconds": 0.0, "summary": _out_of_reach(case, row)}
    hidden = _hidden(case, row["sizes"])
    known = bool(bench.needs_base & set(case.hidden))
    fixed = bench.scaled(bench.base(case.seed), "", case.conditions) if known else {}
    data = hashlib.sha256(f"{data_code()} {case.key} {row['sizes']}".encode()).hexdigest()[:24]
    train, test, third = with_third(bench, hidden, case.conditions, case.seed, kept / f"{data}.npz")
    answer = answered(case.key, by, bench.model, [train], [test], fixed, [third])
    return answer if isinstance(answer, dict) else judged(bench, case, hidden, row["attainable"], answer)


def answered(key: str, by: Ask, *given: Any) -> Answer | Row:
    """An answer; or why there is none: a fault of the diagnosis is a case that it did not get right.

    Args:
        key: Name of the case.
        by: Who answers.
        given: What is asked; see ``answers.ask``.
    """
    try:
        with processor_limit(LIMIT):
            return by(*given)
    except Exception as error:
        seconds = LIMIT if isinstance(error, TooLongError) else 0.0
        return failed(key, f"{type(error).__name__}: {error}", seconds)


def failed(key: str, why: str, seconds: float = 0.0) -> Row:
    """A case to which there is no answer."""
    return {
        "key": key, "outcome": "failed", "verdict": "failed", "named": [], "deviations": {},
        "regained": None, "seconds": seconds, "summary": f"{key}: {why}",
    }  # fmt: skip


def _of_log(model: Model, case: Case, by: Ask) -> Row:
    """What becomes of a statement on a real log."""
    statement = STATEMENTS[case.hidden[0]]
    row: Row = {"sizes": [], "percents": [], "attainable": None, "deviations": {}, "regained": None}
    try:
        pair = statement.records(model)
    except NoDataError as error:
        return row | {"outcome": "skipped", "named": [], "seconds": 0.0, "summary": str(error)}
    answer = answered(case.key, by, model, *pair, {})
    if isinstance(answer, dict):
        return row | answer
    missed = failures(statement, answer)
    return row | {
        "outcome": "not held" if missed else "held",
        "verdict": answer.verdict,
        "named": [list(cause) for cause in answer.named],
        "missed": missed,
        "seconds": round(answer.seconds, 3),
        "summary": answer.summary,
    }


def make(bench: Bench, case: Case) -> Row:
    """Find sizes of what a case hides, and what a diagnosis could gain by it.

    Returns:
        ``sizes`` and ``percents`` of what is hidden; ``shown``: evidence for each in the record to fit
        [nats]; ``attainable``: the output to whose error it adds most, the share of that error which an
        extension could remove on the second record, and on the third.
    """
    reference = case.conditions
    if reference.cut:  # one fault in records of growing length
        reference = replace(reference, cut=0.5 * reference.duration)
    found = [
        find_size(bench, name, sign, percent, reference, case.seed) for name, percent, sign in case.drawn()
    ]
    sizes = [one.size for one in found if one.size is not None]
    row: Row = {
        "sizes": [one.size for one in found],
        "percents": [round(one.percent, 2) for one in found],
        "shown": [],
        "attainable": None,
    }
    if found and len(sizes) == len(found):
        if not case.conditions.cut:  # the beginning of a growing record may not show its fault yet
            row["shown"] = shown(bench, _hidden(case, sizes), case.conditions, case.seed)
        row["attainable"] = _attainable(bench, case, _hidden(case, sizes))
        if row["attainable"] is None:
            return row | {"sizes": [None] * len(sizes)}
    return row


def judged(
    bench: Bench, case: Case, hidden: Sequence[Hidden], attainable: Mapping[str, Any] | None, answer: Answer
) -> Row:
    """All that the table needs of an answer, as plain data."""
    truth: dict[str, dict[str, float]] = {}
    fault = bench.fault(case.hidden[-1]) if case.hidden else None
    regained = None
    if answer.wandering and case.conditions.noise not in WANDERING:
        answer = replace(answer, missing=True)
    if not case.hidden:
        rounding = [e.name for e in bench.model.effects if e.name.endswith("quantisation")]
        allowed = rounding if case.conditions.noise == "quantised" else ()
        outcome = scoring.of_nothing(answer, allowed)
    elif fault is None:
        truth = {
            one.name: bench.scaled(
                bench.values(one.name, one.size, one.sign, case.seed), one.name, case.conditions
            )
            for one in hidden
        }
        outcome = scoring.of_listed(answer, case.hidden)
    elif case.kind == "mixed":
        outcome = scoring.of_mixed(answer, case.hidden[0], fault.near, fault.shows)
    else:
        outcome = scoring.of_unlisted(answer, fault.near, fault.shows)
    delivery = answer.delivery
    if case.hidden and delivery is not None and not (fault and fault.random):
        regained = regained_of(attainable, delivery)
    unseen = _on_windows(bench, case, hidden, attainable, answer) if outcome == "silent" else None
    return {
        "outcome": outcome,
        "verdict": answer.verdict,
        "named": [list(cause) for cause in answer.named],
        "missing": answer.missing,
        "deviations": scoring.deviations(truth, answer),
        "values": truth,
        "regained": regained,
        "stated": answer.stated,
        **({} if delivery is None else scoring.of_delivery(delivery)),
        "power": scoring.power(answer, unseen["output"]) if unseen else None,
        "silence": scoring.of_silence(answer, unseen),
        "silence_of_anything": scoring.of_silence(answer, unseen, True),
        "seconds": round(answer.seconds, 3),
        "summary": answer.summary,
    }


def _on_windows(
    bench: Bench, case: Case, hidden: Sequence[Hidden], attainable: Mapping[str, Any] | None, answer: Answer
) -> Mapping[str, Any] | None:
    """What a fault adds on windows as long as those on which the answer's errors are measured.

    At another pace than the usual one those of the exam are longer or shorter by it.
    """
    if attainable is None or case.conditions.pace == 1.0 or not bench.horizon:
        return attainable
    same = copy(bench)
    same.horizon = answer.windows[attainable["output"]] * case.conditions.pace
    return _attainable(same, case, hidden, attainable["output"])


def _attainable(bench: Bench, case: Case, hidden: Sequence[Hidden], name: str = "") -> dict[str, Any] | None:
    """The output that suffers most, or a given one, and the share of its error that is what is hidden's."""
    known = bool(bench.needs_base & set(case.hidden))

    def ratios(record: int) -> FloatArray:
        """Errors with what is hidden over those without it."""
        with_them, without = (
            errors(bench, what, case.conditions, case.seed, known, record) for what in (hidden, ())
        )
        return with_them / without

    second, third = ratios(TEST), ratios(THIRD)
    if not np.isfinite(np.nanmax(second)):
        return None
    names = [output.name for output in bench.model.outputs]
    output = names.index(name) if name else int(np.nanargmax(second))
    shares = {"share": second, "third": third}
    return {"output": names[output]} | {k: round(1.0 - 1.0 / float(r[output]), 5) for k, r in shares.items()}


def regained_of(attainable: Mapping[str, Any] | None, delivery: Delivery) -> float | None:
    """Share of what can be gained on the output that suffers most that the extended simulation gains."""
    if attainable is None or attainable["third"] <= 0.0 or attainable["output"] not in delivery.before:
        return None
    before, after = (errors[attainable["output"]] for errors in (delivery.before, delivery.after))
    if not before > 0.0:
        return None
    return round(max((1.0 - after / before) / float(attainable["third"]), LEAST_REGAINED), 4)


def _hidden(case: Case, sizes: Sequence[float]) -> list[Hidden]:
    return [Hidden(name, size, sign) for (name, _, sign), size in zip(case.drawn(), sizes, strict=True)]


def _out_of_reach(case: Case, row: Row) -> str:
    if None not in row["sizes"]:
        shows = dict(zip(case.hidden, row["shown"], strict=True))
        not_shown = " and ".join(name for name, evidence in shows.items() if evidence < LEAST_SHOWN)
        beside = " and ".join(name for name, evidence in shows.items() if evidence >= LEAST_SHOWN)
        return f"{case.machine}: the record to fit does not show {not_shown}{beside and f' beside {beside}'}"
    seen = " and ".join(
        f"{name} {percent:.1f} %" for name, percent in zip(case.hidden, row["percents"], strict=True)
    )
    return f"{case.machine}: no size adds as much; at most: {seen}"


def write_row(lines: Any, row: Row) -> None:
    """Add a line to an open log."""
    lines.write(json.dumps(row, allow_nan=False) + "\n")
    lines.flush()


def current_rows(log: Path, code: str) -> list[Row]:
    """Rows of a log that its code still gives; the others are dropped from it."""
    rows = [row for row in read_rows(log) if row["code"] == code]
    write_text(log, "".join(json.dumps(row, allow_nan=False) + "\n" for row in rows))  # whole lines only
    return rows


def read_rows(log: Path) -> list[Row]:
    """Rows of a log; a last line that was cut off by an interruption is left out."""
    rows: list[Row] = []
    if not log.exists():
        return rows
    for line in log.read_text(encoding="utf-8").splitlines():
        try:
            rows.append(json.loads(line))
        except json.JSONDecodeError:
            continue
    return rows


@cache
def data_code() -> str:
    """Hash of the code on which the data of cases depend."""
    here = Path(__file__).parent
    paths = [here / name for name in DATA]
    return hash_of([file for path in paths for file in ([path] if path.is_file() else path.rglob("*.py"))])


@cache
def answer_code(by: Ask = ask) -> str:
    """Hash of the code on which outcomes depend: the models, the benches, and who answers."""
    own = inspect.getfile(by.func if isinstance(by, partial) else by)
    models = (file for file in Path(fieldmodels.__file__).parent.rglob("*") if file.suffix == ".py")
    return hash_of([*{Path(own), *models, *files_reached((__name__, get_bench.__module__))}])


def hash_of(files: Sequence[Path]) -> str:
    """A hash of what some files hold."""
    digest = hashlib.sha256()
    for file in sorted(files):
        digest.update(file.name.encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()[:12]
