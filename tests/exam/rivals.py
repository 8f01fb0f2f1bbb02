"""Rivals of the diagnosis: thirty lines that more rules must beat; and PySINDy, where it can be asked.

``fieldgym exam --by forward`` puts one on the same cases; each takes what ``ask`` takes.
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from exam.answers import Answer
from exam.delivery import Delivery, Stated, deliver
from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.cutting import known_values, split, start_vector
from fieldmodels.diagnosis.fit import fit
from fieldmodels.diagnosis.gain import predict
from fieldmodels.diagnosis.linearisation import Fit
from fieldmodels.diagnosis.problem import build
from fieldmodels.diagnosis.result import Estimate
from fieldmodels.diagnosis.use import Simulation, written
from fieldmodels.diagnosis.whitening import whitener_by_output
from fieldmodels.model import Model, ModelError
from fieldmodels.recording import Recording

MOST = 2
"""Effects that the forward search names at most."""
STARTS = 3
"""Sizes from which each effect is fitted."""


class Forward:
    """Forward steps by BIC with one exchange, two effects at most, each fitted in the whole simulation."""

    def __init__(
        self,
        model: Model,
        train: Sequence[Recording],
        test: Sequence[Recording],
        fixed: Mapping[str, float],
        most: int = MOST,
    ) -> None:
        self.model = model = model.scaled_to([*train, *test])
        fixed = {**known_values(model, [*train, *test]), **fixed}
        self.training, self.testing = split(model, train, test)
        self.base = [k for k, p in enumerate(model.parameters) if p.refitted and p.name not in fixed]
        start = start_vector(model, fixed)
        self.whitener = np.eye(len(self.training.outputs))
        self.whitener = whitener_by_output(self.training, self._fit((), start).raw)
        self.nominal = self._fit((), start)
        now: tuple[str, ...] = ()
        best = self.nominal
        for _ in range(most):
            now, best = self._better([(*now, e.name) for e in model.effects if e.name not in now], now, best)
        others = [e.name for e in model.effects if e.name not in now]
        exchanged = [(*(n for n in now if n != name), other) for name in now for other in others]
        self.effects, self.best = self._better(exchanged, now, best)

    def _better(
        self, sets: Sequence[tuple[str, ...]], now: tuple[str, ...], best: Fit
    ) -> tuple[tuple[str, ...], Fit]:
        """The set with the least BIC, the one that is there included."""
        for names in sets:
            for start in self._starts(names, best):
                tried = self._fit(names, start)
                if self.bic(names, tried) < self.bic(now, best):
                    now, best = names, tried
        return now, best

    def _starts(self, names: Sequence[str], best: Fit) -> list[FloatArray]:
        """The best vector so far with the last effect on, at some of its sizes."""
        chosen = self.model.effect(names[-1]).parameters
        rows = []
        for k in range(STARTS):
            vector = self.model.vector({}, {})
            vector[: len(self.model.parameters)] = best.parameters[: len(self.model.parameters)]
            for name in names[:-1]:
                vector[self.model.slice_of(name)] = best.parameters[self.model.slice_of(name)]
            values = [
                p.starts[k * (len(p.starts) - 1) // (STARTS - 1)] if p.starts else p.nominal + p.scale
                for p in chosen
            ]
            vector[self.model.slice_of(names[-1])] = values
            rows.append(vector)
        return rows

    def _fit(self, names: Sequence[str], start: FloatArray) -> Fit:
        places = [range(self.model.slice_of(n).start, self.model.slice_of(n).stop) for n in names]
        free = np.array([*self.base, *itertools.chain(*places)], dtype=np.int64)
        return fit(self.training, start, free, self.whitener)

    def bic(self, names: Sequence[str], fitted: Fit) -> float:
        """Of Gaussian errors of unknown size, one an output."""
        raw, outputs = fitted.raw, self.training.outputs
        if not math.isfinite(fitted.cost):
            return math.inf
        sums = sum(
            raw[:, outputs == j].size * math.log(float(np.mean(raw[:, outputs == j] ** 2)) + 1e-300)
            for j in np.unique(outputs)
        )
        count = sum(len(self.model.effect(name).parameters) for name in names)
        return sums + count * math.log(raw.size)


def forward(
    model: Model,
    train: Sequence[Recording],
    test: Sequence[Recording],
    fixed: Mapping[str, float],
    third: Sequence[Recording] = (),
) -> Answer:
    """What thirty lines answer; arguments as of ``answers.ask``."""
    began = time.process_time()
    found = Forward(model, train, test, fixed)
    seconds = time.process_time() - began
    values = found.best.parameters

    def numbers(names: Sequence[str], first: int) -> dict[str, Estimate]:
        return {n: Estimate(float(values[first + k]), math.nan, "1") for k, n in enumerate(names)}

    own = found.model
    base = numbers([p.name for p in own.parameters], 0)
    effects = {
        name: numbers([p.name for p in own.effect(name).parameters], own.slice_of(name).start)
        for name in found.effects
    }
    errors = predict(found.testing, values).rmse()
    before = predict(found.testing, found.nominal.parameters).rmse()
    shown = {o.name: j for j, o in enumerate(own.outputs) if j in found.testing.outputs}
    stated = Stated(
        file=written(own, base, effects),
        errors={name: (float(before[j]), float(errors[j])) for name, j in shown.items()},
        horizons=dict.fromkeys(shown, found.training.horizon),
        nominal=Simulation(own, found.nominal.parameters),
        extended=bool(effects),
    )
    odds = found.bic((), found.nominal) - found.bic(found.effects, found.best)
    answer = Answer(
        verdict="named" if effects else "consistent",
        named=tuple((name,) for name in found.effects),
        missing=False,
        values={},
        errors={name: (float(before[j]), float(errors[j])) for name, j in shown.items()},
        seconds=seconds,
        summary=", ".join(found.effects),
        windows=stated.horizons,
        stated=1.0 / (1.0 + math.exp(-min(0.5 * odds, 700.0))) if effects else None,
    )
    return replace(answer, delivery=deliver(model, stated, third)) if third else answer


THRESHOLDS = (0.0, 0.003, 0.01, 0.03, 0.1, 0.3)
"""Below which PySINDy drops a term, in what a column of one deviation contributes."""
CAN_BE_ASKED = ("rig", "pendulum", "propeller_arm", "servo")
"""Machines all of whose states are measured, where velocity is."""


def sindy(
    model: Model,
    train: Sequence[Recording],
    test: Sequence[Recording],
    fixed: Mapping[str, float],
    third: Sequence[Recording] = (),
) -> Answer:
    """What PySINDy's equation predicts: cubic in states and commands, with sines, as sparse as tests best.

    It names nothing; its windows begin where those of the nominal fit do. Arguments as of ``answers.ask``.
    """
    import pysindy as ps

    began = time.process_time()
    nominal = Forward(model, train, test, fixed, most=0)
    states, inputs = [o.name for o in model.outputs], [s.name for s in model.inputs]
    if any(name not in r for r in (*train, *test) for name in states):
        raise ModelError("PySINDy needs every state measured")

    def columns(r: Recording, names: Sequence[str]) -> FloatArray:
        return np.column_stack([r[name] for name in names])

    unit = np.concatenate([columns(r, [*states, *inputs]) for r in train]).std(axis=0) + 1e-300
    size, loud = unit[: len(states)], unit[len(states) :]

    def equation(threshold: float) -> Any:
        library = ps.PolynomialLibrary(degree=3) + ps.FourierLibrary(n_frequencies=1)
        found = ps.SINDy(ps.STLSQ(threshold, normalize_columns=True), library, ps.SmoothedFiniteDifference())
        x, u = ([columns(r, n) / s for r in train] for n, s in ((states, size), (inputs, loud)))
        return found.fit(x, t=train[0].step, u=u)

    def errors(found: Any, records: Sequence[Recording]) -> dict[str, float]:
        """Errors of windows by steps of Runge and Kutta, a sample each."""
        problem = build(nominal.model, records, nominal.training.horizon)
        starts = predict(problem, nominal.nominal.parameters).states
        off, first = [], 0
        for part in problem.parts:
            x, rows = starts[first : first + len(part.windows)] / size, part.windows.starts
            h, first = part.windows.recording.step, first + len(part.windows)
            given, shown = (
                columns(part.windows.recording, n) / s for n, s in ((inputs, loud), (states, size))
            )
            for k in range(part.windows.samples):
                off.append(np.clip(x, -1e3, 1e3) - shown[np.minimum(rows + k, len(shown) - 1)])
                u = given[np.minimum(rows + k, len(given) - 1)]
                a = found.predict(x, u=u)
                b = found.predict(x + 0.5 * h * a, u=u)
                c = found.predict(x + 0.5 * h * b, u=u)
                d = found.predict(x + h * c, u=u)
                x = np.clip(x + h / 6.0 * (a + 2.0 * b + 2.0 * c + d), -1e3, 1e3)
        rms = np.sqrt(np.mean(np.concatenate(off) ** 2, axis=0)) * size
        return {name: float(v) for name, v in zip(states, rms, strict=True)}

    tried = [(errors(found, test), found) for found in map(equation, THRESHOLDS)]
    stated, best = min(tried, key=lambda one: sum(math.log(e) for e in one[0].values()))
    before = predict(nominal.testing, nominal.nominal.parameters).rmse()
    told = {name: (float(before[j]), stated[name]) for j, name in enumerate(states)}
    answer = Answer(
        verdict="unknown", named=(), missing=True, values={}, errors=told,
        seconds=time.process_time() - began, summary="; ".join(best.equations(3)),
    )  # fmt: skip
    before = predict(build(nominal.model, third, nominal.training.horizon), nominal.nominal.parameters).rmse()
    there = {name: float(e) for name, e in zip(states, before, strict=True)}
    return replace(answer, delivery=Delivery(there, errors(best, third), told, extended=True))
