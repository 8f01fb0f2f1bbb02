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
from fieldmodels.model import FloatArray, ModelError, Stage
from fieldmodels.recording import Recording

PROBES = (7, 507)
"""Seeds of the two records on which sizes are found: fitted on the first, measured on the second."""
LOWEST, HIGHEST = 3.0, 40.0
"""Percentages between which sizes are asked for."""
SMALLEST, LARGEST = 1e-6, 1e5
CLOSE = 0.08
"""Steps between neighbouring points of a curve are followed until so near a percentage (in its logarithm)."""


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


def curve_of(subject: Subject, fault: str) -> Curve:
    """Find the curve of one of the model's effects or of a fault from outside.

    A quantisation adds the variance of its steps, which needs no search. Of other faults the records lack the
    sensors' noise, so that small ones show: their error adds to the noise in squares.
    """
    base = _errors(subject, {}, None, {}, noise=True)
    if fault.endswith("quantisation"):
        return _quantisation(subject, fault, base)
    fixed = subject.fixed([fault])
    quiet = _errors(subject, {}, None, fixed, noise=False, scale=base)

    def added(size: float) -> float:
        """Error that the fault adds, in units of the error without it; infinite if the machine fails."""
        outside = Outside(fault, size) if fault in subject.outside else None
        reality = {} if outside else {fault: subject.values(fault, size)}
        try:
            errors = _errors(subject, reality, outside, fixed, noise=False, scale=base)
        except ModelError:
            return math.inf
        return float(np.sqrt(np.nanmax(np.maximum(errors**2 - quiet**2, 0.0) / base**2)))

    return _searched(added)


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


def _quantisation(subject: Subject, effect: str, base: FloatArray) -> Curve:
    """A coarse step q of the first signal adds q^2 / 12 to the variance."""
    unit = subject.values(effect, 1.0)["step"]
    percents = np.geomspace(LOWEST, 1.05 * HIGHEST, 12)
    sizes = _added(percents) * base[0] * math.sqrt(12.0) / unit
    return Curve(tuple(sizes.tolist()), tuple(percents.tolist()), float(percents[-1]))


def _errors(
    subject: Subject,
    reality: dict[str, dict[str, float]],
    outside: Outside | None,
    fixed: dict[str, float],
    *,
    noise: bool,
    scale: FloatArray | None = None,
) -> FloatArray:
    """Held-out root mean square error of the refitted nominal model by output; NaN if not compared."""
    train, test = (subject.record(reality, seed, noise=noise, outside=outside) for seed in PROBES)
    result = np.full(len(subject.model.outputs), np.nan)
    for stage in subject.model.stages([train, test]):
        errors = _refitted(subject, stage, train, test, fixed, scale)
        result = np.where(np.isfinite(errors), errors, result)
    return result


def _refitted(
    subject: Subject,
    stage: Stage,
    train: Recording,
    test: Recording,
    fixed: dict[str, float],
    scale: FloatArray | None,
) -> FloatArray:
    """Errors of one stage."""
    known = {**held(stage), **fixed}
    # What is small and what is large is told by sensors with noise, whatever this record has.
    model = stage.model.scaled_to([subject.record({}, PROBES[0])])
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
