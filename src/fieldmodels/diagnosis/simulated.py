"""What the whole simulation says of curves and names that are judged to first order.

Faults that are seen by far change the motion so much that what explains most of them to first order need not
be what explains them.
"""

from __future__ import annotations

from collections.abc import Sequence

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.candidates import Candidate, Candidates
from fieldmodels.diagnosis.curves import Scored
from fieldmodels.diagnosis.extension import cost, extend
from fieldmodels.diagnosis.verdict import Judgement
from fieldmodels.diagnosis.whitening import covariance_whitener

KEPT = 0.75
"""Share of what a curve promises to first order, of which it must keep as much for no other to be tried."""
OTHERS = 3
"""Other curves that are tried."""


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
