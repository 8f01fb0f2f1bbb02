"""Fit of parameters and initial states to windows: Levenberg-Marquardt with the states projected out.

Each window's initial state is a nuisance parameter. Its sensitivities are removed from the window's
residual by QR (variable projection), and the state itself is updated by back-substitution, so that a
nonlinear model is linearised anew at every step. Observations of an event output (``events.Observations``)
enter by their exact likelihood: their rows are reweighted at every step (Fisher scoring).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.events import Observations
from fieldmodels.diagnosis.problem import Problem
from fieldmodels.model import Parameter

IntArray = NDArray[np.int64]
PRIOR = 2.0  # initial states stay within about this many times their spread over windows
STEP = 0.01  # finite-difference step of a parameter, in its scale
STATE_STEP = 1e-3  # the same of a state, in its spread over windows
TAIL = 10.0  # degrees of freedom of the held-out likelihood: bad windows count less than in a Gaussian
REWEIGHED = 6  # times that weights follow residuals, at most
LEFT = 0.1  # of an average's variance, at least, that initial states are taken to leave
AGREED = 1.2  # ratio of variances from which on they do no longer
INSENSITIVE = (
    0.01  # norm of a whitened column below which a change by ten coordinates is negligible (0.005 nats)
)
SETTLED = 0.01  # nats; a smaller improvement ends a fit
SHARES = (1.0, 0.25, 0.0625, 0.0)  # of a window's proposed change, tried until one does not raise its cost
ROSE = 0.5  # nats by which one window may get worse where parameters move: too little for more simulations
SHORTEST = 1e-3  # share below which a window's state counts as settled


@dataclass(frozen=True)
class Fit:
    """Parameters and initial states fitted to a problem, with the linearisation there.

    Attributes:
        parameters: Whole parameter vector, shape (parameters,).
        free: Indices of the fitted ones, shape (free,).
        states: Initial states, shape (windows, states).
        cost: Half the sum of squared whitened residuals [nats], states included; events by their likelihood.
        quadratic: The same with events by half their weighted squares, as in the quadratic model of a step.
        residual: Whitened residual with states projected out, shape (windows, features + states).
        jacobian: Change of the whitened simulation by the free parameters' coordinates, states projected
            out, shape (windows, features + states, free).
        raw: Measured minus simulated features, shape (windows, features).
        active: Free parameters that are not held at a bound, shape (free,).
        basis: Orthonormal basis of the states' sensitivities, shape (windows, features + states, states).
        state_residual: Change of the states alone that fits best (in their spread over windows), shape
             (windows, states).
        state_jacobian: The same for every free parameter, shape (windows, states, free).
        whitener: Whitening matrix, shape (features, features).
        weight: What each feature is multiplied by before whitening, shape (windows, features); None for 1.
        observations: The event features; None if there are none.
    """

    parameters: FloatArray
    free: IntArray
    states: FloatArray
    cost: float
    quadratic: float
    residual: FloatArray
    jacobian: FloatArray
    raw: FloatArray
    active: NDArray[np.bool_]
    basis: FloatArray
    state_residual: FloatArray
    state_jacobian: FloatArray
    whitener: FloatArray
    weight: FloatArray | None = None
    observations: Observations | None = None

    @property
    def information(self) -> FloatArray:
        """Fisher information in the free parameters' coordinates, shape (free, free)."""
        flat = stacked(self.jacobian)
        return flat.T @ flat


class Coordinates:
    """Free parameters as numbers of order one: the logarithm where a parameter spans decades."""

    def __init__(self, parameters: tuple[Parameter, ...], free: IntArray) -> None:
        chosen = [parameters[i] for i in free]
        self.log = np.array([p.lower > 0 and p.upper > 100 * p.lower for p in chosen], dtype=np.bool_)
        self.scale = np.array([p.scale for p in chosen])
        lower, upper = np.array([p.lower for p in chosen]), np.array([p.upper for p in chosen])
        self.lower, self.upper = self.encode(lower), self.encode(upper)

    def encode(self, values: FloatArray) -> FloatArray:
        """Values to coordinates."""
        positive = np.where(self.log, values, 1.0)
        return np.where(self.log, np.log(positive), values / self.scale)

    def decode(self, coordinates: FloatArray) -> FloatArray:
        """Coordinates to values; the inverse of ``encode``."""
        return np.where(self.log, np.exp(np.where(self.log, coordinates, 0.0)), coordinates * self.scale)

    def slope(self, values: FloatArray) -> FloatArray:
        """Derivative of the values by the coordinates."""
        return np.where(self.log, values, self.scale)


