"""What the whole simulation says of curves and names that are judged to first order.

Faults that are seen by far change the motion so much that what explains most of them to first order need not
be what explains them.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.candidates import Candidate, Candidates
from fieldmodels.diagnosis.curves import Scored
from fieldmodels.diagnosis.extension import extend
from fieldmodels.diagnosis.verdict import Judgement

KEPT = 0.75
"""Share of what a curve promises to first order, of which it must keep as much for no other to be tried."""
OTHERS = 3
"""Other curves that are tried."""


def told_apart(candidates: Candidates, judged: Judgement, found: Sequence[Scored]) -> tuple[Scored, ...]:
    """Curves, the first of which gives way to one that explains more in the whole simulation.

    Others are tried where they explain as much to first order at another place (a heater that fades and a
    thermometer that does), or the first does not keep what it promises (a motor's torque as a function of the
    acceleration that it causes).

    Args:
        candidates: What fits the sets.
        judged: What stands, and what was tried beside it.
        found: The curves beside it, the most important first.
    """
    if not found:
        return ()
    kept, tried, first, options = judged.kept, judged.tried, found[0], candidates.options
    least = _cost(candidates, kept, [first])
    broken = kept.fit.cost - least < KEPT * first.total
    near = first.candidate.total + options.undecided
    others = [
        s for s in tried.judge(kept) if broken or (_acts(s) != _acts(first) and s.candidate.total < near)
    ]
    best, least = first, least - options.undecided
    for one in others[:OTHERS]:
        # A function of a variable may be another one than it seems to first order, too.
        other = one if broken else tried.as_formula(kept, one)
        cost = _cost(candidates, kept, [other])
        if cost < least:
            best, least = other, cost
    if best is first:
        return tuple(found)
    return best, *tried.rivals(best.candidate, options.most_curves - 1)


def without_the_spare(candidates: Candidates, base: Candidate, judged: Judgement) -> Judgement:
    """What stands, without names that a single curve makes spare in the whole simulation.

    To first order a name may explain most of what it imitates, and a curve beside it the rest.

    Args:
        candidates: What fits the sets.
        base: The base alone.
        judged: What stands to first order.
    """
    kept, tried = judged.kept, judged.beside_base
    if not kept.effects or not judged.curves:
        return judged
    whitener = kept.fit.whitener
    most = _cost(candidates, kept, judged.curves, whitener) + candidates.options.least_gain
    for one in itertools.islice(tried.judge(base), OTHERS):
        other = tried.as_formula(base, one)
        if _cost(candidates, base, [other], whitener) < most:
            return Judgement(base, tried, tried, (other,), beaten=(*judged.beaten, *kept.effects))
    return judged


def _acts(scored: Scored) -> tuple[str, str, str]:
    """Where a curve acts, and over what."""
    curve = scored.curve
    return curve.place, curve.target, curve.over


def _cost(
    candidates: Candidates, kept: Candidate, curves: Sequence[Scored], whitener: FloatArray | None = None
) -> float:
    """Of the simulation with curves, and their price [nats]."""
    extension = extend(candidates, kept, curves, whitener)
    count = kept.size + sum(len(one.coefficients) for one in curves)
    cost = kept.fit.cost if extension is None else extension.fit.cost
    return cost + candidates.options.price * count
