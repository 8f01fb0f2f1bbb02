"""The listed mutants: deliberate errors, each with the tests that ought to notice it."""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from fieldmodels.yaml import load_yaml

FOLDER = Path(__file__).parent
ROOT = FOLDER.parents[1]


class MutantError(ValueError):
    """A mutant that cannot be applied, or names no test."""


@dataclass(frozen=True)
class Mutant:
    """One deliberate error.

    Attributes:
        area: Heading of the table that it stands in.
        file: The file that it changes, from the root of the project.
        old: Text that occurs in it exactly once.
        new: What stands there instead.
        error: What is wrong then, in one line.
        tests: Pytest paths or node ids that ought to notice.
    """

    area: str
    file: str
    old: str
    new: str
    error: str
    tests: tuple[str, ...]

    @property
    def key(self) -> str:
        """A name that changes with the mutant."""
        return hashlib.sha256(repr((self.file, self.old, self.new, self.tests)).encode()).hexdigest()[:12]

    def applied(self, root: Path) -> str:
        """The file's text with the error in it.

        Raises:
            MutantError: If the file is missing, or the old text does not occur exactly once.
        """
        path = root / self.file
        if not path.is_file():
            raise MutantError(f"{self.error}: {self.file} does not exist; name the file that holds it now")
        text = path.read_text()
        count = text.count(self.old)
        if count != 1 or self.new == self.old:
            raise MutantError(
                f"{self.error}: {self.old!r} occurs {count} times in {self.file}, not once; "
                "write the text that stands there now into the table"
            )
        return text.replace(self.old, self.new)

    def check_tests(self, root: Path) -> None:
        """Check that each named test exists.

        Raises:
            MutantError: If one does not.
        """
        if not self.tests:
            raise MutantError(f"{self.error}: no test is named")
        for test in self.tests:
            name, *inside = test.split("::")
            path = root / name
            found = path.exists() and (not inside or inside[0].partition("[")[0] in functions(path))
            if not found:
                raise MutantError(f"{self.error}: there is no test {test}")


@cache
def functions(path: Path) -> set[str]:
    """Names of the functions of a file."""
    return {node.name for node in ast.parse(path.read_text()).body if isinstance(node, ast.FunctionDef)}


def read_mutants(folder: Path = FOLDER) -> list[Mutant]:
    """Every mutant of every table, in the order of the files' names."""
    return [mutant for path in sorted(folder.glob("*.yaml")) for mutant in _read(path)]


def _read(path: Path) -> Iterator[Mutant]:
    table = load_yaml(path)
    for entry in table["mutants"]:
        tests = entry.get("tests", table.get("tests", []))
        yield Mutant(
            area=table["area"],
            file=entry.get("file", table.get("file", "")),
            old=str(entry["old"]),
            new=str(entry["new"]),
            error=entry["error"],
            tests=tuple([tests] if isinstance(tests, str) else tests),
        )