def stacked(columns: FloatArray) -> FloatArray:
    """Columns of all windows below each other, shape (windows * rows, columns)."""
    return columns.reshape(columns.shape[0] * columns.shape[1], columns.shape[2])


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
    coordinates = Coordinates(problem.model.all_parameters, free)
    states = problem.states if states is None else states
    raw = problem.features - problem.simulate(parameters[None], states)[0]
    here = _linearise(problem, parameters, free, whitener, states, raw, coordinates)
    damping, reach = 1e-3, np.ones(len(problem))
    for _ in range(iterations):
        losses = _losses(problem, here.raw, here.states, whitener)
        if not np.isfinite(losses).any():
            break
        step, expected = _step(here, coordinates, damping)
        searching = bool(((reach < 1.0) & (reach > SHORTEST)).any())
        # A step that was clipped may be predicted to lose, yet gain: do not stop then.
        if abs(expected) < SETTLED and damping <= 1e-3 and not searching:
            break
        trial = _moved(problem, here, parameters_at(here, coordinates, step), step, reach, losses)
        gained = _gain(losses, trial.losses)
        if gained > 0:
            reach = trial.reach
            searching = bool(((reach < 1.0) & (reach > SHORTEST)).any())
            here = _linearise(problem, trial.parameters, free, whitener, trial.states, trial.raw, coordinates)
            damping = max(damping * 0.1, 1e-6)
            if gained < SETTLED and not searching:
                break
        else:
            damping = max(damping * 10, 1e-3)
            if damping > 1e5 or not len(free):
                break
    return here


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
    best = _Trial(parameters, here.states, here.raw, np.full(len(problem), np.inf), reach)
    poor = np.ones(len(problem), dtype=np.bool_)
    most = np.where(lost, np.inf, before + (ROSE if step.any() else 1e-3))
    if problem.observations is not None:
        # One observation against the odds costs many nats: a window may get worse for long on the way.
        most = np.full(len(problem), np.inf)
    for share in SHARES:
        states = here.states + (share * reach)[:, None] * change
        if share == 0.0 and not lost.all():
            states[lost] = np.median(here.states[~lost], axis=0)
        raw = problem.features - problem.simulate(parameters[None], states)[0]
        losses = _losses(problem, raw, states, here.whitener)
        better = poor & (losses < best.losses)
        next_reach = np.minimum(4.0 * reach, 1.0) if share == 1.0 else max(share, SHARES[-2] / 4) * reach
        best = _Trial(
            parameters,
            np.where(better[:, None], states, best.states),
            np.where(better[:, None] | (share == 1.0), raw, best.raw),
            np.where(better, losses, best.losses),
            np.where(better, next_reach, best.reach),
        )
        poor &= ~(best.losses < most)
        if not poor.any():
            break
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
        best = fit(problem, best.parameters, best.free, whitener, best.states, iterations)
        if size < AGREED * np.mean(best.raw**2):
            break
    taken = np.mean(np.sum(best.basis**2, axis=2), axis=0)[: best.raw.shape[1]]
    whitener = diagonal_whitener(problem, best.raw / np.sqrt(np.maximum(1.0 - taken, LEFT)))
    return fit(problem, best.parameters, best.free, whitener, best.states, iterations)


def costs(problem: Problem, batch: FloatArray, states: FloatArray, whitener: FloatArray) -> FloatArray:
    """Cost [nats] of parameter vectors from given initial states, shape (batch,)."""
    simulated = problem.simulate(batch, states)
    return np.array([_cost(problem, problem.features - one, states, whitener) for one in simulated])


def parameters_at(here: Fit, coordinates: Coordinates, step: FloatArray) -> FloatArray:
    """The whole vector after a step in coordinates, inside the bounds."""
    result = here.parameters.copy()
    if len(here.free):
        moved = coordinates.encode(here.parameters[here.free]) + step
        result[here.free] = coordinates.decode(np.clip(moved, coordinates.lower, coordinates.upper))
    return result


