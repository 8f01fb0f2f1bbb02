"""Sitting the exam: cases in parallel, one line a finished case, so that a run can be interrupted."""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from fieldmodels.diagnosis import diagnose
from fieldmodels.exam.cases import Case
from fieldmodels.exam.scoring import judged
from fieldmodels.exam.sizes import Curve, curve_of, size_on
from fieldmodels.exam.subjects import Outside, get_subject
from fieldmodels.files import write_text
from fieldmodels.model import Model, ModelError
from fieldmodels.recording import Recording

Row = dict[str, Any]
Progress = Callable[[str, float], None]
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
TEST = 500_000
"""Added to a case's seed for the record on which its gain is measured."""


def sit(cases: Sequence[Case], out: Path, *, workers: int = 1, progress: Progress | None = None) -> list[Row]:
    """Sit the exam, or what is left of it.

    ``sizes.json`` keeps how large each fault must be, ``cases.jsonl`` one line a finished case. Both are kept
    with a hash of the code that they depend on; a case whose code has changed is done again.

    Args:
        cases: What is asked.
        out: Folder of the results; earlier ones in it are used.
        workers: Processes, each of one thread.
        progress: Called with what is being done and the share done.

    Returns:
        One row a case, in the order of ``cases``.
    """
    tell = progress or (lambda _what, _share: None)
    out.mkdir(parents=True, exist_ok=True)
    log = out / "cases.jsonl"
    codes = {name: code_hash(name) for name in {case.model for case in cases}}
    kept = read_rows(log)
    write_text(log, "".join(json.dumps(row, allow_nan=False) + "\n" for row in kept))  # whole lines only
    done = {row["key"]: row for row in kept if row["code"] == codes.get(row["model"])}
    # Mixed, so that the rows of an interrupted exam are a sample of the whole.
    left = sorted((c for c in cases if c.key not in done), key=lambda case: crc32(case.key.encode()))
    with _pool(workers) as pool:
        curves = _curves(left, out / "sizes.json", pool, tell)
        futures = {
            pool.submit(examine, case, {f: curves[case.model, f] for f in case.hidden}): case for case in left
        }
        with log.open("a", encoding="utf-8") as lines:
            for number, future in enumerate(as_completed(futures)):
                case = futures[future]
                row = {**future.result(), "code": codes[case.model]}
                done[case.key] = row
                lines.write(json.dumps(row, allow_nan=False) + "\n")
                lines.flush()
                tell(f"{case.model}: {case.kind}", 0.1 + 0.9 * (number + 1) / len(left))
    return [done[case.key] for case in cases]


def examine(case: Case, curves: dict[str, Curve]) -> Row:
    """Hide what a case asks for, diagnose, and judge.

    Args:
        case: The case.
        curves: Curve of each hidden fault.

    Returns:
        The case with the values that were hidden and the outcome, beside those of ``scoring``: ``out of
        reach`` if no size adds the percentage, ``failed`` if the diagnosis ended in an error.
    """
    subject = get_subject(case.model)
    row: Row = case.to_json() | {"percents": [], "values": {}}
    hidden: dict[str, dict[str, float]] = {}
    outside = None
    seeds = (case.seed, case.seed + TEST)
    for name, percent, sign in case.drawn():
        size, added = size_on(subject, name, percent, seeds, sign, curves[name])
        row["percents"].append(round(added, 2))
        if size is None:
            most = f"{name} adds {added:.1f} % at most, not {percent:.1f} %"
            return row | {"outcome": "out of reach", "seconds": 0.0, "summary": most}
        if case.kind == "outside":
            outside = Outside(name, size)
            row["values"][name] = {"size": size}
        else:
            hidden[name] = subject.values(name, size, sign if subject.signed(name) else 1)
            row["values"][name] = hidden[name]
    coloured = subject.wander if case.size == "coloured" else 0.0
    try:
        train, test = (subject.record(hidden, seed, coloured=coloured, outside=outside) for seed in seeds)
    except ModelError as error:
        return row | {"outcome": "out of reach", "seconds": 0.0, "summary": str(error)}
    if not (_finite(subject.model, train) and _finite(subject.model, test)):
        fault = " and ".join(case.hidden)
        return row | {
            "outcome": "out of reach",
            "seconds": 0.0,
            "summary": f"{fault} lets the machine run away",
        }
    began = time.process_time()  # of one thread: other work on the machine does not count
    try:
        found = diagnose(subject.model, [train], [test], fixed=subject.fixed(hidden))
    except Exception as error:  # a fault of the diagnosis counts as a case that it did not get right
        what = f"{case.key}: {type(error).__name__}: {error}"
        return row | {"outcome": "failed", "seconds": time.process_time() - began, "summary": what}
    seconds = time.process_time() - began
    return row | judged(case, hidden, found) | {"seconds": round(seconds, 3)}


def _finite(model: Model, recording: Recording) -> bool:
    """Whether a record holds a number wherever one was measured (an event is none where nothing looked)."""
    signals = (*model.inputs, *(output for output in model.outputs if not output.event))
    return all(np.isfinite(recording[s.name]).all() for s in signals if s.name in recording)


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


def _curves(
    cases: Sequence[Case], path: Path, pool: ProcessPoolExecutor, tell: Progress
) -> dict[tuple[str, str], Curve]:
    """How large each fault must be: as kept, or sought now."""
    kept = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    wanted = sorted({(case.model, fault) for case in cases for fault in case.hidden})
    keys = {pair: f"{pair[0]}/{pair[1]}/{physics_hash(pair[0])}" for pair in wanted}
    futures = {pool.submit(_curve, *pair): pair for pair in wanted if keys[pair] not in kept}
    for number, future in enumerate(as_completed(futures)):
        pair = futures[future]
        kept[keys[pair]] = future.result().to_json()
        write_text(path, json.dumps(kept, indent=1) + "\n")
        tell(f"{pair[0]}: how large {pair[1]} must be", 0.1 * (number + 1) / len(futures))
    return {pair: Curve.from_json(kept[keys[pair]]) for pair in wanted}


def _curve(model: str, fault: str) -> Curve:
    return curve_of(get_subject(model), fault)


@contextmanager
def _pool(workers: int) -> Iterator[ProcessPoolExecutor]:
    """Fresh processes of one thread each; on an interruption what has not begun is dropped."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    pool = ProcessPoolExecutor(workers, mp_context=get_context("spawn"))
    try:
        yield pool
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


@cache
def physics_hash(model: str) -> str:
    """Hash of the code of a model and of its subject."""
    subject = get_subject(model)
    owners = [*type(subject.model).__mro__, *type(subject).__mro__]
    names = {owner.__module__ for owner in owners if owner.__module__.startswith("fieldmodels.")}
    files = {Path(str(import_module(name).__file__)) for name in names}
    # A model in a room of its own depends on the whole room.
    rooms = [f.parent for f in files if f.parent.name not in ("fieldmodels", "subjects")]
    files |= {f for room in rooms for f in room.glob("*.py")}
    here = Path(__file__).parent
    files |= {here.parent / "synthesis.py", here / "sizes.py"}
    return _hash(files)


@cache
def code_hash(model: str) -> str:
    """Hash of all code on which the outcome of a model's cases depends."""
    here = Path(__file__).parent
    files = {here / "cases.py", here / "scoring.py", *(here.parent / "diagnosis").glob("*.py")}
    return _hash(files) + physics_hash(model)


def _hash(files: set[Path]) -> str:
    digest = hashlib.sha256()
    for file in sorted(files):
        digest.update(file.name.encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()[:12]
