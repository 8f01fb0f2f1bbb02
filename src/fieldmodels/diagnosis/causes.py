"""The named causes: which of a chosen set stand, each with its values and its gain."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.candidates import Candidate, Candidates, is_quantisation
from fieldmodels.diagnosis.fit import fit
from fieldmodels.diagnosis.gain import NONE, Prediction, noise_floor, predict, share
from fieldmodels.diagnosis.held_out import window_loss
from fieldmodels.diagnosis.linearisation import Fit
from fieldmodels.diagnosis.phrases import CHANCE, CURVE
from fieldmodels.diagnosis.problem import Problem
from fieldmodels.diagnosis.profile import profiled_error
from fieldmodels.diagnosis.quantisation import coarse_sensor
from fieldmodels.diagnosis.result import (
    Cause,
    Estimate,
    Share,
)
from fieldmodels.diagnosis.selection import Selection, block_p_value, in_few_blocks
from fieldmodels.diagnosis.uncertainty import differs_from_neutral, size_by_chance, standard_errors
from fieldmodels.diagnosis.verdict import (
    Judgement,
)
from fieldmodels.drivers.curved import Curved
from fieldmodels.model import Effect, Model, Parameter
from fieldmodels.recording import Recording

NEGLIGIBLE = 0.1  # nats on the test data that do not count


def path_to(candidates: Candidates, base: Candidate, chosen: Candidate) -> list[Candidate]:
    """Fits from the base to a set, each with one more effect."""
    path = [chosen]
    if not chosen.effects:
        return path
    for name in reversed(chosen.effects[1:]):
        path.append(candidates.without(path[-1], name))
    return [base, *reversed(path)]


def confirmed(candidates: Candidates, base: Candidate, chosen: Candidate, testing: Problem) -> Candidate:
    """The set without effects that the test data contradict: those without which it explains them better.

    Each is judged beside all others, since one may explain nothing before another one is there. A cause that
    does not act during the test data is not rejected by them.
    """
    loss = partial(_test_loss, testing, chosen.fit.whitener)
    least = loss(chosen)
    while chosen.effects:
        several = len(chosen.effects) > 1
        smaller = [candidates.without(chosen, name) for name in chosen.effects] if several else [base]
        best, without = min(((loss(c), c) for c in smaller), key=lambda pair: pair[0])
        if least < best + NEGLIGIBLE:
            break
        chosen, least = without, best
    return chosen


def confirmed_elsewhere(
    candidates: Candidates, chosen: Candidate, seldom: Sequence[Candidate], testing: Problem
) -> Candidate:
    """The set with what a single part of the training data calls for, if the test data do so, too.

    A limit may be reached once in a record. That something else happened then is no explanation of a second
    time in another record, whose prediction gains from the same value.
    """
    loss = partial(_test_loss, testing, chosen.fit.whitener)
    least = loss(chosen) if seldom else 0.0
    gains = [(least - loss(larger), larger) for larger in seldom]
    gain, larger = max(gains, key=lambda pair: pair[0], default=(0.0, chosen))
    return larger if gain > candidates.options.least_gain else chosen


def _test_loss(testing: Problem, whitener: FloatArray, candidate: Candidate) -> float:
    """Negative log-likelihood [nats] of test windows, whose initial states alone are fitted."""
    fitted = fit(testing, candidate.fit.parameters, NONE, whitener, iterations=6)
    return float(window_loss(fitted).sum())


def told_from_neutral(
    candidates: Candidates, path: Sequence[Candidate], testing: Problem, rng: np.random.Generator
) -> tuple[Candidate, tuple[Cause, ...]]:
    """The set without what cannot be told from neutral, one by one, and what that was."""
    chosen, possible = path[-1], []
    while chosen.effects:
        doubtful = [
            cause
            for cause in causes_of(candidates, path, testing, rng)
            if _harms(cause, candidates, path, testing, rng)
            or not differs_from_neutral(candidates.problem, chosen.fit, cause)
        ]
        if not doubtful:
            break
        weakest = min(doubtful, key=lambda c: c.nats)
        possible.append(weakest)
        chosen = candidates.without(chosen, weakest.effect)
        path = path_to(candidates, path[0], chosen)
    return chosen, tuple(possible)


def _harms(
    cause: Cause,
    candidates: Candidates,
    path: Sequence[Candidate],
    testing: Problem,
    rng: np.random.Generator,
) -> bool:
    """Whether a cause makes predictions worse, both over those before it and over all the others."""
    if cause.gain.ci95[1] >= 0.0:
        return False
    [beside] = beside_the_others([cause], candidates, path, testing, rng)
    return beside.gain.ci95[1] < 0.0


def causes_of(
    candidates: Candidates, path: Sequence[Candidate], testing: Problem, rng: np.random.Generator
) -> tuple[Cause, ...]:
    """The effects of a path's end with the gain of each over those before it."""
    chosen = path[-1]
    model, problem = candidates.problem.model, candidates.problem
    if not chosen.effects:
        return ()
    outputs = _most_improved_outputs(problem, path)
    predictions = [predict(testing, c.fit.parameters) for c in path]
    errors = standard_errors(problem, chosen.fit)
    causes = []
    for k, name in enumerate(chosen.effects):
        effect = model.effect(name)
        place = model.slice_of(name).start
        values = {}
        for i, p in enumerate(effect.parameters):
            known = np.flatnonzero(chosen.fit.free == place + i)
            std = float(errors[known[0]]) if len(known) else float("nan")
            if not p.smooth:
                std = profiled_error(candidates, chosen, effect, i)
            elif _has_few_observations(problem, p):
                std = max(std, profiled_error(candidates, chosen, effect, i))
            values[p.name] = Estimate(float(chosen.fit.parameters[place + i]), std, p.unit)
        gain = path[k].loss - path[k + 1].loss
        causes.append(
            Cause(
                effect=name,
                cause=effect.cause,
                where=effect.where,
                parameters=values,
                signal=model.outputs[outputs[k]].name,
                gain=share(predictions[k], predictions[k + 1], outputs[k], testing.blocks, rng),
                p_value=block_p_value(gain, problem.blocks),
                nats=path[k].total - path[k + 1].total,
                equation=effect.equation,
            )
        )
    return tuple(causes)


