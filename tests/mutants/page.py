"""The published page of the mutants."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

from table import Mutant

PAGE = "docs/mutants.md"
INTRODUCTION = """# Deliberate errors

![Deliberate errors by part of the project; tests notice all of them](pictures/mutants.svg)

A test suite is worth what it notices. `make mutants` puts {count} errors into a copy of the project, one at a
time: a flipped sign, a dropped term, exchanged parameters, a wrong power, a step too early, a wrong bound.
For each it runs the tests that ought to notice. An error counts as *killed* only if a test fails by an
assertion; one by which the program merely falls over would prove nothing of the tests. No comparison with
stored outputs takes part: each error is noticed by a property, a number from a source, or an independent
computation.

**{killed} of {count} are killed.** One after the other, their tests took {minutes:.0f} minutes, compiling
included. The tables lie in `tests/mutants/`; this page is written by `make mutants`. What `make test`
alone notices is said by `python tests/mutants/run.py --quick`.
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
