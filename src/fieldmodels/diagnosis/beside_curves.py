"""Names beside an unlisted curve: what the curve adds is taken for given, and the search begins again.

Where a curve explains more than any set of names, a part of what it leaves may have a name: an end stop
beside a damper that nobody has listed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.candidates import Candidate, Candidates
from fieldmodels.diagnosis.causes import (
    beside_the_others,
    causes_of,
    confirmed,
    path_to,
    told_from_neutral,
    with_alternatives,
)
from fieldmodels.diagnosis.curves import Curves, Scored
from fieldmodels.diagnosis.extension import Extension, compared, cost, extend
from fieldmodels.diagnosis.gain import Prediction, predict
from fieldmodels.diagnosis.problem import Problem
from fieldmodels.diagnosis.result import Cause
from fieldmodels.diagnosis.selection import rivals_of, select, unexplained
from fieldmodels.diagnosis.verdict import Judgement, judge, with_formulas
from fieldmodels.diagnosis.whitening import covariance_whitener

GIVEN = ("force", "sensor")
"""Places of curves that can be given."""


@dataclass(frozen=True)
class Named:
    """What is named beside curves.

    Attributes:
        judged: The names, and the curves beside them.
        causes: The names with their values and gains, where what the first curve adds is given.
        after: Prediction of the test windows by the names alone.
    """

    judged: Judgement
    causes: tuple[Cause, ...]
    after: Prediction


def names_beside(
    candidates: Candidates, alone: Judgement, testing: Problem, rng: np.random.Generator
) -> Named | None:
    """Names that the data call for beside the first of some curves; None if there are none.

    With the curves beside them, and all fitted together, they must explain the training data better than
    the curves alone, each name at the price of one, and the test data as well.

    Args:
        candidates: What fits the sets.
        alone: The curves, where nothing is named.
        testing: Test windows.
        rng: Source of randomness.
    """
    found = _given(candidates, alone.kept, alone.curves[0], testing)
    if found is None:
        return None
    among, told = found
    if len(alone.curves) < 2 and not unexplained(among.problem, among.base().fit):
        return None
    selection = select(among, lambda _what, _share: None)
    chosen = confirmed(among, selection.base, selection.chosen, told)
    if not chosen.effects:
        return None
    if chosen is not selection.chosen:
        same = rivals_of(chosen, selection.alternatives, among.problem.blocks, among.options)
        selection = replace(selection, chosen=chosen, alternatives=same)
    path = path_to(among, selection.base, chosen)
    judged = judge(among, selection.base, told_from_neutral(among, path, told, rng)[0])
    together = _together(candidates, alone, judged.kept, testing)
    if together is None:
        return None
    kept, beside, curves = together
    last = judged.kept
    for name in set(last.effects) - set(kept.effects):
        last = among.without(last, name)
    path = path_to(among, selection.base, last)
    causes = with_alternatives(causes_of(among, path, told, rng), selection, replace(judged, kept=last))
    return Named(
        replace(alone, kept=kept, tried=beside, curves=with_formulas(beside, kept, curves)),
        beside_the_others(causes, among, path, told, rng),
        predict(testing, kept.fit.parameters),
    )


def _given(
    candidates: Candidates, base: Candidate, curve: Scored, testing: Problem
) -> tuple[Candidates, Problem] | None:
    """What fits sets, and the test windows, where what a curve adds is given; None if it cannot be."""
    extension = extend(candidates, base, [curve]) if curve.curve.place in GIVEN else None
    if extension is None:
        return None
    problem = with_curves_given(candidates.problem, extension, extension.fit.states)
    result = candidates.of(problem)
    # What the base absorbs could only be told by a curve that is given.
    result.unidentifiable.update(candidates.unidentifiable)
    own = extension.fit.parameters[: len(problem.model.names)]
    here = result.fitted((), own, extension.fit.states)
    result.whitener = covariance_whitener(problem, here.fit)
    result.begin(result.again(here))
    told = predict(replace(testing, model=extension.model), extension.fit.parameters)
    return result, with_curves_given(testing, extension, told.states)


def with_curves_given(problem: Problem, extension: Extension, states: FloatArray) -> Problem:
    """Windows in which what an extension's curves add is known.

    Args:
        problem: The windows.
        extension: The curves, as fitted.
        states: Initial states that fit them, shape (windows, states).
    """
    names = tuple(output.name for output in problem.model.outputs)
    parts, first = [], 0
    for part in problem.parts:
        last = first + len(part.windows)
        begun = part.windows.with_states(states[first:last])
        windows = extension.model.as_given(extension.fit.parameters, begun).with_states(part.windows.states)
        measured = np.nan_to_num(windows.measured(names))
        parts.append(replace(part, windows=windows, features=part.compressed(measured[None])[0]))
        first = last
    return replace(problem, parts=tuple(parts))


def _together(
    candidates: Candidates, alone: Judgement, given: Candidate, testing: Problem
) -> tuple[Candidate, Curves, Sequence[Scored]] | None:
    """Those of some names that are needed beside curves, all fitted together, and these; None if none is.

    Args:
        candidates: What fits the sets.
        alone: Curves without names.
        given: The names, as fitted where a curve is given.
        testing: Test windows.
    """
    problem, options, kept = candidates.problem, candidates.options, given
    if not kept.effects:
        return None
    kept = candidates.fitted(kept.effects, kept.fit.parameters, kept.fit.states, alone.kept.fit.whitener)
    beside = Curves(problem, kept.fit, options)
    curves = beside.rivals(kept)
    extension = extend(candidates, kept, curves)
    if extension is None:
        return None
    whitener = covariance_whitener(problem, extension.fit)

    def total(one: Candidate, with_curves: Sequence[Scored]) -> float:
        price = options.price_of_name * len(one.effects)
        return cost(candidates, one, with_curves, whitener) + price

    while kept.effects:
        several = len(kept.effects) > 1
        smaller = [candidates.without(kept, name) for name in kept.effects] if several else [alone.kept]
        best = min(smaller, key=lambda one: total(one, curves))
        if total(best, curves) > total(kept, curves) + options.least_gain:
            break
        kept = best
    if not kept.effects or total(alone.kept, alone.curves) < total(kept, curves) + options.least_gain:
        return None
    with_names, without = (extend(candidates, *one) for one in ((kept, curves), (alone.kept, alone.curves)))
    if with_names is None:
        return None
    if without is not None and compared(with_names.predict(testing), without.predict(testing)) >= 0.0:
        return None
    return kept, Curves(problem, kept.fit, options), curves
