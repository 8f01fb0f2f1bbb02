"""Names beside curves, once both are fitted together: what is neutral there is possible, and no name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from fieldmodels.diagnosis.candidates import Candidate, Candidates
from fieldmodels.diagnosis.causes import beside_the_others, path_to, refitted
from fieldmodels.diagnosis.curves import Scored
from fieldmodels.diagnosis.extension import cost, improving
from fieldmodels.diagnosis.gain import predict
from fieldmodels.diagnosis.problem import Problem
from fieldmodels.diagnosis.result import Cause
from fieldmodels.diagnosis.uncertainty import differs_from_neutral


def told_together(
    candidates: Candidates,
    base: Candidate,
    kept: Candidate,
    causes: Sequence[Cause],
    curves: Sequence[Scored],
    testing: Problem,
    rng: np.random.Generator,
) -> tuple[Candidate, tuple[Cause, ...], tuple[Cause, ...]]:
    """The names that differ from neutral in the extended simulation, too, and what does not.

    A curve may do what a name seemed to do while it stood without it.

    Args:
        candidates: What fits the sets.
        base: The base alone.
        kept: The base with the names.
        causes: The names with their values and gains.
        curves: The curves beside them.
        testing: Test windows.
        rng: Source of randomness.

    Returns:
        The base with the names that stay, these, and what is only possible, with its values there.
    """
    possible: list[Cause] = []
    while causes:
        after = predict(testing, kept.fit.parameters)
        extension = improving(candidates, kept, curves, testing, after)
        if extension is None:
            break
        problem = replace(candidates.problem, model=extension.model)
        again = [refitted(cause, problem, extension.fit) for cause in causes]
        doubtful = [cause for cause in again if not differs_from_neutral(problem, extension.fit, cause)]
        rests = {
            cause.effect: candidates.without(kept, cause.effect) if len(kept.effects) > 1 else base
            for cause in doubtful
        }
        # That a curve is nearly the same makes a value uncertain, too, while one of both is needed.
        price = partial(
            cost, candidates, curves=curves[: len(extension.curves)], whitener=extension.fit.whitener
        )
        most = price(kept) + candidates.options.least_gain
        needless = [cause for cause in doubtful if price(rests[cause.effect]) <= most]
        if not needless:
            break
        weakest = min(needless, key=lambda cause: cause.nats)
        possible.append(weakest)
        kept, left = rests[weakest.effect], [cause for cause in causes if cause.effect != weakest.effect]
        causes = beside_the_others(left, candidates, path_to(candidates, base, kept), testing, rng)
    return kept, tuple(causes), tuple(possible)
