"""Noise that wanders: a rival of whatever follows slowly from window to window.

Slow noise of a sensor (a random walk, 1/f noise) is alike in neighbouring windows, so a curve over time, or
whatever else happens to run alike, predicts held-out windows by their neighbours. Such noise is no fault of
the simulation: what is said to be missing must bring its gain beside offsets that walk at random.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky_banded, solveh_banded

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled
from fieldmodels.diagnosis.linearisation import PRIOR, Fit, project, pseudo_inverse, stacked
from fieldmodels.diagnosis.problem import Problem

PACES = np.logspace(-2, 6, 9)
"""Variances of a walk over the whole record that are tried, over that of one window's offset."""
RETURNS = 0.0, 3.0, 10.0, 30.0, 100.0
"""How often in a record a zero returns, that are tried."""
SHARES = 1.0, 0.3, 0.1, 0.03
"""Of the errors' variance along the offsets that is left beside a walk: weights were found without one."""

LEFT = 1e-4
"""Of an offset's square, if the initial states take more: then nobody can tell."""


MORE = 6.0
"""Nats that walks bring where sensors wander."""
CERTAIN = 10.0
"""Nats that are lost if a zero hardly walks, from which on it is said: with noise that is not slow, 1.7."""
STEADY = 0.9
"""Of what is the same in all windows: the share of its squares that the mean makes up; of a ramp 0.75."""
SLOW = 0.8
"""How alike neighbouring windows are of what follows slowly; of commands that change they are 0.2 at most."""
WALKING = 0.5
"""How alike a zero is in neighbouring windows that wanders; one that is off in a few windows does not."""
FORCE = -1
"""In an output's place: the generalised force, where noise of the inputs drives the machine."""


@dataclass(frozen=True)
class Wander:
    """What is left of a fit's misfit beside offsets that walk at random.

    Attributes:
        cost: Negative logarithm of the likelihood [nats], up to a constant of the problem and its weights.
        gain: What the walks bring, with their price [nats].
        outputs: Indices of the outputs whose offset walks.
        walked: What of the gain is lost if the offsets hardly walk, with errors along them as small [nats].
    """

    cost: float
    gain: float
    outputs: tuple[int, ...]
    walked: float = 0.0


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
        return Wander(0.5 * float(_left(_products(_columns(fitted))[None])[0]), 0.0, ())
    walks = _Walks(problem, fitted)
    without = walks.without
    cost, paces = walks.search(price)
    still = walks.still({}, list(paces)) if paces else cost
    return Wander(cost, without - cost, tuple(sorted(paces.keys() - {FORCE})), still - cost)


def wandering_zeros(problem: Problem, fitted: Fit, price: float) -> dict[str, float]:
    """Outputs whose zeros certainly wander, and by how much: the standard deviation over a record."""
    if fitted.runs is not None:
        return {}
    walks = _Walks(problem, fitted)
    cost, paces = walks.search(price)
    result = {}
    for j in sorted(paces.keys() - {FORCE}):
        others = {k: pace for k, pace in paces.items() if k != j}
        offsets = walks.walk(j, paces[j])
        size = float(np.std(offsets))
        if size < problem.resolved(j):
            continue
        if walks.still(others, [j]) - cost > CERTAIN and alike(problem, offsets) > WALKING:
            result[problem.model.outputs[j].name] = size
    return result


def beside(
    problem: Problem, parent: Fit, child: Fit, price: float, enough: float = math.inf
) -> tuple[float, float]:
    """Gain [nats] of a child's further columns beside what wanders, and what walks still bring beside it.

    A nat a column, what it costs on held-out data (Akaike 1974), is taken off. Walks beside the child raise
    the gain; where it is ``enough`` without, they are not sought, and bring infinitely much.
    """
    before = wander(problem, parent, price).cost + int(parent.active.sum()) - int(child.active.sum())
    if child.runs is None:
        least = before - 0.5 * float(_left(_products(_columns(child))[None])[0])
        if least > enough:
            return least, math.inf
    after = wander(problem, child, price)
    return before - after.cost, after.gain


