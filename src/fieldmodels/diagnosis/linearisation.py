"""A fit's linearisation: how whitened residuals change with parameters, initial states projected out.

Each window's initial state is a nuisance parameter. Its sensitivities are removed from the window's
residual by orthogonalisation (variable projection). Observations of an event output (``events.Observations``)
enter by their exact likelihood: their rows are reweighted at every step (Fisher scoring).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray, IntArray
from fieldmodels.compiled import compiled
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
        by_states: Change of the simulation by the initial states (over their spread), not whitened, shape
            (windows, features, states).
        by_free: The same by the free parameters' coordinates, shape (windows, features, free).
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
    by_states: FloatArray = field(default_factory=lambda: np.zeros((0, 0, 0)))
    by_free: FloatArray = field(default_factory=lambda: np.zeros((0, 0, 0)))

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


def pseudo_inverse(powers: FloatArray, least: float = 1e-15) -> FloatArray:
    """Pseudo-inverses of symmetric matrices, in a third of the time of NumPy's for small ones.

    Args:
        powers: Shape (..., n, n).
        least: Eigenvalues below this share of the largest count as zero.
    """
    if powers.shape[-1] == 1:
        return np.divide(1.0, powers, out=np.zeros_like(powers), where=powers != 0.0)
    values, vectors = np.linalg.eigh(powers)
    sizes = np.abs(values)
    kept = sizes > least * sizes.max(axis=-1, keepdims=True, initial=0.0)
    inverse = np.divide(1.0, values, out=np.zeros_like(values), where=kept)
    return np.asarray((vectors * inverse[..., None, :]) @ vectors.swapaxes(-1, -2))


def project(fitted: Fit, columns: FloatArray, prior: FloatArray | None = None) -> FloatArray:
    """Whiten further feature columns and project the initial states out of them.

    Args:
        fitted: Supplies the states' sensitivities and the whitener.
        columns: Changes of the features, shape (windows, features, columns).
        prior: Changes of the states' measured values over their prior, shape (states, columns) or (windows,
            states, columns); none by default.

    Returns:
        Columns like those of ``Fit.jacobian``, shape (windows, features + states, columns).
    """
    features, states = len(fitted.whitener), fitted.states.shape[1]
    rows = np.zeros((len(columns), features + states, columns.shape[2]))
    columns = np.where(np.isfinite(columns), columns, 0.0)
    np.matmul(fitted.whitener, _weighted(columns, fitted.weight), out=rows[:, :features])
    if prior is not None:
        rows[:, features:] += prior
    across = fitted.basis.transpose(0, 2, 1)
    rows -= fitted.basis @ over_runs(across @ rows, fitted.runs)
    return rows


def cost_of(problem: Problem, raw: FloatArray, states: FloatArray, whitener: FloatArray) -> float:
    """Cost of all windows [nats], infinite where any simulation failed."""
    return float(losses_of(problem, raw, states, whitener).sum())


def losses_of(
    problem: Problem, raw: FloatArray, states: FloatArray, whitener: FloatArray, some: IntArray | None = None
) -> FloatArray:
    """Cost of each window [nats], of runs their mean; infinite where a simulation failed.

    Args:
        problem: The windows.
        raw: Measured minus simulated features, shape (windows, features).
        states: Initial states, shape (windows, states).
        whitener: Whitening matrix.
        some: Numbers of the windows that ``raw`` and ``states`` are of; by default all.
    """
    if some is not None and (problem.observations is not None or problem.runs is not None):
        whole_raw, whole_states = np.full(problem.features.shape, np.inf), problem.states.copy()
        whole_raw[some], whole_states[some] = raw, states
        return np.asarray(losses_of(problem, whole_raw, whole_states, whitener)[some])
    prior = from_measured(problem, states, some)
    finite: NDArray[np.bool_] = np.asarray(np.isfinite(raw).all(axis=1))
    known = raw if finite.all() else np.where(finite[:, None], raw, 0.0)
    observations = problem.observations
    averages = known if observations is None else observations.averages(known)
    white = averages @ whitener.T
    result = 0.5 * (np.einsum("wf,wf->w", white, white) + np.einsum("ws,ws->w", prior, prior))
    if observations is not None:
        _, event = observations.rows(whitener)
        result += observations.loss(known)[:, event].sum(axis=1)
    result[~finite] = np.inf
    if problem.runs is None:
        return np.asarray(result)
    return over_runs(result, problem.runs) / over_runs(np.ones(len(result)), problem.runs)


def from_measured(problem: Problem, states: FloatArray, some: IntArray | None = None) -> FloatArray:
    """How far initial states are from the measured ones, over their prior; of a run in its first window."""
    measured = problem.states if some is None else problem.states[some]
    distance = (measured - states) / (PRIOR * problem.state_scale)
    return distance if problem.runs is None else np.asarray(distance * _is_first(problem)[:, None])


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
) -> Fit:
    """The linearisation at some parameters and states, given the errors there."""
    coordinates = problem.coordinates(free)
    simulated = problem.features - raw  # not a number where the simulation failed: it says nothing there
    by_free = _derivatives(problem, parameters, free, states, simulated, coordinates)
    by_states = _by_states(problem, parameters, states, simulated)
    return projected(problem, parameters, free, whitener, states, raw, by_states, by_free)


def reweighed(problem: Problem, here: Fit, whitener: FloatArray) -> Fit:
    """The same linearisation with another whitener, which takes no simulation."""
    if whitener is here.whitener:
        return here
    return projected(
        problem, here.parameters, here.free, whitener, here.states, here.raw, here.by_states, here.by_free
    )


def projected(
    problem: Problem,
    parameters: FloatArray,
    free: IntArray,
    whitener: FloatArray,
    states: FloatArray,
    raw: FloatArray,
    by_states: FloatArray,
    by_free: FloatArray,
) -> Fit:
    """A linearisation whitened, with the initial states projected out."""
    features, n_states = len(whitener), states.shape[1]
    finite = np.where(np.isfinite(raw), raw, 0.0)
    observations = problem.observations
    weight = None if observations is None else observations.weight(finite)
    columns = np.concatenate([by_states, finite[:, :, None], by_free], axis=2)
    rows = np.zeros((len(raw), features + n_states, columns.shape[2]))
    np.matmul(whitener, _weighted(columns, weight), out=rows[:, :features])
    rows[:, features:, :n_states] = _is_first(problem)[:, None, None] * np.eye(n_states) / PRIOR
    rows[:, features:, n_states] = from_measured(problem, states)
    quadratic = 0.5 * float(np.sum(rows[:, :, n_states] ** 2))
    others = np.ascontiguousarray(rows[:, :, n_states:])
    if problem.runs is None:
        basis = np.ascontiguousarray(rows[:, :, :n_states])
        solved = _project_out(basis, others)
    else:
        basis, solved = _project_out_of_runs(rows[:, :, :n_states], others, problem.runs)
    residual, jacobian = np.ascontiguousarray(others[:, :, 0]), np.ascontiguousarray(others[:, :, 1:])
    return Fit(
        parameters=parameters,
        free=free,
        states=states,
        cost=cost_of(problem, raw, states, whitener),
        quadratic=quadratic,
        residual=residual,
        jacobian=jacobian,
        raw=raw,
        active=_active(residual, jacobian, parameters[free], problem.coordinates(free)),
        basis=basis,
        state_residual=solved[:, :, 0],
        state_jacobian=solved[:, :, 1:],
        whitener=whitener,
        weight=weight,
        observations=observations,
        runs=problem.runs,
        by_states=by_states,
        by_free=by_free,
    )


@compiled
def _project_out(basis: FloatArray, others: FloatArray) -> FloatArray:
    """Project each window's first columns out of the others, by Gram and Schmidt's method, in place.

    Args:
        basis: Columns, of full rank, shape (windows, rows, n); orthonormal afterwards.
        others: Columns, shape (windows, rows, others); afterwards what the basis cannot represent.

    Returns:
        Coefficients of the first columns that represent the others best, shape (windows, n, others).
    """
    windows, rows, n = basis.shape
    count = others.shape[2]
    shares = np.zeros((windows, n, count))
    triangle = np.zeros((n, n))
    for w in range(windows):
        for j in range(n):
            square = 0.0
            for r in range(rows):
                square += basis[w, r, j] ** 2
            size = math.sqrt(square)
            triangle[j, j] = size
            for r in range(rows):
                basis[w, r, j] /= size
                for k in range(j + 1, n):
                    triangle[j, k] = 0.0
                for k in range(count):
                    shares[w, j, k] += basis[w, r, j] * others[w, r, k]
            for k in range(j + 1, n):
                for r in range(rows):
                    triangle[j, k] += basis[w, r, j] * basis[w, r, k]
            for r in range(rows):
                for k in range(j + 1, n):
                    basis[w, r, k] -= triangle[j, k] * basis[w, r, j]
                for k in range(count):
                    others[w, r, k] -= shares[w, j, k] * basis[w, r, j]
        for j in range(n - 1, -1, -1):
            for k in range(count):
                for i in range(j + 1, n):
                    shares[w, j, k] -= triangle[j, i] * shares[w, i, k]
                shares[w, j, k] /= triangle[j, j]
    return shares


def _project_out_of_runs(
    columns: FloatArray, others: FloatArray, runs: IntArray
) -> tuple[FloatArray, FloatArray]:
    """As ``_project_out`` where the windows of a run share a start: the basis and the coefficients."""
    lower = np.linalg.cholesky(over_runs(columns.transpose(0, 2, 1) @ columns, runs))
    across = np.asarray(np.linalg.solve(lower, columns.transpose(0, 2, 1)), dtype=np.float64)
    shares = over_runs(across @ others, runs)
    basis = across.transpose(0, 2, 1)
    others -= basis @ shares
    return basis, np.asarray(np.linalg.solve(lower.transpose(0, 2, 1), shares), dtype=np.float64)


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


def _by_states(
    problem: Problem, parameters: FloatArray, states: FloatArray, simulated: FloatArray
) -> FloatArray:
    """Change of the features by each initial state, over its spread, so that all are of the same order."""
    steps = STATE_STEP * np.diag(problem.state_scale)
    moved = problem.simulate_from(parameters, states + steps[:, None, :])
    change = np.moveaxis(moved - simulated, 0, 2) / STATE_STEP
    return np.where(np.isfinite(change), change, 0.0)


def _weighted(columns: FloatArray, weight: FloatArray | None) -> FloatArray:
    return columns if weight is None else columns * weight[:, :, None]


def _active(
    residual: FloatArray, jacobian: FloatArray, values: FloatArray, coordinates: Coordinates
) -> NDArray[np.bool_]:
    """Which free parameters may move: those at a bound that the descent direction would violate may not."""
    if not len(values):
        return np.zeros(0, dtype=np.bool_)
    descent = residual.reshape(-1) @ stacked(jacobian)
    at = coordinates.encode(values)
    tiny = 1e-9 * np.maximum(1.0, np.abs(at))
    held = (at <= coordinates.lower + tiny) & (descent < 0) | (at >= coordinates.upper - tiny) & (descent > 0)
    return np.asarray(~held)
