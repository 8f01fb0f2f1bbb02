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
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.candidates import Candidate
from fieldmodels.diagnosis.coordinates import Coordinates
from fieldmodels.diagnosis.held_out import held_out_loss
from fieldmodels.diagnosis.linearisation import PRIOR, Fit, project, stacked
from fieldmodels.diagnosis.options import DiagnosisOptions
from fieldmodels.diagnosis.problem import Problem
from fieldmodels.diagnosis.response import averaged, odds_responses, offsets, responses, segments
from fieldmodels.diagnosis.result import WAVE, MissingCurve
from fieldmodels.diagnosis.selection import (
    RARE_P,
    block_p_value,
    dispersed_p_value,
    dispersion,
    largest_share,
)
from fieldmodels.diagnosis.wander import beside
from fieldmodels.drivers.curved import FreeCurve
from fieldmodels.drivers.variables import (
    CHANGE,
    MEMORY,
    PLAY,
    SHARE,
    TIMES,
    WAY,
    direction_of,
    given,
    remembering,
    variable,
)
from fieldmodels.model import Combination, Signal

Place = Literal["force", "sensor", "parameter", "odds"]
Signals = Mapping[str, tuple[str, FloatArray]]
QUANTILES = tuple(np.linspace(0.01, 0.99, 8))  # of the variable, where a curve's knots are
ENDS = (0.0, 0.05, 0.95, 1.0)  # the same of a curve that only bends where the variable is extreme
OF_PARAMETER = (0.01, 0.25, 0.5, 0.75, 0.99)  # the same for a parameter, which is one for a window
FINE = 129  # points of a known function
MULTIPLIED = 7  # signals whose products are tried
LINES = (CHANGE, MEMORY, PLAY)  # variables to which a force is proportional, if it depends on them at all
NO_FACTORS = ("time", CHANGE, "rate of ")
CYCLES = 600.0  # of a wave over the whole range of its variable, at most
WAVES = 64  # that are tried at a time, which bounds memory
POINTS = 16  # of a cycle of a wave, where its table is given
SCREENED = 24  # curves that are scored against held-out windows: the best ones on the fitted windows
TOLD = (
    3.0  # times its error that a variable must move where noise drives the machine, as of its measured inputs
)
LEAST_SINE = 0.1  # of the angle between a curve's response and the span of the free parameters' sensitivities


def _step(x: FloatArray) -> FloatArray:
    """The sign; over a small range, since nothing reverses at once."""
    return np.asarray(np.tanh(x / 0.02))


def _bend(x: FloatArray) -> FloatArray:
    return np.asarray(x * np.abs(x))


FUNCTIONS: Mapping[str, tuple[Callable[[FloatArray], FloatArray], ...]] = {
    "constant": (np.ones_like,),
    "sign": (_step,),
    "sign and constant": (_step, np.ones_like),
    "size": (np.abs,),
    "square": (np.square,),
    "square with sign": (_bend,),
    "cube": (lambda x: np.asarray(x**3),),
}
"""Functions that are common in machines, of a variable over its largest size."""


@dataclass(frozen=True)
class Curve:
    """A curve that may be missing.

    Attributes:
        place: What it adds to.
        target: The output, base parameter or direction of motion that it adds to; empty for the only force.
            Of a "share of" a direction the values are parts of how fast the machine moves that way.
        over: The variable.
        over_unit: Its unit.
        unit: Of the curve's values.
        values: Columns on the segments of every window, shape (windows, segments, columns); of a parameter's
            curve on the windows, shape (windows, columns).
        knots: Values of the variable at which the curve is given, shape (points,).
        shapes: Each column's value there, shape (points, columns).
        formula: What it is called if it is no table but a known function of the variable.
        tried: Of how many of its kind it is the best.
    """

    place: Place
    target: str
    over: str
    over_unit: str
    unit: str
    values: FloatArray
    knots: FloatArray
    shapes: FloatArray
    formula: str = ""
    tried: int = 1

    @property
    def direction(self) -> str:
        """What it depends on and where it acts, in a few words."""
        return direction_of(self.place, self.target, self.over)


