"""Curves that a simulation may lack: at which place, over which variable, and how they run.

A curve is a lookup table that nobody has listed. It may add to a force in any direction of motion, to what
a sensor shows, to a base parameter, or to the log-odds of an event; over time, a signal, its rate, a command,
or what remembers one. The response of the features to a unit force on each of a few segments of the windows
is simulated once, and the response to every curve is a combination of these. Those that could gain most on
the windows to which they are fitted are scored against the same held-out windows as the listed effects,
jointly with the free parameters and to first order.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis import waves
from fieldmodels.diagnosis.candidates import Candidate
from fieldmodels.diagnosis.feedback import fed_back
from fieldmodels.diagnosis.held_out import held_out_loss
from fieldmodels.diagnosis.jumps import jumps_near, strongest_jump
from fieldmodels.diagnosis.linearisation import PRIOR, Fit, project, pseudo_inverse, stacked
from fieldmodels.diagnosis.options import DiagnosisOptions
from fieldmodels.diagnosis.own_weights import has_own_weights, weighed
from fieldmodels.diagnosis.phrases import CONSTANT
from fieldmodels.diagnosis.problem import Problem
from fieldmodels.diagnosis.response import (
    Answers,
    averaged,
    felt_from,
    odds_responses,
    offsets,
    place_responses,
    responses,
    segments,
    sites_over,
)
from fieldmodels.diagnosis.result import MissingCurve
from fieldmodels.diagnosis.selection import (
    RARE_P,
    block_p_value,
    dispersed_p_value,
    dispersion,
    far_beyond,
    largest_share,
)
from fieldmodels.diagnosis.shapes import (
    Curve,
    Signals,
    along_a_line,
    fading,
    known_functions,
    products,
    tables,
    window_tables,
)
from fieldmodels.diagnosis.wander import SLOW, alike, beside, follows_slowly, wanders, wanders_more
from fieldmodels.drivers.curved import FreeCurve
from fieldmodels.drivers.variables import (
    CHANGE,
    MEMORY,
    PLAY,
    SEGMENTS,
    SHARE,
    TIMES,
    given,
    remembering,
    variable,
)
from fieldmodels.model import ForceDirection, Signal
from fieldmodels.recording.units import simplified

SCREENED = 24  # curves that are scored against held-out windows: the best ones on the fitted windows
HIDDEN = 2.0  # times as much a curve brings with weights of its own, if the others hid it
NEAR_BEST = 3  # tables whose known functions compete with names
TRIED = 4  # of the best tables and functions, of which the first that the data call for is taken
TOLD = 3.0  # times its error that a variable must move where noise drives the machine, as measured inputs do
OF_CHANCE = 5.0  # times as much a curve must bring in few blocks where chance drives: it brought 2.5 times
BEFORE = 2  # segments, by which a variable is late that may hold the noise that a controller feeds back
LASTING = 0.1  # of what a curve over that brings, that it must bring by what that was so long before
TOGETHER = 500_000  # numbers of curves that are looked at together, which bounds memory
SOUND = 1e-11  # of the largest eigenvalue of a curve's columns: below it they are the same
LEAST_SINE = 0.1  # of the angle between a curve's response and the span of the free parameters' sensitivities
SAME_SINE = 0.24  # below which a curve is what effects do anyhow: a sign over another width is 0.22


@dataclass(frozen=True, eq=False)
class Scored:
    """A curve scored jointly with a fit.

    Attributes:
        curve: The curve.
        gain: Improvement of every window's held-out loss [nats].
        p_value: One-sided, over blocks of windows.
        basis: What each identifiable combination adds at the knots, shape (points, combinations).
        values: The same on the segments of every window, shape (windows, segments, combinations), or on the
            windows alone.
        coefficients: Of the combinations, to first order, shape (combinations,).
        covariance: Of the coefficients.
        candidate: The fit with the curve's identifiable columns among its free parameters.
        instead: Place, target and variable of curves that these data do not tell from it.
    """

    curve: Curve
    gain: FloatArray
    p_value: float
    basis: FloatArray
    values: FloatArray
    coefficients: FloatArray
    covariance: FloatArray
    candidate: Candidate
    instead: tuple[tuple[str, str, str], ...] = ()

    @property
    def total(self) -> float:
        """Improvement of all windows [nats], before its price."""
        return float(self.gain.sum())

    @property
    def free(self) -> FreeCurve:
        """The curve for a fit with the whole simulation."""
        curve = self.curve
        sizes = np.maximum(np.abs(self.coefficients), 1.0)
        return FreeCurve(
            curve.place, curve.target, curve.over, curve.knots, self.basis, tuple(sizes), curve.period
        )

    @property
    def continued(self) -> Scored:
        """The same curve, which goes on along a line beyond its knots."""
        knots, basis = along_a_line(self.curve.knots, self.basis)
        return replace(self, curve=replace(self.curve, knots=knots), basis=basis)

    def shown(self, certain: bool = True, confirmed: bool = True) -> MissingCurve:
        """As a result; arguments as of that."""
        curve, before = self.curve, float(self.candidate.loss.sum()) + self.total
        variance = np.einsum("ij,jk,ik->i", self.basis, self.covariance, self.basis)
        errors = np.sqrt(np.maximum(variance, 0.0))
        return MissingCurve(
            curve.place,
            curve.target,
            curve.over,
            simplified(curve.over_unit),
            simplified(curve.unit),
            np.column_stack([curve.knots, self.basis @ self.coefficients, errors]),
            self.p_value,
            float(np.clip(100 * self.total / before, 0, 100)),
            curve.formula,
            certain,
            confirmed,
            curve.period,
            self.instead,
        )


class Curves:
    """The curves that are tried beside one fit."""

    def __init__(self, problem: Problem, fitted: Fit, options: DiagnosisOptions) -> None:
        self.problem, self.fitted, self.options = problem, fitted, options
        model = problem.model
        self._segment = [segments(part.windows.lengths, part.slots.shape[1]) for part in problem.parts]
        self._force = responses(problem, fitted)
        self._felt = felt_from(problem)
        self._moves = {push.name: push for push in model.pushes if push.moves}
        measured = [int(j) for j in np.unique(problem.outputs)]
        self._odds = {
            model.outputs[j].name: odds_responses(problem, fitted, j)
            for j in measured
            if model.outputs[j].event
        }
        self._shown = {
            model.outputs[j].name: offsets(problem, j, fitted) for j in measured if not model.outputs[j].event
        }
        self.signals = self._variables()
        self._fed_back: dict[str, bool] = {}
        self._answers: dict[tuple[str, str, str], Answers] = {}
        self._places: dict[tuple[str, str], FloatArray] = {}
        self._wave_products: dict[tuple[object, ...], FloatArray] = {}
        self._judged: dict[int, tuple[Candidate, list[Scored]]] = {}
        self.all = tuple(self._curves())
        self._wave_places = tuple(waves.places(model, self.signals, self._shown, self._averaged))
        self._over_time = [place for place in self._wave_places if place.over == "time"]

    def reweighed(self, fitted: Fit) -> Curves:
        """The same curves beside the same fit with other weights."""
        result = copy(self)
        result.fitted, result._answers, result._wave_products, result._judged = fitted, {}, {}, {}
        return result

    def judge(self, candidate: Candidate, curves: Iterable[Curve] | None = None) -> list[Scored]:
        """Score every curve beside a candidate, most probable first.

        Args:
            candidate: The fit that the responses were computed for, perhaps with curves of its own already.
            curves: The curves; by default all.
        """
        if curves is None and id(candidate) in self._judged:
            return self._judged[id(candidate)][1]
        basis, _ = np.linalg.qr(stacked(candidate.fit.jacobian[:, :, candidate.fit.active]))
        screen = _Screen(self, basis, candidate.fit.residual.reshape(-1))
        every = curves is None
        if curves is None:
            curves = (*self.all, *self._waves(screen), *self._jumps(screen))
        tried = tuple(curves)
        promising = [
            (gain - candidate.price * combination.shape[1], tried[k], combination)
            for k, gain, combination in screen.identifiable(tried)
        ]
        promising.sort(key=lambda one: -one[0])
        found = (self._scored(candidate, *one[1:]) for one in promising[:SCREENED])
        judged = sorted(
            (one for one in found if not self._is_an_echo(candidate, one)), key=lambda s: s.candidate.total
        )
        if every:
            self._judged[id(candidate)] = candidate, judged
        return judged

    def called_for(self, candidate: Candidate, scored: Scored, among: int | None = None) -> bool:
        """Whether a curve improves a candidate significantly, whichever of all curves it is.

        Args:
            candidate: What it is beside.
            scored: The curve.
            among: Of how many curves it is the best; by default of all.
        """
        if self.convinces(candidate, scored, among) and self.outdoes_noise(candidate, scored, among):
            return True
        if self._is_wandering_noise(candidate, scored):
            return False
        own = self.with_own_weights(candidate, scored)
        if own is None:
            return False
        curves, parent, again = own
        # One that acts in few blocks has its second chance only where the weights are what hid it.
        steady = again.p_value < self.options.curve_level or again.total > HIDDEN * scored.total
        return (
            steady and curves.convinces(parent, again, among) and curves.outdoes_noise(parent, again, among)
        )

    def _is_an_echo(self, candidate: Candidate, scored: Scored) -> bool:
        """Whether a sensor seems to depend on what its own noise has moved through a controller.

        Then it hardly depends on what that was a moment before, when a path or a set-point moved it, too.
        """
        curve, model = scored.curve, self.problem.model
        told = curve.over.startswith("rate of ") or curve.over in {
            *model.rates,
            *(s.name for s in model.inputs),
        }
        if curve.place != "sensor" or not told or model.random_force:
            return False
        if curve.target not in self._fed_back:
            self._fed_back[curve.target] = fed_back(self.problem, curve.target)
        if not self._fed_back[curve.target]:
            return False
        before = np.zeros_like(scored.values)
        before[:, BEFORE:] = scored.values[:, :-BEFORE]
        late = replace(curve, values=before, shapes=scored.basis)
        again = self._scored(candidate, late, np.eye(before.shape[2]))
        return again.total < LASTING * scored.total

    def with_own_weights(
        self, candidate: Candidate, scored: Scored
    ) -> tuple[Curves, Candidate, Scored] | None:
        """The curves, a fit and a curve beside it, with the weights of the errors that the curve leaves.

        Losses hold the logarithms of both covariances' determinants, so that their difference is that of a
        likelihood ratio. Whether the curve helps steadily (its p-value) is asked with its weights alone:
        what the determinants add is the same in all windows.

        Returns:
            None where that is not defined, see ``own_weights``.
        """
        if not has_own_weights(candidate.fit):
            return None
        plain, of_plain = weighed(self.problem, candidate, candidate.fit)
        own, of_own = weighed(self.problem, candidate, scored.candidate.fit)
        beside = self.reweighed(own.fit)
        again = next(iter(beside.judge(own, [scored.curve])), None)
        if again is None:
            return None
        before = plain.loss + of_own - of_plain
        return beside, replace(own, loss=before), replace(again, gain=before - again.candidate.loss)

    def convinces(self, candidate: Candidate, scored: Scored, among: int | None = None) -> bool:
        """Whether a curve brings what the best of so many must, on held-out windows; see ``called_for``."""
        needed = self._needed_of(among) + float(np.log(scored.curve.tried))
        least = max(needed, self.options.least_share * float(candidate.loss.sum()))
        if scored.total <= least:
            return False
        return scored.p_value < self.options.curve_level or self._in_few_blocks(scored, needed)

    def outdoes_noise(self, candidate: Candidate, scored: Scored, among: int | None = None) -> bool:
        """Whether it still does beside sensors whose zero wanders."""
        needed = self._needed_of(among) + float(np.log(scored.curve.tried))
        if scored.curve.place == "odds":
            return True
        options, more, fitted = self.options, self.options.same_gain, scored.candidate.fit
        if scored.curve.formula == CONSTANT and not wanders(self.problem, fitted, options.price):
            return True  # it may be where a walk has come to, but none is seen
        gain, left = beside(self.problem, candidate.fit, fitted, options.price, needed + more)
        if gain <= needed + (more if left > 0.0 else 0.0):
            return False
        return not self._is_wandering_noise(candidate, scored)

    def _is_wandering_noise(self, candidate: Candidate, scored: Scored) -> bool:
        """Whether walks of the sensors' zeros bring more beside a slow curve than the curve beside them.

        Noise that is no walk is followed by whatever is slow, but never as well as by walks.
        """
        if scored.curve.place == "odds" or not self._follows_slowly(candidate, scored):
            return False
        return wanders_more(self.problem, candidate.fit, scored.candidate.fit, self.options.price)

    def _follows_slowly(self, candidate: Candidate, scored: Scored) -> bool:
        """Whether a curve, or what it changes, is alike in neighbouring windows."""
        added = scored.values @ scored.coefficients
        means = added.reshape(len(added), -1).mean(axis=1)
        steady = float(np.mean(means**2)) / max(float(np.mean(added**2)), 1e-300)
        return steady * alike(self.problem, means) > SLOW or follows_slowly(
            self.problem, candidate.fit, scored.candidate.fit
        )

    def beside_walks(self, candidate: Candidate, scored: Scored) -> float:
        """Nats that a curve brings beside sensors whose zero wanders."""
        if scored.curve.place == "odds":
            return scored.total
        return beside(self.problem, candidate.fit, scored.candidate.fit, self.options.price, np.inf)[0]

    def _in_few_blocks(self, scored: Scored, needed: float) -> bool:
        """Whether a curve that acts in few blocks is called for nevertheless; see ``selection.accepted``."""
        blocks, fitted = self.problem.blocks, scored.candidate.fit
        if self.problem.model.random_force:
            needed *= OF_CHANCE
        elif far_beyond(scored.gain, scored.total, needed, blocks):
            return True
        if scored.p_value >= RARE_P or scored.total - largest_share(scored.gain, blocks) <= needed:
            return False
        step, _ = _solved(fitted)
        after = replace(fitted, residual=fitted.residual - fitted.jacobian @ step)
        count = len(scored.coefficients)
        excess = dispersion(after, np.arange(len(step)) >= len(step) - count, blocks)
        # Each block tells of the dispersion along each of the curve's columns.
        freedom = count * (len(np.unique(blocks)) - 1)
        return bool(dispersed_p_value(scored.total, count, excess, freedom) < np.exp(-needed))

    def _needed_of(self, among: int | None) -> float:
        """Nats that the best of so many curves must bring, by default of all."""
        return float(np.log((among or len(self.all)) / self.options.curve_level))

    @property
    def needed(self) -> float:
        """Nats that the best of all curves must bring: the logarithm of their number over the level."""
        return self._needed_of(None)

    def rivals(self, candidate: Candidate, count: int | None = None) -> list[Scored]:
        """The best curve beside a candidate, then further ones beside both, if the data call for them.

        Args:
            candidate: As of ``judge``.
            count: How many at most; by default those of the options.
        """
        found: list[Scored] = []
        for _ in range(self.options.most_curves if count is None else count):
            best = self.judge(candidate)[:1]
            if not best or (candidate.fit is not self.fitted and not self.called_for(candidate, best[0])):
                break
            found.append(best[0])
            candidate = best[0].candidate
        return found

    def first(self, candidate: Candidate) -> list[Scored]:
        """The best curve that the data call for beside a fit, a table or a known function; none or one.

        A function pays for one value or two where a table pays for eight.
        """
        tables = self.judge(candidate)[:NEAR_BEST]
        return self.first_of(candidate, [*tables, *self.as_known(candidate, tables)], len(self.all))

    def first_of(self, candidate: Candidate, scored: Sequence[Scored], among: int) -> list[Scored]:
        """The best of some curves that the data call for; none or one.

        What the best one brings may be the noise's, and the next is asked if it is nearly as good; not more,
        or one of many outdoes any noise. A constant is asked anyhow: no curve is simpler.
        """
        ranked = sorted(scored, key=lambda s: s.candidate.total)
        best = ranked[:TRIED] + [one for one in ranked[TRIED:] if one.curve.formula == CONSTANT][:1]
        near = (one for one in best if one.candidate.total < best[0].candidate.total + self._needed_of(among))
        return list(itertools.islice((one for one in near if self.called_for(candidate, one, among)), 1))

    def as_formula(self, candidate: Candidate, scored: Scored) -> Scored:
        """The same curve as a known function of its variable, where that is as good."""
        known = self.as_known(candidate, [scored])
        if known and known[0].candidate.total < scored.candidate.total:
            return known[0]
        return scored

    def as_known(self, candidate: Candidate, found: Iterable[Scored]) -> list[Scored]:
        """Known functions of the variables of some tables, the most probable first."""
        return self.judge(candidate, self.functions(scored.curve for scored in found))

    def functions(self, found: Iterable[Curve]) -> list[Curve]:
        """Known functions of the variables of some tables."""
        return [
            self._perhaps_share(one)
            for curve in found
            if curve.over in self.signals
            for one in known_functions(curve, self.signals[curve.over][1])
        ]

    def repeats(self, curve: Curve, chosen: Candidate) -> bool:
        """Whether a part of what a curve adds is what a set's effects do, the base's parameters aside."""
        fitted = chosen.fit
        known = fitted.jacobian[:, :, fitted.active]
        base = fitted.free[fitted.active] < len(self.problem.model.parameters)
        own = stacked(self.response(curve))
        own = beyond_span(own / (np.sqrt(np.sum(own**2, axis=0)) + 1e-300), stacked(known[:, :, base]))
        left, size, _ = np.linalg.svd(own, full_matrices=False)
        left = left[:, size > LEAST_SINE]
        rest = np.linalg.svd(beyond_span(left, stacked(known)), compute_uv=False)
        return bool((rest < SAME_SINE).any())

    def response(self, curve: Curve) -> FloatArray:
        """Whitened response of the features to each column, states projected out."""
        answers = self.answers(curve)
        return np.asarray(answers.columns @ answers.of(curve))

    def answers(self, curve: Curve) -> Answers:
        """How the residual answers at a curve's place."""
        target = curve.target.removeprefix(SHARE)
        moves = curve.place == "force" and target in self._moves
        key = curve.place, target, curve.over if moves else ""
        if key not in self._answers:
            columns = self._of_place(target, curve.over) if moves else self._columns(curve.place, target)
            felt = self._felt if curve.place == "force" and not moves else None
            sites = sites_over(self._told(curve.over)) if moves else None
            self._answers[key] = Answers(columns, felt, sites)
        return self._answers[key]

    def _told(self, over: str) -> FloatArray:
        """A variable that the machine is told, along all recordings."""
        recorded = [part.windows.recording for part in self.problem.parts]
        return np.concatenate([given(self.problem.model, one, over) for one in recorded])

    def _of_place(self, target: str, over: str) -> FloatArray:
        """As of ``Answers`` for curves of a place over a variable, which all weights share."""
        if (target, over) not in self._places:
            push = self._moves[target]
            self._places[target, over] = place_responses(self.problem, self.fitted, push, over)
        return project(self.fitted, self._places[target, over])

    def _columns(self, place: str, target: str) -> FloatArray:
        """As of ``Answers``; a parameter is one for a window, and its only segment is the whole."""
        if place == "parameter":
            k = int(np.flatnonzero(self.fitted.free == self.problem.model.index(target))[0])
            slope = self.problem.coordinates(self.fitted.free).slope(
                self.fitted.parameters[self.fitted.free]
            )[k]
            return np.asarray(self.fitted.jacobian[:, :, [k]] / slope)
        if place != "sensor":
            return project(self.fitted, (self._force if place == "force" else self._odds)[target])
        return project(self.fitted, self._shown[target], self._of_start(target))

    def _of_start(self, target: str) -> FloatArray | None:
        """What an erring sensor says too much of a window's start, as of ``project``; None if nothing."""
        model = self.problem.model
        sources = [model.measured_states.get(s.name, s.name) for s in model.states]
        same = np.array([source == target for source in sources])
        if self.problem.runs is not None or not same.any():
            return None
        first = np.eye(1, SEGMENTS)  # the first segment
        return np.asarray((same / (PRIOR * self.problem.state_scale))[:, None] * first)

    def _scored(self, candidate: Candidate, curve: Curve, combination: FloatArray) -> Scored:
        fitted, columns = candidate.fit, self.response(curve) @ combination
        wide = replace(
            fitted,
            jacobian=np.concatenate([fitted.jacobian, columns], axis=2),
            active=np.concatenate([fitted.active, np.ones(columns.shape[2], dtype=np.bool_)]),
        )
        loss = held_out_loss(wide, self.problem.folds)
        step, covariance = _solved(wide)
        count = columns.shape[2]
        return Scored(
            curve,
            candidate.loss - loss,
            block_p_value(candidate.loss - loss, self.problem.blocks),
            curve.shapes @ combination,
            curve.values @ combination,
            step[-count:],
            covariance[-count:, -count:],
            Candidate(
                candidate.effects,
                wide,
                candidate.search + float(np.log(len(self.all) * curve.tried)),
                loss,
                candidate.size + count,
                candidate.price,
            ),
        )

    def _curves(self) -> Iterator[Curve]:
        model, signals = self.problem.model, self.signals
        events = set(self._odds)
        lasting = {n: s for n, s in signals.items() if MEMORY not in n and PLAY not in n}
        plain = {name: s for name, s in lasting.items() if name not in events}
        remembered = {name: s for name, s in signals.items() if name not in lasting}
        outputs = {s.name: s.unit for s in model.outputs}
        own = {n: {k: s for k, s in remembered.items() if f" {n} " in k} for n in outputs}
        made = {name: tuple(tables({name: one})) for name, one in signals.items()}

        def tabled(names: Iterable[str]) -> Iterator[Curve]:
            return itertools.chain.from_iterable(made[name] for name in names)

        # Where chance drives the machine, it is told from a sensor's error alone by what that depends on.
        chance = model.random_force
        for push in model.pushes:
            over = {**plain, **remembered}
            if chance:
                over = {n: s for n, s in over.items() if not any(n in one for one in own.values())}
            if sum(weight != 0.0 for weight in push.weights) > 1:  # part of others, which have all variables
                over = {n: s for n, s in over.items() if push.rate in n}
            if push.over:
                over = {n: s for n, s in over.items() if push.may_depend_on(n)}
            for curve in tabled(over):
                if not (push.moves and curve.formula):  # a place does not only bend at its ends
                    yield replace(curve, target=push.name, unit=push.unit or "1")
            if push.rate in signals:
                places = {n: s for n, s in plain.items() if n in outputs or n == "time"}
                per = signals[push.rate][0]
                share = "1" if per == push.unit else f"{push.unit} / ({per})"
                for curve in tabled(places):
                    yield self._perhaps_share(replace(curve, target=SHARE + push.name, unit=share))
        for curve in products({n: s for n, s in plain.items() if model.pushes[0].may_depend_on(n)}):
            yield replace(curve, target=model.pushes[0].name, unit=model.pushes[0].unit or "1")
        told = (name for s in model.inputs for name in (s.name, f"{CHANGE}{s.name}") if name in plain)
        for name in told:  # of a change: a delay that grows
            yield replace(fading(name, plain), target=model.pushes[0].name, unit=model.pushes[0].unit or "1")
        for name in events:
            for curve in (*tabled(lasting), *products(lasting)):
                yield replace(curve, place="odds", target=name, unit="1")
        for name in self._shown:
            apart = {name: plain[name]} if name in plain else {}
            # A controller's next command holds the sensor's noise, and so does its change.
            steady = {n: s for n, s in plain.items() if not n.startswith(CHANGE)}
            over = {**(apart if chance else steady), **own[name]}
            for curve in (*tabled(over), *(fading(one, plain) for one in apart)):
                yield replace(curve, place="sensor", target=name, unit=outputs[name])
        first = len(model.parameters) if chance else 0
        of_windows = tuple(window_tables(plain))
        for i in self.fitted.free[self.fitted.free >= first]:
            p = model.all_parameters[i]
            if p.knot:  # of a function already
                continue
            for curve in of_windows:
                yield replace(curve, place="parameter", target=model.names[i], unit=p.unit)

    def _waves(self, screen: _Screen) -> Iterator[Curve]:
        """The strongest wave at each place over each variable."""
        for place in self._wave_places:
            found = waves.strongest(place, screen.powers)
            if found is not None:
                yield self._perhaps_share(found)

    def _jumps(self, screen: _Screen) -> Iterator[Curve]:
        """The strongest jump of each force and each sensor's zero."""
        time = self.signals["time"][1]
        for place in self._over_time:
            found = strongest_jump(time, *screen.of_units(place), LEAST_SINE)
            if found is None:
                continue
            near = jumps_near(place, time, *found)
            seen = screen.identifiable(near)
            if seen:
                yield near[max(seen, key=lambda one: one[1])[0]]

    def _perhaps_share(self, curve: Curve) -> Curve:
        """What a share of a direction's own rate adds to it; any other curve as it is."""
        if not curve.target.startswith(SHARE):
            return curve
        return replace(curve, values=curve.values * self.share_of(curve)[..., None])

    def share_of(self, curve: Curve) -> FloatArray:
        """The rate of which a curve is a share, on the segments of every window; of any other curve one."""
        if not curve.target.startswith(SHARE):
            return np.ones_like(self.signals["time"][1])
        (rate,) = [p.rate for p in self.problem.model.pushes if p.name == curve.target.removeprefix(SHARE)]
        return self.signals[rate][1]

    def wave_products(self, place: Curve, counts: FloatArray) -> FloatArray:
        """Products of what the cosine and the sine of so many cycles at a place answer, (counts, 2, 2)."""
        key = place.place, place.target, place.over, counts.tobytes()
        if key not in self._wave_products:
            answers = self.answers(place)
            share = answers.spread(self.share_of(place))
            pairs = answers.products * share[..., None] * share[:, None, :]
            self._wave_products[key] = waves.products(answers.spread(place.values), pairs, counts)
        return self._wave_products[key]

    def _variables(self) -> Signals:
        """Candidate variables averaged over the segments: outputs, their rates, inputs, memory, and time."""
        model = self.problem.model
        runs, first = [], 0
        for part in self.problem.parts:
            # A fitted initial state absorbs the random force of its window, which would then appear as a
            # force that depends on the state; the measured one does not.
            windows, last = part.windows, first + len(part.windows)
            states = windows.states if model.random_force else self.fitted.states[first:last]
            runs.append(model.simulate_all(self.fitted.parameters[None], windows.with_states(states))[0])
            first = last
        collected = {}
        for name, unit in self._named(runs):
            joined = self._averaged(name, runs)
            if np.ptp(joined) > 0:
                collected[name] = unit, joined
        return collected

    def _averaged(self, name: str, runs: Sequence[FloatArray] = ()) -> FloatArray:
        """A variable averaged over the segments of every window; of what a machine is told without runs."""
        parts = self.problem.parts
        runs = runs or [np.zeros((0, 0, 0))] * len(parts)
        values = [
            averaged(variable(self.problem.model, part.windows, out, name), segment)
            for part, out, segment in zip(parts, runs, self._segment, strict=True)
        ]
        return np.concatenate(values)

    def _is_told(self, output: int, order: int) -> bool:
        """Whether an output, or with order one its rate, moves well beyond its error.

        What the noise of measured inputs moves errs by as much, and its error would seem to depend on it.
        """
        if not self.problem.model.noisy_inputs:
            return True
        own, raw = self.problem.outputs == output, self.fitted.raw
        powers = []
        for values in (self.problem.features - raw, raw):
            changes = np.diff(values[:, own], order, axis=1)
            powers.append(float(np.nansum((changes - np.nanmean(changes, axis=1, keepdims=True)) ** 2)))
        return powers[0] > TOLD**2 * powers[1]

    def _named(self, runs: Sequence[FloatArray]) -> Iterator[tuple[str, str]]:
        """Names and units of the candidate variables."""
        model, parts = self.problem.model, self.problem.parts
        recorded = [part.windows.recording for part in parts]
        duration = self.problem.parts[0].windows.samples * recorded[0].step
        yield "time", "s"
        units = {signal.unit for signal in model.outputs}
        for j, signal in enumerate((*model.outputs, *model.unmeasured)):
            values = [out[:, :, j][segment >= 0] for out, segment in zip(runs, self._segment, strict=True)]
            if any(np.isfinite(v).mean() < 0.9 for v in values) or (model.random_force and signal.optional):
                continue
            if self._is_told(j, 0):
                yield signal.name, signal.unit
            if model.random_force and not signal.event:
                for name in remembering(signal.name, duration, float(np.nanstd(np.concatenate(values)))):
                    yield name, signal.unit
            if model.random_force or signal.event or not self._is_told(j, 1):
                continue  # random forces drive the rates, so that these do not reveal what forces depend on
            if f"{signal.unit}/s" not in units:
                states = (state for state, output in model.rates.items() if output == signal.name)
                yield next(states, f"rate of {signal.name}"), f"{signal.unit}/s"
            if signal.name not in model.unbounded_outputs and all(signal.name in one for one in recorded):
                for name in remembering(signal.name, duration, float(np.nanstd(np.concatenate(values)))):
                    yield name, signal.unit
        inputs: Sequence[Signal | ForceDirection] = (*model.inputs, *model.sums)
        for one in inputs:
            told = [given(model, recording, one.name) for recording in recorded]
            if max(len(np.unique(values)) for values in told) <= 3:
                continue  # a flag or a setting
            yield one.name, one.unit
            if isinstance(one, Signal):
                yield f"{CHANGE}{one.name}", one.unit
            for name in remembering(one.name, duration, float(np.std(np.concatenate(told)))):
                yield name, one.unit
            for share in TIMES:
                name = f"{one.name} times {MEMORY}size of {one.name} over {share * duration:.4g} s"
                yield name, f"{one.unit} {one.unit}"


