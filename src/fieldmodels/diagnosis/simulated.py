"""What the whole simulation says of curves and names that are judged to first order.

Faults that are seen by far change the motion so much that what explains most of them to first order need not
be what explains them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.candidates import Candidate, Candidates
from fieldmodels.diagnosis.curves import Curves, Scored
from fieldmodels.diagnosis.extension import compared, cost, extend, first_cost
from fieldmodels.diagnosis.fit import refit
from fieldmodels.diagnosis.gain import predict
from fieldmodels.diagnosis.problem import Problem
from fieldmodels.diagnosis.selection import unexplained
from fieldmodels.diagnosis.verdict import Judgement
from fieldmodels.diagnosis.whitening import covariance_whitener

KEPT = 0.75
"""Share of what a curve promises to first order, of which it must keep as much for no other to be tried."""
OTHERS = 3
"""Other curves that are tried."""
AS_WELL = 0.01
"""Mean logarithm of test errors by which what has fewer names may be worse,"""
BETTER = 0.05
"""and by which it must be better where only the price of names speaks for it."""

HOPELESS = 100.0
"""Nats by which fewer names are too dear with tables that end at their knots for these to be let go on."""


def that_keep_their_promise(
    candidates: Candidates, judged: Judgement, found: Sequence[Scored]
) -> tuple[Scored, ...]:
    """Curves, the first of which gives way to one that explains more in the whole simulation.

    Others are tried where the first does not keep what it promises to first order (a motor's torque as a
    function of the acceleration that it causes).

    Args:
        candidates: What fits the sets.
        judged: What stands, and what was tried beside it.
        found: The curves beside it, the most important first.
    """
    kept, tried = judged.kept, judged.tried
    if not found or _keeps(candidates, kept, found[:1]):
        return tuple(found)
    whitener = _of_what_is_left(candidates, kept, found[:1])
    # A function of a variable may be another one than it seems to first order, too: tables are tried.
    choices = [found[0], *tried.judge(kept)[:OTHERS]]
    best = min(choices, key=lambda one: cost(candidates, kept, [one], whitener))
    if best is found[0]:
        return tuple(found)
    return best, *tried.rivals(best.candidate, candidates.options.most_curves - 1)


def _keeps(candidates: Candidates, kept: Candidate, curves: Sequence[Scored]) -> bool:
    """Whether curves bring in the whole simulation what they promise."""
    extension = extend(candidates, kept, curves)
    promised = sum(one.total for one in curves)
    return extension is not None and extension.gain > KEPT * promised


def _of_what_is_left(candidates: Candidates, kept: Candidate, curves: Sequence[Scored]) -> FloatArray:
    """Weights of the errors that the simulation with curves leaves: those before it make all curves alike."""
    extension = extend(candidates, kept, curves)
    return covariance_whitener(candidates.problem, kept.fit if extension is None else extension.fit)


def without_imitators(
    candidates: Candidates, base: Candidate, judged: Judgement, testing: Problem
) -> Judgement:
    """What stands, without names in whose place curves do as well in the whole simulation.

    Names are fitted to the whole data, curves that compete with them by one linear step; and where several
    imitate one curve, each is covered by the others as long as it is looked for beside them. Names go if
    fewer names and curves explain the training data as well, each number at its price, and the test data are
    explained as well; or if they do so only with the price of names, which two names that imitate one curve
    must bring, and the test data are explained better. Nothing is tried where the names explain all. Curves
    that bring nothing in the whole simulation go first: else a name would go in their stead, for a curve that
    does what it did.

    Args:
        candidates: What fits the sets.
        base: The base alone.
        judged: What stands, and the curves beside it.
        testing: Test windows.
    """
    problem, kept = candidates.problem, judged.kept
    if not kept.effects or not (judged.curves or unexplained(problem, kept.fit)):
        return judged
    whole = extend(candidates, kept, judged.curves)
    weights = covariance_whitener(problem, kept.fit if whole is None else whole.fit)
    after = predict(testing, kept.fit.parameters) if whole is None else whole.predict(testing)
    others, now = list[tuple[float, Judgement]](), _price(candidates, judged, weights)
    if judged.curves:
        alone, by_names = replace(judged, curves=()), predict(testing, kept.fit.parameters)
        price = _price(candidates, alone, weights)
        if price < now + candidates.options.undecided and compared(by_names, after) < AS_WELL:
            judged, now, after = alone, price, by_names
            if not unexplained(problem, kept.fit):
                return judged
    for one in _parts(candidates, base, kept):
        beside = Curves(problem, one.fit, candidates.options)
        curves = tuple(beside.rivals(one))
        for count in range(1, len(curves) + 1):
            other = replace(judged, kept=one, tried=beside, curves=curves[:count])
            if (less := _count(judged) - _count(other)) <= 0:
                continue
            needed, names = -candidates.options.undecided, candidates.options.price_of_name * less
            first = now - first_cost(candidates, one, other.curves, weights)
            if first + names <= needed - HOPELESS:
                continue
            lead = now - _price(candidates, other, weights)
            priced = lead + names
            if priced > needed:
                instead = extend(candidates, one, other.curves)
                limit = AS_WELL if lead > needed else -BETTER
                if instead is not None and compared(instead.predict(testing), after) < limit:
                    others.append((priced, other))
    if not others:
        return judged
    _, best = max(others, key=lambda pair: pair[0])
    gone = tuple(name for name in kept.effects if name not in best.kept.effects)
    unsure = {name: words for name, words in judged.unsure.items() if name not in gone}
    return replace(best, beaten=(*judged.beaten, *gone), unsure=unsure)


def _parts(candidates: Candidates, base: Candidate, kept: Candidate) -> list[Candidate]:
    """Nothing, each single one, and all but one of some names."""
    result = {frozenset[str](): base}
    less = [candidates.without(kept, name) for name in kept.effects] if len(kept.effects) > 1 else []
    result |= {frozenset(one.effects): one for one in less}
    for name in kept.effects if len(kept.effects) > 2 else ():
        one = kept
        for gone in kept.effects:
            one = one if gone == name else candidates.without(one, gone)
        result[frozenset(one.effects)] = one
    return list(result.values())


def _price(candidates: Candidates, judged: Judgement, weights: FloatArray) -> float:
    """Cost of names and the curves beside them, with the price of their numbers [nats]."""
    if judged.curves:
        return cost(candidates, judged.kept, judged.curves, weights)
    fitted = refit(candidates.problem, judged.kept.fit, weights)
    return fitted.cost + candidates.options.price * judged.kept.size


def _count(judged: Judgement) -> int:
    """Of names and curves."""
    return len(judged.kept.effects) + len(judged.curves)