class _Walks:
    """Likelihood of a fit's residual beside walks of some outputs' zeros."""

    def __init__(self, problem: Problem, fitted: Fit, returns: float = 0.0) -> None:
        self.shown, model = {}, problem.model
        sources = [model.measured_states.get(s.name, s.name) for s in model.states]
        for j in np.unique(problem.outputs[~problem.events]):
            own = problem.zeros[int(j)]
            # What a sensor shows too much it says of the window's start, too.
            same = np.array([source == model.outputs[j].name for source in sources], dtype=np.bool_)
            start = same / (PRIOR * problem.state_scale)
            shown = project(fitted, own[:, :, None], start[:, None])[:, :, 0]
            if np.sum(shown**2) > LEFT * np.sum((own @ fitted.whitener.T) ** 2):
                self.shown[int(j)] = shown
        if problem.model.noisy_inputs:  # a random force is another one each moment: a steady one is a fault
            self.shown[FORCE] = _pushed(problem, fitted)
        self._columns = _columns(fitted)
        self._products, self._precision = _products(self._columns), _precision(problem, returns)
        banded = np.stack([np.append(0.0, self._precision[1, :-1]), self._precision[0]])
        self._logs = 2.0 * float(np.sum(np.log(cholesky_banded(banded)[1])))
        # Squares of what a window answers to an offset.
        squares = {j: float(np.mean(np.sum(one**2, axis=1))) for j, one in self.shown.items()}
        self._typical = {j: max(square, 1e-300) for j, square in squares.items()}
        self.without = 0.5 * float(_left(self._products[None])[0])

    def search(self, price: float) -> tuple[float, dict[int, float]]:
        """Least cost, and the paces of the outputs whose walks are worth their price."""
        cost, paces = self.without, dict[int, float]()
        singly = {j: self.best({}, j) for j in self.shown}
        for j in sorted(singly, key=lambda j: singly[j][0]):
            trial, pace = self.best(paces, j) if paces else singly[j]
            if trial + price < cost:
                cost, paces = trial + price, paces | {j: pace}
        return cost, paces

    def still(self, paces: dict[int, float], outputs: list[int]) -> float:
        """Least cost if some outputs walk as slowly as any, and others at their paces."""
        slow = [*paces.values(), *(PACES[0] / self._typical[j] for j in outputs)]
        return float(self.costs([*paces, *outputs], np.tile(slow, (len(SHARES), 1)), np.array(SHARES)).min())

    def best(self, paces: dict[int, float], j: int) -> tuple[float, float]:
        """Least cost with one output more, and its pace."""
        own = np.repeat(PACES / self._typical[j], len(SHARES))
        tried = np.column_stack([*np.tile(list(paces.values()), (len(own), 1)).T, own])
        costs = self.costs([*paces, j], tried, np.tile(SHARES, len(PACES)))
        k = int(np.argmin(costs))
        return float(costs[k]), float(own[k])

    def walk(self, j: int, pace: float) -> FloatArray:
        """The most probable offset of an output's zero in every window, by itself, shape (windows,)."""
        shown, residual = self.shown[j], _stepped(self._columns)
        diagonal, above = self._precision / pace
        diagonal = diagonal + np.sum(shown**2, axis=1)
        banded = np.stack([np.append(0.0, above[:-1]), diagonal])
        return np.asarray(solveh_banded(banded, np.sum(shown * residual, axis=1)), dtype=np.float64)

    def costs(self, outputs: list[int], paces: FloatArray, shares: FloatArray) -> FloatArray:
        """Negative log-likelihoods beside walks of these outputs, parameters at their optimum.

        Args:
            outputs: Whose zeros walk.
            paces: Their paces, shape (cases, outputs).
            shares: Of the errors along the offsets, that is left, shape (cases,).
        """
        shown = np.stack([self.shown[j] for j in outputs], axis=2)
        across = shown.transpose(0, 2, 1)
        power, score = across @ shown, across @ self._columns
        along = stacked(score).T @ stacked(pseudo_inverse(power) @ score)
        taken, changes = _integrated(self._precision, power, score, paces, shares)
        # Errors have the covariance (1 - V) + share V + walks, where V projects on the offsets.
        products = self._products + np.multiply.outer(1.0 / shares - 1.0, along) - taken
        changes += 0.5 * power[:, 0].size * np.log(shares) - self._spread(paces)
        return np.asarray(0.5 * _left(products) + changes, dtype=np.float64)

    def _spread(self, paces: FloatArray) -> FloatArray:
        """Half the logarithm of the determinant of the walks' precision, shape (cases,)."""
        return np.asarray(0.5 * np.sum(self._logs - self._precision.shape[1] * np.log(paces), axis=1))


