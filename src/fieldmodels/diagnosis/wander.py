"""Noise that wanders: a rival of whatever follows slowly from window to window.

Slow noise of a sensor (a random walk, 1/f noise) is alike in neighbouring windows, so a curve over time, or
whatever else happens to run alike, predicts held-out windows by their neighbours. Such noise is no fault of
the simulation: what is said to be missing must bring its gain beside offsets that walk at random.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dpbtrf, dtbtrs

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.linearisation import PRIOR, Fit, project, stacked
from fieldmodels.diagnosis.problem import Problem

PACES = np.logspace(-2, 6, 9)
"""Variances of a walk over the whole record that are tried, over that of one window's offset."""
SHARES = 1.0, 0.3, 0.1, 0.03
"""Of the errors' variance along the offsets that is left beside a walk: weights were found without one."""

LEFT = 1e-4
"""Of an offset's square, if the initial states take more: then nobody can tell."""


FORCE = -1
"""In an output's place: the generalised force, where noise of the inputs drives the machine."""


@dataclass(frozen=True)
class Wander:
    """What is left of a fit's misfit beside offsets that walk at random.

    Attributes:
        cost: Negative logarithm of the likelihood [nats], up to a constant of the problem and its weights.
        gain: What the walks bring, with their price [nats].
        outputs: Indices of the outputs whose offset walks.
    """

    cost: float
    gain: float
    outputs: tuple[int, ...]


def wander(problem: Problem, fitted: Fit, price: float) -> Wander:
    """Let the zero of each sensor, where that helps, walk at random from window to window.

    The offsets of a record's windows are a Gaussian random walk of unknown pace, integrated out exactly (its
    precision is banded); the paces are those of the largest likelihood. Before the record it had walked as
    long. Free columns of the fit are stepped to their optimum beside it.

    Args:
        problem: The windows.
        fitted: A fit to them.
        price: Nats for each pace.
    """
    if fitted.runs is not None:  # one start for many windows: what they share is no offset of each
        return Wander(0.5 * float(np.sum(fitted.residual**2)), 0.0, ())
    walks = _Walks(problem, fitted)
    without = walks.without
    cost, paces = without, dict[int, float]()
    singly = {j: walks.best({}, j)[0] for j in walks.shown}
    for j in sorted(singly, key=lambda j: singly[j]):
        trial, pace = walks.best(paces, j)
        if trial + price < cost:
            cost, paces = trial + price, paces | {j: pace}
    return Wander(cost, without - cost, tuple(sorted(paces.keys() - {FORCE})))


def beside(problem: Problem, parent: Fit, child: Fit, price: float) -> tuple[float, float]:
    """Gain [nats] of a child's further columns beside what wanders, and what walks still bring beside it.

    A nat a column, what it costs on held-out data (Akaike 1974), is taken off.
    """
    before, after = (wander(problem, one, price) for one in (parent, child))
    gain = before.cost - after.cost - (int(child.active.sum()) - int(parent.active.sum()))
    return gain, after.gain


class _Walks:
    """Likelihood of a fit's residual beside walks of some outputs' zeros."""

    def __init__(self, problem: Problem, fitted: Fit) -> None:
        one = problem.average([np.ones(len(part.windows.recording)) for part in problem.parts])
        self.shown, model = {}, problem.model
        sources = [model.measured_states.get(s.name, s.name) for s in model.states]
        for j in np.unique(problem.outputs[~problem.events]):
            own = one * (problem.outputs == j)
            # What a sensor shows too much it says of the window's start, too.
            same = np.array([source == model.outputs[j].name for source in sources], dtype=np.bool_)
            start = same / (PRIOR * problem.state_scale)
            shown = project(fitted, own[:, :, None], start[:, None])[:, :, 0]
            if np.sum(shown**2) > LEFT * np.sum((own @ fitted.whitener.T) ** 2):
                self.shown[int(j)] = shown
        if problem.model.noisy_inputs:  # a random force is another one each moment: a steady one is a fault
            self.shown[FORCE] = _pushed(problem, fitted)
        self._columns = np.concatenate(
            [fitted.residual[:, :, None], fitted.jacobian[:, :, fitted.active]], axis=2
        )
        flat = stacked(self._columns)
        self._products, self._precision = flat.T @ flat, _precision(problem)
        self.without = 0.5 * float(_left(self._products[None])[0])

    def best(self, paces: dict[int, float], j: int) -> tuple[float, float]:
        """Least cost with one output more, and its pace."""
        typical = max(float(np.mean(np.sum(self.shown[j] ** 2, axis=1))), 1e-300)
        tried = [([*paces.values(), pace], share) for pace in PACES / typical for share in SHARES]
        costs = self.costs([*paces, j], tried)
        k = int(np.argmin(costs))
        return float(costs[k]), float(tried[k][0][-1])

    def costs(self, outputs: list[int], tried: list[tuple[list[float], float]]) -> FloatArray:
        """Negative log-likelihoods beside walks of these outputs, parameters at their optimum.

        Args:
            outputs: Whose zeros walk.
            tried: Their paces, and the share of the errors along the offsets that is left.
        """
        shown = np.stack([self.shown[j] for j in outputs], axis=2)
        across = shown.transpose(0, 2, 1)
        power, score = across @ shown, across @ self._columns
        along = stacked(score).T @ stacked(np.linalg.pinv(power, hermitian=True) @ score)
        products, changes = [], []
        for paces, share in tried:
            prior = _banded(self._precision, paces)
            taken, change = _integrated(prior, power / share, stacked(score) / share)
            # Errors have the covariance (1 - V) + share V + walks, where V projects on the offsets.
            products.append(self._products + (1.0 / share - 1.0) * along - taken)
            changes.append(change - self._spread(paces) + 0.5 * power[:, 0].size * np.log(share))
        return np.asarray(0.5 * _left(np.array(products)) + changes, dtype=np.float64)

    def _spread(self, paces: list[float]) -> float:
        """Half the logarithm of the determinant of the walks' precision."""
        size, above = self._precision.shape[1], self._precision[1]
        own = float(np.sum(np.log(-above[above < 0.0])))
        return 0.5 * float(np.sum(own - size * np.log(paces)))


