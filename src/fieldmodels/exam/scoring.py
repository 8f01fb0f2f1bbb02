"""What became of a case: right, right within a set, wrong, abstained."""

from __future__ import annotations

import itertools
import math
from typing import Any, Literal

from fieldmodels.diagnosis.result import Diagnosis
from fieldmodels.exam.cases import Case
from fieldmodels.model import EffectValues

Outcome = Literal[
    "right alone", "in a set of two", "in a larger set", "in part", "with a false one", "wrong", "abstained",
    "consistent", "unknown", "false name", "misnamed", "out of reach",
]  # fmt: skip
RIGHT: tuple[Outcome, ...] = ("right alone", "in a set of two")
"""Outcomes that count as right where something listed is hidden."""
WRONG: tuple[Outcome, ...] = ("wrong", "with a false one")
"""Outcomes in which something is named that is not there."""


def outcome(case: Case, found: Diagnosis) -> Outcome:
    """Judge a diagnosis.

    ``right alone``: the hidden effects and no others are named. ``in a set of two`` or ``larger``: each named
    cause holds another of the hidden effects among what the data cannot distinguish. ``in part``: one of a
    pair is named and nothing else. ``with a false one``: what is hidden is named, and something beside it.
    ``wrong``: a name that leads astray. ``abstained``: nothing is named. Where nothing listed is hidden:
    ``consistent`` or ``unknown``, and ``false name`` or ``misnamed`` if anything is named.
    """
    sets = [{cause.effect, *cause.alternatives} for cause in found.causes]
    if case.kind == "nothing":
        return "false name" if sets else "unknown" if found.verdict == "unknown" else "consistent"
    if case.kind == "outside":
        return "misnamed" if sets else "unknown" if found.verdict == "unknown" else "consistent"
    if not sets:
        return "abstained"
    hits = _matched(sets, case.hidden)
    if hits < len(sets):
        return "with a false one" if hits == len(case.hidden) else "wrong"
    if hits < len(case.hidden):
        return "in part"
    largest = max(len(s) for s in sets)
    return "right alone" if largest == 1 else "in a set of two" if largest == 2 else "in a larger set"


def _matched(sets: list[set[str]], hidden: tuple[str, ...]) -> int:
    """How many causes can be given a hidden effect each of their own."""
    best = 0
    for order in itertools.permutations(hidden):
        for chosen in itertools.combinations(sets, min(len(sets), len(order))):
            best = max(best, sum(name in s for name, s in zip(order, chosen, strict=False)))
    return best


def deviations(hidden: EffectValues, found: Diagnosis) -> dict[str, float]:
    """How far each named parameter of a hidden effect is from the truth, in its standard errors."""
    result = {}
    for cause in found.causes:
        for name, true in hidden.get(cause.effect, {}).items():
            estimate = cause.parameters[name]
            if estimate.std > 0 and math.isfinite(estimate.std):
                result[f"{cause.effect}.{name}"] = (estimate.value - true) / estimate.std
    return result


def named(found: Diagnosis) -> list[list[str]]:
    """Each cause with what the data cannot distinguish from it, as plain data."""
    return [[cause.effect, *cause.alternatives] for cause in found.causes]


def judged(case: Case, hidden: EffectValues, found: Diagnosis) -> dict[str, Any]:
    """All that the table needs of a diagnosis, as plain data."""
    return {
        "outcome": outcome(case, found),
        "verdict": found.verdict,
        "named": named(found),
        "more_is_missing": bool(found.causes) and found.unknown is not None,
        "deviations": {name: round(value, 3) for name, value in deviations(hidden, found).items()},
        "summary": found.summary(),
    }