def standard_errors(problem: Problem, fitted: Fit) -> FloatArray:
    """Standard error of every free parameter, in its unit; NaN where it is unidentifiable."""
    if not len(fitted.free):
        return np.zeros(0)
    coordinates = Coordinates(problem.model.all_parameters, fitted.free)
    flat = fitted.jacobian * fitted.residual[:, :, None]
    # Clustered by block: errors of windows in one block may be correlated.
    scores = np.array([flat[problem.blocks == b].sum(axis=(0, 1)) for b in np.unique(problem.blocks)])
    inverse = np.linalg.pinv(fitted.information, hermitian=True)
    covariance = inverse @ (scores.T @ scores) @ inverse
    spread = np.sqrt(np.maximum(np.diag(covariance), np.diag(inverse)))
    return np.asarray(spread * np.abs(coordinates.slope(fitted.parameters[fitted.free])))


def held_out_loss(fitted: Fit, folds: IntArray) -> FloatArray:
    """Held-out negative log-likelihood [nats] of every window, up to a constant.

    The fit is repeated without each fold by one Gauss-Newton step from the joint optimum. The likelihood
    is Student's t over a window, so that outlying windows do not dominate.

    Args:
        fitted: A fit to all windows.
        folds: Fold of each window, shape (windows,).

    Returns:
        Loss, shape (windows,).
    """
    loss = np.zeros(len(fitted.residual))
    # Nearly unidentifiable parameters would be moved by thousands of coordinates.
    active = fitted.active & (np.sqrt(np.sum(fitted.jacobian**2, axis=(0, 1))) > INSENSITIVE)
    jacobian = fitted.jacobian[:, :, active]
    flat = stacked(jacobian)
    whole, gradient = flat.T @ flat, flat.T @ fitted.residual.reshape(-1)
    for fold in np.unique(folds):
        inside = folds == fold
        own, residual = jacobian[inside], fitted.residual[inside]
        flat = stacked(own)
        rest = whole - flat.T @ flat
        step = np.linalg.pinv(rest, hermitian=True) @ (gradient - flat.T @ residual.reshape(-1))
        loss[inside] = window_loss(fitted, inside, own @ step)
    return loss


def window_loss(
    fitted: Fit, which: NDArray[np.bool_] | slice = slice(None), change: FloatArray | float = 0.0
) -> FloatArray:
    """Negative log-likelihood [nats] of windows, up to a constant: heavy-tailed averages and exact events.

    Args:
        fitted: A fit.
        which: The windows.
        change: Reduction of their whitened residual by a step, shape (windows, features + states).

    Returns:
        Loss, shape (windows,).
    """
    residual = fitted.residual[which]
    moved = residual - change
    observations, features = fitted.observations, fitted.raw.shape[1]
    if observations is None or fitted.weight is None:
        return heavy_tailed(moved, features)
    row, event = observations.rows(fitted.whitener)
    # A weighted step of a probability, times its weight, is a step of the log-odds.
    odds = np.zeros(observations.seen[which].shape)
    odds[:, event] = (residual - moved)[:, row] * fitted.weight[which][:, observations.columns][:, event]
    exact = observations.select(which).loss(fitted.raw[which], odds)[:, event].sum(axis=1)
    moved[:, row] = 0.0
    return np.asarray(heavy_tailed(moved, features - int(observations.columns.sum())) + exact)


def heavy_tailed(residual: FloatArray, features: int) -> FloatArray:
    """Negative log-likelihood [nats] of windows under Student's t, up to a constant, shape (windows,)."""
    return np.asarray(0.5 * (TAIL + features) * np.log1p(np.sum(residual**2, axis=1) / TAIL))


def diagonal_whitener(problem: Problem, raw: FloatArray) -> FloatArray:
    """Whitener that divides each average by its residual's root mean square, no less than its floor."""
    spread = np.maximum(np.sqrt(np.mean(raw**2, axis=0)), problem.floor)
    return np.asarray(np.diag(1.0 / np.where(problem.events, 1.0, spread)))


