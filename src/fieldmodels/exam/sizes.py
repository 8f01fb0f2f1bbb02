"""How large a fault must be to add a given percentage to the held-out error of the refitted nominal model."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from fieldmodels.diagnosis import problem as problems
from fieldmodels.diagnosis.fit import diagonal_whitener, fit
from fieldmodels.diagnosis.gain import predict
from fieldmodels.diagnosis.procedure import main_horizon
from fieldmodels.diagnosis.stages import held
from fieldmodels.exam.subjects import Outside, Subject
from fieldmodels.model import EffectValues, FloatArray, ModelError, Stage
from fieldmodels.recording import Recording

PROBES = (7, 507)
"""Seeds of the two records on which sizes are found: fitted on the first, measured on the second."""
LOWEST, HIGHEST = 3.0, 40.0
"""Percentages between which sizes are asked for."""
SMALLEST, LARGEST = 1e-6, 1e5
CLOSE = 0.08
"""Steps between neighbouring points of a curve are followed until so near a percentage (in its logarithm)."""
NEAR, TRIES = 0.1, 10
"""How near the size of a case must come (in its logarithm), and in how many tries."""


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

    The error beside the fault's is that of records with all noise. The fault's own is measured without the
    sensors' noise, so that a small one shows; both add in squares. Of several outputs the one counts whose
    error grows most, in percent.
    """

    def __init__(self, subject: Subject, fault: str, seeds: tuple[int, int], sign: int = 1) -> None:
        """Measure the errors without the fault.

        Args:
            subject: Where it is hidden.
            fault: One of the model's effects, or of the subject's faults from outside.
            seeds: Of the two records.
            sign: -1 for the other direction of an effect that has two.
        """
        self.subject, self.fault, self.seeds = subject, fault, seeds
        self.sign = sign if fault not in subject.outside and subject.signed(fault) else 1
        self._fixed = subject.fixed([fault])
        self._base = _errors(subject, seeds, {}, None, {}, noise=True)
        self._quiet = self._measured({}, None)

    def _measured(self, reality: EffectValues, outside: Outside | None) -> FloatArray:
        return _errors(self.subject, self.seeds, reality, outside, self._fixed, noise=False, scale=self._base)

    def added(self, size: float) -> float:
        """Error that the fault adds, in units of the error without it; infinite if the machine fails."""
        if self.fault.endswith("quantisation"):  # a coarse step q of the first signal: q^2 / 12 of variance
            step = self.subject.values(self.fault, size)["step"]
            return float(step / math.sqrt(12.0) / self._base[0])
        try:
            if self.fault in self.subject.outside:
                errors = self._measured({}, Outside(self.fault, size))
            else:
                values = self.subject.values(self.fault, size, self.sign)
                errors = self._measured({self.fault: values}, None)
        except ModelError:
            return math.inf
        growth = np.maximum(errors**2 - self._quiet**2, 0.0) / self._base**2
        return float(np.sqrt(np.nanmax(growth)))


def curve_of(subject: Subject, fault: str) -> Curve:
    """Find the curve of one of the model's effects or of a fault from outside, on the probes' records."""
    return _searched(Probe(subject, fault, PROBES).added)


def size_on(
    subject: Subject, fault: str, percent: float, seeds: tuple[int, int], sign: int, curve: Curve
) -> tuple[float | None, float]:
    """The size that adds a percentage on a case's own records, which another excitation makes another one.

    Returns:
        The size, None if none was found; and what it adds there, or the most that was seen [%].
    """
    target = float(_added(percent))
    probe = Probe(subject, fault, seeds, sign)
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


def _errors(
    subject: Subject,
    seeds: tuple[int, int],
    reality: EffectValues,
    outside: Outside | None,
    fixed: dict[str, float],
    *,
    noise: bool,
    scale: FloatArray | None = None,
) -> FloatArray:
    """Held-out root mean square error of the refitted nominal model by output; NaN if not compared."""
    train, test = (subject.record(reality, seed, noise=noise, outside=outside) for seed in seeds)
    # What is small and what is large is told by sensors with noise, whatever these records have.
    noisy = train if noise else subject.record({}, seeds[0])
    result = np.full(len(subject.model.outputs), np.nan)
    for stage in subject.model.stages([train, test]):
        errors = _refitted(stage, noisy, train, test, fixed, scale)
        result = np.where(np.isfinite(errors), errors, result)
    return result


def _refitted(
    stage: Stage,
    noisy: Recording,
    train: Recording,
    test: Recording,
    fixed: dict[str, float],
    scale: FloatArray | None,
) -> FloatArray:
    """Errors of one stage."""
    known = {**held(stage), **fixed}
    model = stage.model.scaled_to([noisy])
    horizon = main_horizon(model, [train])
    training = problems.build(model, [train], horizon)
    testing = problems.build(model, [test], horizon, training)
    start = model.vector({name: value for name, value in known.items() if "." not in name})
    free = np.array(
        [i for i, p in enumerate(model.parameters) if p.refitted and p.name not in known], dtype=np.int64
    )
    if scale is None:
        first = fit(training, start, free, np.diag(1 / training.output_scale))
        whitener = diagonal_whitener(training, first.raw)
    else:
        whitener = np.diag(1 / scale[training.outputs])
    fitted = fit(training, start, free, whitener)
    return predict(testing, fitted.parameters).rmse()


def _added(percent: Any) -> Any:
    """Error beside the error without the fault, of which their sum in squares is so many percent more."""
    return np.sqrt((1.0 + percent / 100.0) ** 2 - 1.0)


def _percent(added: float) -> float:
    return float(100.0 * (math.sqrt(1.0 + added**2) - 1.0))
