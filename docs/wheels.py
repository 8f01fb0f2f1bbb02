"""Where the pinned dependencies have wheels: Pythons and platforms, as a table in docs/faults.md.

``python docs/wheels.py`` asks the package index, by ``pip install --dry-run`` for every pair, for the
packages of a plain installation and of training, at the versions of ``constraints.txt``; nothing is
installed. Linux on this machine's Python is tested; the others are what the wheels tell.
"""

import re
import subprocess
import sys
import tempfile
import tomllib
from importlib.metadata import PackageNotFoundError, requires
from pathlib import Path

from packaging.requirements import Requirement

from exam.table import put

ROOT = Path(__file__).parents[1]
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
PLATFORMS = {
    "Linux (x86-64)": [f"manylinux_2_{n}_x86_64" for n in (28, 27, 24, 17, 12, 5)] + ["manylinux2014_x86_64"],
    "macOS (arm64)": [f"macosx_{n}_0_arm64" for n in (11, 12, 13, 14)],
    "Windows (x86-64)": ["win_amd64"],
}


def plain(name: str) -> str:
    """A name as the index writes it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def declared(name: str) -> list[str]:
    """What a package needs; of this one as the tree says, not as it was installed."""
    if name != "fieldgym":
        try:
            return requires(name) or []
        except PackageNotFoundError:  # for another Python; its needs are unknown here
            return []
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    more = project["optional-dependencies"].items()
    return project["dependencies"] + [
        f"{one} {'and' if ';' in one else ';'} extra == '{extra}'" for extra, all_ in more for one in all_
    ]


def needed(python: str) -> list[str]:
    """The pins of all that a plain installation and training pull in."""
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    pinned = (line.partition(";")[0] for line in lines if re.match(r"[\w.-]+==", line))
    pins = {plain(line.split("==")[0]): line for line in pinned}
    found, waiting = {}, [("fieldgym", "train")]
    while waiting:
        name, extra = waiting.pop()
        for text in declared(name):
            one, where = Requirement(text), {"extra": extra, "python_version": python}
            if plain(one.name) in found or (one.marker and not one.marker.evaluate(where)):
                continue
            if plain(one.name) in pins:  # else of a platform that the pins do not know
                found[plain(one.name)] = pins[plain(one.name)]
            waiting += [(one.name, more) for more in one.extras or ("",)]
    return sorted(found.values())


def lacking(python: str, platforms: list[str], pins: list[str]) -> list[str]:
    """Pins without a wheel; a source distribution does not count."""
    missing = []
    with tempfile.TemporaryDirectory() as folder:
        while True:
            command = [sys.executable, "-m", "pip", "install", "--dry-run", "--quiet", "--no-deps"]
            command += ["--only-binary=:all:", "--python-version", python, "--target", folder]
            for platform in platforms:
                command += ["--platform", platform]
            left = [pin for pin in pins if pin not in missing]
            done = subprocess.run([*command, *left], capture_output=True, text=True, check=False)
            if done.returncode == 0:
                return missing
            wrong = re.search(r"No matching distribution found for (\S+)", done.stderr)
            if wrong is None:
                raise RuntimeError(done.stderr[-2000:])
            missing.append(wrong[1])


def main() -> None:
    """Ask, and put the table into the page."""
    pins = {python: needed(python) for python in PYTHONS}
    lines = [
        f"| of {len(pins[PYTHONS[0]])} packages, at their pinned versions | {' | '.join(PYTHONS)} |",
        "|---|---|---|---|---|",
    ]
    for name, platforms in PLATFORMS.items():
        cells = []
        for python in PYTHONS:
            missing = lacking(python, platforms, pins[python])
            cells.append("all" if not missing else "no wheel: " + ", ".join(missing))
            print(name, python, cells[-1], flush=True)
        lines.append(f"| {name} | {' | '.join(cells)} |")
    put("\n".join([*lines, ""]), ROOT / "docs" / "faults.md", "wheels")


if __name__ == "__main__":
    main()
