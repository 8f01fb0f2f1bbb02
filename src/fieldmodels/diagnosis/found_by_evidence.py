"""What a search by evidence finds: names and curves with probabilities, and the checks of the data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fieldmodels.diagnosis.budget import SEARCH
from fieldmodels.diagnosis.candidates import Candidate, Candidates
from fieldmodels.diagnosis.causes import (
    beside_the_others,
    causes_of,
    path_to,
    quantisation_found,
    told_from_neutral,
)
from fieldmodels.diagnosis.curves import Curves, Scored
from fieldmodels.diagnosis.extension import Extension, compared, final
from fieldmodels.diagnosis.found import Found
from fieldmodels.diagnosis.gain import predict
from fieldmodels.diagnosis.linearisation import reweighed
from fieldmodels.diagnosis.posterior import Posterior, posterior_of
from fieldmodels.diagnosis.problem import Problem
from fieldmodels.diagnosis.relation import CERTAIN, is_unrelated
from fieldmodels.diagnosis.result import Cause
from fieldmodels.diagnosis.search import Search
from fieldmodels.diagnosis.selection import Selection
from fieldmodels.diagnosis.sets import Hypothesis
from fieldmodels.diagnosis.signs import mistaken_columns
from fieldmodels.diagnosis.stages import Progress
from fieldmodels.diagnosis.statements import explained
from fieldmodels.diagnosis.verdict import Judgement, far_from_noise
from fieldmodels.drivers.curved import Curved
from fieldmodels.recording import Recording

LIKELY = 0.5
"""Share of the error above the noise that an answer must explain to be likelier than not."""


def found_by_evidence(
    candidates: Candidates,
    train: Sequence[Recording],
    testing: Problem,
    report: Progress,
    rng: np.random.Generator,
) -> Found:
    """Search by evidence, and say what the search says, unless the data themselves are at fault."""
    report("searching sets of causes", 0.1)
    search, within = Search(candidates), candidates.budget.within
    within("larger sets", search.run, None, SEARCH)
    report("measuring the gain", 0.8)
    said, base = posterior_of(search, testing, rng.spawn(1)[0]), search.base.candidate
    kept = _names_alone(candidates, search, said)
    fits = (base.fit, kept.fit) if said.lead.names else (base.fit,)
    options, problem = candidates.options, candidates.problem
    mistaken = within(
        "mistaken columns", lambda: mistaken_columns(problem.model, train, candidates, kept.fit), ""
    )
    unrelated = not mistaken and is_unrelated(problem, testing, fits, options.level)
    beside = search.sets.linear(said.lead).fit  # of the simulation without curves
    curves = tuple(
        replace(one, p_value=1.0 - p, candidate=replace(one.candidate, fit=beside), instead=others)
        for one, p, others in zip(said.lead.curves, said.curves, said.instead, strict=True)
    )
    if mistaken or unrelated or problem.is_exact(base.fit.raw):
        kept, curves = base, ()
    kept, possible = within(
        "which effects differ from none",
        lambda: told_from_neutral(candidates, path_to(candidates, base, kept), testing, rng),
        (kept, tuple[Cause, ...]()),
    )
    path = path_to(candidates, base, kept)
    causes = beside_the_others(causes_of(candidates, path, testing, rng), candidates, path, testing, rng)
    causes = tuple(_told(cause, said) for cause in causes)
    before = predict(testing, base.fit.parameters)
    after, share = predict(testing, kept.fit.parameters) if causes else before, 1.0
    if not (mistaken or unrelated):
        model = said.lead.setting.problem.model
        full = predict(replace(testing, model=model), said.lead.fit.parameters) if curves else after
        share = explained(testing, before, full, options.unexplained_ratio)
        causes = tuple(replace(cause, chance=1.0 - share * (1.0 - cause.chance)) for cause in causes)
        curves = tuple(replace(one, p_value=1.0 - share * (1.0 - one.p_value)) for one in curves)
        far = not (said.lead.size or model.random_force) and far_from_noise(
            testing, before, False, options.far
        )
        share = 0.0 if far else share
        if share < LIKELY and (said.lead.size or far):
            possible, causes, kept, after, full = (*possible, *causes), (), base, before, before
            curves = curves or tuple(scored for _, scored in search.judged_beside(search.base)[:1])
        rounded = quantisation_found(train, testing, full)
        causes = (*causes, *rounded)
        if rounded:  # what a curve of a sensor makes of its steps
            curves = tuple(one for one in curves if one.curve.place != "sensor")
    if not (causes or possible or curves or mistaken or unrelated):
        unrelated = is_unrelated(problem, testing, fits, options.level, CERTAIN)
    rivals = tuple(one.candidate for one in said.rivals) if kept.effects == said.lead.names else ()
    selection = Selection(base, kept, rivals, base, _singles(search), tuple(candidates.unidentifiable))
    beside_base = Curves(problem, base.fit, options)
    tried = Curves(problem, kept.fit, options) if kept.effects else beside_base
    judged = Judgement(kept, tried, beside_base, curves)
    extension = _extension(search, said.lead, kept, curves)
    if extension is not None and compared(extension.predict(testing), after) >= 0.0:
        extension = None
    return Found(
        mistaken,
        unrelated,
        selection,
        judged,
        causes,
        possible,
        curves,
        share >= LIKELY,
        before,
        after,
        extension,
    )


def _extension(
    search: Search, lead: Hypothesis, kept: Candidate, curves: Sequence[Scored]
) -> Extension | None:
    """The simulation with all members of a set as the search has fitted it; None if not all of them stand."""
    whole, model = lead.setting.problem, lead.setting.problem.model
    if not isinstance(model, Curved) or (kept.effects, len(curves)) != (lead.names, len(lead.curves)):
        return None
    fitted = reweighed(whole, lead.fit, search.marginal(lead).whitener)
    return Extension(model, fitted, final(curves, fitted, search.sets.own), 0.0)


def _told(cause: Cause, said: Posterior) -> Cause:
    """A cause with what may stand in its place, and the probability that neither is there."""
    name = cause.effect
    return replace(cause, alternatives=said.alternatives[name], chance=max(1.0 - said.names[name], 0.0))


def _names_alone(candidates: Candidates, search: Search, said: Posterior) -> Candidate:
    """The names of the leading set without its curves, weighed by what they leave."""
    names, problem, base = said.lead.names, candidates.problem, search.base.candidate
    if not names:
        return base
    if (alone := search.sets.get(names)) is None:
        begun = candidates.fitted(names, said.lead.fit.parameters[: search.sets.own], said.lead.fit.states)
        alone = search.sets.keep(Hypothesis(names, search.base.setting, begun))
    search.sets.settle(alone)
    fitted = reweighed(problem, alone.fit, search.marginal(alone).whitener)
    return candidates.judged(names, fitted, said.lead.candidate.search)


def _singles(search: Search) -> tuple[Candidate, ...]:
    """The single names that were fitted, the best first."""
    return tuple(one.candidate for one in search.ranked() if len(one.names) == 1 and not one.curves)
