"""Sets of names and curves, alike: each is fitted in the whole simulation, and fitted again from others."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.candidates import (
    Candidate,
    Candidates,
    number_of_starts,
    simpler,
)
from fieldmodels.diagnosis.curves import Scored
from fieldmodels.diagnosis.fit import best_of, fit, refit
from fieldmodels.diagnosis.linearisation import Fit, reweighed
from fieldmodels.diagnosis.marginal import Evidence
from fieldmodels.diagnosis.problem import Problem
from fieldmodels.drivers.curved import Curved

Label = tuple[str, str, str, str, int]
Key = tuple[tuple[str, ...], tuple[Label, ...]]
STEPS, CURVED = 20, 8
"""Steps of a fit from another set's states; with curves, which are simulated several times over."""
POLISHED, SETTLED = 3, 0.5
"""Times that a fit goes on by its own weights, as long as that gains so much [nats]."""
SHARES = (1.0, 0.3)
"""Of its first-order size, from which a curve is fitted."""


def label(scored: Scored) -> Label:
    """What makes a curve another one: where it acts, on what, over what, by which function."""
    curve = scored.curve
    return curve.place, curve.target, curve.over, curve.formula, len(scored.coefficients)


@dataclass(frozen=True, eq=False)
class Setting:
    """The simulation with some curves as further effects, and what fits sets of names in it."""

    curves: tuple[Scored, ...]
    problem: Problem
    candidates: Candidates

    @property
    def labels(self) -> tuple[Label, ...]:
        """Of its curves, in alphabetical order."""
        return tuple(sorted(map(label, self.curves)))

    @property
    def effects(self) -> tuple[str, ...]:
        """Its curves, as the simulation calls them."""
        return tuple(f"curve_{k + 1}" for k in range(len(self.curves)))

    def vector(self, own: FloatArray, values: dict[Label, tuple[FloatArray, FloatArray]]) -> FloatArray:
        """All parameters: a model's own, and curves with given values at given knots."""
        coefficients = [
            np.linalg.pinv(one.basis, rcond=1e-6) @ np.interp(one.curve.knots, *values[label(one)])
            for one in self.curves
        ]
        return np.concatenate([own, *coefficients])


@dataclass(eq=False)
class Hypothesis:
    """A set of names and curves, fitted together.

    Attributes:
        names: Listed effects, in alphabetical order.
        setting: The simulation with its curves.
        candidate: The fit; its effects are the names and the curves.
        settled: Whether it has been fitted by the weights of what it leaves, until that gained nothing.
        grown: Whether it has been extended.
        exchanged: Whether each of its members has been exchanged.
    """

    names: tuple[str, ...]
    setting: Setting
    candidate: Candidate
    settled: bool = field(default=False)
    grown: bool = field(default=False)
    exchanged: bool = field(default=False)

    @property
    def curves(self) -> tuple[Scored, ...]:
        """Its curves."""
        return self.setting.curves

    @property
    def key(self) -> Key:
        """What makes it another set."""
        return self.names, self.setting.labels

    @property
    def size(self) -> int:
        """Number of names and curves."""
        return len(self.names) + len(self.curves)

    @property
    def fit(self) -> Fit:
        """Parameters and states."""
        return self.candidate.fit

    @property
    def values(self) -> dict[Label, tuple[FloatArray, FloatArray]]:
        """Knots and values of its curves."""
        model, p = self.setting.problem.model, self.fit.parameters
        effects = zip(self.curves, self.setting.effects, strict=True)
        return {label(one): (one.curve.knots, one.basis @ p[model.slice_of(name)]) for one, name in effects}


