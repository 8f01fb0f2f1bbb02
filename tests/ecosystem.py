"""Train by the libraries of docs/your_library.md, each in an environment of its own, from the page's text.

    python tests/ecosystem.py [--only TorchRL] [--publish]

A section's first block installs, the second trains. The third, in a fresh process, loads and defines
``act(observations)``: this must give what the trained policy gives, and be better than random actions by 10
in mean return over 100 fresh episodes (paired, two-sided 95 %). Needs uv and the network.
"""

from __future__ import annotations

import argparse
import ast
import re
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "your_library.md"
RESULT = "## What came out"
TORCH = re.search(r"^torch==.*$", (ROOT / "constraints.txt").read_text(), re.MULTILINE)
LEAST = 10.0
EXCUSED = "PufferLib"
"""May fail, by its own error: its source distribution fetches files while it is built."""

TRAINED = """
import numpy
seen = numpy.random.default_rng(0).uniform(-1, 1, (64, 7)).astype("float32")
numpy.save("trained.npy", numpy.asarray(act(seen), dtype="float64"))
"""
LOADED = """
import gymnasium, numpy, fieldgym
seen = numpy.random.default_rng(0).uniform(-1, 1, (64, 7)).astype("float32")
numpy.save("loaded.npy", numpy.asarray(act(seen), dtype="float64"))

def returns(act, seed=77_000_000, episodes=100):
    envs = gymnasium.make_vec("fieldgym/PoseReaching-v0", num_envs=episodes)
    seen, _ = envs.reset(seed=seed)
    total, over = numpy.zeros(episodes), numpy.zeros(episodes, bool)
    while not over.all():
        seen, reward, terminated, truncated, _ = envs.step(numpy.asarray(act(seen), dtype="float32"))
        total += numpy.where(over, 0.0, reward)
        over |= terminated | truncated
    return total

rng = numpy.random.default_rng(0)
numpy.save("returns.npy", [returns(act), returns(lambda seen: rng.uniform(-1, 1, (len(seen), 2)))])
"""


@dataclass(frozen=True)
class Section:
    """A library on the page: what pip installs, how it trains, how it acts."""

    name: str
    packages: tuple[str, ...]
    language: str
    train: str
    load: str = ""

    @property
    def lines(self) -> int:
        """Lines of the training that are not empty."""
        return sum(1 for line in self.train.splitlines() if line.strip())


def sections(page: str) -> list[Section]:
    """The libraries of the page."""
    found = []
    for part in re.split(r"^## ", page.partition(RESULT)[0], flags=re.MULTILINE)[1:]:
        blocks = re.findall(r"```(\w+)\n(.*?)```", part, re.DOTALL)
        (_, pip), (language, train), *load = blocks
        packages = tuple(re.findall(r'"([^"]+)"|(\S+)', pip.removeprefix("pip install")))
        names = tuple(quoted or plain for quoted, plain in packages)
        found.append(Section(part.split("\n")[0], names, language, train, load[0][1] if load else ""))
    return found


def imports_of(code: str) -> str:
    """The import statements of a block."""
    kept = [one for one in ast.parse(code).body if isinstance(one, ast.Import | ast.ImportFrom)]
    return "\n".join(map(ast.unparse, kept)) + "\n"


def without_loading(code: str, train: str) -> str:
    """What is left of a block that loads where the trained objects are at hand under the same names."""
    names = {one.id for one in ast.walk(ast.parse(train)) if isinstance(one, ast.Name)}
    kept = []
    for one in ast.parse(code).body:
        made = (
            isinstance(one, ast.Assign)
            and isinstance(one.targets[0], ast.Name)
            and one.targets[0].id in names
        )
        if not made and not isinstance(one, ast.Expr):
            kept.append(ast.unparse(one))
    return "\n".join(kept) + "\n"


def installed(section: Section, wheel: Path, folder: Path, lowest: bool) -> str:
    """Make the section's environment; return what went wrong."""
    python = folder / "venv" / "bin" / "python"
    uv = [sys.executable, "-m", "uv"]
    pip = [*uv, "pip", "install", "--quiet", "--python", str(python)]
    named = [re.sub(r"^fieldgym(?=$|\[)", str(wheel), one) for one in section.packages]
    steps = [[*uv, "venv", "--quiet", "--clear", "--python", sys.executable, str(folder / "venv")]]
    if lowest:
        pins = folder / "lowest.txt"
        steps += [
            [*uv, "pip", "compile", "--quiet", "--resolution", "lowest-direct", "--extra", "train",
             "pyproject.toml", "--output-file", str(pins)],
            ["sed", "-i", f"s/^torch==.*/{TORCH[0]}/", str(pins)],
            [*pip, "--requirement", str(pins)],
            [*pip, "--no-deps", str(wheel)],
        ]  # fmt: skip
    else:
        steps += [[*pip, *named, *([TORCH[0]] if section.name != EXCUSED else [])]]
    for step in steps:
        run = subprocess.run(step, cwd=ROOT, capture_output=True, text=True, check=False)
        if run.returncode:
            (folder / "install.log").write_text(run.stdout + run.stderr)
            return next(line for line in reversed(run.stderr.splitlines()) if "rror" in line).strip()
    return ""


