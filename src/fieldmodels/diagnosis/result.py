"""Result of a diagnosis: verdict and evidence, as frozen data and as JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.phrases import depends_on, sensor_of, the, value_of
from fieldmodels.drivers.variables import SHARE, direction_of
from fieldmodels.recording import Recording

Verdict = Literal["consistent", "named", "ambiguous", "unknown", "unrelated"]


@dataclass(frozen=True)
class Estimate:
    """A fitted value with its standard error (NaN where it is unidentifiable)."""

    value: float
    std: float
    unit: str

    def to_json(self) -> dict[str, Any]:
        """As in ``diagnosis.json``."""
        return {"value": number(self.value), "std": number(self.std), "unit": self.unit}


@dataclass(frozen=True)
class Share:
    """A gain in percent with its 95 % interval."""

    percent: float
    ci95: tuple[float, float]

    def to_json(self) -> dict[str, Any]:
        """As in ``diagnosis.json``."""
        return {"percent": number(self.percent), "ci95": [number(x) for x in self.ci95]}


@dataclass(frozen=True)
class Cause:
    """An effect that the data call for.

    Attributes:
        effect: Its name.
        cause: What happens in the real machine, in one sentence.
        where: Where in the loop it acts.
        parameters: Fitted values.
        signal: The measured signal that it improves most.
        gain: How much smaller its error is with this cause than without it, all others kept, on data not used
            for selection; NaN where it explains noise alone.
        equation: The term that it adds, in plain notation.
        alternatives: Effects that these data cannot distinguish from it.
        p_value: Of the paired test over blocks of windows, when it was added to those before it.
        chance: Probability that it is but chance: the smaller one of ``p_value`` and that of its size, by its
            standard errors.
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
    chance: float = float("nan")
    nats: float = float("nan")

    @property
    def sized(self) -> bool:
        """Whether any of its values is larger than its standard error."""
        return not all(e.std >= abs(e.value) for e in self.parameters.values())

    def to_json(self) -> dict[str, Any]:
        """As in ``diagnosis.json``."""
        return {
            "effect": self.effect,
            "cause": self.cause,
            "where": self.where,
            "equation": self.equation,
            "parameters": {name: e.to_json() for name, e in self.parameters.items()},
            "gain": {"signal": self.signal, **self.gain.to_json()},
            "alternatives": list(self.alternatives),
            "p_value": number(self.p_value),
            "chance": number(self.chance),
            "nats": number(self.nats),
        }


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
        rmse_after: With the extended simulation.
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
            "horizon_s": number(self.horizon),
            "rmse_before": number(self.rmse_before),
            "rmse_after": number(self.rmse_after),
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
        rmse_with_curves: With the unlisted curves, too.
        gain_with_curves: Reduction by both, in percent.
        horizons: Gain of the extended simulation on shorter and longer windows, shortest first.
        unseen: The most that anything else may add to the error, white noise aside; NaN if unknown.
    """

    unit: str
    rmse_before: float
    rmse_after: float
    gain: Share
    horizon: float
    noise_floor: float
    rmse_with_curves: float
    gain_with_curves: Share
    horizons: tuple[HorizonGain, ...] = ()
    unseen: float = math.nan

    def to_json(self) -> dict[str, Any]:
        """As in ``diagnosis.json``."""
        return {
            "unit": self.unit,
            "rmse_before": number(self.rmse_before),
            "rmse_after": number(self.rmse_after),
            **self.gain.to_json(),
            "rmse_with_curves": number(self.rmse_with_curves),
            "with_curves": self.gain_with_curves.to_json(),
            "horizon_s": number(self.horizon),
            "noise_floor": number(self.noise_floor),
            "unseen": number(self.unseen),
            "horizons": [h.to_json() for h in self.horizons],
        }


WAVE = "repeats every"
"""Begins the formula of a curve that is a wave."""
JUMP = "jumps at"
"""The same of one that is a jump."""


@dataclass(frozen=True)
class MissingCurve:
    """A curve that the simulation lacks and that is no listed effect.

    Attributes:
        place: What it adds to: "force", "sensor", "parameter" or "odds" (of an event, logarithmic).
        target: The output, base parameter or direction of motion that it adds to; empty for the only force.
        over: The variable that it depends on.
        over_unit: Unit of that variable.
        unit: Unit of its values.
        curve: Variable, value and its standard error, shape (points, 3).
        p_value: Of the paired test over blocks of windows; by the search by evidence, the probability that no
            such curve is there.
        percent: Share of the loss that it removes [%].
        formula: The known function that it is, "" if it is none.
        certain: Whether the data call for it, not merely for something.
        confirmed: Whether the test data are predicted better with it.
        period: After which it begins anew, in units of the variable; 0 where it does not.
        alternatives: Place, target and variable of curves that these data do not tell from it.
    """

    place: str
    target: str
    over: str
    over_unit: str
    unit: str
    curve: FloatArray
    p_value: float
    percent: float
    formula: str = ""
    certain: bool = True
    confirmed: bool = True
    period: float = 0.0
    alternatives: tuple[tuple[str, str, str], ...] = ()

    @property
    def found(self) -> bool:
        """Whether it is stated as what is missing: the data call for it, and the test data confirm it."""
        return self.certain and self.confirmed

    @property
    def direction(self) -> str:
        """What it depends on and where it acts, in a few words."""
        return direction_of(self.place, self.target, self.over)

    @property
    def words(self) -> str:
        """What it depends on, how it runs where that is a function that is known, and where it acts."""
        others = [depends_on(*other, "") for other in self.alternatives]
        return " or on ".join([depends_on(self.place, self.target, self.over, self.formula), *others])

    def to_json(self) -> dict[str, Any]:
        """As in ``diagnosis.json``."""
        return {
            "direction": self.direction if self.certain else f"undetermined; closest: {self.direction}",
            "place": self.place,
            "target": self.target,
            "over": self.over,
            "direction_unit": self.over_unit,
            "unit": self.unit,
            "curve": [[number(x) for x in row] for row in self.curve],
            "formula": self.formula or None,
            "p_value": number(self.p_value),
            "percent": number(self.percent),
            "confirmed": self.confirmed,
            "alternatives": [direction_of(*other) for other in self.alternatives],
        }


@dataclass(frozen=True)
class Visible:
    """The smallest curve at a place that the data would have shown.

    Attributes:
        place: As of `MissingCurve`.
        target: As of `MissingCurve`.
        over: The variable over which it is hardest to see.
        size: Its root mean square over the data.
        unit: Of the size.
        errors: What it adds to each output's error (root mean square) after a refit, in the output's unit.
    """

    place: str
    target: str
    over: str
    size: float
    unit: str
    errors: Mapping[str, float] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """As in ``diagnosis.json``."""
        return {
            "place": self.place,
            "target": self.target or None,
            "over": self.over,
            "size": number(self.size),
            "unit": self.unit,
            "errors": {name: number(error) for name, error in self.errors.items()},
        }

    @property
    def what(self) -> str:
        """What it would have been."""
        return " ".join(filter(None, self._noun_and_place))

    @property
    def words(self) -> str:
        """The same with its size, for a sentence."""
        noun, place = self._noun_and_place
        unit = "" if self.unit == "1" else f" {self.unit}"
        return f"{noun} of {self.size:.2g}{unit} {place}".strip()

    @property
    def _noun_and_place(self) -> tuple[str, str]:
        moved = the(self.target.removeprefix(SHARE)) if self.target else ""
        share = ", in proportion to it" if self.target.startswith(SHARE) else ""
        return {
            "force": ("an error", f"in {moved}{share}") if self.target else ("a missing force", ""),
            "sensor": ("an error", f"in {sensor_of(self.target)}"),
            "parameter": ("a change", f"in {value_of(self.target)}"),
            "odds": ("a change", f"in the log-odds of {moved}"),
        }[self.place]


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
        base: Whole parameter vector of the refitted base, no effect on, shape (parameters,).
        stretch: Data for a free run, of the first test recording; None for none.
    """

    traces: Mapping[str, Mapping[str, FloatArray]] = field(default_factory=dict)
    residuals: Mapping[str, Mapping[str, FloatArray]] = field(default_factory=dict)
    correlations: tuple[Correlation, ...] = ()
    calibration: Mapping[str, tuple[FloatArray, FloatArray]] = field(default_factory=dict)
    ranking: tuple[tuple[str, float, float, str], ...] = ()
    base: FloatArray = field(default_factory=lambda: np.zeros(0))
    stretch: Recording | None = None


def number(value: float) -> float | None:
    """A number for JSON: null if it is not finite."""
    known = float(value)
    return float(np.format_float_positional(known, 6, fractional=False)) if math.isfinite(known) else None