def whitener_by_output(problem: Problem, raw: FloatArray) -> FloatArray:
    """Whitener that divides each signal's features by their common root mean square."""
    known = np.where(np.isfinite(raw), raw, 0.0)
    size = np.empty(len(problem.outputs))
    for j in np.unique(problem.outputs):
        own = problem.outputs == j
        size[own] = np.sqrt(np.mean(known[:, own] ** 2))
    size = np.where(problem.events, 1.0, np.maximum(size, problem.floor))
    return np.asarray(np.diag(1 / size))


def covariance_whitener(problem: Problem, fitted: Fit, shrink: float = 0.15) -> FloatArray:
    """Whitener from the residual covariance of a fit, shrunk to its diagonal, eigenvalues floored.

    Few windows for many features need more shrinkage than the usual 15 %. Events are left unchanged.
    """
    if problem.events.any():
        result = np.eye(len(problem.outputs))
        if not problem.events.all():
            averages = ~problem.events
            result[np.ix_(averages, averages)] = _from_covariance(
                fitted.raw[:, averages], problem.floor[averages], len(fitted.free), shrink
            )
        return result
    return _from_covariance(fitted.raw, problem.floor, len(fitted.free), shrink)


def _from_covariance(raw: FloatArray, floor: FloatArray, free: int, shrink: float) -> FloatArray:
    windows, features = raw.shape
    scale = np.sqrt(np.mean(raw**2, axis=0) + floor**2)
    correlation = (raw / scale).T @ (raw / scale) / max(windows - free, 1) + np.diag((floor / scale) ** 2)
    shrink = max(shrink, features / (features + windows))
    correlation = (1 - shrink) * correlation + shrink * np.diag(np.diag(correlation))
    values, vectors = np.linalg.eigh(correlation)
    values = np.maximum(values, 0.05 * np.median(values))
    return np.asarray((vectors / np.sqrt(values)).T / scale)


def refit(problem: Problem, fitted: Fit, whitener: FloatArray, iterations: int = 6) -> Fit:
    """Fit again from the optimum of a fit, with another whitener."""
    return fit(problem, fitted.parameters, fitted.free, whitener, fitted.states, iterations)


def project(fitted: Fit, columns: FloatArray) -> FloatArray:
    """Whiten further feature columns and project the initial states out of them.

    Args:
        fitted: Supplies the states' sensitivities and the whitener.
        columns: Changes of the features, shape (windows, features, columns).

    Returns:
        Columns like those of ``Fit.jacobian``, shape (windows, features + states, columns).
    """
    columns = np.where(np.isfinite(columns), columns, 0.0)
    return _remove(
        fitted.basis, _padded(fitted.whitener @ _weighted(columns, fitted.weight), fitted.states.shape[1])
    )


def _cost(problem: Problem, raw: FloatArray, states: FloatArray, whitener: FloatArray) -> float:
    return float(_losses(problem, raw, states, whitener).sum())


def _losses(problem: Problem, raw: FloatArray, states: FloatArray, whitener: FloatArray) -> FloatArray:
    """Cost of each window [nats], infinite where its simulation failed, shape (windows,)."""
    prior = (problem.states - states) / (PRIOR * problem.state_scale)
    finite: NDArray[np.bool_] = np.asarray(np.isfinite(raw).all(axis=1))
    known = np.where(finite[:, None], raw, 0.0)
    observations = problem.observations
    averages = known if observations is None else observations.averages(known)
    result = 0.5 * np.sum((averages @ whitener.T) ** 2, axis=1) + 0.5 * np.sum(prior**2, axis=1)
    if observations is not None:
        _, event = observations.rows(whitener)
        result += observations.loss(known)[:, event].sum(axis=1)
    return np.where(finite, result, np.inf)


