"""Result of a diagnosis: verdict and evidence, as frozen data and as JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.recording import Recording

Verdict = Literal["consistent", "named", "ambiguous", "unknown"]


@dataclass(frozen=True)
class Estimate:
    """A fitted value with its standard error (NaN where it is unidentifiable)."""

    value: float
    std: float
    unit: str

    def to_json(self) -> dict[str, Any]:
        """As in ``diagnosis.json``."""
        return {"value": _number(self.value), "std": _number(self.std), "unit": self.unit}


@dataclass(frozen=True)
class Share:
    """A gain in percent with its 95 % interval."""

    percent: float
    ci95: tuple[float, float]

    def to_json(self) -> dict[str, Any]:
        """As in ``diagnosis.json``."""
        return {"percent": _number(self.percent), "ci95": [_number(x) for x in self.ci95]}


@dataclass(frozen=True)
class Cause:
    """An effect that the data call for.

    Attributes:
        effect: Its name.
        cause: What happens in the real machine, in one sentence.
        where: Where in the loop it acts.
        parameters: Fitted values.
        signal: The measured signal that it improves most.
        gain: Gain on that signal over the causes before it, on data not used for selection.
        equation: The term that it adds, in plain notation.
        alternatives: Effects that these data cannot distinguish from it.
        p_value: Of the paired test over blocks of windows.
        nats: Gain in held-out log-likelihood.
    """

    effect: str
    cause: str
    where: str
    parameters: Mapping[str, Estimate]
    signal: str
    gain: Share
    equation: str = ""
    alternatives: tuple[str, ...] = ()
    p_value: float = float("nan")
    nats: float = float("nan")


@dataclass(frozen=True)
class FailedTest:
    """A test that the refitted nominal simulation fails."""

    signal: str
    test: str
    p_value: float
    where: str


@dataclass(frozen=True)
class HorizonGain:
    """Prediction error of one signal on windows of one length, before and after.

    Attributes:
        horizon: Length of the predicted windows [s].
        rmse_before: With the base refitted and no effect.
        rmse_after: With the causes.
        gain: Reduction in percent.
        windows: Number of windows.
    """

    horizon: float
    rmse_before: float
    rmse_after: float
    gain: Share
    windows: int

    def to_json(self) -> dict[str, Any]:
        """As in ``diagnosis.json``."""
        return {
            "horizon_s": _number(self.horizon),
            "rmse_before": _number(self.rmse_before),
            "rmse_after": _number(self.rmse_after),
            **self.gain.to_json(),
            "windows": self.windows,
        }


@dataclass(frozen=True)
class SignalGain:
    """Prediction error of one signal before and after the causes were added.

    Attributes:
        unit: Unit of the signal.
        rmse_before: With the base refitted and no effect.
        rmse_after: With the causes.
        gain: Reduction in percent.
        horizon: Length of the predicted windows [s].
        noise_floor: Estimated white noise of the sensor; NaN if unknown.
        horizons: The same on shorter and longer windows of the same data, shortest first.
    """

    unit: str
    rmse_before: float
    rmse_after: float
    gain: Share
    horizon: float
    noise_floor: float
    horizons: tuple[HorizonGain, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """As in ``diagnosis.json``."""
        return {
            "unit": self.unit,
            "rmse_before": _number(self.rmse_before),
            "rmse_after": _number(self.rmse_after),
            **self.gain.to_json(),
            "horizon_s": _number(self.horizon),
            "noise_floor": _number(self.noise_floor),
            "horizons": [h.to_json() for h in self.horizons],
        }


@dataclass(frozen=True)
class UnmodelledDynamics:
    """Dynamics that no listed effect explains.

    Attributes:
        direction: The variable that the missing force (or offset of a signal) depends on.
        unit: Unit of the curve's second column.
        direction_unit: Unit of its first column.
        curve: Value of that variable and the missing force there, shape (points, 2).
        p_value: Of the paired test over blocks of windows.
        percent: Share of the loss that it removes [%].
    """

    direction: str
    unit: str
    direction_unit: str
    curve: FloatArray
    p_value: float
    percent: float

    @property
    def certain(self) -> bool:
        """Whether the direction is significant, not merely the fact that something is missing."""
        return self.p_value <= 0.01

    def to_json(self) -> dict[str, Any]:
        """As in ``diagnosis.json``."""
        return {
            "direction": self.direction if self.certain else f"undetermined; closest: {self.direction}",
            "direction_unit": self.direction_unit,
            "unit": self.unit,
            "curve": [[_number(a), _number(b)] for a, b in self.curve],
            "p_value": _number(self.p_value),
            "percent": _number(self.percent),
        }


@dataclass(frozen=True)
class Correlation:
    """Correlation of a signal's errors with something, by lag.

    Attributes:
        signal: Whose errors.
        other: The same signal, or an input.
        lags: By how much the other one leads [s], shape (lags,).
        before: Correlation of the refitted base's errors, shape (lags,).
        after: The same with the causes added.
        low: 2.5th percentile under the null hypothesis at each lag, shape (lags,).
        high: 97.5th percentile.
        p_before: Probability that chance alone gives as large a correlation at any lag, before.
        p_after: The same with the causes added.
    """

    signal: str
    other: str
    lags: FloatArray
    before: FloatArray
    after: FloatArray
    low: FloatArray
    high: FloatArray
    p_before: float
    p_after: float


@dataclass(frozen=True)
class NextMeasurement:
    """The measurement that best distinguishes two sets of effects.

    Attributes:
        why: What to measure and what to expect of it, in plain words.
        input: The same in numbers, for ``diagnosis.json``.
        plan: The commands, sample by sample, if they can be chosen.
    """

    why: str
    input: Mapping[str, Any]
    plan: Recording | None = None


@dataclass(frozen=True)
class Evidence:
    """Data for the figures of the report, which are not part of the JSON.

    Attributes:
        traces: Signal to windows of test data: time, measured, before, after; each (windows, samples).
        residuals: Signal to residuals on the training data, by the variable on the abscissa, in bins: centre,
            mean before, its standard error, mean after, its standard error.
        correlations: Of the errors on test data, among themselves and with the inputs.
        calibration: Event signal to its calibration curves on test data before and after, as of
            ``events.calibration``.
        ranking: Rows (effects, gain in nats, p-value, parameters as text).
    """

    traces: Mapping[str, Mapping[str, FloatArray]] = field(default_factory=dict)
    residuals: Mapping[str, Mapping[str, FloatArray]] = field(default_factory=dict)
    correlations: tuple[Correlation, ...] = ()
    calibration: Mapping[str, tuple[FloatArray, FloatArray]] = field(default_factory=dict)
    ranking: tuple[tuple[str, float, float, str], ...] = ()


@dataclass(frozen=True)
class Diagnosis:
    """Result of comparing measured data with a simulation.

    Attributes:
        model: Name of the model.
        verdict: "consistent", "named", "ambiguous" or "unknown".
        causes: The named causes, in the order in which they were found.
        misfit: Tests that the refitted nominal simulation fails.
        gain: Prediction error by signal, at the main horizon.
        unknown: Unmodelled dynamics, if there are any.
        next_measurement: What to record next, if sets of effects remain indistinguishable.
        parameters: Refitted base parameters of the extended simulation.
        undetermined: Positive base parameters whose standard error exceeds half of their value.
        vector: Whole parameter vector of the extended simulation.
        not_testable: Effects that could not be tested, with the reason.
        trained_on: Sources of the training data.
        tested_on: Sources of the test data ("held-out part of ..." if there were none).
        windows: Number of training and of test windows.
        seconds: Duration of the diagnosis.
        evidence: Arrays for the report.
        notes: Peculiarities and preprocessing of the data (``Recording.notes``).
        above_noise: Ratio of a signal's error to its sensor's noise, where it is well above 1.
    """

    model: str
    verdict: Verdict
    causes: tuple[Cause, ...]
    misfit: tuple[FailedTest, ...]
    gain: Mapping[str, SignalGain]
    unknown: UnmodelledDynamics | None
    next_measurement: NextMeasurement | None
    parameters: Mapping[str, Estimate]
    undetermined: tuple[str, ...]
    vector: FloatArray
    not_testable: Mapping[str, str]
    trained_on: tuple[str, ...]
    tested_on: tuple[str, ...]
    windows: tuple[int, int]
    seconds: float
    evidence: Evidence
    notes: tuple[str, ...] = ()
    above_noise: Mapping[str, float] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """The contract of ``diagnosis.json``: plain data, strictly valid JSON (null for unknown numbers)."""
        return {
            "schema": 1,
            "model": self.model,
            "verdict": self.verdict,
            "summary": self.summary(),
            "causes": [
                {
                    "effect": c.effect,
                    "cause": c.cause,
                    "where": c.where,
                    "equation": c.equation,
                    "parameters": {name: e.to_json() for name, e in c.parameters.items()},
                    "gain": {"signal": c.signal, **c.gain.to_json()},
                    "alternatives": list(c.alternatives),
                    "p_value": _number(c.p_value),
                    "nats": _number(c.nats),
                }
                for c in self.causes
            ],
            "misfit": [
                {"signal": m.signal, "test": m.test, "p_value": _number(m.p_value), "where": m.where}
                for m in self.misfit
            ],
            "gain": {name: g.to_json() for name, g in self.gain.items()},
            "unknown": self.unknown.to_json() if self.unknown else None,
            "next_measurement": (
                {"why": self.next_measurement.why, "input": dict(self.next_measurement.input)}
                if self.next_measurement
                else None
            ),
            "parameters": {name: e.to_json() for name, e in self.parameters.items()},
            "undetermined": list(self.undetermined),
            "above_noise": {name: _number(times) for name, times in self.above_noise.items()},
            "not_testable": dict(self.not_testable),
            "data": {
                "train": list(self.trained_on),
                "test": list(self.tested_on),
                "windows": {"train": self.windows[0], "test": self.windows[1]},
                "notes": list(self.notes),
            },
            "seconds": round(self.seconds, 2),
        }

    def summary(self) -> str:
        """The verdict in one sentence, the remaining error, and a caution where needed."""
        text = self._sentence()
        if self.above_noise and self.verdict != "unknown":
            rest = " and ".join(
                f"that of {name.replace('_', ' ')} {times:.1f} times"
                for name, times in self.above_noise.items()
            )
            text += f" Errors remain above the sensors' noise: {rest}."
        if self.undetermined:
            names = " and ".join(name.replace("_", " ") for name in self.undetermined)
            text += (
                f" Caution: these data hardly determine {names}, so the verdict is weak; "
                "excite the machine more."
            )
        return text

    def _sentence(self) -> str:
        names = " and ".join(c.effect.replace("_", " ") for c in self.causes)
        if self.verdict == "consistent":
            if self.above_noise:
                return "No listed effect helps significantly."
            return "Nothing significant is missing: the refitted simulation explains these data."
        if self.verdict == "unknown":
            shape = ""
            if self.unknown:
                shape = (
                    f"; it depends on {self.unknown.direction}"
                    if self.unknown.certain
                    else "; no direction of it is certain"
                )
            return f"Something is missing that no listed effect explains{shape}. Nothing is named."
        if self.verdict == "ambiguous":
            sets = [" or ".join([c.effect, *c.alternatives]).replace("_", " ") for c in self.causes]
            if len(sets) == 1:
                return f"Missing: {sets[0]}; these data cannot distinguish between them."
            sets = [f"({s})" if c.alternatives else s for s, c in zip(sets, self.causes, strict=True)]
            return f"Missing: {' and '.join(sets)}; these data cannot distinguish the effects in brackets."
        rest = ""
        if self.unknown:
            rest = (
                f" More is missing; it depends on {self.unknown.direction}."
                if self.unknown.certain
                else " More is missing; no direction of it is certain."
            )
        return f"Missing: {names}.{rest}"

    def extended(self) -> dict[str, Any]:
        """The extended simulation as data: what ``extended.yaml`` holds."""
        return {
            "schema": 1,
            "model": self.model,
            "parameters": {name: e.to_json() for name, e in self.parameters.items()},
            "effects": {
                c.effect: {name: e.to_json() for name, e in c.parameters.items()} for c in self.causes
            },
            "equations": {c.effect: {"words": c.cause, "symbols": c.equation} for c in self.causes},
        }


def _number(value: float) -> float | None:
    """A number for JSON: null if it is not finite."""
    number = float(value)
    return float(np.format_float_positional(number, 6, fractional=False)) if math.isfinite(number) else None