@compiled
def _integrated(
    precision: FloatArray, power: FloatArray, score: FloatArray, paces: FloatArray, shares: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """What walks take off the products of the columns, and half the log-determinant of their precision.

    By Cholesky's factor of the banded precision, row by row, a window's offsets and all cases side by side.

    Args:
        precision: Of a walk with variance one, as of ``_precision``.
        power: Products of a window's offsets, shape (windows, walks, walks).
        score: The same with the columns, shape (windows, walks, columns).
        paces: Shape (cases, walks).
        shares: Of the errors' variance along the offsets that is left, shape (cases,).

    Returns:
        Shapes (cases, columns, columns) and (cases,); infinite where a precision is none.
    """
    windows, walks, columns = score.shape
    cases = len(paces)
    kept = walks + 1  # rows that the next one looks at
    precise, paced = 1.0 / shares, 1.0 / paces.T.copy()
    taken, logs = np.zeros((columns, columns, cases)), np.zeros(cases)
    factor = np.zeros((kept, kept, cases))  # of row r the columns r - walks to r, the last one's inverse
    half = np.zeros((kept, columns, cases))
    value = np.zeros(cases)
    for r in range(windows * walks):
        w, a, row = r // walks, r % walks, r % kept
        for i in range(max(walks - r, 0), kept):
            c = (r - walks + i) % kept
            beside = power[w, a, i - walks + a] if i >= walks - a else 0.0
            along = precision[0, w] if i == walks else precision[1, w - 1] if i == 0 else 0.0
            slow = paced[a]
            for case in range(cases):
                value[case] = beside * precise[case] + along * slow[case]
            for k in range(max(walks - r, 0), i):
                first, second = factor[row, k], factor[c, k + walks - i]
                for case in range(cases):
                    value[case] -= first[case] * second[case]
            if i < walks:
                first, second = factor[row, i], factor[c, walks]
                for case in range(cases):
                    first[case] = value[case] * second[case]
        pivot = factor[row, walks]
        for case in range(cases):
            logs[case] += 0.5 * math.log(value[case]) if value[case] > 0.0 else np.inf
            pivot[case] = 1.0 / math.sqrt(value[case]) if value[case] > 0.0 else 1.0
        for m in range(columns):
            mine = half[row, m]
            for case in range(cases):
                mine[case] = score[w, a, m] * precise[case]
            for i in range(max(walks - r, 0), walks):
                first, second = factor[row, i], half[(r - walks + i) % kept, m]
                for case in range(cases):
                    mine[case] -= first[case] * second[case]
            for case in range(cases):
                mine[case] *= pivot[case]
            for n in range(m + 1):
                other, sums = half[row, n], taken[m, n]
                for case in range(cases):
                    sums[case] += mine[case] * other[case]
    result = np.zeros((cases, columns, columns))
    for case in range(cases):
        for m in range(columns):
            for n in range(m + 1):
                if logs[case] < np.inf:
                    result[case, m, n] = result[case, n, m] = taken[m, n, case]
    return result, logs


def _columns(fitted: Fit) -> FloatArray:
    """The residual and what is free to change it, shape (windows, rows, 1 + free)."""
    return np.concatenate([fitted.residual[:, :, None], fitted.jacobian[:, :, fitted.active]], axis=2)


def _stepped(columns: FloatArray) -> FloatArray:
    """The residual once what is free to change it is at its optimum, shape (windows, rows)."""
    residual, flat = columns[:, :, 0], stacked(columns[:, :, 1:])
    step = pseudo_inverse(flat.T @ flat, 1e-8) @ (flat.T @ residual.reshape(-1))
    return np.asarray(residual - (flat @ step).reshape(residual.shape))


def _products(columns: FloatArray) -> FloatArray:
    """Of columns over all windows, shape (columns, columns)."""
    flat = stacked(columns)
    return np.asarray(flat.T @ flat)


def _left(products: FloatArray) -> FloatArray:
    """Square of the first column outside the others, from the products of all, shape (cases,)."""
    try:  # the last pivot of Cholesky's factor
        return np.asarray(np.linalg.cholesky(products[:, ::-1, ::-1])[:, -1, -1] ** 2)
    except np.linalg.LinAlgError:  # columns depend on each other
        own, cross, rest = products[:, 0, 0], products[:, 0, 1:], products[:, 1:, 1:]
        inverse = pseudo_inverse(rest)
        return np.asarray(own - np.einsum("ck,ckl,cl->c", cross, inverse, cross))


def _pushed(problem: Problem, fitted: Fit) -> FloatArray:
    """Response to the same small generalised force in all windows, like a column of ``Fit.jacobian``."""
    base, size = problem.features - fitted.raw, 1e-3
    for _ in range(2):
        forces = [np.full(len(part.windows.recording), size) for part in problem.parts]
        change = problem.response(fitted.parameters, fitted.states, forces) - base
        size *= float(np.sqrt(np.mean(fitted.raw**2) / (np.mean(change**2) + 1e-300)))
    return project(fitted, (change / size)[:, :, None])[:, :, 0]


def _precision(problem: Problem, returns: float = 0.0) -> FloatArray:
    """Of a walk with variance one over each record: its diagonal and the one above, shape (2, windows).

    Args:
        problem: The windows.
        returns: How often in a record it returns to zero: that long after the record over its time constant
            (Uhlenbeck and Ornstein 1930); 0 for a walk that does not, and had walked as long before.
    """
    result, first = np.zeros((2, len(problem))), 0
    for part in problem.parts:
        recording, starts = part.windows.recording, part.windows.starts
        time, run = recording.time[starts], recording.episode[starts]
        duration = float(np.ptp(time)) + problem.horizon
        same = run[1:] == run[:-1]
        apart = np.maximum(np.diff(time), 1e-3 * problem.horizon) / duration
        own = slice(first, first + len(time))
        if returns:
            like = same * np.exp(-returns * apart)
            inverse, both = 2 * returns * like / (1 - like**2), 2 * returns * like**2 / (1 - like**2)
            result[0, own] = 2 * returns + np.append(both, 0.0) + np.append(0.0, both)
        else:
            inverse = same / apart
            result[0, own] = np.append(True, ~same) + np.append(inverse, 0.0) + np.append(0.0, inverse)
        result[1, first : own.stop - 1] = -inverse
        first = own.stop
    return result


def wanders(problem: Problem, fitted: Fit, price: float) -> bool:
    """Whether zeros are seen to walk beside a fit."""
    return wander(problem, fitted, price).walked > MORE


def wanders_more(problem: Problem, parent: Fit, child: Fit, price: float) -> bool:
    """Whether walks bring more beside a child than its further columns do beside them; see ``beside``."""
    gain, _ = beside(problem, parent, child, price)
    return wander(problem, child, price).walked > max(gain, MORE)


def beside_returning(problem: Problem, parent: Fit, child: Fit) -> float:
    """Gain [nats] of a child's further columns beside zeros that wander, and return to their mean.

    A walk may have been anywhere before the record. A nat a column is taken off, as in ``beside``.
    """
    before, after = (
        min(_Walks(problem, fitted, returns).search(1.0)[0] for returns in RETURNS)
        for fitted in (parent, child)
    )
    return before - after - float(child.active.sum() - parent.active.sum())


def is_steady(parent: Fit, child: Fit) -> bool:
    """Whether what a child's further columns change is the same in all windows; see ``follows_slowly``."""
    change = (parent.residual - _stepped(_columns(child))).reshape(len(parent.residual), -1)
    same = len(change) * float(np.sum(change.mean(axis=0) ** 2))
    return same > STEADY * float(np.sum(change**2))


def follows_slowly(problem: Problem, parent: Fit, child: Fit) -> bool:
    """Whether what a child's further columns change is alike in neighbouring windows.

    Args:
        problem: The windows.
        parent: The fit without them.
        child: The fit with them, at its optimum or before its last step.
    """
    return alike(problem, parent.residual - _stepped(_columns(child))) > SLOW


def alike(problem: Problem, values: FloatArray) -> float:
    """How alike neighbouring windows of a run are: 1 if the same, 0 if unlike.

    Args:
        problem: The windows.
        values: Of each window, shape (windows, ...).
    """
    flat = values.reshape(len(values), -1)
    pairs = np.flatnonzero(_next_to_each_other(problem))
    both = float(np.sum(flat[pairs] ** 2) + np.sum(flat[pairs + 1] ** 2))
    return 2.0 * float(np.sum(flat[pairs] * flat[pairs + 1])) / max(both, 1e-300)


def _next_to_each_other(problem: Problem) -> NDArray[np.bool_]:
    """Whether each window but the last is followed by one of its own run, shape (windows - 1,)."""
    runs, first = [], 0
    for part in problem.parts:
        episode = part.windows.recording.episode[part.windows.starts]
        runs.append(first + np.unique(episode, return_inverse=True)[1])
        first = int(runs[-1].max()) + 1
    run = np.concatenate(runs)
    return np.asarray(run[1:] == run[:-1])
