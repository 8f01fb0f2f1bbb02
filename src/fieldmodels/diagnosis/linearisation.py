"""A fit's linearisation: how whitened residuals change with parameters, initial states projected out.

Each window's initial state is a nuisance parameter. Its sensitivities are removed from the window's
residual by QR (variable projection). Observations of an event output (``events.Observations``) enter by their
exact likelihood: their rows are reweighted at every step (Fisher scoring).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray, IntArray
from fieldmodels.diagnosis.coordinates import Coordinates
from fieldmodels.diagnosis.events import Observations
from fieldmodels.diagnosis.problem import Problem

PRIOR = 2.0  # initial states stay within about this many times their spread over windows
STATE_STEP = 1e-3  # the same of a state, in its spread over windows


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
        runs: Number of the run that each window is a piece of; None where each has its own start.
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
    runs: IntArray | None = None

    @property
    def information(self) -> FloatArray:
        """Fisher information in the free parameters' coordinates, shape (free, free)."""
        flat = stacked(self.jacobian)
        return flat.T @ flat


def over_runs(values: FloatArray, runs: IntArray | None) -> FloatArray:
    """Sum over the windows of each run, for every window; the values themselves where each is a run."""
    if runs is None:
        return values
    sums = np.zeros((runs.max() + 1, *values.shape[1:]))
    np.add.at(sums, runs, values)
    return np.asarray(sums[runs])


def stacked(columns: FloatArray) -> FloatArray:
    """Columns of all windows below each other, shape (windows * rows, columns)."""
    return columns.reshape(columns.shape[0] * columns.shape[1], columns.shape[2])


def project(fitted: Fit, columns: FloatArray, prior: FloatArray | None = None) -> FloatArray:
    """Whiten further feature columns and project the initial states out of them.

    Args:
        fitted: Supplies the states' sensitivities and the whitener.
        columns: Changes of the features, shape (windows, features, columns).
        prior: Changes of the states' measured values over their prior, shape (states, columns); none by
            default.

    Returns:
        Columns like those of ``Fit.jacobian``, shape (windows, features + states, columns).
    """
    columns = np.where(np.isfinite(columns), columns, 0.0)
    padded = _padded(fitted.whitener @ _weighted(columns, fitted.weight), fitted.states.shape[1])
    if prior is not None:
        padded[:, columns.shape[1] :] += prior
    return _remove(fitted.basis, padded, fitted.runs)


def cost_of(problem: Problem, raw: FloatArray, states: FloatArray, whitener: FloatArray) -> float:
    """Cost of all windows [nats], infinite where any simulation failed."""
    return float(losses_of(problem, raw, states, whitener).sum())


def losses_of(problem: Problem, raw: FloatArray, states: FloatArray, whitener: FloatArray) -> FloatArray:
    """Cost of each window [nats], of runs their mean; infinite where a simulation failed, (windows,)."""
    prior = _from_measured(problem, states)
    finite: NDArray[np.bool_] = np.asarray(np.isfinite(raw).all(axis=1))
    known = np.where(finite[:, None], raw, 0.0)
    observations = problem.observations
    averages = known if observations is None else observations.averages(known)
    result = 0.5 * np.sum((averages @ whitener.T) ** 2, axis=1) + 0.5 * np.sum(prior**2, axis=1)
    if observations is not None:
        _, event = observations.rows(whitener)
        result += observations.loss(known)[:, event].sum(axis=1)
    result = np.where(finite, result, np.inf)
    return over_runs(result, problem.runs) / over_runs(np.ones(len(result)), problem.runs)


def _from_measured(problem: Problem, states: FloatArray) -> FloatArray:
    """How far initial states are from the measured ones, over their prior; of a run in its first window."""
    distance = (problem.states - states) / (PRIOR * problem.state_scale)
    return np.asarray(distance * _is_first(problem)[:, None])


