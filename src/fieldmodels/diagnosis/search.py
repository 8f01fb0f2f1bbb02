"""One search over names and curves alike: forward, exchange, pairs; each step is fitted and scored the same.

The score of a set is its negative log marginal likelihood with the price of what was tried.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.candidates import Candidates, number_of_starts, simpler, times_off
from fieldmodels.diagnosis.curves import Curves, Scored
from fieldmodels.diagnosis.fit import best_of, refit
from fieldmodels.diagnosis.linearisation import Fit, reweighed
from fieldmodels.diagnosis.marginal import Evidence, Marginal
from fieldmodels.diagnosis.sets import Hypothesis, Sets, label
from fieldmodels.diagnosis.shapes import Curve
from fieldmodels.diagnosis.whitening import whitener_by_output

SOMETHING, UNLISTED = 3.0, 2.3
"""Log odds of nothing against something, a sensor's slow zero included, 20 to 1; of a listed against an
unlisted cause, 10 to 1."""
TRIED, BESIDE_CURVES = 8, 3
"""Names that are fitted beside a set, by what they promise to first order; beside one with curves."""
BEAM, MOST, MOST_CURVES, PAIRS = 2, 4, 2, 8
"""Sets that are extended, members of a set, curves among them, pairs of all that are followed."""
NEAR, OTHER = 6.0, 15.0
"""Nats within which the best set of the other kind (with a curve, without) is exchanged, is extended."""
FAR = 5.0
"""Times the noise that errors of samples must be for every pair to be fitted."""
JUDGED, FUNCTIONS = 12, 8
"""Tables and known functions whose evidence is asked beside a set."""


class Search:
    """Searches sets of names and curves.

    Attributes:
        sets: What was fitted.
        base: The base alone.
        names: Listed effects that are tried.
        evidence: Of fits to the windows.
    """

    def __init__(self, candidates: Candidates) -> None:
        self._candidates, self._problem = candidates, candidates.problem
        first = candidates.base()
        self.evidence = Evidence(self._problem)
        candidates.whitener = self.evidence.of(self._problem, first.fit).whitener
        base = candidates.again(first)
        candidates.whitener = first.fit.whitener  # single names are fitted by one weight an output
        names = candidates.names()
        absorbed = [not one for one in candidates.each(lambda n: candidates.identifiable(base, n), names)]
        candidates.unidentifiable.update(itertools.compress(names, absorbed))
        self.names = candidates.names()
        self.sets = Sets(candidates, self.evidence)
        self.base = self.sets.keep(Hypothesis((), self.sets.setting(()), base))
        self.sets.settle(self.base)
        self._count = 1  # of curves that were tried
        self._curves: dict[object, Curves] = {}
        self._judged: dict[int, tuple[Hypothesis, list[tuple[float, Scored]]]] = {}

    def run(self) -> None:
        """Search until nothing improves; what time is left for decides nothing of what was fitted."""
        self._forward([self.base])
        self._exchange()
        if times_off(self.best.setting.problem, self.best.fit) > FAR and self._every_pair():
            # As if nothing had been found: two names may each be worse alone.
            self._forward(self.ranked()[:BEAM])
            self._exchange()

    @property
    def best(self) -> Hypothesis:
        """The set with the least score."""
        return self.ranked()[0]

    def ranked(self) -> list[Hypothesis]:
        """All sets, the best first; those near the best are fitted until nothing is gained."""
        while True:
            order = sorted(self.sets, key=self.score)
            near = self.score(order[0]) + OTHER
            if not (moving := [one for one in order if self.score(one) <= near and not one.settled]):
                return order
            for one in moving:
                self.sets.settle(one)

    def score(self, one: Hypothesis) -> float:
        """Negative log posterior of a set, but for a constant [nats]."""
        return self.marginal(one).value + self._price(one)

    def marginal(self, one: Hypothesis) -> Marginal:
        """The evidence of what a set leaves, and the weights by its covariance."""
        return self.evidence.of(one.setting.problem, one.fit)

    def curves_beside(self, one: Hypothesis) -> Curves:
        """The curves that are tried beside a set; none that acts in an effect's own numbers."""
        if one.key not in self._curves:
            found = Curves(one.setting.problem, one.fit, self._candidates.options)
            found.all = tuple(c for c in found.all if not (c.place == "parameter" and "." in c.target))
            self._curves[one.key] = found
            self._count = max(self._count, len(found.all))
        return self._curves[one.key]

    def _price(self, one: Hypothesis) -> float:
        """What its parameters cost, by their number and by what was tried for them [nats]."""
        model, rows = self._problem.model, self.evidence.rows
        names = sum(_price(model.effect(n).size, rows) + math.log(len(self.names)) for n in one.names)
        curves = sum(self.price_of_curve(c.curve, len(c.coefficients)) for c in one.curves)
        something = SOMETHING if one.size or self.marginal(one).slow else 0.0
        return names + one.candidate.search + curves + something

    def price_of_curve(self, curve: Curve, size: int) -> float:
        """What a curve of so many values costs [nats]."""
        tried = math.log(self._count * curve.tried)
        return _price(size, self.evidence.rows) + tried + UNLISTED

    def _forward(self, beam: Sequence[Hypothesis]) -> None:
        """Extend the best sets, and the best one of the other kind, until that improves nothing."""
        last = math.inf
        for level in range(MOST):
            made = [one for lead in beam for one in self._grown(lead)]
            order = self.ranked()
            least = self.score(order[0])
            if not made or (level and last < least + 0.01):
                break
            beam, last = order[:BEAM], least
            other = next((n for n in order if bool(n.curves) != bool(order[0].curves)), None)
            further = [other] if other is not None and self.score(other) < least + OTHER else []
            further += [min(made, key=self.score)] if not level else []
            beam = list({id(one): one for one in (*beam, *further)}.values())

    def _exchange(self) -> None:
        """Drop each member of the lead, put others in its place, and begin again where that is better."""
        for _ in range(3):
            order = self.ranked()
            lead, least = order[0], self.score(order[0])
            other = next((n for n in order if bool(n.curves) != bool(lead.curves)), None)
            near = [other] if other is not None and self.score(other) < least + NEAR else []
            for one in (lead, *near):
                if one.exchanged:
                    continue
                one.exchanged = True
                members: list[str | Scored] = [*one.names, *one.curves]
                for member in members:
                    rest = self.sets.without(one, member, self.marginal(one).whitener)
                    self._instead(one, rest)
                    self._grown(rest, 1 if rest.curves else BESIDE_CURVES, 1)
                self._grown(one, BESIDE_CURVES, 1)
            if least < self.score(self.best) + 0.01:
                break

    def _grown(
        self, one: Hypothesis, names: int | None = None, curves: int | None = None
    ) -> list[Hypothesis]:
        """The set with each of the most promising names and curves more; nothing if that was done."""
        if one.grown or one.size >= MOST:
            return []
        one.grown = True
        names = (BESIDE_CURVES if one.curves else TRIED) if names is None else names
        curves = (0 if one.size > 2 else 1 if one.curves else 2) if curves is None else curves
        weights = self.marginal(one).whitener
        made = [self.sets.with_name(one, n, s, weights) for n, s in self._promising(one, names)]
        if curves and len(one.curves) < MOST_CURVES:
            made += [self.sets.with_curve(one, scored) for scored in self._curves_to_try(one, curves)]
        return [found for found in made if found is not None]

    def _curves_to_try(self, one: Hypothesis, count: int) -> Iterator[Scored]:
        """At so many directions the table and the known function that promise most."""
        there, seen = {own.curve.direction for own in one.curves}, set[tuple[str, bool]]()
        for gain, scored in self.judged_beside(one):
            key, begun = (scored.curve.direction, bool(scored.curve.formula)), {way for way, _ in seen}
            # Two curves of one variable at one place are one.
            fresh = key not in seen and key[0] not in there and (key[0] in begun or len(begun) < count)
            if gain > 0.0 and fresh:
                seen.add(key)
                yield scored

    def judged_beside(self, one: Hypothesis) -> list[tuple[float, Scored]]:
        """Curves beside a set with what each brings to first order [nats], the best first.

        Each is fitted by the set's own weights, and by one weight an output, which looks away from nothing.
        """
        if id(one) not in self._judged:
            problem = one.setting.problem
            found: dict[object, tuple[float, Scored]] = {}
            for whitener in (self.marginal(one).whitener, whitener_by_output(problem, one.fit.raw)):
                here = reweighed(problem, one.fit, whitener)
                beside, candidate = self.curves_beside(one).reweighed(here), replace(one.candidate, fit=here)
                tables = beside.judge(candidate)[:JUDGED]
                known = beside.functions(scored.curve for scored in tables[:3])
                pool = [*tables, *(beside.judge(candidate, known)[:FUNCTIONS] if tables else [])]
                without = self.evidence.first_order(here, np.zeros((*here.residual.shape, 0)))
                for scored in pool:
                    more = scored.candidate.fit.jacobian[:, :, here.jacobian.shape[2] :]
                    value = self.evidence.first_order(here, more)
                    gain = without - value - self.price_of_curve(scored.curve, more.shape[2])
                    if gain > found.get(label(scored), (-math.inf, scored))[0]:
                        found[label(scored)] = gain, scored
            self._judged[id(one)] = one, sorted(found.values(), key=lambda pair: -pair[0])
        return self._judged[id(one)][1]

    def _promising(self, one: Hypothesis, count: int) -> list[tuple[str, list[FloatArray]]]:
        """Names that promise most to first order beside a set, with their starts.

        By its own weights and by one weight an output in turn, as curves are judged.
        """
        candidates, own, effect = self._candidates, self.sets.linear(one), self._problem.model.effect
        plain = reweighed(one.setting.problem, one.fit, whitener_by_output(self._problem, one.fit.raw))
        plain = replace(plain, parameters=own.fit.parameters, raw=own.fit.raw)
        found: dict[str, tuple[int, list[FloatArray]]] = {}
        for beside in (own, replace(own, fit=plain)):
            gains = {n: candidates.score_test(beside, n) for n in self.names if n not in one.names}
            order = sorted((n for n, gain in gains.items() if gain > 0.0), key=lambda n: -gains[n])
            for place, name in enumerate(order):
                if name not in found or place < found[name][0]:
                    found[name] = place, candidates.screened(beside, effect(name))[1]
        best = sorted(found, key=lambda name: found[name][0])[:count]
        return [(name, found[name][1]) for name in best]

    def _instead(self, lead: Hypothesis, rest: Hypothesis) -> None:
        """Names in a member's place, from the states of the set that holds it."""
        weights = self.marginal(lead).whitener
        for name, starts in self._promising(rest, 2 if rest.curves else 4):
            if name not in lead.names:
                self.sets.in_place(lead, rest, name, starts, weights)

    def _kept_pair(self, pair: tuple[str, ...], fitted: Fit, steps: int) -> Hypothesis | None:
        problem, model = self._problem, self._problem.model
        if not np.isfinite(fitted.cost):
            return None
        fitted = self.sets.polished(problem, fitted, steps)
        if any(simpler(model, model.effect(name), fitted.parameters) for name in pair):
            return None
        search = sum(math.log(number_of_starts(problem, model.effect(name))) for name in pair)
        found = replace(self.base.candidate, effects=pair, fit=fitted, search=search)
        return self.sets.keep(Hypothesis(tuple(sorted(pair)), self.base.setting, found))

    def _every_pair(self) -> bool:
        """Fit every pair in the simulation, from what was declared and measured, by one weight an output.

        By the covariance of the base's errors the right pair may rank below the sixtieth.
        """
        candidates, problem, model = self._candidates, self._problem, self._problem.model
        weights = whitener_by_output(problem, self.base.fit.raw)
        starts = {n: candidates.screened(self.base.candidate, model.effect(n))[1][:1] for n in self.names}
        found: list[tuple[float, tuple[str, ...], Fit]] = []
        able = [n for n in self.names if starts[n]]
        for pair in itertools.combinations(able, 2):
            start = candidates.start.copy()
            for name in pair:
                start[model.slice_of(name)] = starts[name][0][model.slice_of(name)]
            fitted = best_of(problem, [start], candidates.free(pair), weights, problem.states, 10)
            if np.isfinite(fitted.cost):
                found.append((fitted.cost, pair, fitted))
        made = []
        for _, names, fitted in sorted(found, key=lambda one: one[0])[:PAIRS]:
            closer = refit(problem, fitted, whitener_by_output(problem, fitted.raw), 15)
            made.append(self._kept_pair(names, closer, 15))
        return any(one is not None for one in made)


def _price(size: int, rows: int) -> float:
    """Half a logarithm of the number of samples for each parameter, as Schwarz (1978) has it."""
    return 0.5 * size * math.log(rows)