class _Screen:
    """Products of what curves explain with each other, with the free parameters and with the residual."""

    def __init__(self, curves: Curves, basis: FloatArray, residual: FloatArray) -> None:
        """Prepare.

        Args:
            curves: Whose places answer.
            basis: Orthonormal basis of the free parameters' sensitivities, shape (windows * rows, free).
            residual: What remains to be explained, shape (windows * rows,).
        """
        self._curves = curves
        self._others = np.column_stack([basis, residual])
        self._left = basis.T @ residual
        self._with_others: dict[int, FloatArray] = {}

    def identifiable(self, curves: Sequence[Curve]) -> list[tuple[int, float, FloatArray]]:
        """Those of some curves that are identifiable: number, and as of ``_identifiable``; in their order.

        Curves at one place with equally many columns are looked at together.
        """
        alike: dict[tuple[int, int], list[int]] = {}
        for k, curve in enumerate(curves):
            key = id(self._curves.answers(curve)), curve.values.shape[-1]
            alike.setdefault(key, []).append(k)
        found = []
        for (_, columns), numbers in alike.items():
            answers = self._curves.answers(curves[numbers[0]])
            windows, _, segments = answers.columns.shape
            at_once = max(TOGETHER // (windows * segments * columns), 1)
            for i in range(0, len(numbers), at_once):
                some = numbers[i : i + at_once]
                # Windows first, so that each takes one product for all curves.
                values = np.stack([answers.of(curves[k]) for k in some], axis=2)
                apart = np.ascontiguousarray(values.reshape(-1, len(some), columns).transpose(1, 2, 0))
                flat = values.reshape(windows, segments, -1)
                image = (answers.products @ flat).reshape(-1, len(some), columns).transpose(1, 0, 2)
                others = apart @ self._of(answers).reshape(windows * segments, -1)
                gram = apart @ np.ascontiguousarray(image)
                seen = _identifiable(gram, others[:, :, :-1].transpose(0, 2, 1), others[:, :, -1], self._left)
                found += [(k, *one) for k, one in zip(some, seen, strict=True) if one is not None]
        return sorted(found, key=lambda one: one[0])

    def powers(self, place: Curve, counts: FloatArray) -> FloatArray:
        """What waves of so many cycles at a place explain beside the basis, shape (counts,)."""
        curves = self._curves
        answers = curves.answers(place)
        others = self._of(answers) * answers.spread(curves.share_of(place))[..., None]
        pairs = waves.against(answers.spread(place.values), others, counts)
        cross, whole = pairs[:-1], curves.wave_products(place, counts)
        own = whole - np.einsum("fkc,fkd->kcd", cross, cross)
        slopes = pairs[-1] - np.tensordot(self._left, cross, 1)
        size, left = (np.trace(one, axis1=1, axis2=2) for one in (whole, own))
        told = left > LEAST_SINE**2 * size  # others are what the free parameters do
        own = np.where(told[:, None, None], own + 1e-6 * size[:, None, None] * np.eye(2), np.eye(2))
        explained = np.sum(slopes * np.linalg.solve(own, slopes[..., None])[..., 0], axis=1)
        return np.where(told, explained, 0.0)

    def of_units(self, place: Curve) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Of a unit at a place throughout each window: square, products with all others, and these' own.

        As of ``strongest_jump``.
        """
        answers = self._curves.answers(place)
        return answers.products.sum(axis=(1, 2)), self._of(answers).sum(axis=1), self._left

    def _of(self, answers: Answers) -> FloatArray:
        if id(answers) not in self._with_others:
            self._with_others[id(answers)] = answers.with_all(self._others)
        return self._with_others[id(answers)]


def _identifiable(
    gram: FloatArray, cross: FloatArray, slopes: FloatArray, left: FloatArray
) -> list[tuple[float, FloatArray] | None]:
    """What of some curves the free parameters cannot reproduce.

    A curve that is nearly collinear with a free parameter (a force proportional to the angle, with the
    stiffness free) would get a huge coefficient, whose small remaining component fits the noise.

    Args:
        gram: Products of the response to a curve's columns, shape (curves, columns, columns).
        cross: The same with an orthonormal basis of the free parameters' sensitivities, (curves, free,
            columns).
        slopes: The same with the residual, shape (curves, columns).
        left: Of the basis with the residual, shape (free,).

    Returns:
        Of each curve what the identifiable combinations gain on the fitted windows [nats], and these, shape
        (columns, combinations); None if there are none.
    """
    scale = np.sqrt(np.maximum(np.diagonal(gram, axis1=1, axis2=2), 0.0)) + 1e-30
    size, turn = np.linalg.eigh(gram / (scale[:, :, None] * scale[:, None, :]))
    sound = size > SOUND * np.maximum(size[:, -1:], 1e-30)
    rooted = np.sqrt(np.where(sound, size, 1.0))
    white = np.where(sound[:, None, :], turn / rooted[:, None, :] / scale[:, :, None], 0.0)
    across = cross @ white
    own = np.eye(gram.shape[1]) * sound[:, None, :]
    squares, turn = np.linalg.eigh(own - across.transpose(0, 2, 1) @ across)
    kept = squares > LEAST_SINE**2
    combined = white @ turn
    explained = (slopes[:, None, :] @ combined)[:, 0] - ((left @ across)[:, None, :] @ turn)[:, 0]
    gains = 0.5 * np.sum(np.where(kept, explained**2, 0.0) / np.where(kept, squares, 1.0), axis=1)
    return [
        (float(gain), np.ascontiguousarray(all_of[:, these])) if these.any() else None
        for gain, all_of, these in zip(gains, combined, kept, strict=True)
    ]


def beyond_span(columns: FloatArray, others: FloatArray) -> FloatArray:
    """What of some columns is not in the span of others."""
    if not others.shape[1]:
        return columns
    basis, _ = np.linalg.qr(others)
    return np.asarray(columns - basis @ (basis.T @ columns))


def _solved(wide: Fit) -> tuple[FloatArray, FloatArray]:
    """Gauss-Newton step of all active columns, zero for the others, and its covariance."""
    active = wide.active
    flat = stacked(wide.jacobian[:, :, active])
    # A parameter of the machine may be known a hundred thousand times better than a curve.
    size = np.sqrt(np.sum(flat**2, axis=0))
    size = np.where(size > 0.0, size, 1.0)
    inverse = pseudo_inverse((flat / size).T @ (flat / size), 1e-8) / np.outer(size, size)
    step, covariance = np.zeros(len(active)), np.zeros((len(active), len(active)))
    step[active] = inverse @ (flat.T @ wide.residual.reshape(-1))
    covariance[np.ix_(active, active)] = inverse
    return step, covariance
