"""Fits of candidate effects: the base and a set of effects, freed together."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from threading import Lock
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis import waves
from fieldmodels.diagnosis.budget import SEARCH, Budget
from fieldmodels.diagnosis.effort import shared, threads_of
from fieldmodels.diagnosis.fit import best_of, costs, fit, parameters_at, refit, weighed
from fieldmodels.diagnosis.held_out import held_out_loss, leave_out_steps, window_loss
from fieldmodels.diagnosis.linearisation import Fit, project, stacked
from fieldmodels.diagnosis.options import DEFAULT, DiagnosisOptions
from fieldmodels.diagnosis.problem import Problem
from fieldmodels.diagnosis.response import Answers, felt_from, mean_outputs, responses, sample_times
from fieldmodels.diagnosis.whitening import whitener_by_output
from fieldmodels.model import Effect, Model

IntArray = NDArray[np.int64]
Names = tuple[str, ...]
Pushed = tuple[Answers, FloatArray, FloatArray]
Item = TypeVar("Item")
Result = TypeVar("Result")
NONE = np.zeros(0, dtype=np.int64)
TRIED = 2  # starts that are followed after screening
CLOSER = 2  # times that a first-order gain is read from a step nearer to what it says is there
PROMISED = 0.7  # of the gain predicted of the first start: with so much in hand no other one is followed
LEAST = 0.5  # nats of the same
BASE_STEPS = 30  # of a fit of the base
MOST = 60  # steps of a fit; a load on a body whose suspension is unknown took forty
ROUGH = 0.1  # nats; an extension whose step gains less is told from others, and fitted again if it is near
HELD = 2  # better points in a row at which a bound holds a fit that then counts as the simpler effect there
LINES = 4  # spectral lines that are followed
SLOW = (
    29  # periods along the way, from the whole of it to a fifteenth, that are worth their simulation anyhow
)
BATCH = 100  # parameter vectors a call, which bounds memory
SCANNED = 50_000  # samples; with more a frequency is sought only where the model expects it
FREQUENCIES = 0.1, 5.0  # sought, in cycles of the main horizon, which follows the machine's pace
USUAL = 0.5  # the same of a resonance
MAX_FREQUENCIES = 1000  # half a spectral line apart, those nearest to the usual one
CLEAR = 8.0  # nats that an effect on events gains at its start without a refit: it is not absorbed
EXTRAPOLATED = 5.0  # nats above its fitted loss from which on a window's held-out one is simulated
SEEN = 1e-8  # of a wave's power, what the free parameters leave at least where anything is told of it
FAR = 3.0  # times the sensor's noise: a base that is nearer is not doubted
BETTER = 0.05  # of the samples' error, by which another start must lead nearer than the usual ones
REWEIGHED = 3  # times that weights follow what is left of the errors
SINGULAR = 2e-3  # smallest singular value of unit columns that counts as identifiable


@dataclass(frozen=True)
class Candidate:
    """A set of effects fitted jointly with the base.

    Attributes:
        effects: Names of the effects, in the order in which they were added.
        fit: Parameters and states.
        search: Penalty [nats] for the search over several starts: the logarithm of their number.
        loss: Held-out loss [nats] of every window.
        size: Number of the effects' parameters.
        price: Of each [nats].
    """

    effects: Names
    fit: Fit
    search: float
    loss: FloatArray
    size: int = 0
    price: float = DEFAULT.price

    @property
    def total(self) -> float:
        """Held-out loss of all windows with the penalties for search and size: what selection minimises."""
        return float(self.loss.sum()) + self.search + self.price * self.size


@dataclass
class Candidates:
    """Fits sets of effects to one problem.

    Attributes:
        problem: Training windows.
        start: Parameter vector with the fixed values; also the start of the base.
        fixed: Names of parameters that are not fitted.
        folds: Fold of each window for held-out losses.
        whitener: Whitening matrix that all fits share.
        unidentifiable: Effects that the free parameters absorb exactly.
        options: Thresholds and prices.
        budget: How long the search may take.
        seen: Cached results of ``screened``, by parent and effect.
        made: The same of ``again`` and ``without``, by candidate, effect and whitener.
        tried: Effects that were added to a set, with that set.
        pushes: The same of ``_pushed``, by fit.
        pushing: Held while one of these is made, by fit.
        bases: The same of ``base``, by number of steps.
        extensions: The same of ``extension.extend``, by candidate, curves and weights.
    """

    problem: Problem
    start: FloatArray
    fixed: frozenset[str]
    folds: IntArray
    whitener: FloatArray
    options: DiagnosisOptions = DEFAULT
    budget: Budget = field(default_factory=Budget)
    unidentifiable: set[str] = field(default_factory=set)
    seen: dict[tuple[int, str], tuple[Fit, float, list[FloatArray]]] = field(default_factory=dict)
    made: dict[tuple[int, str, int], tuple[Candidate, FloatArray, Candidate]] = field(default_factory=dict)
    tried: set[tuple[frozenset[str], str]] = field(default_factory=set, init=False)
    pushes: dict[int, tuple[Fit, tuple[Answers, FloatArray, FloatArray]]] = field(
        default_factory=dict, init=False
    )
    pushing: dict[int, Lock] = field(default_factory=dict, init=False)
    bases: dict[int, Candidate] = field(default_factory=dict, init=False)  # of this problem alone
    extensions: dict[tuple[int, ...], Any] = field(default_factory=dict, init=False)

    def of(self, problem: Problem) -> Candidates:
        """The same for another problem, with nothing fitted yet."""
        return replace(self, problem=problem, folds=problem.folds, unidentifiable=set(), seen={}, made={})

    def free(self, effects: Names) -> IntArray:
        """Indices of the parameters that are fitted by gradient: base and effects, except fixed ones."""
        model = self.problem.model
        indices = list(range(len(model.parameters)))
        for name in effects:
            indices += range(*model.slice_of(name).indices(len(model.names)))
        parameters = model.all_parameters
        moved = [i for i in indices if model.names[i] not in self.fixed and parameters[i].smooth]
        count = len(model.parameters)  # a known base parameter is among the fixed, unless a stage frees it
        return np.array([i for i in moved if i < count or parameters[i].refitted], dtype=np.int64)

    def names(self) -> list[str]:
        """Effects to try: not fixed by the user, identifiable, and not detected from the values."""
        model = self.problem.model
        return [
            effect.name
            for effect in model.effects
            if not any(f"{effect.name}.{p.name}" in self.fixed for p in effect.parameters)
            and effect.name not in self.unidentifiable
            and not is_quantisation(effect)
        ]

    def base(self, iterations: int = BASE_STEPS) -> Candidate:
        """Fit the base alone, from the nominal values, the model's starts and a coarse search."""
        if iterations not in self.bases:
            self.bases[iterations] = self._fitted_base(iterations)
            self.whitener = self.bases[iterations].fit.whitener
        return self.bases[iterations]

    def begin(self, base: Candidate) -> None:
        """Take a fit of the base, and its weights, for that from which the search begins."""
        self.bases[BASE_STEPS] = base
        self.whitener = base.fit.whitener

    def fitted(
        self, effects: Names, start: FloatArray, states: FloatArray, whitener: FloatArray | None = None
    ) -> Candidate:
        """A set, fitted from given parameters and states; by default with the current weights."""
        whitener = self.whitener if whitener is None else whitener
        return self.judged(effects, fit(self.problem, start, self.free(effects), whitener, states), 0.0)

    def _fitted_base(self, iterations: int) -> Candidate:
        problem, free = self.problem, self.free(())
        starts = _base_starts(problem, self.start, free)
        simulated = problem.simulate(starts, problem.states)
        costs = np.sum(((problem.features - simulated) @ self.whitener.T) ** 2, axis=(1, 2))
        order = np.argsort(np.where(np.isfinite(costs), costs, np.inf))[:3]
        # Weighed by a signal's spread, averages would count nothing beside events, and states follow these.
        self.whitener = whitener_by_output(problem, problem.features - simulated[order[0]])
        best = best_of(problem, [starts[i] for i in order], free, self.whitener, problem.states, 8)
        best = refit(problem, best, self.whitener, iterations)
        best = weighed(problem, best, 10)
        if len(_shown(problem)) and not problem.model.random_force and times_off(problem, best) > FAR:
            other = self._from_fitted_states(free, iterations)
            if _misfit(problem, other) < _misfit(problem, best) - BETTER:
                best = other
        return self.judged((), best, 0.0)

    def _from_fitted_states(self, free: IntArray, iterations: int) -> Fit:
        """The base from the given start, of whose windows the initial states are fitted first.

        What no sensor sees is far off at first: errors from there say little of parameters, or of weights.
        """
        problem, start = self.problem, self.start
        raw, states = problem.features - problem.simulate(start[None], problem.states)[0], problem.states
        for _ in range(REWEIGHED):
            still = fit(problem, start, NONE, whitener_by_output(problem, raw), states, 5)
            raw, states = still.raw, still.states
        still = fit(problem, start, free, whitener_by_output(problem, raw), states, 0)
        moved = weighed(problem, refit(problem, still, still.whitener, iterations), 10)
        return min(moved, still, key=lambda f: _misfit(problem, f))

    def each(self, function: Callable[[Item], Result], items: Sequence[Item]) -> list[Result]:
        """Results of independent fits, in the order of their items, shared by threads."""
        return shared(function, items, threads_of(self.options.threads))

    def extend(self, parent: Candidate, name: str) -> Candidate | None:
        """Add an effect to a fitted set; None if no start gives a finite cost, or the time is over."""
        return self._in_time(parent, name, lambda: self._extended(parent, name), None)

    def _extended(self, parent: Candidate, name: str) -> Candidate | None:
        self.tried.add((frozenset(parent.effects), name))
        effect = self.problem.model.effect(name)
        starts, good = self.screened(parent, effect)[1], self.promised(parent, name)
        free = self.free((*parent.effects, name))
        best = best_of(self.problem, starts, free, self.whitener, parent.fit.states, 3, good)
        if not np.isfinite(best.cost):
            return None
        best = refit(self.problem, best, self.whitener, MOST, _Enough(self.problem.model, effect))
        if effect.where == "sensor" and _left_measured(self.problem, parent.fit):
            best = min(best, self._from_measured(best.parameters, free), key=lambda f: f.cost)
        best = self.profiled(best, effect)
        if simpler(self.problem.model, effect, best.parameters) or self._never_repeats(
            effect, best.parameters
        ):
            return None
        search = np.log(number_of_starts(self.problem, effect)) + parent.search
        return self.judged((*parent.effects, name), best, float(search))

    def _never_repeats(self, effect: Effect, parameters: FloatArray) -> bool:
        """Whether a period along the way has ended beyond the longest that is sought, the way itself."""
        values = parameters[self.problem.model.slice_of(effect.name)]
        pairs = zip(effect.parameters, values, strict=True)
        return any(p.name == "period" and value > max(p.starts, default=np.inf) for p, value in pairs)

    def _from_measured(self, start: FloatArray, free: IntArray) -> Fit:
        """A fit whose initial states begin where they were measured, weighed by its own errors on the way.

        Without a sensor's error the base believes its motion more than the sensor; its states and weights
        keep a fit that goes on from there in a local minimum.
        """
        problem = self.problem
        begun = fit(problem, start, free, self.whitener, problem.states, 3)
        return refit(problem, weighed(problem, begun, 10), self.whitener, MOST)

    def again(self, candidate: Candidate) -> Candidate:
        """Refit a candidate with the current whitener."""

        def refitted() -> Candidate:
            fitted = refit(self.problem, candidate.fit, self.whitener, MOST)
            return self.judged(candidate.effects, fitted, candidate.search)

        return self._once(candidate, "", refitted)

    def without(self, candidate: Candidate, gone: str) -> Candidate:
        """Refit a set with one effect removed."""
        model = self.problem.model

        def refitted() -> Candidate:
            effects = tuple(name for name in candidate.effects if name != gone)
            start = candidate.fit.parameters.copy()
            start[model.slice_of(gone)] = self.start[model.slice_of(gone)]
            fitted = fit(self.problem, start, self.free(effects), self.whitener, candidate.fit.states)
            return self.judged(effects, fitted, candidate.search)

        return self._once(candidate, gone, refitted)

    def _once(self, candidate: Candidate, gone: str, make: Callable[[], Candidate]) -> Candidate:
        """What was made of a candidate, perhaps without an effect, with the same weights; else make it."""
        key = id(candidate), gone, id(self.whitener)
        if key not in self.made:
            # Both are kept with their ids, so that these cannot be used again.
            self.made[key] = candidate, self.whitener, make()
        return self.made[key][2]

    def simplified(self, candidate: Candidate) -> Candidate:
        """The set with the simpler effect in place of one that has come to equal it when it was refitted."""
        model = self.problem.model
        for name in candidate.effects:
            twin = simpler(model, model.effect(name), candidate.fit.parameters)
            if twin and twin not in candidate.effects:
                return self.extend(self.without(candidate, name), twin) or candidate
        return candidate

    def score_test(self, parent: Candidate, name: str) -> float:
        """Improvement [nats] by an effect from its best start, predicted to first order (a score test).

        None is promised where the time for the search is over.
        """
        effect = self.problem.model.effect(name)
        return self._in_time(parent, name, lambda: self.screened(parent, effect)[0], -np.inf)

    def _in_time(self, parent: Candidate, name: str, act: Callable[[], Result], otherwise: Result) -> Result:
        """What a step of the search for an effect beside a parent gives, if there is time for it."""
        return self.budget.within(" + ".join((*parent.effects, name)), act, otherwise, SEARCH)

    def twins(self, name: str) -> set[str]:
        """Simpler effects that an effect equals at bounds of its parameters."""
        return {twin for p in self.problem.model.effect(name).parameters for twin in p.reduces_to if twin}

    def promised(self, parent: Candidate, name: str) -> float:
        """Cost [nats] at which a fit of an effect beside a parent needs no other start; -inf if none does."""
        if self.problem.observations is not None or parent.fit.whitener is not self.whitener:
            return -np.inf
        return parent.fit.cost - max(PROMISED * self.score_test(parent, name), LEAST)

    def score(self, parent: Candidate, starts: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Improvement [nats] by an effect from each of its starts, predicted to first order (score tests).

        Args:
            parent: What the effect is added to.
            starts: As of ``start_vectors``.

        Returns:
            Improvements, shape (starts,), and the optimal multiple of each linear parameter's step,
            shape (starts, group).
        """
        count, group, size = starts.shape
        flat_starts = starts.reshape(-1, size)
        simulated = np.concatenate(
            [
                self.problem.simulate(flat_starts[i : i + BATCH], parent.fit.states)
                for i in range(0, len(flat_starts), BATCH)
            ]
        )
        change = simulated - (self.problem.features - parent.fit.raw)
        columns = project(parent.fit, np.moveaxis(change, 0, 2))
        flat, residual = self.beside(parent.fit, columns)
        flat = flat.reshape(len(flat), count, group).transpose(1, 0, 2)
        power = flat.transpose(0, 2, 1) @ flat
        trace = np.trace(power, axis1=1, axis2=2)[:, None, None]
        power = power + (1e-6 * trace + 1e-12) * np.eye(group)
        slope = flat.transpose(0, 2, 1) @ residual
        multiple = np.linalg.solve(power, slope[:, :, None])[:, :, 0]
        return 0.5 * np.sum(multiple * slope, axis=1), multiple

    def start_vectors(self, parent: Candidate, effect: Effect) -> FloatArray:
        """Starts with one linear parameter switched on at a time, shape (starts, linear, parameters)."""
        choices = [_parameter_starts(self.problem, effect, k) for k in range(len(effect.parameters))]
        linear = _linear(self.problem, effect)
        for k, parameter in enumerate(effect.parameters):
            if effect.where != "force" or not self.problem.model.disturbance_unit or len(choices[k]) <= LINES:
                continue
            if parameter.unit == "Hz":  # a model states peaks by size
                found = self.lines(parent, sample_times(self.problem), np.sort(choices[k]))
                choices[k] = tuple(found.tolist())
            way = [j for j in _shown(self.problem) if self.problem.model.outputs[j].unit == parameter.unit]
            if parameter.name == "period" and len(way) == 1:
                passed = mean_outputs(self.problem, parent.fit, way[0])
                found = self.lines(parent, passed, np.sort(1.0 / np.array(choices[k])), SLOW)
                choices[k] = tuple((1.0 / found).tolist())
        values = np.array(list(itertools.product(*choices)))
        place = self.problem.model.slice_of(effect.name)
        result = np.tile(parent.fit.parameters, (len(values), len(linear), 1))
        for g, k in enumerate(linear):
            result[:, g, place] = values
            for other in linear:
                if other != k:
                    result[:, g, place.start + other] = effect.parameters[other].nominal
        return result

    def lines(
        self, parent: Candidate, over: FloatArray, grid: FloatArray, slow: int | None = None
    ) -> FloatArray:
        """Frequencies of a periodic force that explain most of a parent's residual, by its force response.

        Args:
            parent: What the force is added to.
            over: What it repeats over, on the segments of every window, shape (windows, segments).
            grid: Frequencies that are tried, rising.
            slow: How many, the first, are worth their simulation anyhow, by default all: short waves take
                short steps, and must promise what an effect must bring.
        """
        answers, others, left = self._pushed(parent.fit)
        over = answers.spread(over)
        gain = np.empty(len(grid))
        for some in _evenly_spaced(grid):
            pairs = waves.against(over, others, grid[some])
            whole, cross = waves.products(over, answers.products, grid[some]), pairs[:-1]
            own = whole - np.einsum("fkc,fkd->kcd", cross, cross)
            s, t = (pairs[-1] - np.tensordot(left, cross, 1)).T
            a, b, c = own[:, 0, 0], own[:, 1, 1], own[:, 0, 1]
            determinant = np.maximum(a * b - c**2, 1e-6 * a * b)
            power = b * s**2 - 2 * c * s * t + a * t**2
            # A force without any response beside the parameters' brings nothing, at no frequency.
            told = np.minimum(a, b) > SEEN * np.trace(whole, axis1=1, axis2=2)
            gain[some] = np.divide(power, determinant, out=np.zeros_like(power), where=told)
        peaks = [
            i
            for i in np.argsort(-gain)
            if gain[i] >= gain[max(i - 1, 0) : i + 2].max()
            and (slow is None or i < slow or 0.5 * gain[i] > self.options.least_gain)
        ]
        return np.asarray(grid[peaks[:LINES]])

    def _pushed(self, fitted: Fit) -> Pushed:
        """How a fit answers to a force, products of that with its parameters and residual, and these' own."""
        key = id(fitted)
        with self.pushing.setdefault(key, Lock()):  # of two threads one waits for the other
            if key not in self.pushes:
                push = self.problem.model.pushes[0]
                force = responses(self.problem, fitted, [push.name])[push.name]
                answers = Answers(project(fitted, force), felt_from(self.problem))
                basis = np.linalg.qr(stacked(fitted.jacobian[:, :, fitted.active]))[0]
                residual = fitted.residual.reshape(-1)
                others = answers.with_all(np.column_stack([basis, residual]))
                self.pushes[key] = fitted, (answers, others, basis.T @ residual)
        return self.pushes[key][1]

    @staticmethod
    def beside(fitted: Fit, columns: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Columns and residual of all windows with the fitted parameters projected out."""
        flat = stacked(columns)
        residual = fitted.residual.reshape(-1)
        own = stacked(fitted.jacobian[:, :, fitted.active])
        if own.shape[1]:
            basis = np.linalg.qr(own)[0]
            flat = flat - basis @ (basis.T @ flat)
            residual = residual - basis @ (basis.T @ residual)
        return flat, residual

    def screened(self, parent: Candidate, effect: Effect) -> tuple[float, list[FloatArray]]:
        """Predicted improvement by an effect added to a parent, and its start vectors, best first.

        Parameters with a single start are set to their first-order optimum, within limits.
        """
        key = (id(parent.fit), effect.name)
        if key in self.seen:
            return self.seen[key][1:]
        starts = self.start_vectors(parent, effect)
        predicted, multiple = self.score(parent, starts)
        place = self.problem.model.slice_of(effect.name).start
        linear = _linear(self.problem, effect)
        single = [g for g, k in enumerate(linear) if len(_parameter_starts(self.problem, effect, k)) == 1]
        for _ in range(CLOSER if single else 0):
            # A step much larger than what is there shows no derivative.
            share = np.clip(2.0 * np.max(np.abs(multiple[:, single]), axis=1), 0.1, 0.3)
            nearer = starts.copy()
            for g in single:
                p, own = place + linear[g], parent.fit.parameters[place + linear[g]]
                nearer[:, g, p] = own + share * (starts[:, g, p] - own)
            again, twice = self.score(parent, nearer)
            better = again > 1.1 * predicted
            starts = np.where(better[:, None, None], nearer, starts)
            predicted = np.where(better, again, predicted)
            multiple = np.where(better[:, None], twice, multiple)
            if not np.any(better):
                break
        if len(linear) == 1 and _one_sided(self.problem, effect, linear[0]):
            predicted = np.where(multiple[:, 0] > 0.0, predicted, 0.0)
        if self.problem.observations is not None and starts.shape[:2] == (len(starts), 1) and len(starts) > 1:
            # Likelihoods of rare events change too much for a first-order approximation.
            vectors = np.concatenate([parent.fit.parameters[None], starts[:, 0]])
            exact = costs(self.problem, vectors, parent.fit.states, parent.fit.whitener)
            predicted = exact[0] - exact[1:]
        result = []
        for i in np.argsort(-predicted)[:TRIED]:
            start = starts[i, 0].copy()
            for g, k in enumerate(linear):
                if len(_parameter_starts(self.problem, effect, k)) > 1:
                    continue
                p, step = effect.parameters[k], starts[i, g, place + k] - effect.parameters[k].nominal
                least = -3.0 if p.lower < p.nominal < p.upper else 0.2
                reach = np.clip(multiple[i, g], least, 3.0)
                start[place + k] = np.clip(p.nominal + reach * step, p.lower, p.upper)
            result.append(start)
        # The fit is kept with its id, so that the id cannot be reused by another one.
        self.seen[key] = parent.fit, float(predicted.max()), result
        return self.seen[key][1:]

    def identifiable(self, parent: Candidate, name: str) -> bool:
        """Whether an effect is identifiable beside the base, by an exact rank test at its start."""
        return self._in_time(parent, name, lambda: self._identifiable(parent, name), True)

    def _identifiable(self, parent: Candidate, name: str) -> bool:
        effect = self.problem.model.effect(name)
        predicted, starts = self.screened(parent, effect)
        if self.problem.observations is not None and predicted > CLEAR:
            return True  # an absorbed effect gains nothing; derivatives may all vanish at the start
        free = self.free((*parent.effects, name))
        here = fit(self.problem, starts[0], free, self.whitener, parent.fit.states, 0)
        own = self.problem.model.slice_of(name)
        mine = (free >= own.start) & (free < own.stop)
        if _beyond_base(here.jacobian, mine) > 0.05:
            return True
        return _beyond_base(self._central(here), mine) > SINGULAR

    def _central(self, here: Fit) -> FloatArray:
        """Jacobian by central differences, accurate enough for a rank test."""
        coordinates = self.problem.coordinates(here.free)
        at = coordinates.encode(here.parameters[here.free])
        step = 1e-3
        batch = np.repeat(here.parameters[None], 2 * len(here.free), axis=0)
        for k, i in enumerate(here.free):
            for sign, row in ((1, 2 * k), (-1, 2 * k + 1)):
                moved = at.copy()
                moved[k] += sign * step
                batch[row, i] = coordinates.decode(np.clip(moved, coordinates.lower, coordinates.upper))[k]
        outputs = self.problem.simulate(batch, here.states)
        return project(here, np.moveaxis(outputs[0::2] - outputs[1::2], 0, 2) / (2 * step))

    def judged(self, effects: Names, fitted: Fit, search: float) -> Candidate:
        """A fit with its held-out loss."""
        size = sum(self.problem.model.effect(name).size for name in effects)
        return Candidate(effects, fitted, search, self.held_out(fitted), size, self.options.price)

    def held_out(self, fitted: Fit) -> FloatArray:
        """Held-out loss of every window, simulated where its linear prediction is far from what was fitted.

        A window in which a machine nearly sticks may have a slope that holds for no step at all.
        """
        loss, coordinates = (
            held_out_loss(fitted, self.folds),
            self.problem.coordinates(fitted.free),
        )
        if fitted.observations is not None:
            return loss
        excess = loss - window_loss(fitted)
        for fold, step in leave_out_steps(fitted, self.folds):
            inside = self.folds == fold
            if excess[inside].max() > EXTRAPOLATED:
                moved = parameters_at(fitted, coordinates, step)
                again = fit(self.problem, moved, NONE, fitted.whitener, fitted.states, 6)
                loss[inside] = np.minimum(loss[inside], window_loss(again, inside))
        return loss

    def profiled(self, best: Fit, effect: Effect) -> Fit:
        """Search parameters without derivative on successively finer grids around the best start."""
        model = self.problem.model
        place = model.slice_of(effect.name).start
        for k, parameter in enumerate(effect.parameters):
            if parameter.smooth or model.names[place + k] in self.fixed:
                continue
            reach = spacing(self.problem, effect, k)
            for _ in range(3):
                around = best.parameters[place + k] + reach * np.linspace(-1, 1, 17)
                batch = np.repeat(best.parameters[None], len(around), axis=0)
                batch[:, place + k] = np.clip(around, parameter.lower, parameter.upper)
                if self.problem.observations is not None:
                    choice = int(np.argmin(costs(self.problem, batch, best.states, self.whitener)))
                else:
                    raw = self.problem.features - self.problem.simulate(batch, best.states)
                    shifted = project(best, np.moveaxis(raw, 0, 2))
                    flat, _ = self.beside(best, shifted)
                    choice = int(np.argmin(np.sum(flat**2, axis=0)))
                trial = fit(self.problem, batch[choice], best.free, self.whitener, best.states, 3)
                if trial.cost < best.cost:
                    best = trial
                reach /= 8
        return best


def _evenly_spaced(grid: FloatArray) -> list[IntArray]:
    """Numbers of the frequencies of a rising grid in parts with even steps: nearly all, and single ones."""
    step = float(np.median(np.diff(grid))) if len(grid) > 1 else 1.0
    turns = (grid - grid[len(grid) // 2]) / step
    even = np.abs(turns - np.rint(turns)) < 1e-6
    numbers = np.flatnonzero(even)
    breaks = np.flatnonzero(np.diff(np.rint(turns[even])) != 1) + 1
    return [*np.split(numbers, breaks), *np.flatnonzero(~even)[:, None]]


class _Enough:
    """Says when a fit has nearly ended, or come to a simpler effect: its bound holds, time after time."""

    def __init__(self, model: Model, effect: Effect) -> None:
        self.model, self.effect, self.times, self.cost = model, effect, 0, np.inf

    def __call__(self, here: Fit) -> bool:
        """Whether it has, at the next better point of the fit."""
        at, _ = _reached(self.model, self.effect, here.parameters)
        held = at is not None and bool((~here.active & (here.free == at)).any())
        self.times = self.times + 1 if held else 0
        gained, self.cost = self.cost - here.cost, here.cost
        return self.times == HELD or gained < ROUGH


def simpler(model: Model, effect: Effect, parameters: FloatArray) -> str:
    """The simpler effect of the model that an effect equals where it has ended; empty if there is none."""
    return _reached(model, effect, parameters)[1]


def _reached(model: Model, effect: Effect, parameters: FloatArray) -> tuple[int | None, str]:
    """Index of the parameter at whose bound an effect equals a simpler one, and that; None if it does not."""
    place, listed = model.slice_of(effect.name).start, {e.name for e in model.effects}
    for i, p in enumerate(effect.parameters, place):
        at = (parameters[i] < 1.02 * p.lower, parameters[i] > p.upper / 1.02)
        for reached, twin in zip(at, p.reduces_to, strict=True):
            if reached and twin in listed:
                return i, twin
    return None, ""


def times_off(problem: Problem, fitted: Fit) -> float:
    """How many times the noise of its sensor an output's samples are off, of the one that is most."""
    errors, noise = _sample_errors(problem, fitted), [o.noise for o in problem.model.outputs]
    off = (errors[j] / max(noise[j], problem.resolved(j), 1e-300) for j in _shown(problem))
    return float(max(off, default=0.0))


def _left_measured(problem: Problem, fitted: Fit) -> bool:
    """Whether initial states that a sensor shows are off what it measured by several times its noise."""
    noise = {output.name: output.noise for output in problem.model.outputs}
    moved = np.sqrt(np.mean((fitted.states - problem.states) ** 2, axis=0))
    states = zip(problem.model.states, moved, strict=True)
    return any(state.name in noise and size > FAR * noise[state.name] for state, size in states)


def _misfit(problem: Problem, fitted: Fit) -> float:
    """Mean logarithm of the signals' errors, sample by sample; infinite where a simulation failed.

    Averages would not do: a swing that is faster than they are leaves no trace in them.
    """
    errors = _sample_errors(problem, fitted)[_shown(problem)]
    return float(np.mean(np.log(np.maximum(errors, 1e-300)))) if np.isfinite(fitted.cost) else np.inf


def _shown(problem: Problem) -> IntArray:
    return np.unique(problem.outputs[~problem.events])


def _sample_errors(problem: Problem, fitted: Fit) -> FloatArray:
    """Root mean square error of every output's samples, shape (outputs,); 0 of one that is not measured."""
    names = tuple(output.name for output in problem.model.outputs)
    squares, counts = np.zeros(len(names)), np.zeros(len(names))
    for part, simulated in zip(problem.parts, problem.samples(fitted.parameters, fitted.states), strict=True):
        error = part.windows.measured(names) - simulated
        squares += np.nansum(error**2, axis=(0, 1))
        counts += np.isfinite(error).sum(axis=(0, 1))
    return np.asarray(np.sqrt(squares / np.maximum(counts, 1.0)))


def is_quantisation(effect: Effect) -> bool:
    """Whether an effect is sensor quantisation, which is detected from the values themselves."""
    return effect.name.endswith("quantisation")


def _beyond_base(jacobian: FloatArray, mine: NDArray[np.bool_]) -> float:
    """Smallest singular value that an effect's columns of unit length have beside the others.

    Of the others only what the data determine counts: a base that they do not determine absorbs nothing. 0
    if a column of the effect vanishes or any is not finite.
    """
    flat = stacked(jacobian)
    size = np.linalg.norm(flat, axis=0)
    if not np.isfinite(flat).all() or not mine.any() or size[mine].min() <= 1e-9 * size.max():
        return 0.0
    others = (flat / np.maximum(size, 1e-300))[:, ~mine]
    left, values, _ = np.linalg.svd(others, full_matrices=False)
    left = left[:, values > SINGULAR]
    own = flat[:, mine] / size[mine]
    return float(np.linalg.svd(own - left @ (left.T @ own), compute_uv=False)[-1])


def _parameter_starts(problem: Problem, effect: Effect, k: int) -> Sequence[float]:
    """Starts of one parameter; frequencies and times of a change are searched over the whole record."""
    parameter = effect.parameters[k]
    if not parameter.refitted:
        return (parameter.nominal,)
    large = sum(p.slots.shape[0] * p.slots.shape[1] for p in problem.parts) > SCANNED
    if parameter.unit == "Hz" and not (large and parameter.starts):
        recordings = [p.windows.recording for p in problem.parts]
        duration = max(min(np.ptp(r.time), 4 * len(r) * r.step) for r in recordings)  # a clock may leap
        step = min(p.windows.recording.step for p in problem.parts)
        cycle = problem.model.horizons[min(1, len(problem.model.horizons) - 1)]
        low, high = (share / cycle for share in FREQUENCIES)
        grid = np.arange(max(1 / duration, low), min(high, 0.4 / step), 0.5 / duration)
        inside = grid[(grid > parameter.lower) & (grid < parameter.upper)]
        nearest = np.argsort(np.abs(np.log(inside * cycle / USUAL)), kind="stable")[:MAX_FREQUENCIES]
        return tuple(sorted({*inside[nearest].tolist(), *parameter.starts}))
    if parameter.starts:
        return parameter.starts
    if not parameter.smooth and parameter.unit == "s":
        times = np.concatenate([p.windows.recording.time for p in problem.parts])
        return tuple(np.linspace(times.min(), times.max(), 19)[1:-1].tolist())
    step = parameter.nominal + parameter.scale
    return (step if step <= parameter.upper else parameter.nominal - parameter.scale,)


def spacing(problem: Problem, effect: Effect, k: int) -> float:
    """Distance between neighbouring starts of one parameter."""
    grid = np.sort(_parameter_starts(problem, effect, k))
    return float(np.median(np.diff(grid))) if len(grid) > 1 else effect.parameters[k].scale


def _linear(problem: Problem, effect: Effect) -> list[int]:
    """Parameters with a single start, taken as linear in the screening; the others span its grid."""
    single = [
        k
        for k, p in enumerate(effect.parameters)
        if p.refitted and len(_parameter_starts(problem, effect, k)) == 1
    ]
    return single or [0]


def _one_sided(problem: Problem, effect: Effect, k: int) -> bool:
    """Whether a parameter's one start lies on the only side of neutral where it may be."""
    p = effect.parameters[k]
    return len(_parameter_starts(problem, effect, k)) == 1 and (p.nominal <= p.lower or p.nominal >= p.upper)


def _grid(problem: Problem, effect: Effect) -> list[tuple[float, ...]]:
    """All combinations of starts."""
    return list(
        itertools.product(*(_parameter_starts(problem, effect, k) for k in range(len(effect.parameters))))
    )


def number_of_starts(problem: Problem, effect: Effect) -> int:
    """From how many combinations of values an effect is sought."""
    return max(len(_grid(problem, effect)), 1)


def _base_starts(problem: Problem, start: FloatArray, free: IntArray) -> FloatArray:
    """The start itself, the model's own starts, and a coarse search over decades."""
    parameters = problem.model.all_parameters
    result = [start]
    own = start.copy()
    for i in free:
        if parameters[i].starts:
            own[i] = parameters[i].starts[0]
    result.append(own)
    wide = [i for i in free if parameters[i].lower > 0 and parameters[i].upper > 100 * parameters[i].lower]
    for shift in itertools.product((-2.0, -1.0, 0.0, 1.0, 2.0), repeat=min(len(wide), 3)):
        moved = own.copy()
        for i, decade in zip(wide[:3], shift, strict=True):
            moved[i] = np.clip(own[i] * 10**decade, parameters[i].lower, parameters[i].upper)
        result.append(moved)
    return np.array(result)
