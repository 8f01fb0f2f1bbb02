"""The verdict: what is named, what an unlisted curve explains as well or better, what is left over.

Everything competes on one scale, the held-out likelihood with one price: the set of listed effects that the
search has chosen, and unlisted curves beside the base or beside a part of that set.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from fieldmodels.diagnosis.candidates import Candidate, Candidates
from fieldmodels.diagnosis.chance import varying_by_chance
from fieldmodels.diagnosis.curves import NEAR_BEST, Curves, Scored
from fieldmodels.diagnosis.gain import Prediction, noise_floor
from fieldmodels.diagnosis.misshapen import Shape, misshapen
from fieldmodels.diagnosis.options import DiagnosisOptions
from fieldmodels.diagnosis.phrases import CURVE
from fieldmodels.diagnosis.problem import IntArray, Problem
from fieldmodels.diagnosis.result import Cause, MissingCurve, Verdict
from fieldmodels.diagnosis.selection import block_p_value
from fieldmodels.model import Effect, Model

HALF = 0.5
"""Of what a curve must bring, that a likely one must bring beside sensors that wander. On a pendulum's
swing-up the best one brought 0.75 of it; where only the noise was slow -0.5 and 0.2."""


@dataclass(frozen=True)
class Judgement:
    """What stands after unlisted curves have competed.

    Attributes:
        kept: The base with the effects that are named.
        tried: The curves that were tried beside it.
        beside_base: Those that were tried beside the base.
        curves: Unlisted curves beside it, the most important first.
        twin: An unlisted curve that explains the data as well as the named effects, if there is one.
        beaten: Effects that the search had chosen and that curves explain better.
        unsure: Of each effect that need not be what its name says, what it may be instead: a curve in its
            place, how its value differs between parts of the data, or that it varies by chance.
    """

    kept: Candidate
    tried: Curves
    beside_base: Curves
    curves: tuple[Scored, ...] = ()
    twin: Scored | None = None
    beaten: tuple[str, ...] = ()
    unsure: Mapping[str, str] = field(default_factory=dict)


def unjudged(candidates: Candidates, base: Candidate, chosen: Candidate) -> Judgement:
    """A chosen set with which there was no time for curves to compete."""
    beside = Curves(candidates.problem, base.fit, candidates.options)
    tried = Curves(candidates.problem, chosen.fit, candidates.options) if chosen.effects else beside
    return Judgement(chosen, tried, beside)


def judge(candidates: Candidates, base: Candidate, chosen: Candidate) -> Judgement:
    """Let curves compete with a chosen set: as a whole, with each member, and for what is left over.

    Args:
        candidates: What fits the sets.
        base: The base alone.
        chosen: The set; the base itself if there is none.
    """
    options, problem = candidates.options, candidates.problem
    if not chosen.effects:
        curves = Curves(problem, base.fit, options)
        rivals = curves.first(base)
        if not rivals:
            return Judgement(base, curves, curves)
        rivals += curves.rivals(rivals[0].candidate, options.most_curves - 1)
        return Judgement(base, curves, curves, with_formulas(curves, base, rivals))
    curves = Curves(problem, base.fit, options)
    several = len(chosen.effects) > 1
    rivals = curves.rivals(base, 1 if several else None)
    if several and rivals:
        # One curve as a known function has few parameters, too.
        rivals[0] = curves.as_formula(base, rivals[0])
        rivals[1:] = curves.rivals(rivals[0].candidate, options.most_curves - 1)
    burden = options.price_of_name * (len(chosen.effects) - 1)
    beside = Curves(problem, chosen.fit, options)
    left = beside.rivals(chosen)
    known = _known(curves, beside, base, chosen)
    ahead = [
        rival
        for rival in (*(rivals[:count] for count in range(len(rivals), 0, -1)), *([one] for one in known))
        if _beats(rival[-1].candidate, chosen, burden, problem.blocks, options)
        and not _mostly(candidates, base, chosen, left, rival, burden)
    ]
    anyhow = [rival for rival in ahead if rival[-1].candidate.total < chosen.total]
    kept, beaten, as_good = (
        (chosen, chosen.effects, {}) if anyhow else _without_the_beaten(candidates, chosen, left)
    )
    # What is ahead of several names by their burden alone may be what they are, while each of them stands.
    if ahead and beaten:
        found = with_formulas(curves, base, (anyhow or ahead)[0])
        return Judgement(base, curves, curves, found, beaten=chosen.effects)
    if beaten:
        beside = Curves(problem, kept.fit, options)
        left = beside.rivals(kept)
    shapes = misshapen(beside, kept)
    for name, shape in shapes.items():
        rest = candidates.without(kept, name) if len(kept.effects) > 1 else base
        instead = _instead(candidates, rest, shape)
        better = all(
            _beats(one, than, 0.0, problem.blocks, options)
            for one, than in ((shape.other, shape.own), (shape.scored.candidate, kept))
        )
        if instead and better:
            kept, (beside, left), beaten = rest, instead, (*beaten, name)
            shapes = misshapen(beside, kept)
            break
    if left and not beside.called_for(kept, left[0]):
        left = []
    twin = next((r for r in (*rivals, *known) if _as_good(r, chosen, burden, problem.blocks, options)), None)
    return Judgement(
        kept,
        beside,
        curves,
        with_formulas(beside, kept, left),
        twin if not beaten else None,
        beaten,
        {
            **as_good,
            **{name: _words(shape.scored) for name, shape in shapes.items()},
            **_in_one_sensor(problem, kept, left),
            **varying_by_chance(problem, kept),
            **_varying(beside, kept),
        },
    )


def _known(curves: Curves, beside: Curves, base: Candidate, chosen: Candidate) -> list[Scored]:
    """Known functions that compete with names: of the best tables, without those that hold what names do.

    A table of eight values pays for what it does not need; a function has one or two.

    Args:
        curves: Those beside the base.
        beside: Those beside the names.
        base: What the functions are added to.
        chosen: The names.
    """
    best = curves.judge(base)[:NEAR_BEST]
    return [one for one in curves.as_known(base, best) if not beside.repeats(one.curve, chosen)]


def _instead(candidates: Candidates, rest: Candidate, shape: Shape) -> tuple[Curves, list[Scored]] | None:
    """A known function in the place of a name, and what is missing beside it; None if it is not seen."""
    beside, curve = Curves(candidates.problem, rest.fit, candidates.options), shape.scored.curve
    tables = [t for t in beside.all if t.direction == curve.direction and not t.formula]
    judged = beside.judge(rest, [f for f in beside.functions(tables) if f.formula == curve.formula])
    if not judged:
        return None
    return beside, [judged[0], *beside.rivals(judged[0].candidate, candidates.options.most_curves - 1)]


def _words(scored: Scored) -> str:
    """A curve as an alternative to a name."""
    return f"{CURVE}{scored.curve.direction}"


def _in_one_sensor(problem: Problem, kept: Candidate, left: Sequence[Scored]) -> dict[str, str]:
    """Named effects of a sensor in which more is missing: a curve of that sensor holds both.

    Args:
        problem: The windows.
        kept: The names.
        left: The curves that are called for beside them.
    """
    result, model = {}, problem.model
    for name in (n for n in kept.effects if model.effect(n).where == "sensor"):
        place = model.slice_of(name)
        own = (kept.fit.free >= place.start) & (kept.fit.free < place.stop)
        moved = np.nansum(kept.fit.by_free[:, :, own] ** 2, axis=(0, 2))
        for one in left:
            if one.curve.place == "sensor" and moved[problem.outputs == _output(model, one)].any():
                result[name] = _words(one)
    return result


def _output(model: Model, scored: Scored) -> int:
    """Number of the sensor in which a curve acts."""
    return [s.name for s in model.outputs].index(scored.curve.target)


def _varying(beside: Curves, kept: Candidate) -> dict[str, str]:
    """Named effects whose values do not agree between parts of the data, each with the clearest difference.

    The parts are told apart by the mean and the size of every signal in a window, and by the time.
    """
    result = {}
    for name in kept.effects:
        own = [c for c in beside.all if c.place == "parameter" and c.target.startswith(f"{name}.")]
        for one in beside.first_of(kept, beside.judge(kept, own), len(own)):
            result[name] = _words(one)
    return result


def most_likely(tried: Curves, kept: Candidate, far: bool, options: DiagnosisOptions) -> tuple[Scored, ...]:
    """The best curve for an error above the white noise; none if coloured noise of a sensor may be all of it.

    Args:
        tried: The curves.
        kept: What they stand beside.
        far: Whether the error is so large that something must be missing, significant or not.
        options: Thresholds.
    """
    judged = tried.judge(kept)
    if far:
        return tuple(judged[:1])
    moving = [s for s in judged if s.curve.place != "sensor" and s.curve.over != "time"]
    likely = [s for s in moving if s.total > tried.needed and s.p_value < options.likely_p][:1]
    return tuple(s for s in likely if tried.beside_walks(kept, s) > HALF * tried.needed)


def verdict_of(causes: Sequence[Cause], curves: Sequence[MissingCurve]) -> Verdict:
    """The verdict in one word."""
    if causes:
        return "ambiguous" if any(c.alternatives for c in causes) else "named"
    return "unknown" if curves else "consistent"


def far_from_noise(testing: Problem, after: Prediction, named: bool, times: float) -> bool:
    """Whether an error is more than some times above its sensor's white noise.

    Where effects are named the first output decides, else any.
    """
    outputs = np.unique(testing.outputs)
    return any(
        bool(after.rmse()[j] > times * noise_floor(testing, after, int(j)))
        for j in (outputs[:1] if named else outputs)
    )


def mostly_explained(testing: Problem, before: Prediction, after: Prediction) -> bool:
    """Whether the causes explain more of the first output's error than remains above the sensor's noise."""
    j = int(testing.outputs[0])
    first, last = before.rmse()[j] ** 2, after.rmse()[j] ** 2
    return bool(first - last > last - noise_floor(testing, after, j) ** 2)


def _without_the_beaten(
    candidates: Candidates, chosen: Candidate, left: Sequence[Scored]
) -> tuple[Candidate, tuple[str, ...], dict[str, str]]:
    """The set without the members that a curve in their place explains better, one by one.

    Args:
        candidates: What fits the sets.
        chosen: The set.
        left: The curves beside it.

    Returns:
        What is left, what is not, and of each of several members that are left a curve that does as well.
    """
    options, blocks = candidates.options, candidates.problem.blocks
    beaten: list[str] = []
    as_good: dict[str, str] = {}
    while len(chosen.effects) > 1:
        worst: tuple[float, str, Candidate] | None = None
        as_good = {}
        for name in chosen.effects:
            rest = candidates.without(chosen, name)
            for scored in Curves(candidates.problem, rest.fit, options).judge(rest)[:1]:
                rival = scored.candidate
                if _as_good(scored, chosen, 0.0, blocks, options):
                    as_good[name] = _words(scored)
                if not _beats(rival, chosen, 0.0, blocks, options) or _mostly(
                    candidates, rest, chosen, left, [scored], 0.0
                ):
                    continue
                if worst is None or chosen.total - rival.total > worst[0]:
                    worst = chosen.total - rival.total, name, rest
        if worst is None:
            break
        beaten.append(worst[1])
        chosen = worst[2]
        left = ()  # what stood beside the larger set says nothing of this one
        as_good = {}
    return chosen, tuple(beaten), as_good


def _mostly(
    candidates: Candidates,
    rest: Candidate,
    named: Candidate,
    left: Sequence[Scored],
    rival: Sequence[Scored],
    burden: float,
) -> bool:
    """Whether names explain most of what curves in their place do, and with a further curve as much.

    A table holds the friction that is named and what else depends on the velocity; it need not be told
    apart from the name with a table of the rest. That holds on one side alone: no table of a force holds what
    a sensor does.
    """
    options, last = candidates.options, rival[-1].candidate
    names = [candidates.problem.model.effect(name) for name in named.effects if name not in rest.effects]
    if not all(any(_same_side(effect, one) for one in rival) for effect in names):
        return False
    with_more = left[0].candidate if left else named
    most = rest.total - named.total > options.most * (rest.total - last.total)
    return most and with_more.total + burden < last.total + options.same_gain


def _same_side(effect: Effect, scored: Scored) -> bool:
    """Whether an effect and a curve both act in a sensor, or neither does."""
    return (effect.where == "sensor") == (scored.curve.place == "sensor")


def with_formulas(curves: Curves, base: Candidate, found: Sequence[Scored]) -> tuple[Scored, ...]:
    """The curves as known functions, where these do as well."""
    result, beside = [], base
    for one in found:
        result.append(curves.as_formula(beside, one))
        beside = one.candidate
    return tuple(result)


def _beats(
    rival: Candidate, named: Candidate, burden: float, blocks: IntArray, options: DiagnosisOptions
) -> bool:
    better = named.loss - rival.loss
    lead = named.total + burden - rival.total
    p = block_p_value(better + burden / len(better), blocks)
    return lead > options.beaten_by and p < options.beaten_p


def _as_good(
    scored: Scored, named: Candidate, burden: float, blocks: IntArray, options: DiagnosisOptions
) -> bool:
    """Whether the data cannot tell a curve from what is named; it is not beaten.

    A wave's period is the best on a grid, a name's is fitted: that it was sought costs the wave nothing here.
    """
    rival = scored.candidate
    worse = rival.total - named.total - burden - float(np.log(scored.curve.tried))
    if worse < options.undecided:
        return True
    return bool(worse < options.same_gain and block_p_value(rival.loss - named.loss, blocks) > options.same_p)
