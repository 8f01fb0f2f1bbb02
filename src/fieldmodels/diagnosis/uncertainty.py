"""Standard errors of a fit's parameters, and whether an effect's size differs from neutral."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.held_out import INSENSITIVE
from fieldmodels.diagnosis.linearisation import Fit, pseudo_inverse
from fieldmodels.diagnosis.problem import Problem
from fieldmodels.diagnosis.result import Cause
from fieldmodels.drivers.curved import Curved
from fieldmodels.model import Effect

CHANCE = 2 * float(stats.norm.sf(2.0))
"""Level at which a size must differ from neutral: two standard errors of a single value."""
SMALL = 0.01
"""Of its scale, by which a value is moved from neutral to see whether it does anything."""


def standard_errors(problem: Problem, fitted: Fit) -> FloatArray:
    """Standard error of every free parameter.

    The largest of three, since each alone is too small for some kind of error: by the information, and by the
    jackknife over blocks of windows and over pairs of blocks, whose errors may be correlated. All take the
    residual covariance for known; it was estimated from windows with as many averages as ``p`` less the
    states, which makes estimates vary by a factor of sqrt(1 + p / windows) more.

    Args:
        problem: The windows.
        fitted: A fit to them.

    Returns:
        In each parameter's unit, NaN where it has no influence, shape (free,).
    """
    count = len(fitted.free)
    if not count:
        return np.zeros(0)
    result = np.full(count, np.nan)
    size = np.sqrt(np.sum(fitted.jacobian**2, axis=(0, 1)))
    # The probability of an event may be so certain that no derivative is left: its profile says more.
    used = size > (INSENSITIVE if fitted.observations is None else -1.0)
    variances = [np.diag(pseudo_inverse(_powers(fitted, used).sum(axis=0)))]
    free = used & fitted.active
    at = np.flatnonzero(free[used])
    for pooled in (1, 2):
        spread = np.zeros(int(used.sum()))
        spread[at] = _jackknife(problem, fitted, free, pooled)
        variances.append(spread)
    states = fitted.states.shape[1]
    unknown = 1.0 + max(fitted.raw.shape[1] - states, 0) / len(fitted.raw)
    slope = np.abs(problem.coordinates(fitted.free).slope(fitted.parameters[fitted.free]))
    result[used] = np.sqrt(unknown * np.max(variances, axis=0)) * slope[used]
    return result


def differs_from_neutral(problem: Problem, fitted: Fit, cause: Cause) -> bool:
    """Whether an effect's size differs from neutral: Wald's test of all its amplitudes together.

    Amplitudes without a standard error are believed, but for smooth ones that have no influence where they
    are: any larger one would do as well, as a lag does that is much longer than a window. Arguments as of
    ``_wald``.
    """
    wald, count = _wald(problem, fitted, cause)
    if np.isfinite(wald):
        return bool(stats.chi2.sf(wald, count) < CHANCE)
    return any(
        not p.smooth or np.isfinite(cause.parameters[p.name].std)
        for p in problem.model.effect(cause.effect).parameters
        if p.refitted and p.name in cause.parameters
    )


def size_by_chance(problem: Problem, fitted: Fit, cause: Cause) -> float:
    """Probability that chance alone makes an effect so large: by Wald's test, of as many blocks as there are.

    Returns:
        NaN where a standard error is unknown, and for a limit that is neutral only beyond all data.
    """
    effect = problem.model.effect(cause.effect)
    wald, count = _wald(problem, fitted, cause)
    blocks = len(np.unique(problem.blocks))
    if not np.isfinite(wald) or blocks < 2 or any(p.nominal >= p.upper for p in effect.parameters):
        return float("nan")
    return float(stats.f.sf(wald / count, count, blocks - 1))


def _wald(problem: Problem, fitted: Fit, cause: Cause) -> tuple[float, int]:
    """Wald's statistic of an effect's amplitudes together, and how many they are.

    A frequency, a place or a threshold has no neutral value and proves nothing: it is sharp in whatever is
    fitted.

    Args:
        problem: The windows.
        fitted: A fit with the effect.
        cause: Its values and their standard errors.

    Returns:
        NaN where an amplitude has no standard error.
    """
    effect, place = problem.model.effect(cause.effect), problem.model.slice_of(cause.effect)
    own = [k for k in amplitudes(problem, fitted, effect) if effect.parameters[k].name in cause.parameters]
    named = [(effect.parameters[k], cause.parameters[effect.parameters[k].name]) for k in own]
    size = np.array([(value.value - p.nominal) / value.std for p, value in named])
    if not np.isfinite(size).all():
        return float("nan"), len(own)
    at = [int(np.flatnonzero(fitted.free == place.start + k)[0]) for k in own]
    covariance = pseudo_inverse(fitted.information)[np.ix_(at, at)]
    scale = np.sqrt(np.diag(covariance))
    wald = size @ pseudo_inverse(covariance / np.outer(scale, scale), 1e-9) @ size
    return float(wald), len(own)


def amplitudes(problem: Problem, fitted: Fit, effect: Effect) -> list[int]:
    """Which of an effect's values switch it on: they change the simulation from neutral by themselves.

    The others are neutral meanwhile, or as fitted where no value does so (a stop whose place is neutral
    beyond the travel). So are curves: one in a value of the effect would switch it on by itself.
    """
    place, count = problem.model.slice_of(effect.name), len(effect.parameters)
    if count == 1:
        return [0]
    if isinstance(problem.model, Curved):
        problem = replace(problem, model=problem.model.inner)
    nominal = np.array([p.nominal for p in effect.parameters])
    step = np.array([SMALL * (p.scale if p.nominal < p.upper else -p.scale) for p in effect.parameters])
    for others in (nominal, fitted.parameters[place]):
        batch = np.repeat(fitted.parameters[None, : len(problem.model.names)], 2 * count, axis=0)
        own = np.repeat(others[None], 2 * count, axis=0)
        for k in range(count):
            own[2 * k : 2 * k + 2, k] = nominal[k], nominal[k] + step[k]
        batch[:, place] = own
        outputs = problem.simulate(batch, fitted.states)
        found = [
            k for k in range(count) if not np.array_equal(outputs[2 * k], outputs[2 * k + 1], equal_nan=True)
        ]
        if found:
            return found
    return list(range(count))


def _powers(fitted: Fit, which: NDArray[np.bool_]) -> FloatArray:
    """Information of each window on some parameters, shape (windows, parameters, parameters)."""
    own = fitted.jacobian[:, :, which]
    return np.asarray(own.transpose(0, 2, 1) @ own)


def _jackknife(problem: Problem, fitted: Fit, which: NDArray[np.bool_], pooled: int) -> FloatArray:
    """Variance of coordinates from the changes by leaving out each group of so many blocks, (parameters,)."""
    number = np.unique(problem.blocks // pooled, return_inverse=True)[1]
    groups = int(number.max()) + 1
    power, score = (
        _powers(fitted, which),
        np.einsum("wfk,wf->wk", fitted.jacobian[:, :, which], fitted.residual),
    )
    powers, scores = np.zeros((groups, *power.shape[1:])), np.zeros((groups, score.shape[1]))
    np.add.at(powers, number, power)
    np.add.at(scores, number, score)
    inverse = pseudo_inverse(powers.sum(axis=0) - powers)
    changes = (inverse @ scores[:, :, None])[:, :, 0]
    return np.asarray((groups - 1) / groups * np.sum(changes**2, axis=0))
