"""Running cases in parallel, one line a finished case, so that a run can be interrupted."""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from fieldmodels.diagnosis import diagnose
from fieldmodels.exam.benchmarks import Benchmark, Outside, get_benchmark
from fieldmodels.exam.cases import Case
from fieldmodels.exam.scoring import judged
from fieldmodels.exam.sizes import Curve, curve_of, size_on
from fieldmodels.files import write_text
from fieldmodels.model import EffectValues, Model, ModelError
from fieldmodels.recording import Recording

Row = dict[str, Any]
Progress = Callable[[str, float], None]
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
TEST = 500_000
"""Added to a case's seed for the record on which its gain is measured."""


def run_cases(
    cases: Sequence[Case], out: Path, *, workers: int = 1, progress: Progress | None = None
) -> list[Row]:
    """Run the cases, or what is left of them.

    ``sizes.json`` keeps how large each fault must be, ``cases.jsonl`` one line a finished case. Both are kept
    with a hash of the code that they depend on; a case whose code has changed is done again.

    Args:
        cases: The cases.
        out: Folder of the results; earlier ones in it are used.
        workers: Processes, each of one thread.
        progress: Called with what is being done and the share done.

    Returns:
        One row a case, in the order of ``cases``.
    """
    report = progress or (lambda _what, _share: None)
    out.mkdir(parents=True, exist_ok=True)
    log = out / "cases.jsonl"
    codes = {name: code_hash(name) for name in {case.model for case in cases}}
    kept = read_rows(log)
    write_text(log, "".join(json.dumps(row, allow_nan=False) + "\n" for row in kept))  # whole lines only
    done = {row["key"]: row for row in kept if row["code"] == codes.get(row["model"])}
    # Mixed, so that the rows of an interrupted exam are a sample of the whole.
    left = sorted((c for c in cases if c.key not in done), key=lambda case: crc32(case.key.encode()))
    with _pool(workers) as pool:
        curves = _curves(left, out / "sizes.json", pool, report)
        futures = {
            pool.submit(run_case, case, {f: curves[case.model, f] for f in case.hidden}): case
            for case in left
        }
        with log.open("a", encoding="utf-8") as lines:
            for number, future in enumerate(as_completed(futures)):
                case = futures[future]
                row = {**future.result(), "code": codes[case.model]}
                done[case.key] = row
                lines.write(json.dumps(row, allow_nan=False) + "\n")
                lines.flush()
                report(f"{case.model}: {case.kind}", 0.1 + 0.9 * (number + 1) / len(left))
    return [done[case.key] for case in cases]


def run_case(case: Case, curves: dict[str, Curve]) -> Row:
    """Hide what a case says, diagnose, and judge.

    Args:
        case: The case.
        curves: Curve of each hidden fault.

    Returns:
        The case with the values that were hidden and the outcome, beside those of ``scoring``: ``out of
        reach`` if no size adds the percentage, ``failed`` if the diagnosis ended in an error.
    """
    benchmark = get_benchmark(case.model)
    row: Row = case.to_json() | {"percents": [], "values": {}}
    effects: dict[str, dict[str, float]] = {}
    outside = None
    for name, percent, sign in case.drawn():
        size, added = size_on(benchmark, name, percent, (case.seed, case.seed + TEST), sign, curves[name])
        row["percents"].append(round(added, 2))
        if size is None:
            return row | _out_of_reach(f"{name} adds {added:.1f} % at most, not {percent:.1f} %")
        if case.kind == "outside":
            outside = Outside(name, size)
            row["values"][name] = {"size": size}
        else:
            effects[name] = benchmark.values(name, size, sign if benchmark.signed(name) else 1)
            row["values"][name] = effects[name]
    coloured = benchmark.coloured_share if case.size == "coloured" else 0.0
    try:
        pair = records(benchmark, effects, case.seed, coloured, outside, case.without)
    except ModelError as error:
        return row | _out_of_reach(str(error))
    began = time.process_time()  # of one thread: other work on the machine does not count
    try:
        found = diagnose(benchmark.model, pair[:1], pair[1:], fixed=benchmark.fixed(effects))
    except Exception as error:  # a fault of the diagnosis counts as a case that it did not get right
        what = f"{case.key}: {type(error).__name__}: {error}"
        return row | {"outcome": "failed", "seconds": time.process_time() - began, "summary": what}
    seconds = time.process_time() - began
    return row | judged(case, effects, found) | {"seconds": round(seconds, 3)}


def records(
    benchmark: Benchmark,
    effects: EffectValues,
    seed: int,
    coloured: float = 0.0,
    outside: Outside | None = None,
    without: Iterable[str] = (),
) -> list[Recording]:
    """A record to fit and one to measure the gain on.

    Args:
        benchmark: The machine.
        effects: Effects of its model that are hidden.
        seed: Of the first record.
        coloured: Share of the noise's variance that wanders slowly.
        outside: A fault that its model does not list.
        without: Signals that are not measured.

    Raises:
        ModelError: If the machine does not stand what is hidden.
    """
    pair = [benchmark.record(effects, one, coloured=coloured, outside=outside) for one in (seed, seed + TEST)]
    if not all(_finite(benchmark.model, recording) for recording in pair):
        raise ModelError(f"{' and '.join(effects) or outside} lets the machine run away")
    return [
        replace(one, signals={name: v for name, v in one.signals.items() if name not in set(without)})
        for one in pair
    ]


def _out_of_reach(why: str) -> Row:
    return {"outcome": "out of reach", "seconds": 0.0, "summary": why}


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
    cases: Sequence[Case], path: Path, pool: ProcessPoolExecutor, report: Progress
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
        report(f"{pair[0]}: how large {pair[1]} must be", 0.1 * (number + 1) / len(futures))
    return {pair: Curve.from_json(kept[keys[pair]]) for pair in wanted}


def _curve(model: str, fault: str) -> Curve:
    return curve_of(get_benchmark(model), fault)


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
    """Hash of the code of a model and of its benchmark."""
    benchmark = get_benchmark(model)
    owners = [*type(benchmark.model).__mro__, *type(benchmark).__mro__]
    names = {owner.__module__ for owner in owners if owner.__module__.startswith("fieldmodels.")}
    files = {Path(str(import_module(name).__file__)) for name in names}
    # A model in a room of its own depends on the whole room.
    rooms = [f.parent for f in files if f.parent.name not in ("fieldmodels", "benchmarks")]
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
