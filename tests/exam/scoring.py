"""What became of a case: right, right within a set, wrong, misnamed, silent, abstained."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any, Literal

from exam.answers import CURVE, Answer
from exam.delivery import Delivery
from exam.places import shown_at

Outcome = Literal[
    "right alone", "in a set", "in a large set", "in part", "with a false one", "wrong", "abstained",
    "silent", "consistent", "doubted", "false name", "misnamed", "near name", "curve", "elsewhere", "both",
    "unexplained", "refused", "out of reach", "failed", "held", "not held", "skipped",
]  # fmt: skip
RIGHT: tuple[Outcome, ...] = ("right alone", "in a set")
"""Outcomes that count as right where something listed is hidden."""
WRONG: tuple[Outcome, ...] = ("wrong", "with a false one")
"""Outcomes in which something is named that is not there."""
SAID: tuple[Outcome, ...] = (*RIGHT, "near name", "curve", "both", "unexplained", "refused")
"""Outcomes that say what is wrong, and where; or, where nobody can, that."""
FALSE: tuple[Outcome, ...] = (*WRONG, "misnamed", "false name", "elsewhere")
"""Outcomes in which a name or a place is false."""
SMALL = 3
"""Names in a set that still says something; a curve is none."""
RANKS: Mapping[str, int] = {
    "right alone": 5, "near name": 5, "curve": 4, "in a set": 4, "in a large set": 3, "in part": 3,
    "abstained": 2, "silent": 1, "elsewhere": 1, "with a false one": 0, "wrong": 0, "misnamed": 0,
    "failed": 0,
}  # fmt: skip
"""How good an answer is, to see whether more data make it worse."""


def of_nothing(answer: Answer, allowed: Sequence[str] = ()) -> Outcome:
    """Judge an answer where nothing is hidden: ``consistent``, ``doubted`` or ``false name``.

    Args:
        answer: The answer.
        allowed: Effects that the noise itself has (a rounding sensor), so that their names are not false.
    """
    sets = [set(cause) - {CURVE} for cause in answer.named]
    if any(one and not one & set(allowed) for one in sets):
        return "false name"
    quiet = answer.verdict == "consistent" and not answer.missing
    return "consistent" if quiet or (sets and all(sets)) else "doubted"


def of_listed(answer: Answer, hidden: Sequence[str]) -> Outcome:
    """Judge an answer where listed effects are hidden.

    ``right alone``: the hidden effects and no others are named. ``in a set`` or ``in a large set``: each
    named cause holds another one of them among what the data cannot tell apart. ``in part``: some are named,
    and nothing else. ``with a false one``: all are named, and something beside them. ``wrong``: a name that
    leads astray. ``silent``: nothing is missing, it says. ``abstained``: no name.
    """
    sets = [set(cause) for cause in answer.named if set(cause) != {CURVE}]
    if not sets:
        return "silent" if answer.verdict == "consistent" else "abstained"
    hits = _matched(sets, hidden)
    if hits < len(sets):
        return "with a false one" if hits == len(hidden) else "wrong"
    if hits < len(hidden):
        return "in part"
    if all(len(one) == 1 for one in sets):
        return "right alone"
    return "in a set" if max(len(one - {CURVE}) for one in sets) <= SMALL else "in a large set"


def of_unlisted(answer: Answer, near: Sequence[str], shows: Sequence[str]) -> Outcome:
    """Judge an answer where a fault is hidden that no model lists.

    ``misnamed``: a cause has a listed name, and says neither that it may be a curve nor the same in a listed
    word. ``near name``: it does the latter. ``curve``: it shows a curve where the fault acts, alone or as
    what a name may be. ``elsewhere``: it shows curves, and none of them there. ``abstained``: something is
    missing, it says, but not what. ``silent``: nothing is missing, it says.

    Args:
        answer: The answer.
        near: Names that say the same.
        shows: Where a curve that is the fault acts, and over what; see ``places.shown_at``.
    """
    if any(CURVE not in cause and not _says(cause, near) for cause in answer.named):
        return "misnamed"
    if any(_says(cause, near) for cause in answer.named):
        return "near name"
    if answer.named or answer.curve:
        return "curve" if any(shown_at(*one, shows) for one in answer.curves) else "elsewhere"
    return "silent" if answer.verdict == "consistent" and not answer.missing else "abstained"


def of_mixed(answer: Answer, effect: str, near: Sequence[str], shows: Sequence[str]) -> Outcome:
    """Judge an answer where a listed effect and a fault that no model lists are hidden.

    ``both``: the effect is named, alone or in a set, and beside it a curve where the fault acts, or the fault
    in a listed word. ``in part``: the effect alone. ``misnamed``: a further cause has a listed name and says
    neither that it may be a curve nor the fault in a listed word. ``curve``: the effect is not named, and a
    curve is shown where the fault acts. ``elsewhere``: curves are shown, and none of them there.
    """
    others = [cause for cause in answer.named if effect not in cause]
    if any(CURVE not in cause and not _says(cause, near) for cause in others):
        return "misnamed"
    found, shown = len(others) < len(answer.named), bool(others or answer.curve)
    if not shown:
        unnoticed = answer.verdict == "consistent" and not answer.missing
        return "in part" if found else "silent" if unnoticed else "abstained"
    there = any(_says(cause, near) for cause in others)
    if not there and not any(shown_at(*one, shows) for one in answer.curves):
        return "elsewhere"
    return "both" if found else "curve"


def _says(cause: Sequence[str], near: Sequence[str]) -> bool:
    """Whether a cause says what a fault is in a listed word."""
    return any(name == one or name.endswith(f"_{one}") for name in cause for one in near)


def _matched(sets: Sequence[set[str]], hidden: Sequence[str]) -> int:
    """How many causes can be given a hidden effect each of their own."""
    best = 0
    for order in itertools.permutations(hidden):
        for chosen in itertools.combinations(sets, min(len(sets), len(order))):
            best = max(best, sum(name in one for name, one in zip(order, chosen, strict=False)))
    return best


def of_silence(answer: Answer, attainable: Mapping[str, Any] | None, anything: bool = False) -> float | None:
    """How large a fault that stays unseen is, in the smallest one that the answer says it would have seen.

    Both are what is added to the error of the output that suffers most, on windows of the refitted nominal
    machine: by the fault, and by the smallest curve at that place where most is needed. Above one the fault
    is larger than any curve that it says it would have seen, wherever the fault acts.

    Args:
        answer: The answer.
        attainable: The output that suffers most, and the share of its error that is the fault's.
        anything: Whether to compare with the most that anything may add, it says, if that is larger: a
            fault need not be a curve.

    Returns:
        None if nothing is stated of that output.
    """
    if attainable is None:
        return None
    stated = power(answer, attainable["output"], anything)
    if stated is None:
        return None
    size = math.sqrt(max(1.0 - (1.0 - attainable["share"]) ** 2, 0.0)) / stated
    return round(size, 3)


def power(answer: Answer, output: str, anything: bool = False) -> float | None:
    """The smallest curve that would have shown, as a part of an output's error; None if none is stated."""
    stated = max(answer.seen.get(output, 0.0), answer.unseen.get(output, 0.0) if anything else 0.0)
    before = answer.errors.get(output, (0.0, 0.0))[0]
    return stated / before if stated > 0.0 and before > 0.0 else None


def of_delivery(delivery: Delivery) -> dict[str, Any]:
    """What of a delivery the table counts, as plain data: null where a window runs away."""
    return {
        "extended": delivery.extended,
        "broken": delivery.broken,
        "over_stated": _finite(delivery.over_stated),
        "over_before": _finite(delivery.over_before),
    }


def _finite(value: float) -> float | None:
    return round(value, 4) if math.isfinite(value) else None


def deviations(hidden: Mapping[str, Mapping[str, float]], answer: Answer) -> dict[str, float]:
    """How far each named parameter of a hidden effect is from the truth, in its standard errors."""
    result = {}
    for effect, values in hidden.items():
        for name, true in values.items():
            value, std = answer.values.get(effect, {}).get(name, (math.nan, math.nan))
            if std > 0 and math.isfinite(std):
                result[f"{effect}.{name}"] = round((value - true) / std, 3)
    return result