@dataclass(frozen=True)
class Scored:
    """A curve scored jointly with a fit.

    Attributes:
        curve: The curve.
        gain: Improvement of every window's held-out loss [nats].
        p_value: One-sided, over blocks of windows.
        basis: What each identifiable combination adds at the knots, shape (points, combinations).
        coefficients: Of the combinations, to first order, shape (combinations,).
        covariance: Of the coefficients.
        candidate: The fit with the curve's identifiable columns among its free parameters.
    """

    curve: Curve
    gain: FloatArray
    p_value: float
    basis: FloatArray
    coefficients: FloatArray
    covariance: FloatArray
    candidate: Candidate

    @property
    def total(self) -> float:
        """Improvement of all windows [nats], before its price."""
        return float(self.gain.sum())

    @property
    def free(self) -> FreeCurve:
        """The curve for a fit with the whole simulation."""
        curve = self.curve
        return FreeCurve(curve.place, curve.target, curve.over, curve.knots, self.basis)

    def shown(self, certain: bool = True) -> MissingCurve:
        """As a result."""
        curve, before = self.curve, float(self.candidate.loss.sum()) + self.total
        variance = np.einsum("ij,jk,ik->i", self.basis, self.covariance, self.basis)
        errors = np.sqrt(np.maximum(variance, 0.0))
        return MissingCurve(
            curve.place,
            curve.target,
            curve.over,
            curve.over_unit,
            curve.unit,
            np.column_stack([curve.knots, self.basis @ self.coefficients, errors]),
            self.p_value,
            float(np.clip(100 * self.total / before, 0, 100)),
            curve.formula,
            certain,
        )


