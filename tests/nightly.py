"""Run every test there is, in parts that resume; a part whose inputs did not change is not repeated.

    python tests/nightly.py [--only TEXT ...] [--workers 2] [--list] [--again]

A part is a file of tests with all its cases, or the table of deliberate errors. What a part reads is watched
while it runs: modules, configs, data. It is kept in results/nightly/ with the hashes of all that; a part that
starts other programs is taken to read the whole project. Exit status 1 if a part has failed.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
STORE = ROOT / "results" / "nightly"
MUTANTS = "mutants"
OURS = ("src", "envs", "agents", "tests", "papers", "configs", "docs", "benchmarks")
ALWAYS = ("pyproject.toml", "constraints.txt", "tests/conftest.py")
READS = "NIGHTLY_READS"


@dataclass(frozen=True)
class Outcome:
    """How a part ended.

    Attributes:
        passed: Whether nothing failed.
        words: The last line of what was printed.
        seconds: Wall time.
        commit: Of the project.
        inputs: Hash of each file that it read, by its path in the project.
    """

    passed: bool
    words: str
    seconds: float
    commit: str
    inputs: dict[str, str]

    def holds(self) -> bool:
        """Whether it passed, and all that it read is as it was."""
        return self.passed and all(digest(path) == known for path, known in self.inputs.items())


@cache
def digest(path: str) -> str:
    """Hash of a file of the project; empty if it is gone."""
    file = ROOT / path
    return hashlib.sha256(file.read_bytes()).hexdigest()[:16] if file.is_file() else ""


@cache
def project() -> tuple[str, ...]:
    """Every file of the project that a test may read."""
    listed = subprocess.run(
        ["git", "ls-files", *OURS, *ALWAYS], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return tuple(listed.stdout.splitlines())


def parts() -> list[str]:
    """Names of all parts: files of tests, and the deliberate errors."""
    files = sorted(path.relative_to(ROOT).as_posix() for path in (ROOT / "tests").rglob("test_*.py"))
    return [*files, MUTANTS]


def earlier(part: str) -> Outcome | None:
    """The stored outcome of a part."""
    file = stored(part)
    return Outcome(**json.loads(file.read_text())) if file.is_file() else None


def stored(part: str) -> Path:
    """Where the outcome of a part is kept."""
    return STORE / f"{part.removeprefix('tests/').removesuffix('.py').replace('/', '.')}.json"


def run(part: str, commit: str) -> Outcome:
    """Run a part and keep its outcome."""
    began, reads = time.perf_counter(), stored(part).with_suffix(".reads")
    command = [sys.executable, ROOT / "tests" / "mutants" / "run.py", "--keep", "--workers", "1"]
    if part != MUTANTS:
        command = [sys.executable, "-m", "pytest", "-q", "-m", "", "-p", "nightly", "-p", "no:xdist", part]
    paths = os.pathsep.join(filter(None, [str(ROOT / "tests"), os.environ.get("PYTHONPATH", "")]))
    environment = {**os.environ, "PYTHONPATH": paths, "OMP_NUM_THREADS": "1", READS: str(reads)}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    words = (done.stdout.strip().splitlines() or [done.stderr.strip()[-200:]])[-1]
    found = set(reads.read_text().splitlines()) if reads.exists() else {""}
    reads.unlink(missing_ok=True)
    inputs = {*ALWAYS, *(({part} | found) & {*project()})} if "" not in found else {*project()}
    hashes = {path: digest(path) for path in sorted(inputs)}
    outcome = Outcome(done.returncode == 0, words, time.perf_counter() - began, commit, hashes)
    kept = stored(part).with_suffix(".new")
    kept.write_text(json.dumps(asdict(outcome), indent=1))
    kept.replace(stored(part))
    stored(part).with_suffix(".txt").write_text(done.stdout + done.stderr)
    return outcome


def pytest_configure() -> None:
    """As a plugin of pytest: watch what is read; an empty line stands for another program, or a fork."""
    target, read = os.environ[READS], set[str]()

    def watch(event: str, arguments: tuple[object, ...]) -> None:
        if event == "open" and isinstance(arguments[0], str | os.PathLike):
            read.add(os.fspath(arguments[0]))
        elif event in ("subprocess.Popen", "os.posix_spawn", "os.system", "os.fork"):
            read.add("")

    sys.addaudithook(watch)
    import atexit

    owner = os.getpid()

    def write() -> None:
        if os.getpid() == owner:
            if any(name.startswith("multiprocessing.popen_") for name in sys.modules):
                read.add("")
            Path(target).write_text("\n".join(sorted(set(_of_project(read)))))

    atexit.register(write)


def _of_project(read: set[str]) -> Iterator[str]:
    for name in sorted(read) + [str(getattr(one, "__file__", None) or "/") for one in sys.modules.values()]:
        path = Path(os.path.abspath(name)) if name else None  # noqa: PTH100  (a link stays one)
        if path is None:
            yield ""
        elif path.is_relative_to(ROOT):
            yield path.relative_to(ROOT).as_posix()


def main() -> int:
    """Run what has changed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--only", nargs="*", action="extend", default=[], help="parts whose name holds one of these"
    )
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--list", action="store_true", help="say what would be run")
    parser.add_argument("--again", action="store_true", help="repeat what has not changed, too")
    given = parser.parse_args()
    STORE.mkdir(parents=True, exist_ok=True)
    wanted = [part for part in parts() if not given.only or any(text in part for text in given.only)]
    known = {part: earlier(part) for part in wanted}
    left = [part for part in wanted if given.again or not (known[part] and known[part].holds())]
    left.sort(key=lambda part: -(known[part].seconds if known[part] else 60.0))  # long ones first
    print(f"{len(wanted)} parts, {len(wanted) - len(left)} of them unchanged since they passed", flush=True)
    if given.list:
        print("\n".join(left))
        return 0
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.strip()
    failed = []
    with ThreadPoolExecutor(given.workers) as pool:
        running = {pool.submit(run, part, commit): part for part in left}
        for count, done in enumerate(as_completed(running), 1):
            part, outcome = running[done], done.result()
            failed += [] if outcome.passed else [part]
            state = "passed" if outcome.passed else "FAILED"
            print(
                f"{count}/{len(left)} {state} {part} ({outcome.seconds:.0f} s): {outcome.words}", flush=True
            )
    for part in failed:
        print(f"FAILED {part}: see {stored(part).with_suffix('.txt')}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