def ran(code: str, python: Path, folder: Path, name: str) -> str:
    """Run a block in the section's environment; return the last line of what went wrong."""
    (folder / f"{name}.py").write_text(code)
    run = subprocess.run(
        [python, f"{name}.py"], cwd=folder, capture_output=True, text=True, check=False,
        env={"PATH": f"{python.parent}:/usr/bin:/bin", "HOME": str(Path.home()), "OMP_NUM_THREADS": "1"},
    )  # fmt: skip
    (folder / f"{name}.log").write_text(run.stdout + run.stderr)
    return "" if run.returncode == 0 else (run.stderr.strip().splitlines() or ["no message"])[-1]


def tried(section: Section, wheel: Path, folder: Path, lowest: bool = False) -> dict[str, str]:
    """Install, train, load, score: a row of the table."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    row = {"library": section.name + (", lowest versions" if lowest else ""), "lines": str(section.lines)}
    if wrong := installed(section, wheel, folder, lowest):
        return row | {"outcome": f"does not install: {wrong[:120]}"}
    python = folder / "venv" / "bin" / "python"
    shutil.copy(ROOT / "docs" / "ppo.py", folder)
    if section.language == "bash":
        train = f"import subprocess\nsubprocess.run(['bash', '-ec', {section.train!r}], check=True)\n"
        load = section.load
    else:
        train = section.train
        load = imports_of(section.train) + section.load
        if section.load:
            train += without_loading(section.load, section.train) + TRAINED
    began = time.perf_counter()
    wrong = ran(train, python, folder, "train")
    row["seconds"] = f"{time.perf_counter() - began:.0f}"
    if wrong or not section.load:
        return row | {"outcome": f"fails: {wrong[:120]}" if wrong else "steps"}
    if wrong := ran(load + LOADED, python, folder, "load"):
        return row | {"outcome": f"loading fails: {wrong[:120]}"}
    import numpy as np

    learnt, random = np.load(folder / "returns.npy")
    gain, half = (learnt - random).mean(), 1.984 * (learnt - random).std(ddof=1) / len(learnt) ** 0.5
    row |= {"return": f"{learnt.mean():.1f}", "over random": f"{gain:.1f} ± {half:.1f}"}
    kept = (folder / "trained.npy").exists()
    if kept and not np.array_equal(np.load(folder / "trained.npy"), np.load(folder / "loaded.npy")):
        return row | {"outcome": "acts otherwise once loaded"}
    return row | {"outcome": "learns" if gain - half >= LEAST else "learns too little"}


def main() -> None:
    """Try the libraries one after the other; exit with 1 if one does not do what the page says."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", action="append", help="name of a section")
    parser.add_argument("--publish", action="store_true", help=f"write the section {RESULT!r} of the page")
    given = parser.parse_args()
    work = ROOT / "results" / "ecosystem"
    shutil.rmtree(work / "dist", ignore_errors=True)
    build = [sys.executable, "-m", "build", "--wheel", "--outdir", str(work / "dist"), str(ROOT)]
    subprocess.run(build, check=True, capture_output=True)
    (wheel,) = (work / "dist").glob("*.whl")
    page = PAGE.read_text()
    every = [(one, False) for one in sections(page)]
    every.append((every[0][0], True))
    rows = []
    for section, lowest in every:
        if given.only and section.name not in given.only:
            continue
        name = re.sub(r"\W+", "_", section.name.lower()) + ("_lowest" if lowest else "")
        rows.append(tried(section, wheel, work / name, lowest))
        print(rows[-1], flush=True)
    columns = ("library", "lines", "seconds", "return", "over random", "outcome")
    table = ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    table += ["| " + " | ".join(row.get(column, "") for column in columns) + " |" for row in rows]
    print("\n".join(table))
    if given.publish:
        said = (
            f"{RESULT}\n\nLines of the training, seconds on one thread of a busy machine, mean return of a"
            " hundred fresh episodes.\n\n"
        )
        PAGE.write_text(page.partition(RESULT)[0] + said + "\n".join(table) + "\n")
    sys.exit(any(r["outcome"] not in ("learns", "steps") and r["library"] != EXCUSED for r in rows))


if __name__ == "__main__":
    main()
