"""What all sets that were fitted say: the leading one, what may stand in a member's place, how sure."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray, IntArray
from fieldmodels.diagnosis.candidates import Candidates
from fieldmodels.diagnosis.curves import Curves, Scored
from fieldmodels.diagnosis.fit import fit, refit
from fieldmodels.diagnosis.linearisation import Fit, reweighed, stacked
from fieldmodels.diagnosis.marginal import Evidence
from fieldmodels.diagnosis.misshapen import misshapen
from fieldmodels.diagnosis.phrases import CURVE
from fieldmodels.diagnosis.problem import Problem
from fieldmodels.diagnosis.search import Search
from fieldmodels.diagnosis.sets import Hypothesis, label, settled
from fieldmodels.diagnosis.whitening import whitener_by_output
from fieldmodels.drivers.variables import SHARE

SAME = 3.0
"""Nats within which sets are not told apart: the one with fewest curves and members leads."""
TOLD = 2 * SAME
"""Nats from the best within which sets say what may stand in a member's place: as many for each record."""
PART = 0.02
"""Share of what a curve brings within which a name takes its place: first-order columns of a curve are
interpolated between samples, where a name's are exact."""
SINE = 0.35
"""Sine to the span of curves below which what a name adds may be a part of theirs."""
NEAR = 15.0
"""Nats within which sets are asked how likely they make the test data."""
BEGUN = 5
"""Steps of a fit to the test windows by one weight an output, twice, before it goes on by its own weights."""
ALLOWED = 2.0
"""Nats that test windows may fall short of what two sets that differ by a member should differ in them."""
MOST = 2
"""Curves that may stand in another's place, as are said."""
RESAMPLED = 1000
"""Pairs of records that are put together from blocks of the two."""
KNOWN = ("sign", "size", "square with sign", "cube")
"""Known functions of a variable that are among what its curves may be."""

Place = tuple[str, str, str]


@dataclass(frozen=True)
class Posterior:
    """The leading set.

    Attributes:
        lead: The set.
        alternatives: Of each name, what may stand in its place: names, or curves in words.
        names: Of each name, the probability that it or one of its alternatives is there.
        instead: Of each curve, in order, where others act that are not told from it, and over what.
        curves: Of each curve, the probability that it or one of these is there.
        rivals: Sets with another name in the place of one, of those that are not told from the lead.
    """

    lead: Hypothesis
    alternatives: Mapping[str, tuple[str, ...]]
    names: Mapping[str, float]
    instead: tuple[tuple[Place, ...], ...]
    curves: tuple[float, ...]
    rivals: tuple[Hypothesis, ...]


def posterior_of(search: Search, testing: Problem, rng: np.random.Generator) -> Posterior:
    """The leading set of a search, and what all sets near it say of its members.

    Args:
        search: Over the training windows.
        testing: Windows that nothing was fitted to: how likely each set has made them counts as well.
        rng: Source of the resampling.
    """
    totals, blocks = _with_test(search, testing)
    order = sorted(totals, key=lambda one: totals[one])
    scores = np.array([totals[one] for one in order])
    weights = bagged(scores, np.array([blocks[one] for one in order]), rng)
    near = [one for one in order if totals[one] <= scores[0] + SAME]
    lead = _named_instead(search, min(near, key=lambda one: (len(one.curves), one.size)))  # then by score
    near = [one for one in order if totals[one] <= scores[0] + TOLD]
    instead = {name: _alternatives(search, lead, near, name) for name in lead.names}
    curves = tuple(_curves_instead(lead, near, own) for own in lead.curves)

    def probability(held: Sequence[bool]) -> float:
        return float(weights @ np.asarray(held, dtype=np.float64))

    return Posterior(
        lead=lead,
        alternatives=instead,
        names={n: probability([_holds(one, (n, *o)) for one in order]) for n, o in instead.items()},
        instead=curves,
        curves=tuple(
            probability([bool({_place(own), *others} & {*map(_place, one.curves)}) for one in order])
            for own, others in zip(lead.curves, curves, strict=True)
        ),
        rivals=tuple(
            one
            for one in near
            if not (one.curves or lead.curves)
            and one.size == lead.size
            and len({*one.names} - {*lead.names}) == 1
        ),
    )