def _linearise(
    problem: Problem,
    parameters: FloatArray,
    free: IntArray,
    whitener: FloatArray,
    states: FloatArray,
    raw: FloatArray,
    coordinates: Coordinates,
) -> Fit:
    cost = _cost(problem, raw, states, whitener)
    n_states = states.shape[1]
    finite = np.where(np.isfinite(raw), raw, 0.0)
    simulated = problem.features - raw  # not a number where the simulation failed: it says nothing there
    observations = problem.observations
    weight = None if observations is None else observations.weight(finite)
    columns = _derivatives(problem, parameters, free, states, simulated, coordinates)
    basis, triangle = _state_basis(problem, parameters, states, whitener, simulated, weight)
    prior = (problem.states - states) / (PRIOR * problem.state_scale)
    weighted = finite if weight is None else finite * weight
    residual = np.concatenate([weighted @ whitener.T, prior], axis=1)[:, :, None]
    jacobian = _padded(whitener @ _weighted(columns, weight), n_states)
    across = basis.transpose(0, 2, 1)
    result = Fit(
        parameters=parameters,
        free=free,
        states=states,
        cost=cost,
        quadratic=0.5 * float(np.sum(residual**2)),
        residual=_remove(basis, residual)[:, :, 0],
        jacobian=_remove(basis, jacobian),
        raw=raw,
        active=np.ones(len(free), dtype=np.bool_),
        basis=basis,
        state_residual=np.asarray(np.linalg.solve(triangle, across @ residual)[:, :, 0]),
        state_jacobian=np.asarray(np.linalg.solve(triangle, across @ jacobian), dtype=np.float64),
        whitener=whitener,
        weight=weight,
        observations=observations,
    )
    return replace(result, active=_active(result, coordinates))


def _derivatives(
    problem: Problem,
    parameters: FloatArray,
    free: IntArray,
    states: FloatArray,
    simulated: FloatArray,
    coordinates: Coordinates,
) -> FloatArray:
    """Change of the features by each free coordinate, one-sided, away from a near bound."""
    if not len(free):
        return np.zeros((*simulated.shape, 0))
    here = coordinates.encode(parameters[free])
    sign = np.where(here + STEP > coordinates.upper, -1.0, 1.0)
    batch = np.repeat(parameters[None], len(free), axis=0)
    for k in range(len(free)):
        moved = here.copy()
        moved[k] += sign[k] * STEP
        batch[k, free[k]] = coordinates.decode(moved)[k]
    change = problem.simulate(batch, states) - simulated
    change = np.where(np.isfinite(change), change, 0.0)
    return np.moveaxis(change, 0, 2) * (sign / STEP)


def _state_basis(
    problem: Problem,
    parameters: FloatArray,
    states: FloatArray,
    whitener: FloatArray,
    simulated: FloatArray,
    weight: FloatArray | None,
) -> tuple[FloatArray, FloatArray]:
    """QR of the whitened sensitivities to the initial states, with the prior's rows below."""
    n_states = states.shape[1]
    columns = np.empty((*simulated.shape, n_states))
    for j in range(n_states):
        moved = states.copy()
        moved[:, j] += STATE_STEP * problem.state_scale[j]
        change = problem.simulate(parameters[None], moved)[0] - simulated
        columns[:, :, j] = change / STATE_STEP  # by spread, so that all columns are of the same order
    columns = np.where(np.isfinite(columns), columns, 0.0)
    prior = np.broadcast_to(np.eye(n_states) / PRIOR, (len(columns), n_states, n_states))
    q, r = np.linalg.qr(np.concatenate([whitener @ _weighted(columns, weight), prior], axis=1))
    return q, r


def _weighted(columns: FloatArray, weight: FloatArray | None) -> FloatArray:
    return columns if weight is None else columns * weight[:, :, None]


def _remove(basis: FloatArray, columns: FloatArray) -> FloatArray:
    return np.asarray(columns - basis @ (basis.transpose(0, 2, 1) @ columns))


def _padded(columns: FloatArray, rows: int) -> FloatArray:
    """Append the prior's rows, which do not depend on parameters."""
    return np.concatenate([columns, np.zeros((len(columns), rows, columns.shape[2]))], axis=1)


def _active(here: Fit, coordinates: Coordinates) -> NDArray[np.bool_]:
    """Which free parameters may move: those at a bound that the descent direction would violate may not."""
    if not len(here.free):
        return np.zeros(0, dtype=np.bool_)
    descent = np.einsum("wfk,wf->k", here.jacobian, here.residual)
    at = coordinates.encode(here.parameters[here.free])
    tiny = 1e-9 * np.maximum(1.0, np.abs(at))
    held = (at <= coordinates.lower + tiny) & (descent < 0) | (at >= coordinates.upper - tiny) & (descent > 0)
    return np.asarray(~held)


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