def beside_the_others(
    causes: Sequence[Cause],
    candidates: Candidates,
    path: Sequence[Candidate],
    testing: Problem,
    rng: np.random.Generator,
) -> tuple[Cause, ...]:
    """Causes with the gain of each over all the others, and the probability that each is but chance.

    The gain over those before it, by which they are chosen, may be nothing where it acts only together with a
    later one.

    Args:
        causes: Of the path's end.
        candidates: What fits the sets without one.
        path: Fits from the base to the set of all causes.
        testing: Windows to measure gains on.
        rng: Source of randomness.
    """
    chosen, result = path[-1], []
    for cause in causes:
        rest = candidates.without(chosen, cause.effect) if len(chosen.effects) > 1 else path[0]
        pair = [rest, chosen]
        [output] = _most_improved_outputs(candidates.problem, pair)
        without, beside = (predict(testing, one.fit.parameters) for one in pair)
        by_size = size_by_chance(candidates.problem, chosen.fit, cause)
        if_rare = in_few_blocks(rest, chosen, candidates.problem.blocks)
        result.append(
            replace(
                cause,
                signal=candidates.problem.model.outputs[output].name,
                gain=share(without, beside, output, testing.blocks, rng),
                chance=float(np.nanmin([cause.p_value, by_size, if_rare])),
            )
        )
    return tuple(result)


def _most_improved_outputs(training: Problem, path: Sequence[Candidate]) -> list[int]:
    """The output whose error each cause reduces most on the training data: its gain is stated there."""
    errors = [predict(training, c.fit.parameters).rmse() for c in path]
    return [int(np.nanargmin(after / before)) for before, after in itertools.pairwise(errors)]


def with_alternatives(
    causes: tuple[Cause, ...], selection: Selection, judged: Judgement
) -> tuple[Cause, ...]:
    """Add to each cause the effects, or the unlisted curve, that could replace it."""
    chosen = set(selection.chosen.effects)
    same = set(judged.kept.effects) == chosen
    result = []
    for cause in causes:
        others: list[str] = []
        twin = f"{CURVE}{judged.twin.curve.direction}" if judged.twin else ""
        unsure = judged.unsure.get(cause.effect, "")
        # A value that varies by chance is another matter than a curve that does as well on average.
        instead = [twin, unsure] if unsure.startswith(CHANCE) else [twin or unsure]
        for other in selection.alternatives if same else ():
            removed, added = chosen - set(other.effects), set(other.effects) - chosen
            if cause.effect in removed:
                others += [name for name in other.effects if name in added and name not in others]
        result.append(replace(cause, alternatives=(*others, *filter(None, instead))))
    return tuple(result)


def _has_few_observations(problem: Problem, p: Parameter) -> bool:
    """Whether a value's derivative may rest on few observations."""
    return problem.observations is not None and len(p.starts) > 1


def refitted(cause: Cause, problem: Problem, final: Fit) -> Cause:
    """A cause with the values of a fit together with curves, and their standard errors.

    Standard errors that are those of profiles stay as they are without the curves. So does an effect in whose
    values one of the curves acts: its value is then that where the curve is zero, which may be anywhere.

    Args:
        cause: The cause.
        problem: The windows, with the model of the fit.
        final: The fit.
    """
    effect, values = problem.model.effect(cause.effect), dict(cause.parameters)
    curves = problem.model.curves if isinstance(problem.model, Curved) else ()
    own = any(c.place == "parameter" and c.target.split(".")[0] == effect.name for c in curves)
    if own or is_quantisation(effect):
        return cause
    errors = dict(zip(final.free.tolist(), standard_errors(problem, final).tolist(), strict=True))
    for i, p in enumerate(effect.parameters, start=problem.model.slice_of(cause.effect).start):
        alone = values[p.name]
        std = errors.get(i, math.nan) if p.smooth and not _has_few_observations(problem, p) else math.nan
        value = float(final.parameters[i])
        values[p.name] = replace(alone, value=value, std=std if math.isfinite(std) else alone.std)
    return replace(cause, parameters=values)


def quantisation_found(train: Sequence[Recording], testing: Problem, after: Prediction) -> tuple[Cause, ...]:
    """Sensor quantisation as a cause, if it makes up enough of the remaining error."""
    model, error = testing.model, after.rmse()
    if model.random_force:  # it hides the sensor's noise in the error
        error = np.array([noise_floor(testing, after, j) for j in range(len(model.outputs))])
    coarse = coarse_sensor(model, train, error)
    return () if coarse is None else (_quantisation(model, *coarse),)


def _quantisation(model: Model, effect: Effect, step: float, share: float) -> Cause:
    """Quantisation as a cause; it explains noise, so that predictions gain nothing."""
    parameter = effect.parameters[0]
    return Cause(
        effect=effect.name,
        cause=f"{effect.cause} It makes up {100 * share:.0f} % of the remaining error's variance.",
        where=effect.where,
        parameters={parameter.name: Estimate(step, 0.0, parameter.unit)},
        signal=model.outputs[0].name,
        gain=Share(math.nan, (math.nan, math.nan)),
        equation=effect.equation,
    )
