"""Apply each listed mutant to a copy of the project and run the tests that ought to notice it.

    python tests/mutants/run.py [--only TEXT ...] [--workers 2] [--keep | --fresh] [--quick] [--publish]

A mutant is *killed* if a test fails by an assertion, *survives* if all pass, and is *broken* if the program
falls over before any test can say no (it does not import, or does not compile): that proves nothing of the
tests. At the end the tests that noticed something run once more without any error, and must pass.

Results are kept in results/mutants/ as long as the project stays as it is, so that a run that was interrupted
goes on where it ended. While tests are written, ``--keep`` keeps every result whose own file and tests have
not changed. With ``--quick`` tests of the night are left out: what does `make test` alone notice?
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import queue
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

from page import PAGE, page
from table import FOLDER, ROOT, Mutant, read_mutants

from fieldmodels.files import write_text

COPIED = (
    "src",
    "envs",
    "agents",
    "tests",
    "papers",
    "configs",
    "docs",
    "pyproject.toml",
    "README.md",
    "mkdocs.yml",
)
WORK = ROOT / "results" / "mutants"
STORE = WORK / "results.json"
QUICK = WORK / "results-quick.json"
WARM = WORK / "kernels"  # of the project as it is
TIMEOUT = 600.0  # seconds, for the tests of one mutant
PATIENCE = 5400.0  # seconds, for all tests without any error, kernels compiled


@dataclass(frozen=True)
class Result:
    """How the tests of one mutant ended.

    Attributes:
        status: ``killed``, ``survived`` or ``broken``.
        test: The test that failed first; empty if none did.
        error: What it said.
        seconds: Time that the tests took, compiling included.
        tree: Hash of the project that it was found in.
        own: Hash of the changed file and of its tests.
    """

    status: str
    test: str
    error: str
    seconds: float
    tree: str = ""
    own: str = ""


class Worker:
    """A copy of the project, its own cache of kernels, and the tests run in it."""

    def __init__(self, number: int, tests: str = "") -> None:
        self.tests = tests
        self.root = WORK / f"worker{number}"
        self.kernels = WORK / f"kernels{number}"
        self.report = WORK / f"report{number}.jsonl"
        shutil.rmtree(self.root, ignore_errors=True)
        self.root.mkdir(parents=True)
        for name in COPIED:
            source = ROOT / name
            if source.is_dir():
                shutil.copytree(source, self.root / name, ignore=shutil.ignore_patterns("__pycache__"))
            elif source.exists():
                shutil.copy(source, self.root / name)

    def pytest(
        self, tests: Sequence[str], kernels: Path, *options: str, timeout: float = TIMEOUT
    ) -> tuple[int, list[dict[str, Any]]]:
        """Exit status, and one entry for each test that ran."""
        self.report.write_text("")
        floors = [str(self.root / floor) for floor in ("src", "envs", "agents", "tests", ".")]
        environment = {
            **os.environ,
            "PYTHONPATH": os.pathsep.join([*floors, str(FOLDER)]),
            "NUMBA_CACHE_DIR": str(kernels),
            "OMP_NUM_THREADS": "1",
            "MUTANT_REPORT": str(self.report),
            "MUTANT_TREE": str(self.root),
        }
        fixed = ["-q", "-m", self.tests, "-p", "witness", "-p", "no:cacheprovider", "-p", "no:xdist"]
        command = [sys.executable, "-m", "pytest", *fixed, *options, *tests]
        try:
            done = subprocess.run(
                command, cwd=self.root, env=environment, capture_output=True, text=True, timeout=timeout
            )
            status = done.returncode
            if status == 70:
                raise SystemExit(done.stdout + done.stderr)
        except subprocess.TimeoutExpired:
            status = -1
        return status, [json.loads(line) for line in self.report.read_text().splitlines()]

    def judge(self, mutant: Mutant, warm: Path) -> Result:
        """Apply a mutant, run its tests, restore."""
        began = time.perf_counter()
        path = self.root / mutant.file
        right = path.read_text()
        shutil.rmtree(self.kernels, ignore_errors=True)
        shutil.copytree(warm, self.kernels, copy_function=os.link)
        try:
            path.write_text(mutant.applied(self.root))
            status, ran = self.pytest(mutant.tests, self.kernels, "-x")
            if status not in (0, -1) and not any(one["asserted"] for one in ran):
                # The first test fell over; another may still say no.
                status, ran = self.pytest(mutant.tests, self.kernels, "--maxfail=5")
        finally:
            path.write_text(right)
        seconds = time.perf_counter() - began
        failed = [one for one in ran if one["outcome"] == "failed"]
        noticed = [one for one in failed if one["asserted"]]
        if noticed:
            return Result("killed", noticed[0]["test"], noticed[0]["error"], seconds)
        if status in (0, 5):  # 5: all its tests are of the night
            return Result("survived", "", "", seconds)
        first = (
            failed[0] if failed else {"test": "", "error": "took too long" if status == -1 else "no import"}
        )
        return Result("broken", first["test"], first["error"], seconds)


def tree_hash() -> str:
    """Hash of all that a result depends on, the tables apart: each result is kept under its mutant's key."""
    files: list[Path] = []
    for name in COPIED:
        source = ROOT / name
        files += sorted(source.rglob("*")) if source.is_dir() else [source]
    docs = ROOT / "docs"
    return hash_of([path for path in files if not {FOLDER, docs} & set(path.parents)], ROOT)


def own_hash(mutant: Mutant, root: Path) -> str:
    """Hash of what a result depends on above all: the changed file, and the tests."""
    names = (mutant.file, *sorted({test.split("::")[0] for test in mutant.tests}))
    return hash_of([root / name for name in names], root)