def bagged(scores: FloatArray, blocks: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Probabilities of sets, on average over records that are put together from blocks of those at hand.

    A model that none of the sets completes makes one of them certain that another record would not (Huggins
    and Miller, Reproducible model selection using bagged posteriors, Bayesian Analysis 18, 2023).

    Args:
        scores: Negative log posterior of each set but for a constant [nats], shape (sets,).
        blocks: What each block of windows adds to it, shape (sets, blocks).
        rng: Source of the resampling.
    """
    count = blocks.shape[1]
    times = rng.multinomial(count, np.full(count, 1.0 / count), RESAMPLED) - 1.0
    values = scores[:, None] + (blocks - blocks[:1]) @ times.T
    weights = np.exp(values.min(axis=0) - values)
    return np.asarray((weights / weights.sum(axis=0)).mean(axis=1))


def _with_test(
    search: Search, testing: Problem
) -> tuple[dict[Hypothesis, float], dict[Hypothesis, FloatArray]]:
    """Scores of the sets near the best and of parts of the lead, with the evidence of the test windows.

    What a member of the lead has brought counts as far as the test windows repeat it: what noise of a kind
    that no model of it fits has seemed to show in one record, it does not show in another.

    Returns:
        The scores, and what each block of windows of either record adds.
    """
    evidence, order = Evidence(testing), search.ranked()
    found: dict[Hypothesis, tuple[Fit, float]] = {}
    blocks: dict[Hypothesis, FloatArray] = {}

    def tested(one: Hypothesis) -> tuple[Fit, float]:
        """Fit to the test windows and its evidence: the base is free there, effects as far as unknown."""
        if one not in found:
            problem = replace(testing, model=one.setting.problem.model)
            begun, free = one.fit.parameters, one.setting.candidates.free(one.candidate.effects)
            raw = problem.features - problem.simulate(begun[None], problem.states)[0]
            fitted = fit(problem, begun, free, whitener_by_output(problem, raw), problem.states, BEGUN)
            fitted = refit(problem, fitted, whitener_by_output(problem, fitted.raw), BEGUN)
            fitted = settled(evidence, problem, fitted)
            here = reweighed(problem, fitted, evidence.of(problem, fitted).whitener)
            known = reweighed(one.setting.problem, one.fit, search.marginal(one).whitener)
            base = one.setting.candidates.free(())
            now, before = evidence.of(problem, fitted), search.marginal(one)
            found[one] = here, now.value + _moved(problem, known, here, base)
            records = ((before, one.setting.problem), (now, problem))
            blocks[one] = np.concatenate([_over(r.blocks, m.windows) for m, r in records])
        return found[one]

    near = [one for one in order if search.score(one) <= search.score(order[0]) + NEAR]
    totals = {one: search.score(one) + tested(one)[1] for one in (search.base, *near)}
    seen: set[Hypothesis] = set()
    while (lead := min(totals, key=lambda one: totals[one])) not in seen:
        seen.add(lead)
        here, own = tested(lead)
        for part in search.sets.parts(lead):
            there, without = tested(part)
            apart = 0.5 * float(np.sum(((here.raw - there.raw) @ here.whitener.T) ** 2))
            brought = max(search.marginal(part).value - search.marginal(lead).value, 0.0)
            due = min(apart, brought * len(testing) / len(search.base.setting.problem))
            lacking = brought * (1.0 - np.clip((without - own + ALLOWED) / (due + ALLOWED), 0.0, 1.0))
            fewer = search.score(part) - search.score(lead) + without - own
            total = totals[lead] + fewer - float(lacking)
            totals[part] = min(totals.get(part, math.inf), total)
    return totals, blocks


def _over(blocks: IntArray, windows: FloatArray) -> FloatArray:
    """Sums over the windows of each block."""
    return np.asarray(np.bincount(np.unique(blocks, return_inverse=True)[1], windows), dtype=np.float64)


def _moved(problem: Problem, known: Fit, here: Fit, base: IntArray) -> float:
    """What it costs that effects are what the training windows say, as exactly as these do [nats].

    Laplace's approximation: parameters that fit the test windows best are drawn from the posterior.

    Args:
        problem: The test windows.
        known: The fit to the training windows, whitened by its errors.
        here: The fit to the test windows, likewise.
        base: Parameters that may differ.
    """
    own = ~np.isin(here.free, base)
    if not own.any():
        return 0.0
    before, now = _beside_the_others(known, own), _beside_the_others(here, own)
    at = problem.coordinates(here.free).encode
    off = now @ (at(known.parameters[here.free]) - at(here.parameters[here.free]))[own]
    both, target = np.concatenate([before, now]), np.concatenate([np.zeros(len(before)), off])
    apart = target - both @ np.linalg.lstsq(both, target, rcond=1e-9)[0]
    least = (1e-6 * float(np.sum(both**2)) / both.shape[1] + 1e-12) * np.eye(both.shape[1])
    volume = np.linalg.slogdet(both.T @ both + least)[1] - np.linalg.slogdet(before.T @ before + least)[1]
    return 0.5 * float(apart @ apart + volume)


def _beside_the_others(here: Fit, own: NDArray[np.bool_]) -> FloatArray:
    """Columns of some parameters without what the others explain of them."""
    columns = stacked(here.jacobian) * here.active
    others, mine = columns[:, ~own], columns[:, own]
    return np.asarray(mine - others @ np.linalg.lstsq(others, mine, rcond=1e-9)[0])


def _holds(one: Hypothesis, some: Sequence[str]) -> bool:
    """Whether a set has one of some names, or of some curves in words."""
    return bool(set(some) & {*one.names, *map(_words, one.curves)})


def _place(scored: Scored) -> Place:
    return scored.curve.place, scored.curve.target, scored.curve.over


def _words(scored: Scored) -> str:
    return f"{CURVE}{scored.curve.direction}"


def _named_instead(search: Search, lead: Hypothesis) -> Hypothesis:
    """A set with a name in the place of a curve where that does nearly what the curve does."""
    for curve in lead.curves:
        rest = [other for other in lead.curves if other is not curve]
        without = search.sets.get(lead.names, rest)
        named = [
            one
            for one in search.sets
            if without is not None
            and one.setting.labels == without.setting.labels
            and len(one.names) == len(lead.names) + 1
            and set(lead.names) <= set(one.names)
        ]
        if without is None or not named:
            continue
        best, own = min(named, key=search.score), search.score(lead)
        if search.score(best) <= own + max(SAME, PART * (search.score(without) - own)):
            return best
    return lead


def _alternatives(search: Search, lead: Hypothesis, near: Sequence[Hypothesis], name: str) -> tuple[str, ...]:
    """What sets that are not told from the lead have in a name's place, or what it may be a part of."""
    rest, result = set(lead.names) - {name}, list[str]()
    for one in near:
        if name in one.names:
            continue
        if rest <= set(one.names) and one.size == lead.size:
            result += [other for other in one.names if other not in rest]
        if len(one.curves) > len(lead.curves) and set(one.names) <= set(lead.names):
            result += [_words(c) for c in one.curves if label(c) not in lead.setting.labels][:1]
    if not any(other.startswith(CURVE) for other in result):
        if lead.curves and _is_part(search, lead, name):
            result.append(_words(lead.curves[0]))
        elif not lead.curves and name in (shapes := _misshapen(search, lead)):
            result.append(shapes[name])
    return tuple(dict.fromkeys(result))


def _curves_instead(lead: Hypothesis, near: Sequence[Hypothesis], own: Scored) -> tuple[Place, ...]:
    """Where sets that are not told from the lead have another curve in a curve's place."""
    rest = {_place(other) for other in lead.curves if other is not own}
    places = [
        {*map(_place, one.curves)} - rest
        for one in near
        if one.names == lead.names and len(one.curves) == len(lead.curves)
    ]
    others = [next(iter(some)) for some in places if len(some) == 1]
    found = {(*place[:2], frozenset(_variables(place[2]))): place for place in reversed(others)}
    mine = _place(own)
    found.pop(
        (*mine[:2], frozenset(_variables(mine[2]))), None
    )  # of what is never negative, its size is the same
    return tuple(reversed(found.values()))[:MOST]


def _misshapen(search: Search, lead: Hypothesis) -> dict[str, str]:
    """Names for which another known function of their variable does as well, with that in words."""
    candidates: Candidates = lead.setting.candidates
    here = reweighed(lead.setting.problem, lead.fit, search.marginal(lead).whitener)
    kept = candidates.judged(lead.names, here, lead.candidate.search)
    beside = Curves(lead.setting.problem, here, candidates.options)
    return {name: _words(shape.scored) for name, shape in misshapen(beside, kept).items()}


def _is_part(search: Search, lead: Hypothesis, name: str) -> bool:
    """Whether what a name adds is, beside the base, what curves at a place of the lead's curves may be."""
    here, model, inner = lead.fit, lead.setting.problem.model, search.base.setting.problem.model
    effect, own = inner.effect(name), model.slice_of(name)
    waves = [c for c in lead.curves if c.curve.place == "force" and "time" in _variables(c.curve.over)]
    if waves and effect.where == "force" and any(p.unit == "Hz" for p in effect.parameters):
        return True  # a periodic force is a curve over time
    slope = lead.setting.problem.coordinates(here.free).slope(here.parameters[here.free])
    nominal = np.array([p.nominal for p in model.all_parameters])
    mine = (here.free >= own.start) & (here.free < own.stop) & here.active
    added = stacked(here.jacobian) @ ((here.parameters - nominal)[here.free] / slope * mine)
    base = stacked(here.jacobian[:, :, (here.free < len(inner.parameters)) & here.active])
    spans = [stacked(here.jacobian[:, :, (here.free >= len(inner.names)) & here.active])]
    beside = search.curves_beside(lead).reweighed(here)
    for scored in lead.curves:
        place, target, over = _place(scored)
        some = {*_variables(over), over}
        tables = [
            c
            for c in beside.all
            if (c.place, c.target.removeprefix(SHARE)) == (place, target.removeprefix(SHARE))
            and c.over in some
            and not c.formula
        ]
        functions = [f for f in beside.functions(tables) if f.formula in KNOWN]
        spans += [stacked(beside.response(c)) for c in (*tables, *functions)]
    return _sine(added, np.concatenate(spans, axis=1), base) < SINE


def _sine(column: FloatArray, span: FloatArray, known: FloatArray) -> float:
    """Sine of the angle between a column and a span, both beside known columns."""
    unit = np.linalg.qr(_scaled(known))[0]
    column, span = column - unit @ (unit.T @ column), _scaled(span)
    span = span - unit @ (unit.T @ span)
    left, sizes, _ = np.linalg.svd(span, full_matrices=False)
    left = left[:, sizes > 1e-3 * np.max(sizes, initial=0.0)]
    away = column - left @ (left.T @ column)
    return float(np.linalg.norm(away) / (np.linalg.norm(column) + 1e-300))


def _scaled(columns: FloatArray) -> FloatArray:
    return np.asarray(columns / (np.sqrt(np.sum(columns**2, axis=0)) + 1e-300))


def _variables(over: str) -> set[str]:
    """The signals that a variable is made of."""
    plain = re.sub(r"^play of (.*) of [-+\d.e]+$", r"\1", over)
    plain = re.sub(r"memory of (.*?) over [-+\d.e]+ s", r"\1", plain)
    return {part.removeprefix("size of ").removeprefix("change of ") for part in plain.split(" times ")}