def _is_first(problem: Problem) -> FloatArray:
    """One for every window with a start of its own, zero for those that go on with a run."""
    if problem.runs is None:
        return np.ones(len(problem))
    return np.asarray(np.diff(problem.runs, prepend=-1) != 0, dtype=np.float64)


def linearise(
    problem: Problem,
    parameters: FloatArray,
    free: IntArray,
    whitener: FloatArray,
    states: FloatArray,
    raw: FloatArray,
    coordinates: Coordinates,
) -> Fit:
    """The linearisation at some parameters and states, given the errors there."""
    cost = cost_of(problem, raw, states, whitener)
    n_states = states.shape[1]
    finite = np.where(np.isfinite(raw), raw, 0.0)
    simulated = problem.features - raw  # not a number where the simulation failed: it says nothing there
    observations = problem.observations
    weight = None if observations is None else observations.weight(finite)
    columns = _derivatives(problem, parameters, free, states, simulated, coordinates)
    basis, triangle = _state_basis(problem, parameters, states, whitener, simulated, weight)
    prior = _from_measured(problem, states)
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
        residual=_remove(basis, residual, problem.runs)[:, :, 0],
        jacobian=_remove(basis, jacobian, problem.runs),
        raw=raw,
        active=np.ones(len(free), dtype=np.bool_),
        basis=basis,
        state_residual=np.asarray(
            np.linalg.solve(triangle, over_runs(across @ residual, problem.runs))[:, :, 0]
        ),
        state_jacobian=np.asarray(
            np.linalg.solve(triangle, over_runs(across @ jacobian, problem.runs)), dtype=np.float64
        ),
        whitener=whitener,
        weight=weight,
        observations=observations,
        runs=problem.runs,
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
    step = coordinates.difference(parameters[free])
    step = np.where(here + step > coordinates.upper, -step, step)
    batch = np.repeat(parameters[None], len(free), axis=0)
    for k in range(len(free)):
        moved = here.copy()
        moved[k] += step[k]
        batch[k, free[k]] = coordinates.decode(moved)[k]
    change = problem.simulate(batch, states) - simulated
    change = np.where(np.isfinite(change), change, 0.0)
    return np.moveaxis(change, 0, 2) / step


def _state_basis(
    problem: Problem,
    parameters: FloatArray,
    states: FloatArray,
    whitener: FloatArray,
    simulated: FloatArray,
    weight: FloatArray | None,
) -> tuple[FloatArray, FloatArray]:
    """QR of the whitened sensitivities to the initial states, with the prior's rows below.

    The windows of a run share a start: then the triangle is that of all their rows, by Cholesky.
    """
    n_states = states.shape[1]
    columns = np.empty((*simulated.shape, n_states))
    for j in range(n_states):
        moved = states.copy()
        moved[:, j] += STATE_STEP * problem.state_scale[j]
        change = problem.simulate(parameters[None], moved)[0] - simulated
        columns[:, :, j] = change / STATE_STEP  # by spread, so that all columns are of the same order
    columns = np.where(np.isfinite(columns), columns, 0.0)
    prior = _is_first(problem)[:, None, None] * np.eye(n_states) / PRIOR
    rows = np.concatenate([whitener @ _weighted(columns, weight), prior], axis=1)
    if problem.runs is None:
        q, r = np.linalg.qr(rows)
        return q, r
    lower = np.asarray(
        np.linalg.cholesky(over_runs(rows.transpose(0, 2, 1) @ rows, problem.runs)), dtype=np.float64
    )
    across = np.asarray(np.linalg.solve(lower, rows.transpose(0, 2, 1)), dtype=np.float64)
    return across.transpose(0, 2, 1), lower.transpose(0, 2, 1)


def _weighted(columns: FloatArray, weight: FloatArray | None) -> FloatArray:
    return columns if weight is None else columns * weight[:, :, None]


def _remove(basis: FloatArray, columns: FloatArray, runs: IntArray | None) -> FloatArray:
    return np.asarray(columns - basis @ over_runs(basis.transpose(0, 2, 1) @ columns, runs))


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
