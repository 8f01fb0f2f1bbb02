"""Model selection: which effects the data call for, and which of them are indistinguishable."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy import special

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.candidates import Candidate, Candidates
from fieldmodels.diagnosis.gain import noise_floor, predict
from fieldmodels.diagnosis.linearisation import Fit, project, pseudo_inverse, stacked
from fieldmodels.diagnosis.options import DEFAULT, DiagnosisOptions
from fieldmodels.diagnosis.problem import Problem
from fieldmodels.diagnosis.wander import (
    beside,
    beside_returning,
    follows_slowly,
    is_steady,
    wander,
    wanders_more,
)
from fieldmodels.diagnosis.whitening import covariance_whitener

IntArray = NDArray[np.int64]
Progress = Callable[[str, float], None]

RARE_P = 0.1  # of the test over blocks for a cause that acts in few of them only
STRONG_P = 1e-6  # of its likelihood-ratio test; noise that is not white reached 6e-6 where nothing was hidden
UNEVEN = 3.0  # times what it must bring, without its best block; 1.7 where nothing was hidden
AFFECTED = 0.01  # of the largest change by a cause in any block
SAME_ANYHOW = 2.0  # nats that count as none
CONTAINS = (
    0.1  # nats by which a set that contains another one may fit worse: fits end that near their optimum
)
PARENTS = 3  # best sets of each size that are extended
TRIED_AT_LEAST = 4  # extensions fitted, and all that promise half of what they must bring
OF_THE_WAY = 0.25  # to the best set's cost, which the first-order gain of another must promise
CERTAINLY_STEADY = 2.0  # times what it must bring, beside zeros that return; 1.2 where nothing was hidden
UNEXPLAINED = 1.5  # times its white noise that an error must be for what promises nothing to be tried
REFITTED_WITHIN = 60.0  # nats from the best; sets further off stay out of the comparison


@dataclass(frozen=True)
class Selection:
    """The selected effects.

    Attributes:
        base: The base alone, refitted.
        chosen: The chosen set (the base itself if no effect is significant).
        alternatives: Other sets of the same size that the data cannot distinguish from the chosen one.
        before: The base as fitted with the whitening of the ranking.
        ranking: All fits of the first round (single effects), best first.
        unidentifiable: Effects that the free parameters absorb.
        seldom: The chosen set with one effect more, which brings much, but in too few parts of the data.
    """

    base: Candidate
    chosen: Candidate
    alternatives: tuple[Candidate, ...]
    before: Candidate
    ranking: tuple[Candidate, ...]
    unidentifiable: tuple[str, ...]
    seldom: tuple[Candidate, ...] = ()


def block_p_value(gain: FloatArray, blocks: IntArray) -> float:
    """One-sided p-value of a mean gain above zero, by a t-test over blocks and over pairs of blocks."""
    result = 0.0
    for size in (1, 2):
        sums = np.bincount(np.unique(blocks // size, return_inverse=True)[1], weights=gain)
        if len(sums) < (4 if size == 1 else 12):
            continue
        spread = sums.std(ddof=1)
        if spread <= 1e-12 * max(1.0, float(np.abs(sums).max())):
            p = 0.0 if sums.mean() > 1e-9 else 1.0
        else:
            # Student's one-sided t-test, without the checks that take SciPy a millisecond.
            p = float(special.stdtr(len(sums) - 1, -sums.mean() / (spread / np.sqrt(len(sums)))))
        result = max(result, p)
    return result


def largest_share(gain: FloatArray, blocks: IntArray) -> float:
    """Gain of the block that gains most."""
    return float(np.bincount(np.unique(blocks, return_inverse=True)[1], weights=gain).max())


def accepted(
    parent: Candidate, child: Candidate, blocks: IntArray, options: DiagnosisOptions = DEFAULT
) -> bool:
    """Whether the data call for the effects that the child has and the parent has not."""
    gain = parent.loss - child.loss
    total = parent.total - child.total
    if (
        total <= max(options.least_gain, options.least_share * float(parent.loss.sum()))
        or child.fit.cost >= parent.fit.cost
    ):
        return False
    if block_p_value(gain, blocks) < options.level:
        return True
    if _one_more(parent, child) and far_beyond(gain, total, options.least_gain, blocks):
        return True
    return in_few_blocks(parent, child, blocks, options) < STRONG_P


def _one_more(parent: Candidate, child: Candidate) -> bool:
    return len(child.effects) == len(parent.effects) + 1


def far_beyond(gain: FloatArray, total: float, needed: float, blocks: IntArray) -> bool:
    """Whether something brings so much that it may be in some blocks, and be wrong in others.

    What begins at some time is fitted to all of it: it brings much in one part and costs something in the
    other, and a t-test over blocks sees their differences.

    Args:
        gain: Of every window [nats].
        total: All of it, after its price.
        needed: What it must bring.
        blocks: Of every window.
    """
    without_the_best = total - largest_share(gain, blocks)
    return without_the_best > UNEVEN * needed and block_p_value(gain, blocks) < RARE_P


def in_few_blocks(
    parent: Candidate, child: Candidate, blocks: IntArray, options: DiagnosisOptions = DEFAULT
) -> float:
    """p-value of one more effect that may act in few blocks only, such as a limit that is seldom reached.

    Returns:
        That of the gain in likelihood; 1 if a single block brings it, or the gain over blocks is nothing.
    """
    gain = parent.loss - child.loss
    total = parent.total - child.total
    if not _one_more(parent, child) or total - largest_share(gain, blocks) <= options.least_gain:
        return 1.0
    return likelihood_p_value(parent, child, blocks) if block_p_value(gain, blocks) < RARE_P else 1.0


def likelihood_p_value(parent: Candidate, child: Candidate, blocks: IntArray) -> float:
    """p-value of a child's gain in likelihood where errors may be correlated within a block of windows.

    A t-test over blocks has no power for a cause that acts in few of them: the gains themselves differ
    too much. Here the blocks only give the overdispersion of the errors along the cause's own direction,
    that of its score after the fit; twice the gain is divided by it (quasi-likelihood, McCullagh and Nelder
    1989, section 4.5), and compared with F.
    """
    new = ~np.isin(child.fit.free, parent.fit.free) & child.fit.active
    count = int(new.sum())
    if count == 0:
        return 1.0
    excess = dispersion(child.fit, new, blocks)
    if child.fit.observations is not None:
        excess = dispersion_of_change(parent.fit, child.fit, blocks)
    freedom = max(len(np.unique(blocks)) - count, 1)
    return dispersed_p_value(parent.total - child.total, count, excess, freedom)


def dispersed_p_value(gain: float, count: int, excess: float, freedom: int) -> float:
    """p-value of a gain [nats] by some parameters along which errors are overdispersed.

    Args:
        gain: The gain.
        count: Number of the parameters.
        excess: The overdispersion.
        freedom: Degrees of freedom with which that is known.
    """
    return float(special.fdtrc(count, freedom, max(2 * gain, 0.0) / (count * excess)))


def dispersion(fitted: Fit, which: NDArray[np.bool_], blocks: IntArray) -> float:
    """Overdispersion of the errors along some free parameters' own directions: 1 for white noise, or more.

    Mean square of the score over blocks, and over pairs of blocks, in units of its information.
    """
    count = int(which.sum())
    if count == 0:
        return 1.0
    own = stacked(fitted.jacobian[:, :, which])
    others = stacked(fitted.jacobian[:, :, ~which & fitted.active])
    if others.shape[1]:
        basis = np.linalg.qr(others)[0]
        own = own - basis @ (basis.T @ own)
    columns = own.reshape(*fitted.residual.shape, count)
    scores = np.einsum("wfk,wf->wk", columns, fitted.residual)
    powers = columns.transpose(0, 2, 1) @ columns
    result = 1.0
    for size in (1, 2):
        number = np.unique(blocks // size, return_inverse=True)[1]
        score, power = np.zeros((number.max() + 1, count)), np.zeros((number.max() + 1, count, count))
        np.add.at(score, number, scores)
        np.add.at(power, number, powers)
        inverse = pseudo_inverse(power, 1e-6)
        result = max(result, float(np.einsum("bk,bkl,bl->b", score, inverse, score).mean()) / count)
    return result


def dispersion_of_change(parent: Fit, child: Fit, blocks: IntArray) -> float:
    """The same along the whole change by a cause: with events, derivatives may vanish at the optimum.

    Blocks that the cause hardly affects are left out.
    """
    column = project(child, (parent.raw - child.raw)[:, :, None])[:, :, 0]
    scores, powers = np.sum(column * child.residual, axis=1), np.sum(column**2, axis=1)
    result = 1.0
    for size in (1, 2):
        number = np.unique(blocks // size, return_inverse=True)[1]
        score, power = np.bincount(number, scores), np.bincount(number, powers)
        affected = power > AFFECTED * power.max()
        if affected.any():
            result = max(result, float(np.mean(score[affected] ** 2 / power[affected])))
    return result


def select(candidates: Candidates, progress: Progress) -> Selection:
    """Name the effects that the data call for, one by one, or in pairs where neither is significant alone."""
    blocks = candidates.problem.blocks
    progress("refitting the base", 0.05)
    base = candidates.base()
    names = candidates.names()
    found = candidates.each(lambda name: candidates.identifiable(base, name), names)
    candidates.unidentifiable.update(
        name for name, identifiable in zip(names, found, strict=True) if not identifiable
    )
    progress("trying each effect", 0.1)
    level = _grown(candidates, [base])
    base = candidates.again(base)
    ranking, before, chosen, levels = tuple(level), base, base, {1: level}
    size, most = 1, candidates.options.most_causes
    looks = most  # so that no set leads to another one and back
    while size <= most:
        whitener = candidates.whitener
        if size > 1:
            progress(f"trying sets of {size}", 0.2 + 0.1 * size)
            parents = [c for c in level if c is not chosen][:PARENTS]
            children = _grown(candidates, [chosen, *parents] if chosen.effects else parents)
            larger = _called_for(candidates, candidates.again(chosen), parents, children)
            levels[size] = children
        else:
            children, larger = level, _called_for(candidates, base, [], level)
        again = larger is None and looks > 0 and chosen.effects
        if again and unexplained(candidates.problem, chosen.fit):
            weights, looks = candidates.whitener, looks - 1
            larger = _looked_again(candidates, chosen, most, levels)
            if larger is None:
                candidates.whitener = weights
            else:
                children = levels[len(larger.effects)]
        if larger is None and size > 1:  # if no single effect is accepted a pair may be, but no larger set
            candidates.whitener = whitener
            break
        if larger is not None:
            chosen, level, size = larger, children, len(larger.effects)
            levels[size] = children
        size += 1
    progress("comparing indistinguishable sets", 0.65)
    base = candidates.again(base)
    needed, level = _settled(candidates, chosen, levels)
    if needed.effects:
        near = (c for c in level if indistinguishable(needed, c, blocks, candidates.options))
        same = tuple(c for c in near if c.total < needed.total or not _contains(candidates, c, needed))
        chosen, alternatives = _simplest(needed, same, blocks, candidates.options)
    else:
        chosen, alternatives = base, ()
    return Selection(
        base=base,
        chosen=chosen,
        alternatives=alternatives,
        before=before,
        ranking=ranking,
        unidentifiable=tuple(sorted(candidates.unidentifiable)),
        seldom=_seldom(candidates, chosen, levels.get(len(chosen.effects) + 1, ())),
    )


def _seldom(candidates: Candidates, chosen: Candidate, larger: Sequence[Candidate]) -> tuple[Candidate, ...]:
    """Of sets with one effect more, those that bring much, but not in enough parts of the data.

    What is a sensor's must bring it in a single part: its zero may wander alike in all records.
    """
    problem, least = candidates.problem, candidates.options.least_gain
    beside = candidates.again(chosen)
    found = []
    enough = UNEVEN * least
    near = (c for c in larger if c.fit.cost < chosen.fit.cost - 0.5 * enough)  # with nearly the same weights
    for one in map(candidates.again, (c for c in near if set(chosen.effects) < set(c.effects))):
        gain = beside.total - one.total
        if gain <= enough:
            continue
        [more] = set(one.effects) - set(chosen.effects)
        once = gain - largest_share(beside.loss - one.loss, problem.blocks) <= least
        if (once or problem.model.effect(more).where != "sensor") and _stands(candidates, beside, one):
            found.append(one)
    return tuple(found)


def _settled(
    candidates: Candidates, chosen: Candidate, levels: Mapping[int, list[Candidate]]
) -> tuple[Candidate, list[Candidate]]:
    """What is needed of a set, or of a better one that differs in a single effect; and its rivals.

    What the search has found is fitted once more beside all others, each effect from its own starts (a
    floating search, Pudil et al. 1994): the fewer that it was first fitted beside may have led it astray.

    Args:
        candidates: What fits the sets.
        chosen: The set.
        levels: All sets that were found, by number of effects.

    Returns:
        The set, and others of its size, the best first.
    """
    needed, size = _needed(candidates, chosen), len(chosen.effects)
    found = {frozenset(c.effects): c for c in levels.get(size, ())}
    while needed.effects:
        if len(needed.effects) < size:
            size = len(needed.effects)
            near = [c for c in levels[size] if c.total < needed.total + REFITTED_WITHIN]
            # Smaller sets were last fitted with other weights.
            found = {frozenset(c.effects): c for c in candidates.each(candidates.again, near)}
        for child in _neighbours(candidates, needed, set(candidates.tried)) if size > 1 else ():
            key = frozenset(child.effects)
            if key not in found or child.total < found[key].total:
                found[key] = child
        found[frozenset(needed.effects)] = needed
        enough = needed.total - SAME_ANYHOW
        better = (_needed(candidates, c) for c in found.values() if c.total < enough)
        best = min((c for c in better if c.total < enough), key=lambda c: c.total, default=None)
        if best is None:
            break
        needed = best
    rivals = (c for c in found.values() if c is not needed)
    return needed, sorted(rivals, key=lambda c: c.total)


def _needed(candidates: Candidates, chosen: Candidate) -> Candidate:
    """The set without effects that are no longer needed: they may have compensated a local minimum.

    The remaining set is fitted from the optimum of the larger one, which the search did not start from.
    """
    blocks = candidates.problem.blocks
    while chosen.effects:
        smaller = candidates.each(partial(candidates.without, chosen), chosen.effects)
        spare = [
            c
            for c in smaller
            if not (accepted(c, chosen, blocks, candidates.options) and _stands(candidates, c, chosen))
        ]
        if not spare:
            return candidates.simplified(chosen)
        chosen = min(spare, key=lambda c: c.total)
    return chosen


def _stands(candidates: Candidates, parent: Candidate, child: Candidate) -> bool:
    """Whether what a child has more explains as much by itself as noise that wanders, or enough beside it."""
    options = candidates.options
    gain, left = beside(candidates.problem, parent.fit, child.fit, options.price)
    gain -= options.price * (child.size - parent.size)
    if left < SAME_ANYHOW or wander(candidates.problem, child.fit, options.price).walked < SAME_ANYHOW:
        return True
    fits = candidates.problem, parent.fit, child.fit
    if gain > min(options.least_gain, left) and not (
        follows_slowly(*fits) and wanders_more(*fits, options.price)
    ):
        return True
    if not is_steady(parent.fit, child.fit):
        return False
    gain = beside_returning(*fits) - options.price * (child.size - parent.size)
    return gain > CERTAINLY_STEADY * options.least_gain


def _simplest(
    chosen: Candidate,
    alternatives: tuple[Candidate, ...],
    blocks: IntArray,
    options: DiagnosisOptions = DEFAULT,
) -> tuple[Candidate, tuple[Candidate, ...]]:
    """Of indistinguishable sets, the one with fewest parameters, and its alternatives."""
    first = min((chosen, *alternatives), key=lambda c: c.size)  # the best of that size
    if first.size == chosen.size:
        return chosen, alternatives
    others = (c for c in (chosen, *alternatives) if c is not first)
    return first, tuple(c for c in others if indistinguishable(first, c, blocks, options))


def _called_for(
    candidates: Candidates, before: Candidate, parents: list[Candidate], children: list[Candidate]
) -> Candidate | None:
    """The larger set that is accepted, if any; a pair found from no effect must also beat both its members.

    A set of more effects with fewer parameters need only fit better: the set with more parameters may merely
    approximate it (a long spatial wave, for a constant and a cubic force). If the best one acts in too few
    blocks to be significant, the next one may be called for beside it.

    Args:
        candidates: What fits the sets.
        before: The set so far, fitted with the weights of the larger ones.
        parents: Other sets of its size.
        children: The larger sets, the best first.
    """
    blocks, options = candidates.problem.blocks, candidates.options
    for child in children:
        if child.size < before.size and before.total - child.total > SAME_ANYHOW:
            return child
    for child in children:
        if before.total - child.total <= options.least_gain:
            return None
        if accepted(before, child, blocks, options) and (
            child is children[0] or _beside_the_best(candidates, before, child, children[0])
        ):
            inside = [p for p in parents if set(p.effects) < set(child.effects)] if not before.effects else []
            called = all(accepted(candidates.again(p), child, blocks, options) for p in inside)
            return child if called else None
    return None


def _beside_the_best(candidates: Candidates, before: Candidate, child: Candidate, best: Candidate) -> bool:
    """Whether what a set has more than the one before is called for beside the best set, too."""
    more = set(child.effects) - set(before.effects)
    if len(more) != 1 or more <= set(best.effects) or not set(before.effects) < set(best.effects):
        return False
    both = candidates.extend(best, more.pop())
    return both is not None and accepted(best, both, candidates.problem.blocks, candidates.options)


def indistinguishable(
    first: Candidate, second: Candidate, blocks: IntArray, options: DiagnosisOptions = DEFAULT
) -> bool:
    """Whether the data cannot distinguish a better set from a worse one.

    A worse set with more parameters that fits as well is no alternative: it may contain the better one (a
    step at the very start of the record is a constant).
    """
    worse = second.total - first.total
    if worse > 0 and second.size > first.size and second.fit.cost < first.fit.cost + CONTAINS:
        return False
    if worse < options.undecided:
        return True
    return bool(
        worse < options.same_gain and block_p_value(second.loss - first.loss, blocks) > options.same_p
    )


def unexplained(problem: Problem, fitted: Fit) -> bool:
    """Whether the error of any sensor is clearly larger than its white noise."""
    if problem.model.random_force:
        return False
    prediction = predict(problem, fitted.parameters)
    sensors = np.unique(problem.outputs[~problem.events])
    return any(
        bool(prediction.rmse()[j] > UNEXPLAINED * noise_floor(problem, prediction, int(j))) for j in sensors
    )


def _looked_again(
    candidates: Candidates, chosen: Candidate, most: int, levels: dict[int, list[Candidate]]
) -> Candidate | None:
    """A set that is called for where an error remains that nothing promises to explain; None if none is.

    Beside a large fault first-order promises mislead, so every effect is fitted; and of two faults neither
    may bring anything without the other.

    Args:
        candidates: What fits the sets.
        chosen: The set so far.
        most: Effects that a set may have.
        levels: Sets by number of effects, into which those are put that are fitted if one is called for.
    """
    parents, everything, fitted = [chosen], True, dict[int, list[Candidate]]()
    for size in range(len(chosen.effects) + 1, min(len(chosen.effects) + 2, most) + 1):
        if not (larger := _grown(candidates, parents, everything)):
            break
        fitted[size] = larger
        before = candidates.again(chosen)
        if accepted(before, larger[0], candidates.problem.blocks, candidates.options):
            needed = _needed(candidates, larger[0])
            if needed.total > before.total - SAME_ANYHOW or set(needed.effects) == set(chosen.effects):
                return None
            levels.update(fitted)
            others = [c for c in levels.get(len(needed.effects), ()) if set(c.effects) != set(needed.effects)]
            rivals = sorted(candidates.each(candidates.again, others), key=lambda c: c.total)
            levels[len(needed.effects)] = [needed, *rivals]
            return needed
        parents, everything = larger[: PARENTS + 1], False
    return None


def _contains(candidates: Candidates, larger: Candidate, smaller: Candidate) -> bool:
    """Whether a set differs from another one by an effect that contains one of that: hysteresis, friction."""
    own, gone = set(larger.effects) - set(smaller.effects), set(smaller.effects) - set(larger.effects)
    return any(candidates.twins(name) & gone for name in own)


def rivals_of(
    chosen: Candidate,
    others: Sequence[Candidate],
    blocks: IntArray,
    options: DiagnosisOptions = DEFAULT,
) -> tuple[Candidate, ...]:
    """Of sets of a size, those that the data cannot distinguish from one of them; none if it is not there."""
    if not any(one is chosen for one in others):
        return ()
    return tuple(c for c in others if c is not chosen and indistinguishable(chosen, c, blocks, options))


def _grown(candidates: Candidates, parents: list[Candidate], everything: bool = False) -> list[Candidate]:
    """Parents with one effect more, best first, all whitened by the best one's residual covariance.

    Args:
        candidates: What fits the sets.
        parents: The best sets so far, the best first.
        everything: Whether effects are fitted, too, that promise too little to first order.
    """
    names = candidates.names()
    pairs = [(parent, name) for parent in parents for name in names if name not in parent.effects]
    scores = candidates.each(lambda pair: candidates.score_test(*pair), pairs)
    jobs = [
        (score - (parent.total - parents[0].total), parent, name)
        for score, (parent, name) in zip(scores, pairs, strict=True)
    ]
    jobs.sort(key=lambda job: -job[0])
    best: dict[frozenset[str], Candidate] = {}
    model = candidates.problem.model
    tried: list[tuple[Candidate, str]] = []
    for i, (predicted, parent, name) in enumerate(jobs):
        lack = parent.total - parents[0].total
        needed = 0.5 * (candidates.options.least_gain - lack)  # to first order a part of it is promised
        if parent.size + model.effect(name).size < parents[0].size:  # what many parameters imitate
            needed = -0.5 * lack - 2 * candidates.options.same_gain
        # The heavy-tailed loss grows slowly: by it alone sets that are far off seem near.
        far = OF_THE_WAY * (parent.fit.cost - parents[0].fit.cost)
        if i < TRIED_AT_LEAST or everything or (predicted >= needed and predicted + lack >= far):
            tried.append((parent, name))
    # A set is told in the order of the best parent, unless another one's led to a better optimum: that is
    # sought where the first way did not bring what the other one promises.
    tried.sort(key=lambda pair: pair[0] is not parents[0])
    ways: dict[frozenset[str], tuple[Candidate, str]] = {}
    others = [way for way in tried if ways.setdefault(_set_of(way), way) is not way]
    for now in (list(ways.values()), others):
        now = [
            w for w in now if _set_of(w) not in best or best[_set_of(w)].fit.cost > candidates.promised(*w)
        ]
        for child in candidates.each(lambda way: candidates.extend(*way), now):
            if child is None:
                continue
            key = frozenset(child.effects)
            if key not in best or child.total < best[key].total - SAME_ANYHOW:
                best[key] = child
    if not best:
        return []
    leader = min(best.values(), key=lambda c: c.total)
    if parents[0].effects and leader.total > parents[0].total:
        return [leader]  # nothing is called for beside them
    candidates.whitener = covariance_whitener(candidates.problem, leader.fit)
    ranked = sorted(best.values(), key=lambda c: c.total)
    # Two effects that one imitates may each be far off alone: the next parents stay, whatever they lack.
    near = [c for i, c in enumerate(ranked) if i <= PARENTS or c.total < leader.total + REFITTED_WITHIN]
    return sorted(candidates.each(candidates.again, near), key=lambda c: c.total)


def _set_of(way: tuple[Candidate, str]) -> frozenset[str]:
    """The set that an effect beside a parent makes."""
    return frozenset((*way[0].effects, way[1]))


def exchanged(candidates: Candidates, chosen: Candidate) -> tuple[Candidate, ...]:
    """Sets with another effect in the place of one that the data cannot tell from a set, the best first.

    A set that lost members to curves was never compared with these.
    """
    blocks, options = candidates.problem.blocks, candidates.options
    near = [c for c in _neighbours(candidates, chosen) if indistinguishable(chosen, c, blocks, options)]
    same = (c for c in near if c.total < chosen.total or not _contains(candidates, c, chosen))
    return tuple(sorted(same, key=lambda c: c.total))


def _neighbours(
    candidates: Candidates, chosen: Candidate, tried: Set[tuple[frozenset[str], str]] = frozenset()
) -> list[Candidate]:
    """Sets with another effect in the place of one, where it promises at least half of what that brings.

    Args:
        candidates: What fits the sets.
        chosen: The set.
        tried: Effects that need not be added once more, each with the set that it was added to.
    """
    result: list[Candidate | None] = []
    for gone in chosen.effects:
        rest = candidates.without(chosen, gone)
        needed = max(0.5 * (rest.total - chosen.total), OF_THE_WAY * (rest.fit.cost - chosen.fit.cost))
        known = {name for to, name in tried if to == frozenset(rest.effects)} | set(chosen.effects)
        names = [name for name in candidates.names() if name not in known]
        scores = candidates.each(partial(candidates.score_test, rest), names)
        near = [name for name, score in zip(names, scores, strict=True) if score > needed]
        result += candidates.each(partial(candidates.extend, rest), near)
    return [child for child in result if child is not None]