def hash_of(files: Sequence[Path], root: Path) -> str:
    """Hash of the names and contents of files."""
    total = hashlib.sha256()
    for path in files:
        if path.is_file() and "__pycache__" not in path.parts:
            total.update(str(path.relative_to(root)).encode() + b"\0" + path.read_bytes())
    return total.hexdigest()


def without_error(workers: Sequence[Worker], tests: Sequence[str], kernels: Path) -> dict[str, str]:
    """Run tests on the project as it is.

    Returns:
        Those that do not pass, or do not run, and why.
    """
    kernels.mkdir(parents=True, exist_ok=True)
    shares = [tests[k :: len(workers)] for k in range(len(workers))]
    useless: dict[str, str] = {}
    with ThreadPoolExecutor(len(workers)) as pool:
        ran = pool.map(
            lambda pair: pair[0].pytest(pair[1], kernels, timeout=PATIENCE) if pair[1] else (0, []),
            zip(workers, shares, strict=True),
        )
        for status, lines in ran:
            own = {one["test"]: one["error"] for one in lines if one["outcome"] in ("failed", "skipped")}
            if status and not own:
                raise SystemExit(
                    f"pytest ended with {status} without any error put in; can all tests be read?"
                )
            useless |= own
    return useless


def earlier(mutants: Sequence[Mutant], tree: str, keep: bool, store: Path) -> dict[str, Result]:
    """Results of earlier runs that still hold, by mutant's key."""
    if not store.exists():
        return {}
    stored = {key: Result(**value) for key, value in json.loads(store.read_text()).items()}
    return {
        mutant.key: result
        for mutant in mutants
        if (result := stored.get(mutant.key))
        and (result.tree == tree or (keep and result.own == own_hash(mutant, ROOT)))
    }


def run(
    mutants: Sequence[Mutant], known: dict[str, Result], count: int, tree: str, store: Path, tests: str
) -> dict[str, Result]:
    """Results by mutant's key; those that are known are not found again."""
    waiting = [mutant for mutant in mutants if mutant.key not in known]
    if not waiting:
        return known
    workers = [Worker(number, tests) for number in range(count)]
    began = time.perf_counter()
    if not WARM.is_dir():
        without_error(workers, sorted({test for mutant in waiting for test in mutant.tests}), WARM)
        print(f"kernels compiled in {time.perf_counter() - began:.0f} s", flush=True)
    idle: queue.SimpleQueue[Worker] = queue.SimpleQueue()
    for worker in workers:
        idle.put(worker)

    def one(mutant: Mutant) -> Result:
        worker = idle.get()
        try:
            own = own_hash(mutant, worker.root)
            return replace(worker.judge(mutant, WARM), tree=tree, own=own)
        finally:
            idle.put(worker)

    with ThreadPoolExecutor(count) as pool:
        jobs = {pool.submit(one, mutant): mutant for mutant in waiting}
        for number, job in enumerate(as_completed(jobs), 1):
            mutant, result = jobs[job], job.result()
            known[mutant.key] = result
            write_text(store, json.dumps({key: asdict(one) for key, one in known.items()}))
            said = "" if result.status == "killed" else f"  {result.test} {result.error}"
            print(
                f"{number:3}/{len(waiting)} {result.status:8} {result.seconds:5.1f} s  "
                f"{Path(mutant.file).name}: {mutant.error}{said}",
                flush=True,
            )
    noticed = {known[m.key].test for m in waiting if known[m.key].status == "killed"}
    useless = without_error(workers, sorted(noticed), WARM)
    for key, result in known.items():
        if result.test in useless:
            said = f"fails without the error, too: {useless[result.test]}"
            known[key] = replace(result, status="broken", error=said)
            print(f"broken: {result.test} {said}", flush=True)
    write_text(store, json.dumps({key: asdict(one) for key, one in known.items()}))
    return known


def main() -> None:
    """Run the listed mutants and print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--only", nargs="*", default=[], help="mutants whose file, area or error holds a text"
    )
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--keep", action="store_true", help="keep results whose file and tests are unchanged")
    parser.add_argument("--fresh", action="store_true", help="forget the results of earlier runs")
    parser.add_argument("--quick", action="store_true", help="with the tests of `make test` alone")
    parser.add_argument("--publish", action="store_true", help=f"write {PAGE}")
    options = parser.parse_args()
    everything = read_mutants()
    mutants = [
        m
        for m in everything
        if not options.only or any(text in f"{m.area} {m.file} {m.error}" for text in options.only)
    ]
    for mutant in mutants:
        mutant.applied(ROOT)
        mutant.check_tests(ROOT)
    began = time.perf_counter()
    tree = tree_hash()
    store, tests = (QUICK, "not nightly") if options.quick else (STORE, "")
    known = {} if options.fresh else earlier(everything, tree, options.keep, store)
    results = run(mutants, known, options.workers, tree, store, tests)
    minutes = (time.perf_counter() - began) / 60
    found = [results[m.key].status for m in mutants]
    print(
        f"{len(mutants)} mutants: {found.count('killed')} killed, {found.count('survived')} survived, "
        f"{found.count('broken')} broken, in {minutes:.1f} minutes"
    )
    if options.publish:
        _, heading, drawn = (ROOT / PAGE).read_text().partition("\n## Drawn at random")
        (ROOT / PAGE).write_text(page(everything, results) + heading + drawn)
    sys.exit(found.count("killed") != len(found))


if __name__ == "__main__":
    main()