class Sets:
    """All sets that were fitted, each at its best fit so far."""

    def __init__(self, candidates: Candidates, evidence: Evidence) -> None:
        self.candidates, self.problem, self._evidence = candidates, candidates.problem, evidence
        self.own = len(self.problem.model.names)
        self._settings: dict[tuple[Label, ...], Setting] = {(): Setting((), self.problem, candidates)}
        self._made: dict[Key, Hypothesis] = {}
        self._linear: dict[int, tuple[Hypothesis, Candidate]] = {}

    def __iter__(self) -> Iterator[Hypothesis]:
        return iter(list(self._made.values()))

    def get(self, names: Sequence[str], curves: Sequence[Scored] = ()) -> Hypothesis | None:
        """A set, if it was fitted."""
        return self._made.get((tuple(sorted(names)), tuple(sorted(map(label, curves)))))

    def keep(self, one: Hypothesis) -> Hypothesis:
        """A set, or the same with a better fit that was there."""
        old = self._made.get(one.key)
        if old is not None:
            problem = one.setting.problem
            if self._evidence.of(problem, one.fit).value >= self._evidence.of(problem, old.fit).value - 0.1:
                return old
        self._made[one.key] = one
        return one

    def parts(self, one: Hypothesis) -> list[Hypothesis]:
        """Sets with one member less than a set, of those that were fitted."""
        rests = [([n for n in one.names if n != name], one.curves) for name in one.names]
        rests += [(list(one.names), tuple(c for c in one.curves if c is not own)) for own in one.curves]
        return [part for rest in rests if (part := self.get(*rest)) is not None]

    def setting(self, curves: Sequence[Scored]) -> Setting:
        """The simulation with some curves."""
        key = tuple(sorted(map(label, curves)))
        if key not in self._settings:
            problem = replace(self.problem, model=Curved(self.problem.model, [one.free for one in curves]))
            zeros = np.zeros(sum(len(one.coefficients) for one in curves))
            candidates = replace(
                self.candidates.of(problem),
                start=np.concatenate([self.candidates.start, zeros]),
                unidentifiable=set(self.candidates.unidentifiable),
            )
            self._settings[key] = Setting(tuple(curves), problem, candidates)
        return self._settings[key]

    def linear(self, one: Hypothesis) -> Candidate:
        """A set's fit as one of the simulation without curves, whose columns are among its Jacobian's."""
        if not one.curves:
            return one.candidate
        if id(one) not in self._linear:
            own = one.fit.parameters[: self.own]
            raw = self.problem.features - self.problem.simulate(own[None], one.fit.states)[0]
            found = replace(one.candidate, fit=replace(one.fit, parameters=own, raw=raw))
            self._linear[id(one)] = one, found
        return self._linear[id(one)][1]

    def with_name(
        self, one: Hypothesis, name: str, starts: Sequence[FloatArray], whitener: FloatArray
    ) -> Hypothesis | None:
        """A set with a name more; None if it cannot be fitted, or equals a simpler effect."""
        if found := self.get((*one.names, name), one.curves):
            return found
        if not one.curves:
            more = self.candidates.extend(one.candidate, name)
            if more is None:
                return None
            more = replace(more, fit=self.polished(self.problem, more.fit))
            return self.keep(Hypothesis(_sorted(*one.names, name), one.setting, more))
        begun = [self._moved(one.fit.parameters, name, start) for start in starts]
        return self._fitted(one, name, begun, one.fit.states, whitener, (3, CURVED))

    def in_place(
        self,
        lead: Hypothesis,
        rest: Hypothesis,
        name: str,
        starts: Sequence[FloatArray],
        whitener: FloatArray,
    ) -> Hypothesis | None:
        """A name in a member's place, fitted from the states of the set that holds the member."""
        old = self.get((*rest.names, name), rest.curves)
        begun = [old.fit.parameters] if old else []
        begun = [*begun, *starts][: 2 if old else len(starts)]
        vectors = [self._moved(rest.fit.parameters, name, start) for start in begun]
        steps = 6 if rest.curves else 12
        return self._fitted(rest, name, vectors, lead.fit.states, whitener, (steps, 0))

    def polished(self, problem: Problem, fitted: Fit, steps: int = CURVED) -> Fit:
        """A fit that goes on by the weights of what it leaves, if that makes it more likely."""
        return _polished(self._evidence, problem, fitted, steps)

    def settle(self, one: Hypothesis) -> None:
        """Fit a set by the weights of what it leaves until that gains nothing."""
        if not one.settled:
            one.settled = True
            one.candidate = replace(one.candidate, fit=settled(self._evidence, one.setting.problem, one.fit))

    def _fitted(
        self,
        one: Hypothesis,
        name: str,
        begun: Sequence[FloatArray],
        states: FloatArray,
        whitener: FloatArray,
        steps: tuple[int, int],
    ) -> Hypothesis | None:
        candidates, problem = one.setting.candidates, one.setting.problem
        effect, effects = self.problem.model.effect(name), (*one.candidate.effects, name)
        candidates.whitener = whitener
        best = best_of(problem, list(begun), candidates.free(effects), whitener, states, steps[0])
        if not np.isfinite(best.cost):
            return None
        if steps[1]:
            best = candidates.profiled(refit(problem, best, whitener, steps[1]), effect)
        best = self.polished(problem, best)
        if simpler(self.problem.model, effect, best.parameters[: self.own]):
            return None
        search = math.log(number_of_starts(self.problem, effect)) + one.candidate.search
        found = replace(one.candidate, effects=effects, fit=best, search=search)
        return self.keep(Hypothesis(_sorted(*one.names, name), one.setting, found))

    def _moved(self, parameters: FloatArray, name: str, start: FloatArray) -> FloatArray:
        """Parameters with an effect's as of another vector."""
        own, result = self.problem.model.slice_of(name), parameters.copy()
        result[own] = start[own]
        return result

    def with_curve(self, one: Hypothesis, scored: Scored) -> Hypothesis | None:
        """A set with a curve more, by the weights with which it was judged, then by what it leaves."""
        if label(scored) in one.setting.labels:
            return None
        if found := self.get(one.names, (*one.curves, scored)):
            return found
        setting = self.setting((*one.curves, scored))
        effects, whitener = (*one.names, *setting.effects), scored.candidate.fit.whitener
        free, problem = setting.candidates.free(effects), setting.problem
        before, best = reweighed(one.setting.problem, one.fit, whitener).cost, None
        for share in SHARES:
            values = share * (scored.basis @ scored.coefficients)
            shown = {**one.values, label(scored): (scored.curve.knots, values)}
            start = setting.vector(one.fit.parameters[: self.own], shown)
            tried = fit(problem, start, free, whitener, one.fit.states, CURVED)
            best = tried if best is None or tried.cost < best.cost else best
            if best.cost < before:
                break
        if best is None or not np.isfinite(best.cost):
            return None
        best = self.polished(problem, best)
        return self.keep(Hypothesis(one.names, setting, replace(one.candidate, effects=effects, fit=best)))

    def without(self, one: Hypothesis, member: str | Scored, whitener: FloatArray) -> Hypothesis:
        """A set without a member, fitted from its states."""
        own = one.fit.parameters[: self.own].copy()
        if isinstance(member, str):
            own[self.problem.model.slice_of(member)] = self.candidates.start[
                self.problem.model.slice_of(member)
            ]
        names = tuple(name for name in one.names if name != member)
        setting = self.setting([other for other in one.curves if other is not member])
        effects = (*names, *setting.effects)
        free, steps = setting.candidates.free(effects), CURVED if setting.curves else STEPS
        start = setting.vector(own, one.values)
        fitted = fit(setting.problem, start, free, whitener, one.fit.states, steps)
        fitted = self.polished(setting.problem, fitted)
        old = self.get(names, setting.curves)
        search = (old or one).candidate.search
        return self.keep(
            Hypothesis(names, setting, replace(one.candidate, effects=effects, fit=fitted, search=search))
        )


def settled(evidence: Evidence, problem: Problem, fitted: Fit) -> Fit:
    """A fit that goes on by the weights of what it leaves until that gains nothing."""
    for _ in range(POLISHED):
        before, fitted = fitted, _polished(evidence, problem, fitted, CURVED)
        if evidence.of(problem, fitted).value > evidence.of(problem, before).value - SETTLED:
            break
    return fitted


def _polished(evidence: Evidence, problem: Problem, fitted: Fit, steps: int) -> Fit:
    here = evidence.of(problem, fitted)
    closer = refit(problem, fitted, here.whitener, steps)
    return closer if evidence.of(problem, closer).value < here.value else fitted


def _sorted(*names: str) -> tuple[str, ...]:
    return tuple(sorted(names))