class Curves:
    """The curves that are tried beside one fit."""

    def __init__(self, problem: Problem, fitted: Fit, options: DiagnosisOptions) -> None:
        self.problem, self.fitted, self.options = problem, fitted, options
        model = problem.model
        self._segment = [segments(part.windows.lengths, part.slots.shape[1]) for part in problem.parts]
        self._force = responses(problem, fitted)
        measured = [int(j) for j in np.unique(problem.outputs)]
        self._odds = {
            model.outputs[j].name: odds_responses(problem, fitted, j)
            for j in measured
            if model.outputs[j].event
        }
        self._shown = {
            model.outputs[j].name: offsets(problem, j) for j in measured if not model.outputs[j].event
        }
        self.signals = self._variables()
        self.all = tuple(self._curves())
        self._wave_places = tuple(self._places_of_waves())

    def judge(self, candidate: Candidate, curves: Iterable[Curve] | None = None) -> list[Scored]:
        """Score every curve beside a candidate, most probable first.

        Args:
            candidate: The fit that the responses were computed for, perhaps with curves of its own already.
            curves: The curves; by default all.
        """
        basis, _ = np.linalg.qr(stacked(candidate.fit.jacobian[:, :, candidate.fit.active]))
        residual = candidate.fit.residual.reshape(-1)
        promising: list[tuple[float, Curve, FloatArray, FloatArray]] = []
        for curve in (*self.all, *self._waves(basis, residual)) if curves is None else curves:
            combined = _identifiable(self.response(curve), basis)
            if combined is not None:
                columns, combination, own = combined
                gain = 0.5 * float(np.sum((own.T @ residual) ** 2)) - candidate.price * len(own.T)
                promising.append((gain, curve, columns, combination))
        promising.sort(key=lambda one: -one[0])
        found = [self._scored(candidate, *one[1:]) for one in promising[:SCREENED]]
        return sorted(found, key=lambda s: s.candidate.total)

    def significant(self, candidate: Candidate) -> Scored | None:
        """The best curve, if the data call for it."""
        for scored in self.judge(candidate):
            if self.called_for(candidate, scored):
                return scored
        return None

    def called_for(self, candidate: Candidate, scored: Scored, among: int | None = None) -> bool:
        """Whether a curve improves a candidate significantly, whichever of all curves it is.

        Args:
            candidate: What it is beside.
            scored: The curve.
            among: Of how many curves it is the best; by default of all.
        """
        return self.convinces(candidate, scored, among) and self.outdoes_noise(candidate, scored, among)

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
        gain, left = beside(self.problem, candidate.fit, scored.candidate.fit, self.options.price)
        return gain > needed + (self.options.same_gain if left > 0.0 else 0.0)

    def _in_few_blocks(self, scored: Scored, needed: float) -> bool:
        """Whether a curve that acts in few blocks is called for nevertheless; see ``selection.accepted``."""
        blocks, fitted = self.problem.blocks, scored.candidate.fit
        if self.problem.model.random_force:  # chance acts in few blocks as well
            return False
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

    def as_formula(self, candidate: Candidate, scored: Scored) -> Scored:
        """The same curve as a known function of its variable, where that is as good."""
        known = self.judge(candidate, self._known_functions(scored.curve))
        if known and known[0].candidate.total < scored.candidate.total:
            return known[0]
        return scored

    def response(self, curve: Curve) -> FloatArray:
        """Whitened response of the features to each column, states projected out."""
        if curve.place == "parameter":
            k = int(np.flatnonzero(self.fitted.free == self.problem.model.index(curve.target))[0])
            slope = Coordinates(self.problem.model.all_parameters, self.fitted.free).slope(
                self.fitted.parameters[self.fitted.free]
            )[k]
            return np.asarray(self.fitted.jacobian[:, :, k, None] * curve.values[:, None, :] / slope)
        if curve.place == "force":
            response = self._force[curve.target.removeprefix(SHARE)]
        elif curve.place == "odds":
            response = self._odds[curve.target]
        else:
            response = self._shown[curve.target]
        return project(self.fitted, response @ curve.values, self._of_start(curve))

    def _of_start(self, curve: Curve) -> FloatArray | None:
        """What an erring sensor says too much of a window's start, as of ``project``; None if nothing."""
        model = self.problem.model
        sources = [model.measured_states.get(s.name, s.name) for s in model.states]
        same = np.array([curve.place == "sensor" and source == curve.target for source in sources])
        if self.problem.runs is not None or not same.any():
            return None
        return np.asarray((same / (PRIOR * self.problem.state_scale))[:, None] * curve.values[:, :1])

    def _scored(
        self, candidate: Candidate, curve: Curve, columns: FloatArray, combination: FloatArray
    ) -> Scored:
        fitted = candidate.fit
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
        for push in model.pushes:
            over = {**plain, **remembered}
            if sum(weight != 0.0 for weight in push.weights) > 1:  # part of others, which have all variables
                over = {n: s for n, s in over.items() if push.rate in n}
            for curve in _tables(over):
                yield replace(curve, target=push.name, unit=push.unit or "1")
            if push.rate in signals:
                places = {n: s for n, s in plain.items() if n in outputs or n == "time"}
                per = signals[push.rate][0]
                share = "1" if per == push.unit else f"{push.unit} / ({per})"
                for curve in _tables(places):
                    yield self._perhaps_share(replace(curve, target=SHARE + push.name, unit=share))
        for curve in _products(plain):
            yield replace(curve, target=model.pushes[0].name, unit=model.pushes[0].unit or "1")
        signals = lasting
        for name in events:
            for curve in (*_tables(signals), *_products(signals)):
                yield replace(curve, place="odds", target=name, unit="1")
        # Where chance drives the machine, it is told from a sensor's error alone by what that depends on.
        chance = model.random_force
        for name in self._shown:
            over = (
                {name: plain[name]} if name in plain and chance else {} if chance else {**plain, **own[name]}
            )
            for curve in _tables(over):
                yield replace(curve, place="sensor", target=name, unit=outputs[name])
        first = len(model.parameters) if chance else 0
        for i in self.fitted.free[self.fitted.free >= first]:
            for curve in _window_tables(plain):
                p = model.all_parameters[i]
                yield replace(curve, place="parameter", target=model.names[i], unit=p.unit)

    def _waves(self, basis: FloatArray, residual: FloatArray) -> Iterator[Curve]:
        """The strongest wave at each place over each variable: hum, eccentric gears and wheels.

        Args:
            basis: Orthonormal basis of the free parameters' sensitivities, shape (windows * features, free).
            residual: What remains to be explained, shape (windows * features,).
        """
        for curve in self._wave_places:
            # Faster waves are lost in the averages over a segment.
            x, span = curve.values, float(curve.knots[1] - curve.knots[0])
            passed = float(np.median(np.abs(np.diff(x, axis=1)))) + 1e-9
            counts = np.arange(2.0, min(0.5 / passed, CYCLES), 0.5)
            if not len(counts):
                continue
            powers = np.concatenate(
                [
                    self._wave_powers(curve, some, basis, residual)
                    for some in np.array_split(counts, -(-len(counts) // WAVES))
                ]
            )
            count = float(counts[np.argmax(powers)])
            points = np.linspace(0.0, 1.0, POINTS * int(np.ceil(count)) + 1)
            yield self._perhaps_share(
                replace(
                    curve,
                    values=_wave(x, count),
                    knots=curve.knots[0] + span * points,
                    shapes=_wave(points, count),
                    formula=f"{WAVE} {span / count:.3g} {curve.over_unit}",
                    tried=len(counts),
                )
            )

    def _places_of_waves(self) -> Iterator[Curve]:
        """Where there may be waves, and over what: the variable from zero to one in place of values."""
        model, outputs = self.problem.model, {s.name: s.unit for s in self.problem.model.outputs}

        def place(place: Place, target: str, unit: str, over: str, over_unit: str, x: FloatArray) -> Curve:
            ends = np.array([x.min(), x.max()])
            return Curve(place, target, over, over_unit, unit, (x - ends[0]) / np.ptp(ends), ends, np.eye(2))

        for target in self._shown:
            for over, (unit, values) in self.signals.items():
                if over == "time" or (over == target and not unit.endswith("/s")):
                    yield place("sensor", target, outputs[target], over, unit, values)
        for push in model.pushes:
            one_way = sum(weight != 0.0 for weight in push.weights) == 1
            if push.rate in self.signals and push.rate not in outputs and one_way:
                per, way = self.signals[push.rate][0], f"{WAY}{push.rate}"
                values = self._averaged(way)
                if np.ptp(values) > 0:
                    share = "1" if per == push.unit else f"{push.unit} / ({per})"
                    unit = per.removesuffix("/s")
                    yield place("force", SHARE + push.name, share, way, unit, values)

    def _wave_powers(
        self, curve: Curve, counts: FloatArray, basis: FloatArray, residual: FloatArray
    ) -> FloatArray:
        """What waves of so many cycles at a place explain of a residual, shape (waves,)."""
        waves = np.concatenate([_wave(curve.values, count) for count in counts], axis=-1)
        flat = stacked(self.response(self._perhaps_share(replace(curve, values=waves))))
        flat = flat - basis @ (basis.T @ flat)
        pairs = flat.reshape(len(flat), len(counts), 2)
        slopes = np.tensordot(residual, pairs, 1)
        power = np.einsum("rcj,rck->cjk", pairs, pairs)
        power += (1e-6 * np.trace(power, axis1=1, axis2=2)[:, None, None] + 1e-300) * np.eye(2)
        return np.asarray(np.sum(slopes * np.linalg.solve(power, slopes[..., None])[..., 0], axis=1))

    def _known_functions(self, curve: Curve) -> Iterator[Curve]:
        """Functions that are common in machines, over the variable of a table."""
        if curve.shapes.shape[1] == 1 or curve.place == "parameter" or curve.over == "time" or curve.formula:
            return
        values = self.signals[curve.over][1]
        knots = np.linspace(values.min(), values.max(), FINE)
        size = float(np.abs(knots).max())
        for name, terms in FUNCTIONS.items():
            known = replace(
                curve,
                knots=knots,
                values=np.stack([f(values / size) for f in terms], axis=-1),
                shapes=np.stack([f(knots / size) for f in terms], axis=-1),
                formula=name,
            )
            yield self._perhaps_share(known)

    def _perhaps_share(self, curve: Curve) -> Curve:
        """What a share of a direction's own rate adds to it; any other curve as it is."""
        if not curve.target.startswith(SHARE):
            return curve
        (rate,) = [p.rate for p in self.problem.model.pushes if p.name == curve.target.removeprefix(SHARE)]
        return replace(curve, values=curve.values * self.signals[rate][1][..., None])

    def _variables(self) -> Signals:
        """Candidate variables averaged over the segments: outputs, their rates, inputs, memory, and time."""
        model = self.problem.model
        runs, first = [], 0
        for part in self.problem.parts:
            # A fitted initial state absorbs the random force of its window, which would then appear as a
            # force that depends on the state; the measured one does not.
            windows, last = part.windows, first + len(part.windows)
            states = windows.states if model.random_force else self.fitted.states[first:last]
            runs.append(model.simulate(self.fitted.parameters[None], windows.with_states(states))[0])
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
        for j, signal in enumerate(model.outputs):
            values = [out[:, :, j][segment >= 0] for out, segment in zip(runs, self._segment, strict=True)]
            if any(np.isfinite(v).mean() < 0.9 for v in values) or (model.random_force and signal.optional):
                continue
            if self._is_told(j, 0):
                yield signal.name, signal.unit
            if model.random_force or signal.event or not self._is_told(j, 1):
                continue  # random forces drive the rates, so that these do not reveal what forces depend on
            if f"{signal.unit}/s" not in units:
                yield f"rate of {signal.name}", f"{signal.unit}/s"
            if signal.name not in model.unbounded_outputs and all(signal.name in one for one in recorded):
                for name in remembering(signal.name, duration, float(np.nanstd(np.concatenate(values)))):
                    yield name, signal.unit
        inputs: Sequence[Signal | Combination] = (*model.inputs, *model.sums)
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


def _tables(signals: Signals) -> Iterator[Curve]:
    """Lookup tables of every signal."""
    for name, (unit, values) in signals.items():
        if name.startswith(LINES) or " times " in name:
            yield _line(name, unit, values)
            continue
        knots = np.unique(np.quantile(values, QUANTILES))
        if len(knots) >= 4:
            yield Curve("force", "", name, unit, "", _hats(values, knots), knots, np.eye(len(knots)))
            ends = np.quantile(values, ENDS)
            yield Curve("force", "", name, unit, "", _beyond(values, ends), ends, _beyond(ends, ends), "ends")


def _products(signals: Signals) -> Iterator[Curve]:
    """Products of pairs of signals; of a machine with many sensors only of its first ones."""
    moving = [n for n in signals if not n.startswith(NO_FACTORS)]
    for first, second in itertools.combinations(moving[:MULTIPLIED], 2):
        a, b = signals[first][1], signals[second][1]
        unit = f"{signals[first][0]} {signals[second][0]}"
        yield _line(f"{first} times {second}", unit, a * b)
        yield _line(f"{first} times size of {second}", unit, a * np.abs(b))
        yield _line(f"{second} times size of {first}", unit, np.abs(a) * b)


def _window_tables(signals: Signals) -> Iterator[Curve]:
    """Tables and lines of the mean and of the size of every signal in a window."""
    for name, (unit, values) in signals.items():
        if name.startswith(CHANGE):
            continue
        sizes = {name: values.mean(axis=1)}
        if name != "time":
            sizes[f"size of {name}"] = np.sqrt(np.mean(values**2, axis=1))
        for over, size in sizes.items():
            knots = np.unique(np.quantile(size, OF_PARAMETER))
            if len(knots) >= 4:
                middle = float(size.mean())
                line = (knots - middle)[:, None]
                yield Curve("parameter", "", over, unit, "", (size - middle)[:, None], knots, line)
                yield Curve("parameter", "", over, unit, "", _hats(size, knots), knots, np.eye(len(knots)))


def _line(over: str, unit: str, values: FloatArray) -> Curve:
    """A force proportional to one quantity."""
    low, high = np.quantile(values, [0.01, 0.99])
    knots = np.linspace(low, high, 9)
    return Curve("force", "", over, unit, "", values[:, :, None], knots, knots[:, None])


def _wave(x: FloatArray, count: float) -> FloatArray:
    """Sine and cosine of so many cycles from zero to one, shape (..., 2)."""
    return np.stack([np.sin(2 * np.pi * count * x), np.cos(2 * np.pi * count * x)], axis=-1)


def _hats(values: FloatArray, knots: FloatArray) -> FloatArray:
    """Piecewise-linear hat functions at the knots, constant beyond the outer ones; shape (..., knots)."""
    eye = np.eye(len(knots))
    return np.stack([np.interp(values, knots, eye[k]) for k in range(len(knots))], axis=-1)


def _beyond(values: FloatArray, ends: FloatArray) -> FloatArray:
    """By how much values lie beyond the inner two of four ends, shape (..., 2)."""
    return np.stack([np.minimum(values - ends[1], 0.0), np.maximum(values - ends[2], 0.0)], axis=-1)


def _identifiable(columns: FloatArray, basis: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """What of a curve the free parameters cannot reproduce.

    A curve that is nearly collinear with a free parameter (a force proportional to the angle, with the
    stiffness free) would get a huge coefficient, whose small remaining component fits the noise.

    Args:
        columns: Response to the curve's columns, shape (windows, features, columns).
        basis: Orthonormal basis of the free parameters' sensitivities, shape (windows * features, free).

    Returns:
        Response to the identifiable combinations, the combinations, shape (columns, combinations), and the
        orthonormal basis of what of their response is their own; None if there are none.
    """
    flat = stacked(columns)
    scale = np.sqrt(np.sum(flat**2, axis=0)) + 1e-30
    left, size, right = np.linalg.svd(flat / scale, full_matrices=False)
    sound = size > 1e-6 * max(float(size[0]), 1e-30)
    own, sines, turn = np.linalg.svd(left[:, sound] - basis @ (basis.T @ left[:, sound]), full_matrices=False)
    kept = sines > LEAST_SINE
    if not kept.any():
        return None
    combination = np.asarray((right[sound].T / size[sound]) @ turn[kept].T / scale[:, None])
    return columns @ combination, combination, own[:, kept]


def _solved(wide: Fit) -> tuple[FloatArray, FloatArray]:
    """Gauss-Newton step of all active columns, zero for the others, and its covariance."""
    active = wide.active
    flat = stacked(wide.jacobian[:, :, active])
    inverse = np.linalg.pinv(flat.T @ flat, hermitian=True, rcond=1e-8)
    step, covariance = np.zeros(len(active)), np.zeros((len(active), len(active)))
    step[active] = inverse @ (flat.T @ wide.residual.reshape(-1))
    covariance[np.ix_(active, active)] = inverse
    return step, covariance
