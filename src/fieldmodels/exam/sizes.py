"""How large a fault must be to add a given percentage to the held-out error of the refitted nominal model."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis import problem as problems
from fieldmodels.diagnosis.fit import diagonal_whitener, fit
from fieldmodels.diagnosis.gain import NONE, predict
from fieldmodels.diagnosis.problem import Problem
from fieldmodels.diagnosis.procedure import main_horizon
from fieldmodels.diagnosis.stages import held
from fieldmodels.exam.benchmarks import Benchmark, Outside, get_benchmark
from fieldmodels.model import EffectValues, ModelError, Stage

PROBES = (7, 507)
"""Seeds of the two records on which sizes are found: fitted on the first, measured on the second."""
LOWEST, HIGHEST = 3.0, 40.0
"""Percentages between which sizes are sought."""
SMALLEST, LARGEST = 1e-6, 1e5
CLOSE = 0.08
"""Steps between neighbouring points of a curve are followed until so near a percentage (in its logarithm)."""
NEAR, TRIES = 0.1, 10
"""How near the size of a case must come (in its logarithm), and in how many tries."""


CHANCES = (1e-3, 1.0 - 1e-3)
"""Between which chances of an event count: short of certainty."""


@dataclass(frozen=True)
class Curve:
    """What a fault adds to the error, by its size.

    Attributes:
        sizes: Multiples of the fault's typical step, increasing.
        percents: What each adds to the held-out error of the refitted nominal model [%], increasing.
        most: The most that any size tried adds [%].
    """

    sizes: tuple[float, ...]
    percents: tuple[float, ...]
    most: float

    def size(self, percent: float) -> float | None:
        """The size that adds so much; None if none does."""
        if not self.sizes or percent > self.percents[-1]:
            return None
        logs = np.log(_added(np.array(self.percents)))
        return float(np.exp(np.interp(math.log(_added(percent)), logs, np.log(self.sizes))))

    def to_json(self) -> dict[str, Any]:
        """As plain data."""
        return {"sizes": list(self.sizes), "percents": list(self.percents), "most": self.most}

    @staticmethod
    def from_json(data: dict[str, Any]) -> Curve:
        """Read back."""
        return Curve(tuple(data["sizes"]), tuple(data["percents"]), data["most"])


class Probe:
    """Measures what one fault adds to the error on a pair of records: one to fit, one to measure.

    The error of records with the fault but without the sensors' noise adds in squares to the error of records
    with all noise and no fault. Where chance drives the machine, or draws events, it would blur a small
    effect: there an effect adds how far the refitted nominal model and the true one predict apart, each from
    the states that fit best. Of several outputs that one counts whose error grows most; of an event
    output the error is its root mean deviance.
    """

    def __init__(self, benchmark: Benchmark, fault: str, seeds: tuple[int, int], sign: int = 1) -> None:
        """Measure the error without the fault.

        Args:
            benchmark: Where it is hidden.
            fault: One of the model's effects, or of the benchmark's faults from outside.
            seeds: Of the two records.
            sign: -1 for the other direction of an effect that has two.
        """
        self.benchmark, self.fault, self.seeds = benchmark, fault, seeds
        self.sign = sign if fault not in benchmark.outside and benchmark.signed(fault) else 1
        self._fixed = benchmark.fixed([fault])
        self._base = _base_errors(benchmark.name, seeds)
        chance = benchmark.model.random_force or any(output.event for output in benchmark.model.outputs)
        self._quiet = None
        if fault in benchmark.outside or not chance:
            self._quiet = Pair(benchmark, seeds, {}, None).errors(self._fixed, self._base)

    def added(self, size: float) -> float:
        """Error that the fault adds, in units of the error without it; infinite if the machine fails."""
        if self.fault.endswith("quantisation"):  # a coarse step q of the first signal: q^2 / 12 of variance
            step = self.benchmark.values(self.fault, size)["step"]
            return float(step / math.sqrt(12.0) / self._base[0])
        outside = Outside(self.fault, size) if self.fault in self.benchmark.outside else None
        hidden = {} if outside else {self.fault: self.benchmark.values(self.fault, size, self.sign)}
        try:
            pair = Pair(self.benchmark, self.seeds, hidden, outside)
        except ModelError:
            return math.inf
        if self._quiet is None:
            growth = pair.apart(self._fixed, self._base, hidden) ** 2
        else:
            growth = pair.errors(self._fixed, self._base) ** 2 - self._quiet**2
        return float(np.sqrt(np.nanmax(np.maximum(growth, 0.0) / self._base**2)))


def curve_of(benchmark: Benchmark, fault: str) -> Curve:
    """Find the curve of one of the model's effects or of a fault from outside, on the probes' records."""
    return _searched(Probe(benchmark, fault, PROBES).added)


def size_on(
    benchmark: Benchmark, fault: str, percent: float, seeds: tuple[int, int], sign: int, curve: Curve
) -> tuple[float | None, float]:
    """The size that adds a percentage on a case's own records, which another excitation makes another one.

    Returns:
        The size, None if none was found; and what it adds there, or the most that was seen [%].
    """
    target = float(_added(percent))
    probe = Probe(benchmark, fault, seeds, sign)
    seen: dict[float, float] = {}
    size = curve.size(percent) or (curve.sizes[-1] if curve.sizes else 1.0)
    for _ in range(TRIES):
        seen[size] = probe.added(size)
        if abs(math.log(max(seen[size], 1e-9) / target)) < NEAR:
            return size, _percent(seen[size])
        below, above = _bracket(seen, target)
        if above is None:  # grow
            size *= min(3.0, 1.1 * target / max(seen[size], 1e-9))
        elif below is None:
            size *= max(0.2, 0.9 * target / seen[size])
        else:
            size = _between(below, above, seen[below], seen[above], target)
    return None, _percent(max((a for a in seen.values() if math.isfinite(a)), default=0.0))


def _searched(added: Callable[[float], float]) -> Curve:
    """Points of the curve between the percentages that are asked for."""
    low, high = _added(LOWEST), _added(HIGHEST)
    seen: dict[float, float] = {}
    size = 1.0
    for _ in range(24):  # to a size that adds less than is asked for
        seen[size] = added(size)
        if seen[size] < low or size < SMALLEST:
            break
        size *= 0.1 if seen[size] > 10 * low else 0.5 * low / seen[size]
    size = min(s for s in seen if seen[s] == min(seen.values()))
    for _ in range(24):  # to one that adds enough
        if seen.setdefault(size, added(size)) >= high or size > LARGEST:
            break
        size *= min(4.0, max(1.3, 1.2 * high / max(seen[size], 1e-9)))
    for target in np.geomspace(low, high, 5):
        for _ in range(4):
            below, above = _bracket(seen, float(target))
            if below is None or above is None:
                break
            if abs(math.log(seen[above] / target)) < CLOSE or math.log(above / below) < 0.01:
                break
            size = _between(below, above, seen[below], seen[above], float(target))
            seen[size] = added(size)
    finite = {s: a for s, a in seen.items() if math.isfinite(a)}
    points: list[tuple[float, float]] = []
    for s in sorted(finite):  # an error that falls again (friction that stops the motion) is not followed
        if finite[s] > 0 and (not points or finite[s] > points[-1][1]):
            points.append((s, finite[s]))
        if points and points[-1][1] >= high:
            break
    return Curve(
        tuple(s for s, _ in points),
        tuple(_percent(a) for _, a in points),
        _percent(max(finite.values(), default=0.0)),
    )


def _bracket(seen: dict[float, float], target: float) -> tuple[float | None, float | None]:
    """The largest size before the first that adds the target, and that one."""
    above = min((s for s, a in seen.items() if a >= target), default=None)
    if above is None:
        return None, None
    return max((s for s in seen if s < above), default=None), above


def _between(below: float, above: float, least: float, most: float, target: float) -> float:
    """A size between two, where the target is expected."""
    share = 0.5
    if least > 0 and math.isfinite(most):
        share = float(np.clip(math.log(1.02 * target / least) / math.log(most / least), 0.1, 0.9))
    return float(below * (above / below) ** share)


@cache
def _noisy(model: str, seeds: tuple[int, int]) -> Pair:
    """Records with all noise and without a fault."""
    return Pair(get_benchmark(model), seeds, {}, None, noise=True)


@cache
def _base_errors(model: str, seeds: tuple[int, int]) -> FloatArray:
    """Held-out error of the refitted nominal model by output where nothing is hidden."""
    return _noisy(model, seeds).errors({}, None)


class Pair:
    """A record to fit and one to measure."""

    def __init__(
        self,
        benchmark: Benchmark,
        seeds: tuple[int, int],
        reality: EffectValues,
        outside: Outside | None,
        noise: bool = False,
    ) -> None:
        self.benchmark, self.seeds = benchmark, seeds
        self.train, self.test = (
            benchmark.record(reality, seed, noise=noise, outside=outside) for seed in seeds
        )

    def errors(self, fixed: Mapping[str, float], scale: FloatArray | None) -> FloatArray:
        """Error of the refitted nominal model by output; NaN where nothing is compared."""
        result = np.full(len(self.benchmark.model.outputs), np.nan)
        for stage in self.benchmark.model.stages([self.train, self.test]):
            testing, nominal = self._refitted(stage, fixed, scale)
            predicted = _predicted(testing, nominal, scale)
            measured = _where_measured(testing, _measured(testing))
            for j in np.unique(testing.outputs):
                if testing.model.outputs[j].event:
                    chances = np.clip(predicted[j], *CHANCES)
                    squares = 2.0 * _cross_entropy(chances, chances)
                else:
                    squares = (measured[j] - predicted[j]) ** 2
                result[j] = math.sqrt(float(np.mean(squares)))
        return result

    def apart(self, fixed: Mapping[str, float], scale: FloatArray, hidden: EffectValues) -> FloatArray:
        """How far the refitted nominal model and the true one predict apart by output."""
        result = np.full(len(self.benchmark.model.outputs), np.nan)
        for stage in self.benchmark.model.stages([self.train, self.test]):
            testing, nominal = self._refitted(stage, fixed, scale)
            acting = {name: values for name, values in hidden.items() if name in stage.effects}
            base = {n: v for n, v in self.train.known.items() if n in stage.model.names}
            true = _predicted(testing, testing.model.vector(base, acting), scale)
            refitted = _predicted(testing, nominal, scale)
            for j in np.unique(testing.outputs):
                if testing.model.outputs[j].event:
                    truly, believed = np.clip(true[j], *CHANCES), np.clip(refitted[j], *CHANCES)
                    squares = 2.0 * (_cross_entropy(truly, believed) - _cross_entropy(truly, truly))
                else:
                    squares = (true[j] - refitted[j]) ** 2
                result[j] = math.sqrt(float(np.mean(squares)))
        return result

    def _refitted(
        self, stage: Stage, fixed: Mapping[str, float], scale: FloatArray | None
    ) -> tuple[Problem, FloatArray]:
        """The test windows of one stage, and its nominal model refitted to the training windows."""
        known = {**self.train.known, **held(stage), **fixed}
        # What is small and what is large is said by sensors with noise, whatever these records have.
        noisy = self.train if scale is None else _noisy(self.benchmark.name, self.seeds).train
        model = stage.model.scaled_to([noisy])
        horizon = main_horizon(model, [self.train])
        training = problems.build(model, [self.train], horizon)
        testing = problems.build(model, [self.test], horizon, training)
        start = model.vector({name: value for name, value in known.items() if name in model.names})
        free = np.array(
            [i for i, p in enumerate(model.parameters) if p.refitted and p.name not in known], dtype=np.int64
        )
        if scale is None:
            first = fit(training, start, free, np.diag(1 / training.output_scale))
            whitener = diagonal_whitener(training, first.raw)
        else:
            whitener = _whitener(training, scale)
        return testing, fit(training, start, free, whitener).parameters


def _predicted(problem: Problem, parameters: FloatArray, scale: FloatArray | None) -> dict[int, FloatArray]:
    """Every output as predicted where it was measured, from the states that fit best.

    Outputs count by the error of records with noise, in records without it too: else the smallest errors
    would count most.
    """
    if scale is None:
        simulated = predict(problem, parameters).simulated
    else:
        states = fit(problem, parameters, NONE, _whitener(problem, scale), None, 10).states
        simulated = problem.samples(parameters, states)
    return _where_measured(problem, simulated)


def _where_measured(problem: Problem, values: Sequence[FloatArray]) -> dict[int, FloatArray]:
    """Values of all windows, where an output was measured, by output."""
    measured = _measured(problem)
    return {
        int(j): np.concatenate(
            [v[:, :, j][np.isfinite(m[:, :, j])] for v, m in zip(values, measured, strict=True)]
        )
        for j in np.unique(problem.outputs)
    }


def _measured(problem: Problem) -> list[FloatArray]:
    """Measured values of all windows, (windows, samples, outputs) a recording; NaN where there is none."""
    names = tuple(o.name for o in problem.model.outputs)
    return [part.windows.measured(names) for part in problem.parts]


def _whitener(problem: Problem, scale: FloatArray) -> FloatArray:
    return np.asarray(np.diag(1 / np.where(problem.events, 1.0, scale[problem.outputs])))


def _cross_entropy(truly: FloatArray, believed: FloatArray) -> FloatArray:
    """Mean surprise [nats] at events of true chances for one who believes others."""
    return np.asarray(-truly * np.log(believed) - (1.0 - truly) * np.log1p(-believed))


def _added(percent: Any) -> Any:
    """Error beside the error without the fault, of which their sum in squares is so many percent more."""
    return np.sqrt((1.0 + percent / 100.0) ** 2 - 1.0)


def _percent(added: float) -> float:
    return float(100.0 * (math.sqrt(1.0 + added**2) - 1.0))
