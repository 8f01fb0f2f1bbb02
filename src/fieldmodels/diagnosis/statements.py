"""What a diagnosis states in numbers beside its causes: gains, parameters, errors above the noise."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.candidates import Candidate
from fieldmodels.diagnosis.gain import Prediction, by_horizon, noise_floor, share
from fieldmodels.diagnosis.linearisation import Fit
from fieldmodels.diagnosis.phrases import value_of
from fieldmodels.diagnosis.problem import Problem
from fieldmodels.diagnosis.result import (
    Estimate,
    SignalGain,
)
from fieldmodels.diagnosis.selection import Selection, block_p_value
from fieldmodels.diagnosis.uncertainty import standard_errors
from fieldmodels.diagnosis.unseen import may_add
from fieldmodels.model import Model
from fieldmodels.rounding import with_error

POORLY_KNOWN = 0.5  # relative standard error above which a base parameter counts as poorly known
ABOVE = (
    1.5  # times the noise: a larger error is reported; equal parts of white and slowly varying noise give 1.4
)
ALIKE = 0.5
"""Between how far a signal moves in the quietest and in the liveliest windows: else all are alike."""


def gains(
    testing: Problem,
    fits: tuple[Candidate, Candidate],
    predictions: tuple[Prediction, Prediction, Prediction],
    extended: tuple[Problem, FloatArray],
    rng: np.random.Generator,
) -> dict[str, SignalGain]:
    """Gain of every signal, from the base to the named effects, and with the curves.

    Args:
        testing: Test windows.
        fits: The base, and the named effects.
        predictions: By the base, the named effects, and the extended simulation.
        extended: That simulation: the test windows with its model, and its whole vector.
        rng: Source of the resampling.
    """
    before, after, whole = predictions
    horizons = by_horizon(testing, fits[0].fit.parameters, extended, rng)
    most = may_add(testing, whole, fits[1].fit.parameters)
    result = {}
    for j in np.unique(testing.outputs):
        signal = testing.model.outputs[j]
        result[signal.name] = SignalGain(
            unit=signal.unit,
            rmse_before=float(before.rmse()[j]),
            rmse_after=float(after.rmse()[j]),
            gain=share(before, after, int(j), testing.blocks, rng),
            horizon=testing.horizon,
            noise_floor=noise_floor(testing, whole, int(j)),
            rmse_with_curves=float(whole.rmse()[j]),
            gain_with_curves=share(before, whole, int(j), testing.blocks, rng),
            horizons=horizons[signal.name],
            unseen=float(most[j]),
        )
    return result


def base_estimates(
    problem: Problem, fitted: Fit, model: Model, fixed: Mapping[str, float]
) -> dict[str, Estimate]:
    """The base parameters of a fit; one that is held has no error."""
    errors = standard_errors(problem, fitted)
    result = {}
    for i, p in enumerate(model.parameters):
        known = np.flatnonzero(fitted.free == i)
        std = float(errors[known[0]]) if len(known) else 0.0 if p.name in fixed else float("nan")
        result[p.name] = Estimate(float(fitted.parameters[i]), std, p.unit)
    return result


def poorly_known(model: Model, base: Mapping[str, Estimate]) -> tuple[str, ...]:
    """Positive base parameters whose relative standard error is large or unknown."""
    return tuple(
        p.name
        for p in model.parameters
        if p.lower > 0 and not base[p.name].std <= POORLY_KNOWN * base[p.name].value
    )


def bounded(model: Model, fitted: Fit) -> tuple[str, ...]:
    """Fitted values that the data would have beyond what is allowed, each with where it ended.

    By a score test at two standard errors: a spring that is not there ends at no stiffness as well.
    """
    result = []
    errors = fitted.residual.ravel()
    columns = fitted.jacobian.reshape(len(errors), -1)
    others = columns[:, fitted.active]
    for k in np.flatnonzero(~fitted.active & (fitted.free < len(model.names))):
        own = columns[:, k] - others @ np.linalg.lstsq(others, columns[:, k], rcond=None)[0]
        if (own @ errors) ** 2 < 4.0 * (own @ own):
            continue
        i = fitted.free[k]
        p, value = model.all_parameters[i], float(fitted.parameters[i])
        end = "smallest" if value - p.lower < p.upper - value else "largest"
        size = with_error(value, unit=p.unit)
        result.append(f"{value_of(model.names[i])} at the {end} value allowed, {size}")
    return tuple(result)


def above_noise(testing: Problem, after: Prediction) -> dict[str, float]:
    """Ratio of each signal's error to its sensor's noise, where it is well above 1.

    Where random forces drive the machine the error proves nothing; an event has no sensor noise.
    """
    if testing.model.random_force:
        return {}
    result = {}
    for j in np.unique(testing.outputs[~testing.events]):
        floor = noise_floor(testing, after, int(j))
        if floor > 0 and after.rmse()[j] > ABOVE * floor:
            result[testing.model.outputs[j].name] = float(after.rmse()[j] / floor)
    return result


def explained(testing: Problem, before: Prediction, after: Prediction, enough: float) -> float:
    """Share of the test windows' squared error above the noise that is explained, of the worst signal.

    One if what is left is at most ``enough`` times the noise, or where random forces drive the machine. What
    is left where the machine moves most and hardly more than where it moves least is noise of another colour.
    """
    shares = [1.0]
    for j in np.unique(testing.outputs[~testing.events]) if not testing.model.random_force else ():
        floor, first, last = noise_floor(testing, after, int(j)), before.rmse()[j], after.rmse()[j]
        still, moving = _by_movement(testing, after, int(j))
        if floor > 0 and last > enough * floor and moving > enough * still:
            shares.append((first**2 - last**2) / max(first**2 - floor**2, last**2))
    return float(max(min(shares), 0.0))


def _by_movement(testing: Problem, after: Prediction, output: int) -> tuple[float, float]:
    """Error of a signal in the quarters of the test windows in which it moves least and most.

    Zero and infinite where it moves in all of them alike.
    """
    outputs = tuple(o.name for o in testing.model.outputs)
    shown = [part.windows.measured(outputs)[:, :, output] for part in testing.parts]
    ways = np.concatenate([np.fmax.reduce(one, axis=1) - np.fmin.reduce(one, axis=1) for one in shown])
    squares, counts = after.squares[:, output], after.counts[:, output]
    movement = np.where(counts > 0.5 * counts.max(), ways, np.nan)
    least, most = np.nanquantile(movement, [0.25, 0.75])
    if not least < ALIKE * most:
        return 0.0, math.inf
    errors = [
        np.sqrt(squares[some].sum() / counts[some].sum()) for some in (movement <= least, movement >= most)
    ]
    return float(errors[0]), float(errors[1])


def not_testable(selection: Selection) -> dict[str, str]:
    """Effects that could not be tested, with the reason."""
    return dict.fromkeys(
        selection.unidentifiable,
        "the refitted base parameters absorb it exactly; fix one of them with --set to test it",
    )


def ranking(selection: Selection, problem: Problem) -> tuple[tuple[str, float, float, str], ...]:
    """Single effects with their gain [nats], p-value and values; see ``Evidence.ranking``."""
    rows = []
    model = problem.model
    for c in selection.ranking:
        values = ", ".join(
            f"{p.name} {c.fit.parameters[i]:.4g} {p.unit}"
            for name in c.effects
            for i, p in enumerate(model.effect(name).parameters, start=model.slice_of(name).start)
        )
        gain = selection.before.loss - c.loss
        rows.append(
            (
                " + ".join(c.effects),
                selection.before.total - c.total,
                block_p_value(gain, problem.blocks),
                values,
            )
        )
    return tuple(rows)
