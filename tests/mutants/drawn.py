"""Draw errors by a public tool (cosmic-ray) and see which of them `make test` lets live.

    python tests/mutants/drawn.py [--count 200] [--workers 2] [--budget 60] [--publish]

The draw is seeded by the commit's hash: nobody chose these errors. Each is put into a copy of the project,
and the files of tests nearest to the changed module, by imports, are run one after the other, until one fails
or they have taken the budget [s]. What is known of a commit is kept in results/mutants/. Needs cosmic-ray.
"""

from __future__ import annotations

import argparse
import ast
import json
import random
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path
from queue import SimpleQueue
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

import grimp
import run
from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator, operator_names
from table import ROOT

PACKAGES = {"fieldmodels": "src", "fieldgym": "envs", "fieldagents": "agents", "exam": "tests", "papers": "."}
PAGE = ROOT / run.PAGE
HEADING = "## Drawn at random"


def main() -> None:
    """Draw, run, print the survivors."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--budget", type=float, default=60.0)
    parser.add_argument("--publish", action="store_true", help=f"write the section of {run.PAGE}")
    given = parser.parse_args()
    commit = subprocess.run(
        ["git", "rev-parse", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.strip()
    store = run.WORK / f"drawn-{commit[:12]}.json"
    run.WORK.mkdir(parents=True, exist_ok=True)
    known: dict[str, Any] = json.loads(store.read_text()) if store.exists() else {}
    drawn = draw(random.Random(int(commit, 16)), given.count)
    waiting = [one for one in drawn if key(one) not in known]
    idle: SimpleQueue[run.Worker] = SimpleQueue()
    for number in range(given.workers if waiting else 0):
        worker = run.Worker(number, "not nightly")
        worker.kernels.mkdir(parents=True, exist_ok=True)
        idle.put(worker)

    def one(mutation: dict[str, Any]) -> None:
        worker = idle.get()
        try:
            known[key(mutation)] = mutation | judged(worker, mutation, given.budget)
        finally:
            idle.put(worker)
        store.write_text(json.dumps(known, indent=1))
        last = known[key(mutation)]
        print(
            f"{len(known):3}/{given.count} {last['status']:8} {last['seconds']:5.1f} s  {words(last)}",
            flush=True,
        )

    with ThreadPoolExecutor(given.workers) as pool:
        list(pool.map(one, waiting))
    found = [known[key(one)] for one in drawn]
    text = section(commit, found, given.budget)
    print(text)
    if given.publish:
        before = PAGE.read_text().partition(f"\n{HEADING}")[0].rstrip()
        PAGE.write_text(f"{before}\n\n{text}")


def draw(rng: random.Random, count: int) -> list[dict[str, Any]]:
    """Mutations, each place and operator of the packages as likely as any other."""
    pool: list[dict[str, Any]] = []
    for package, room in PACKAGES.items():
        for path in sorted((ROOT / room / package).rglob("*.py")):
            if path.name.startswith("test_"):
                continue
            text = path.read_text()
            annotations, nodes = set(_annotated(ast.parse(text))), list(ast_nodes(get_ast(text)))
            for name in sorted(operator_names()):
                operator = get_operator(name)
                if operator.arguments():
                    continue
                places = (place for node in nodes for place in operator().mutation_positions(node))
                for occurrence, (begin, _) in enumerate(places):
                    if begin not in annotations:  # a type's `|` is never run
                        file = path.relative_to(ROOT).as_posix()
                        where = {"file": file, "line": begin[0], "operator": name, "occurrence": occurrence}
                        pool.append(where)
    return rng.sample(pool, count)


def _annotated(tree: ast.Module) -> Iterator[tuple[int, int]]:
    """Every place (line, column) within an annotation."""
    for node in ast.walk(tree):
        for inside in (getattr(node, "annotation", None), getattr(node, "returns", None)):
            if isinstance(inside, ast.expr) and inside.end_col_offset is not None:
                line = inside.lineno
                if inside.end_lineno == line:
                    yield from ((line, column) for column in range(inside.col_offset, inside.end_col_offset))


def key(mutation: dict[str, Any]) -> str:
    """Its name in the store."""
    return " ".join(str(mutation[name]) for name in ("file", "operator", "occurrence"))


def words(mutation: dict[str, Any]) -> str:
    """What was changed, in a line."""
    return f"{mutation['file'].split('/', 1)[1]}:{mutation['line']} {mutation['operator'].split('/')[1]}"


def judged(worker: run.Worker, mutation: dict[str, Any], budget: float) -> dict[str, Any]:
    """Put an error in, run the nearest tests, restore."""
    began, path = time.perf_counter(), worker.root / mutation["file"]
    right = path.read_text()
    wrong = mutate_code(right, get_operator(mutation["operator"])(), mutation["occurrence"])
    status, test = "survived", ""
    try:
        path.write_text(wrong)
        for file in nearest(mutation["file"]):
            ended, lines = worker.pytest([file], worker.kernels, "-x", timeout=2.0 * budget)
            if ended not in (0, 5):  # 5: all its tests are of the night
                failed = next((line["test"] for line in lines if line["outcome"] == "failed"), file)
                status, test = "killed", failed
                break
            if time.perf_counter() - began > budget:
                break
    finally:
        path.write_text(right)
    changed = [
        (a.strip(), b.strip()) for a, b in zip(right.splitlines(), wrong.splitlines(), strict=False) if a != b
    ]
    return {"status": status, "test": test, "seconds": time.perf_counter() - began, "change": changed[:1]}


@cache
def nearest(file: str) -> tuple[str, ...]:
    """Files of tests in the order of how directly they import a module; those that never do are left out."""
    graph = _graph()
    place = file if file.startswith("papers/") else file.split("/", 1)[1]
    module = place.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
    far, frontier, step = {module: 0}, {module}, 0
    while frontier:
        step += 1
        frontier = {m for one in frontier for m in graph.find_modules_that_directly_import(one)} - set(far)
        far |= dict.fromkeys(frontier, step)
    tokens = set(module.replace(".", "_").split("_"))
    found = []
    for test in sorted((ROOT / "tests").rglob("test_*.py")):
        distance = min((far[m] for m in _imported(test) if m in far), default=None)
        if distance is not None:
            name = test.relative_to(ROOT).with_suffix("").as_posix()
            alike = len(tokens & set(name.replace("/", "_").split("_")))
            found.append((distance, -alike, test.relative_to(ROOT).as_posix()))
    return tuple(test for _, _, test in sorted(found))


@cache
def _graph() -> Any:
    return grimp.build_graph(*PACKAGES)


@cache
def _imported(test: Path) -> frozenset[str]:
    """Modules that a file of tests imports, with what it takes of them where that may be a module."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(test.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{one.name}" for one in node.names)}
        elif isinstance(node, ast.Import):
            names |= {one.name for one in node.names}
    return frozenset(names)


def section(commit: str, found: list[dict[str, Any]], budget: float) -> str:
    """The page's part on these errors."""
    alive = [one for one in found if one["status"] == "survived"]
    rooms = Counter(one["file"].split("/")[0] for one in alive)
    lines = [
        HEADING,
        "",
        f"Of {len(found)} errors that cosmic-ray drew, seeded by commit {commit[:12]}, each place and "
        f"operator as likely as any other, **{len(found) - len(alive)} are killed** by those tests of "
        f"`make test` that are nearest to the changed module, within {budget:.0f} s "
        "(`python tests/mutants/drawn.py`). The survivors "
        f"({', '.join(f'{count} in {room}' for room, count in rooms.most_common())}):",
        "",
        "| where | was | became |",
        "|---|---|---|",
    ]
    for one in alive:
        was, became = (one["change"] or [("", "")])[0]
        cells = (text.replace("|", "\\|")[:90] for text in (was, became))
        lines.append(
            f"| `{one['file'].split('/', 1)[1]}:{one['line']}` | {' | '.join(f'`{c}`' for c in cells)} |"
        )
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
