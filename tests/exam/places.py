"""Where a curve acts, and over what: whether that is what an exam lists.

An exam lists ``place target over first*second``: ``force over velocity``, ``sensor position over time``,
``parameter stiffness over position*velocity``. Names that mean the same stand with a bar between them
(``position|angle``, so that machines may share a line). Without a target any is right; without ``over`` any
variable is, since what is constant depends on none.

The variable of a curve is read as the set of signals in it. Words that leave the signal what it is are taken
off, with their numbers (``size of``, ``way of``, ``memory of``, ``play of``, ``change of``). ``rate of
position`` is ``velocity``; any other rate is a signal of its own. A curve fits a line if its signals are
those listed, all of them and no others. Where the line says ``past of torque``, what the torque was is what
matters: then the curve has to run over a memory, a play or a change of it.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass

PAST = "past of "
_WORD = re.compile(r"(size|way|memory|play|change) of ")
_NUMBER = re.compile(r" (?:over|of) [-+.\de]+(?: s)?$")
_SAME = {"rate of position": "velocity", "rate of angle": "velocity"}


@dataclass(frozen=True)
class Line:
    """What an exam lists, as read.

    Attributes:
        place: As of a diagnosis's curve.
        targets: Those that are right; none for any.
        variables: Sets of signals that are right; none for any.
    """

    place: str
    targets: frozenset[str]
    variables: tuple[frozenset[str], ...]


def shown_at(place: str, target: str, over: str, listed: Sequence[str]) -> bool:
    """Whether a curve is at one of the places that are listed, over what is listed there.

    Args:
        place: As of a diagnosis's curve.
        target: The same.
        over: The same.
        listed: See above.
    """
    found, aim = signals(over), target.replace("_", " ")
    return any(
        place == line.place
        and (not line.targets or aim in line.targets)
        and (not line.variables or any(_fits(found, one) for one in line.variables))
        for line in map(read, listed)
    )


def read(text: str) -> Line:
    """Read a line of an exam's list."""
    where, _, over = text.replace("_", " ").partition(" over ")
    place, _, targets = where.partition(" ")
    factors = [_alternatives(factor) for factor in over.split("*")] if over else []
    variables = tuple(map(frozenset, itertools.product(*factors))) if over else ()
    return Line(place, frozenset(targets.split("|") if targets else ()), variables)


def signals(over: str) -> frozenset[str]:
    """Signals in a curve's variable; ``past of`` those that it remembers."""
    found = set()
    for factor in over.replace("_", " ").split(" times "):
        name, past = _NUMBER.sub("", factor), ""
        while word := _WORD.match(name):
            name = name[word.end() :]
            past = PAST if word[1] not in ("size", "way") else past
        found.add(past + _SAME.get(name, name))
    return frozenset(found)


def _alternatives(factor: str) -> list[str]:
    past = PAST if factor.startswith(PAST) else ""
    return [past + name for name in factor.removeprefix(PAST).split("|")]


def _fits(found: frozenset[str], wanted: frozenset[str]) -> bool:
    same = {s.removeprefix(PAST) for s in found} == {s.removeprefix(PAST) for s in wanted}
    return same and all(s in found for s in wanted if s.startswith(PAST))
