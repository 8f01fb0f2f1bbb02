"""The published page of the mutants."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

from table import Mutant

PAGE = "tests/mutants/killed.md"
INTRODUCTION = """# Deliberate errors

`make mutants` puts {count} errors into a copy of the project, one at a time, and runs the tests that ought to
notice each. An error counts as *killed* only if a test fails by an assertion; comparisons with stored outputs
take no part.

**{killed} of {count} are killed.** One after the other, their tests took {minutes:.0f} minutes, compiling
included. The errors are listed in `tests/mutants/*.yaml`; this page is written by `make mutants`.
`python tests/mutants/run.py --quick` says what `make test` alone notices.
"""


def page(mutants: Sequence[Mutant], results: Mapping[str, Any]) -> str:
    """The page's Markdown.

    Args:
        mutants: All of them, in order.
        results: By mutant's key.
    """
    missing = [mutant.error for mutant in mutants if mutant.key not in results]
    if missing:
        raise SystemExit(f"without results: {'; '.join(missing)}; run them all before publishing")
    killed = sum(results[m.key].status == "killed" for m in mutants)
    minutes = sum(results[m.key].seconds for m in mutants) / 60
    parts = [INTRODUCTION.format(count=len(mutants), killed=killed, minutes=minutes)]
    for area, group in itertools.groupby(mutants, key=lambda m: m.area):
        parts.append(f"\n## {area}\n\n| error | in | noticed by |\n|---|---|---|\n")
        parts += [_row(mutant, results[mutant.key]) for mutant in group]
    return "".join(parts)


def _row(mutant: Mutant, result: Any) -> str:
    place = mutant.file.split("/", 1)[1]
    noticed = f"`{result.test.split('::', 1)[-1]}`" if result.status == "killed" else f"**{result.status}**"
    return f"| {mutant.error} | `{place}` | {noticed} |\n"
