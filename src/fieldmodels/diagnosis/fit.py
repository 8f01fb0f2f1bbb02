"""Fit of parameters and initial states to windows: Levenberg-Marquardt with the states projected out.

Each window's state is updated by back-substitution, so that a nonlinear model is linearised anew at every
step; given the parameters windows are independent, and each accepts its own change.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from fieldmodels.arrays import FloatArray, IntArray
from fieldmodels.diagnosis.coordinates import Coordinates
from fieldmodels.diagnosis.linearisation import (
    Fit,
    cost_of,
    linearise,
    losses_of,
    projected,
    reweighed,
)
from fieldmodels.diagnosis.problem import Problem
from fieldmodels.diagnosis.whitening import diagonal_whitener, whitener_by_output

REWEIGHED = 6  # times that weights follow residuals, at most
LEFT = 0.1  # of an average's variance, at least, that initial states are taken to leave
AGREED = 1.2  # ratio of variances from which on they do no longer
SETTLED = 0.01  # nats; a smaller improvement ends a fit
SHARES = (1.0, 0.25, 0.0625, 0.0)  # of a window's proposed change, tried until one does not raise its cost
ROSE = 0.5  # nats by which one window may get worse where parameters move: too little for more simulations
FORESEEN = 0.33  # of what a step promises, within which its gain must be for its derivatives to serve again
FAR = 10.0  # nats a feature, from which on derivatives change too soon to serve again
SHORTEST = 1e-3  # share below which a window's state counts as settled


def fit(
    problem: Problem,
    parameters: FloatArray,
    free: IntArray,
    whitener: FloatArray,
    states: FloatArray | None = None,
    iterations: int = 20,
) -> Fit:
    """Minimise the whitened residual over free parameters and all initial states.

    Args:
        problem: The windows.
        parameters: Start of the whole vector; the others stay fixed.
        free: Indices of the free parameters (may be empty: then only states are fitted).
        whitener: Matrix that whitens a window's residual, shape (features, features).
        states: Start of the initial states; by default the measured ones.
        iterations: Maximal number of steps.

    Returns:
        The best point seen; its cost is infinite if the simulation fails at the start.
    """
    states = problem.states if states is None else states
    return _improved(problem, _begun(problem, parameters, free, whitener, states), iterations)


def best_of(
    problem: Problem,
    starts: Sequence[FloatArray],
    free: IntArray,
    whitener: FloatArray,
    states: FloatArray,
    iterations: int,
    good: float = -np.inf,
) -> Fit:
    """The best of some fits from several starts; other arguments as of ``fit``.

    Where the others end is not linearised: their costs are all that is asked of them.

    Args:
        problem: The windows.
        starts: The starts, the most promising first.
        free: As of ``fit``.
        whitener: As of ``fit``.
        states: As of ``fit``.
        iterations: As of ``fit``.
        good: A cost [nats] at or below which no further start is tried.
    """
    costs: list[float] = []
    ends: list[tuple[Fit, _Trial | None]] = []
    for start in starts:
        ends.append(_followed(problem, _begun(problem, start, free, whitener, states), iterations))
        here, trial = ends[-1]
        costs.append(here.cost if trial is None else trial.cost)
        if costs[-1] <= good:
            break
    return _ended(problem, *ends[int(np.argmin(costs))])


def refit(
    problem: Problem,
    fitted: Fit,
    whitener: FloatArray,
    iterations: int = 6,
    enough: Callable[[Fit], bool] = lambda _: False,
) -> Fit:
    """Fit on from where a fit of the same problem ended, with the same whitener or another.

    Args:
        problem: The windows.
        fitted: Where it begins.
        whitener: As of ``fit``.
        iterations: As of ``fit``.
        enough: Asked at every better point: whether it may end there.
    """
    return _improved(problem, reweighed(problem, fitted, whitener), iterations, enough)


def _begun(
    problem: Problem, parameters: FloatArray, free: IntArray, whitener: FloatArray, states: FloatArray
) -> Fit:
    """The linearisation at some parameters and states."""
    raw = problem.features - problem.simulate(parameters[None], states)[0]
    return linearise(problem, parameters, free, whitener, states, raw)


def _improved(
    problem: Problem, here: Fit, iterations: int, enough: Callable[[Fit], bool] = lambda _: False
) -> Fit:
    """The best point that so many steps reach."""
    return _ended(problem, *_followed(problem, here, iterations, enough))


def _ended(problem: Problem, here: Fit, trial: _Trial | None) -> Fit:
    """A fit where a step has led to, linearised there; the fit itself if none is left to be."""
    if trial is None:
        return here
    return linearise(problem, trial.parameters, here.free, here.whitener, trial.states, trial.raw)


def _followed(
    problem: Problem, here: Fit, iterations: int, enough: Callable[[Fit], bool] = lambda _: False
) -> tuple[Fit, _Trial | None]:
    """The last linearisation of so many steps, and the better point to which the last step led, if it did."""
    free, whitener = here.free, here.whitener
    coordinates = problem.coordinates(free)
    damping, reach = 1e-3, np.ones(len(problem))
    trial: _Trial | None = None
    at: _Trial | None = None  # where the derivatives are those of another point
    foreseen = False
    losses = losses_of(problem, here.raw, here.states, whitener)
    for _ in range(iterations):
        if trial is not None:
            losses, new = trial.losses, trial is not at
            here = _carried(problem, here, trial) if foreseen else _ended(problem, here, trial)
            trial, at = None, trial if foreseen else None
            if new and at is None and enough(here):
                break
        if not np.isfinite(losses).any():
            break
        step, expected = _step(here, coordinates, damping)
        searching = bool(((reach < 1.0) & (reach > SHORTEST)).any())
        # A step that was clipped may be predicted to lose, yet gain: do not stop then.
        if abs(expected) < SETTLED and damping <= 1e-3 and not searching:
            if at is None:
                break
            trial, foreseen = at, False  # another point's derivatives do not tell the end
            continue
        tried = _moved(problem, here, parameters_at(here, coordinates, step), step, reach, losses)
        gained = _gain(losses, tried.losses)
        if gained > 0:
            trial, reach = tried, tried.reach
            # Windows that share no parameter do not wait for each other's derivatives.
            near = tried.cost < FAR * tried.raw.size
            foreseen = near and len(free) > 0 and abs(gained - expected) < FORESEEN * expected
            searching = bool(((reach < 1.0) & (reach > SHORTEST)).any())
            damping = max(damping * 0.1, 1e-6)
            if gained < SETTLED and not searching:
                if at is None:
                    break
                foreseen = False
        elif at is not None:
            trial, foreseen = at, False
        else:
            damping = max(damping * 10, 1e-3)
            if damping > 1e5 or not len(free):
                break
    return here, trial or at


def _carried(problem: Problem, here: Fit, trial: _Trial) -> Fit:
    """A fit where a step has led to, with the derivatives of where it began; the errors are its own."""
    moved = trial.parameters, here.free, here.whitener, trial.states, trial.raw
    return projected(problem, *moved, here.by_states, here.by_free)


@dataclass(frozen=True)
class _Trial:
    """Where a step ends.

    Attributes:
        parameters: Whole parameter vector, shape (parameters,).
        states: Initial states, shape (windows, states).
        raw: Measured minus simulated features, shape (windows, features).
        losses: Cost of each window [nats], shape (windows,).
        reach: Share of its next proposed change that each window's state takes, shape (windows,).
    """

    parameters: FloatArray
    states: FloatArray
    raw: FloatArray
    losses: FloatArray
    reach: FloatArray

    @property
    def cost(self) -> float:
        """Cost of all windows [nats]."""
        return float(self.losses.sum())


def _moved(
    problem: Problem,
    here: Fit,
    parameters: FloatArray,
    step: FloatArray,
    reach: FloatArray,
    before: FloatArray,
) -> _Trial:
    """Step all states to what suits the new parameters, each window as far as it gains by it.

    Given the parameters windows are independent: one whose linearisation is poor keeps none of the others.
    A window whose simulation diverges starts again from the usual state if nothing nearer helps.

    Args:
        problem: The windows.
        here: The present fit, with its linearisation.
        parameters: The new vector.
        step: Its step in coordinates.
        reach: Share of the proposed change that each window takes first.
        before: Cost of each window at present.
    """
    change = np.clip(here.state_residual - here.state_jacobian @ step, -3, 3) * problem.state_scale
    lost = ~np.isfinite(before)
    most = np.where(lost, np.inf, before + (ROSE if step.any() else 1e-3))
    if problem.observations is not None:
        # One observation against the odds costs many nats: a window may get worse for long on the way.
        most = np.full(len(problem), np.inf)
    states = here.states + reach[:, None] * change
    raw = problem.features - problem.simulate(parameters[None], states)[0]
    losses = losses_of(problem, raw, states, here.whitener)
    best = _Trial(parameters, states, raw, losses, np.minimum(4.0 * reach, 1.0))
    failed = ~np.isfinite(losses)
    best.states[failed], best.reach[failed] = here.states[failed], reach[failed]
    left: tuple[float, ...] = SHARES[1:]
    while len(left):
        poor = np.flatnonzero(~(best.losses < most))
        if not len(poor):
            break
        # For few windows all shares take one simulation side by side, though not all may be needed.
        few = problem.apart and len(left) * len(poor) <= len(problem)
        together = len(left) if few else 1
        starts = np.stack([here.states + (share * reach)[:, None] * change for share in left[:together]])
        if left[:together][-1] == 0.0 and not lost.all():
            starts[-1, lost] = np.median(here.states[~lost], axis=0)
        raws = problem.features[poor] - problem.simulate_from(parameters, starts, poor)
        for share, start, raw in zip(left, starts, raws, strict=False):
            losses = losses_of(problem, raw, start[poor], here.whitener, poor)
            better = ~(best.losses[poor] < most[poor]) & (losses < best.losses[poor])
            at = poor[better]
            best.states[at], best.raw[at], best.losses[at] = start[at], raw[better], losses[better]
            best.reach[at] = max(share, SHARES[-2] / 4) * reach[at]
        left = left[together:]
    return best


def _gain(before: FloatArray, after: FloatArray) -> float:
    """By how much the cost falls [nats]; windows that a simulation gets through count first."""
    was, now = np.isfinite(before), np.isfinite(after)
    if now.sum() != was.sum():
        return float("inf") if now.sum() > was.sum() else -float("inf")
    return float(before[was].sum() - after[now].sum())


def weighed(problem: Problem, start: Fit, iterations: int) -> Fit:
    """Fit with errors weighed by their own size, until weights and residuals agree.

    While weights are too coarse, a fit ends early, and its states stay too near to what was measured of them.
    Signals are weighed as a whole first, then average by average, of which the initial states take a share:
    weighed by what is left, an average that they can follow would count more and more.
    """
    best = start
    for _ in range(REWEIGHED):
        size = np.mean(best.raw**2)
        whitener = whitener_by_output(problem, best.raw)
        best = refit(problem, best, whitener, iterations)
        if size < AGREED * np.mean(best.raw**2):
            break
    taken = np.mean(np.sum(best.basis**2, axis=2), axis=0)[: best.raw.shape[1]]
    whitener = diagonal_whitener(problem, best.raw / np.sqrt(np.maximum(1.0 - taken, LEFT)))
    return refit(problem, best, whitener, iterations)


def costs(problem: Problem, batch: FloatArray, states: FloatArray, whitener: FloatArray) -> FloatArray:
    """Cost [nats] of parameter vectors from given initial states, shape (batch,)."""
    simulated = problem.simulate(batch, states)
    return np.array([cost_of(problem, problem.features - one, states, whitener) for one in simulated])


def parameters_at(here: Fit, coordinates: Coordinates, step: FloatArray) -> FloatArray:
    """The whole vector after a step in coordinates, inside the bounds."""
    result = here.parameters.copy()
    if len(here.free):
        moved = coordinates.encode(here.parameters[here.free]) + step
        result[here.free] = coordinates.decode(np.clip(moved, coordinates.lower, coordinates.upper))
    return result


def _step(here: Fit, coordinates: Coordinates, damping: float) -> tuple[FloatArray, float]:
    """Damped Gauss-Newton step of the free coordinates, and the predicted improvement."""
    step = np.zeros(len(here.free))
    active = here.active
    if active.any():
        a = here.information[np.ix_(active, active)]
        g = np.einsum("wfk,wf->k", here.jacobian, here.residual)[active]
        diagonal = np.diag(a)
        ridge = np.maximum(diagonal * damping, 1e-9 * diagonal.max() + 1e-30)
        step[active] = np.clip(np.linalg.solve(a + np.diag(ridge), g), -10, 10)
        log = coordinates.log & active
        step[log] = np.clip(step[log], -1.5, 1.5)
    moved = here.residual - here.jacobian @ step
    # The part of the residual outside the projection is removed by the states.
    expected = here.quadratic - 0.5 * float(np.sum(moved**2))
    return step, expected