def _integrated(prior: FloatArray, power: FloatArray, score: FloatArray) -> tuple[FloatArray, float]:
    """What walks take off the products of the columns, and half the log-determinant of their precision."""
    both, size = prior.copy(), power.shape[1]
    for a in range(size):
        for b in range(a, size):
            both[size - (b - a), b::size] += power[:, a, b]
    factor, failed = dpbtrf(both)
    if failed:
        return np.zeros((score.shape[1],) * 2), float("inf")
    half = dtbtrs(factor, score, uplo="U", trans="T")[0]
    return half.T @ half, float(np.sum(np.log(factor[size])))


def _left(products: FloatArray) -> FloatArray:
    """Square of the first column outside the others, from the products of all, shape (cases,)."""
    try:  # the last pivot of Cholesky's factor
        return np.asarray(np.linalg.cholesky(products[:, ::-1, ::-1])[:, -1, -1] ** 2)
    except np.linalg.LinAlgError:  # columns depend on each other
        own, cross, rest = products[:, 0, 0], products[:, 0, 1:], products[:, 1:, 1:]
        inverse = np.linalg.pinv(rest, hermitian=True)
        return np.asarray(own - np.einsum("ck,ckl,cl->c", cross, inverse, cross))


def _pushed(problem: Problem, fitted: Fit) -> FloatArray:
    """Response to the same small generalised force in all windows, like a column of ``Fit.jacobian``."""
    base, size = problem.features - fitted.raw, 1e-3
    for _ in range(2):
        forces = [np.full(len(part.windows.recording), size) for part in problem.parts]
        change = problem.response(fitted.parameters, fitted.states, forces) - base
        size *= float(np.sqrt(np.mean(fitted.raw**2) / (np.mean(change**2) + 1e-300)))
    return project(fitted, (change / size)[:, :, None])[:, :, 0]


def _precision(problem: Problem) -> FloatArray:
    """Of a walk with variance one over each record: its diagonal and the one above, shape (2, windows)."""
    result, first = np.zeros((2, len(problem))), 0
    for part in problem.parts:
        recording, starts = part.windows.recording, part.windows.starts
        time, run = recording.time[starts], recording.episode[starts]
        duration = float(np.ptp(time)) + problem.horizon
        same = run[1:] == run[:-1]
        inverse = same * duration / np.maximum(np.diff(time), 1e-3 * problem.horizon)
        own = slice(first, first + len(time))
        result[0, own] = np.append(True, ~same) + np.append(inverse, 0.0) + np.append(0.0, inverse)
        result[1, first : own.stop - 1] = -inverse
        first = own.stop
    return result


def _banded(precision: FloatArray, paces: list[float]) -> FloatArray:
    """Precision of several walks, a window's offsets side by side, in upper banded form."""
    size, count = len(paces), precision.shape[1]
    result = np.zeros((size + 1, size * count))
    for k, pace in enumerate(paces):
        result[size, k::size] = precision[0] / pace
        result[0, size + k :: size] = precision[1, :-1] / pace
    return result
