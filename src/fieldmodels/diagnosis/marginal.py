"""The evidence for a set of causes: the marginal likelihood of what its fit leaves.

The errors of a window follow Student's t with a covariance that nobody knows. It is integrated out under an
inverse-Wishart prior about white noise, of which the size in every output and the strength are those that
explain the errors best (Gelman et al., Bayesian Data Analysis, 3rd ed., section 3.6). Two sets are so
compared without weights that either of them chose: weights by what a set leaves look away from what it lacks.
What the fit of a window's start has taken of its errors counts as theirs. The slow zero of every sensor is
integrated out, too (Laplace's approximation).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray, IntArray
from fieldmodels.compiled import compiled
from fieldmodels.diagnosis.linearisation import (
    PRIOR,
    Fit,
    from_measured,
    over_runs,
    project,
    reweighed,
    stacked,
)
from fieldmodels.diagnosis.problem import Problem
from fieldmodels.diagnosis.response import responses

STRENGTHS = (0.25, 1.0, 4.0, 16.0, 64.0)
"""Of the prior, in windows for each feature: from errors of any colour to white ones."""
FREEDOM = 10.0
"""Degrees of freedom of a window's errors, by Student's t: windows that lie far off count less."""
ROUNDS, SETTLED = 6, 4
"""Times that the sizes of the prior, and that starts and covariance, are improved: fixed points."""
SINES = 24
"""Sines over the record by which a slow zero is described, beside where it begins."""
ORDERS = np.array([0.5, *(np.arange(1, SINES + 1) - 0.5)])
"""Half waves over the record; it begins as far from zero as its longest wave is large."""
SIZES, FALLS = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0), (1.0, 0.5)
"""Sizes of a slow zero, in parts of the errors, and how it falls with frequency: a random walk, 1/f noise."""
PACES = ((0.0, 1.0), *((size, fall) for fall in FALLS for size in SIZES))
PACE = math.log(len(PACES))
"""Price of a sensor's pace [nats]: one is chosen of so many."""
LOOKS = 3
"""Times that the paces of all sensors are looked at again, one after the other."""


@dataclass(frozen=True)
class Marginal:
    """The evidence of a fit.

    Attributes:
        value: Negative log marginal likelihood [nats].
        whitener: By the mean of its errors' covariance, shape (features, features).
        slow: Whether a sensor's zero moves.
        windows: What each window adds by the mean of its errors' covariance [nats], shape (windows,).
    """

    value: float
    whitener: FloatArray
    slow: bool
    windows: FloatArray


class Evidence:
    """Evidence of fits to the windows of a problem, by its model or by one with further effects.

    Attributes:
        rows: Number of averages that say something; of events, where there is nothing else.
    """

    def __init__(self, problem: Problem) -> None:
        self._problem, self._averages = problem, ~problem.events
        self._pushed: list[FloatArray] | None = None
        self._known: dict[int, tuple[Fit, Marginal]] = {}
        self._strength = len(STRENGTHS) - 1  # of the errors that were looked at last
        windows, features = problem.features.shape
        some = windows * int(self._averages.sum())
        self.rows = max(some - problem.states.size, 1) if some else windows * features
        outputs, floor = problem.outputs[self._averages], problem.floor[self._averages]
        self._outputs, number = np.unique(outputs, return_inverse=True)
        place = np.sum(np.tril(number[:, None] == number[None, :], -1), axis=1)
        # Where all samples have one covariance of their outputs, each sample is a row of errors.
        self._place = place if problem.alike else np.zeros_like(place)
        alike = number if problem.alike else np.arange(len(number))
        self._column: IntArray = alike
        first = np.unique(alike, return_index=True)[1]
        self._number, self._floor = number[first], np.asarray(floor[first])

    def of(self, problem: Problem, fitted: Fit) -> Marginal:
        """Evidence of a fit of these windows, with slow zeros or without, whichever is more."""
        if id(fitted) not in self._known:  # kept with the fit, so that its id is not used again
            self._known[id(fitted)] = fitted, self._of(problem, fitted)
        return self._known[id(fitted)][1]

    def _of(self, problem: Problem, fitted: Fit) -> Marginal:
        events = np.zeros(len(fitted.raw))
        if problem.observations is not None:
            loss = problem.observations.loss(fitted.raw)
            events = np.sum(loss.reshape(len(events), -1), axis=1)
        if not self._averages.any():
            return Marginal(float(events.sum()), fitted.whitener, False, events)
        rows = self._rows(fitted.raw)
        changes = np.diff(rows, axis=0) / math.sqrt(2.0)  # in which a slow zero hardly shows
        still = self._settled(problem, fitted, self._white(rows))
        slow = self._settled(problem, fitted, self._white(changes), still[0])
        value, covariance, rows = min(still, slow, key=lambda one: one[0])
        windows = _by_window(covariance, rows, len(events)) + events
        return Marginal(value + float(events.sum()), self._whitener(covariance), slow[0] < still[0], windows)

    def first_order(self, here: Fit, further: FloatArray) -> float:
        """Evidence of a fit with further columns, without slow zeros, to first order.

        Args:
            here: The fit, whitened as the columns are to be fitted.
            further: Columns like those of its Jacobian.
        """
        return self._value(here, _left(here, *_solution(here, further)))[0]

    def _settled(
        self, problem: Problem, fitted: Fit, covariance: FloatArray, still: float | None = None
    ) -> tuple[float, FloatArray, FloatArray]:
        """Evidence and mean covariance of the errors, where starts and covariance agree.

        Args:
            problem: The windows.
            fitted: A fit to them.
            covariance: From which to begin.
            still: The evidence without slow zeros, where it is to be that with them.
        """
        value, rows = math.inf, np.zeros((0, 0))
        for _ in range(SETTLED):
            here, before = reweighed(problem, fitted, self._whitener(covariance)), value
            if still is None:
                value, covariance, rows = self._value(here, None)
            else:
                price, left = self._beside_slow_zeros(problem, here)
                if not math.isfinite(price):
                    return math.inf, covariance, rows
                value, covariance, rows = self._value(here, left)
                # To first order, with slow zeros or without, more may be promised than a simulation keeps.
                promised = still - self._value(here, _left(here, *_solution(here)))[0]
                value += price + max(promised, 0.0)
            if abs(value - before) < 0.1:
                break
        return value, covariance, rows

    def _beside_slow_zeros(self, problem: Problem, here: Fit) -> tuple[float, FloatArray]:
        """Price of the slow zeros that are there, infinite if none is, and what is left beside them."""
        slow, (x, _) = self._slow_zeros(problem, here), _solution(here)
        both = np.concatenate([x, here.residual.reshape(-1, 1)], axis=1)
        products, across, powers = slow.T @ slow, slow.T @ both, both.T @ both

        paces = _least(products, across, powers)
        sizes = _deviations(paces).ravel()
        half, rest, taken, root = _without(products, across, powers, sizes)
        b, u = np.linalg.lstsq(rest[:-1, :-1], rest[:-1, -1], rcond=1e-10)[0], np.zeros(len(sizes))
        u[sizes > 0.0] = np.linalg.solve(root.T, taken[:, -1] - taken[:, :-1] @ b)
        price = half + PACE * sum(i > 0 for i in paces) + 0.5 * float(u @ u)
        left = _left(here, np.concatenate([x, slow], axis=1), np.concatenate([b, sizes * u]))
        return (price if any(paces) else math.inf), left

    def _value(self, here: Fit, left: FloatArray | None) -> tuple[float, FloatArray, FloatArray]:
        """Evidence of what a fit leaves, the mean covariance of the errors, and the errors row by row.

        Args:
            here: The fit.
            left: Whitened, with what the starts are off; by default as the fit has left it.
        """
        features, starts = len(here.whitener), here.by_states.shape[2]
        if left is None:
            known = np.where(np.isfinite(here.raw), here.raw, 0.0)
            white, off = known @ here.whitener.T, from_measured(self._problem, here.states)
        else:
            white, off = left[:, :features], left[:, features:]
        raw = np.asarray(np.linalg.solve(here.whitener, white.T).T, dtype=np.float64)
        rows, far = self._rows(raw), np.sum(self._rows(white) ** 2, axis=1)
        apart = not self._place.any()
        weights, value = _by_distance(far + starts * apart, rows.shape[1])
        products = (rows * weights[:, None]).T @ rows
        if apart:  # what the starts have taken of the errors
            own = here.whitener @ here.by_states
            bound = over_runs(own.transpose(0, 2, 1) @ own, here.runs) + np.eye(starts) / PRIOR**2
            moved = here.by_states[:, self._averages] @ np.linalg.cholesky(np.linalg.inv(bound))
            products = products + np.tensordot(moved, moved, axes=([0, 2], [0, 2]))
        more, covariance = self._errors(products, len(rows))
        return value + 0.5 * float(np.sum(off**2)) + more, covariance, rows

    def _rows(self, raw: FloatArray) -> FloatArray:
        """Rows of errors that have one covariance: windows, or samples where all are alike."""
        shown = np.where(np.isfinite(raw), raw, 0.0)[:, self._averages]
        if not self._place.any():
            return shown
        return np.stack([shown[:, self._column == k].ravel() for k in range(len(self._outputs))], axis=1)

    def _white(self, rows: FloatArray) -> FloatArray:
        """The covariance of white errors: what starts take of errors keeps the size from which it begins."""
        squares = np.bincount(self._number, np.mean(rows**2, axis=0)) / np.bincount(self._number)
        return np.diag(squares[self._number] + self._floor**2 + 1e-300)

    def _errors(self, products: FloatArray, rows: int) -> tuple[float, FloatArray]:
        """Evidence of independent errors by the best prior of their covariance, and its mean.

        Args:
            products: Sum of the products of each row's errors, shape (features, features).
            rows: How many.
        """
        number, features = self._number, len(products)
        counts = np.bincount(number)
        least = np.bincount(number, self._floor**2) / counts
        squares = np.bincount(number, np.diag(products)) / (counts * rows)
        unit = np.sqrt(np.maximum(squares, least) + 1e-300)[number]
        floor, products = self._floor / unit, products / np.outer(unit, unit)
        sizes = np.ones(len(counts))
        found: dict[int, tuple[float, FloatArray]] = {}

        def by(strength: int) -> float:
            if strength not in found:
                windows = STRENGTHS[strength] * features
                value, covariance = _by_prior(products, number, floor, rows, windows, sizes)
                value += rows * float(np.sum(np.log(math.sqrt(math.pi) * unit)))
                found[strength] = value, covariance * np.outer(unit, unit)
            return found[strength][0]

        self._strength = climbed(by, self._strength, len(STRENGTHS))
        return found[self._strength]

    def _whitener(self, covariance: FloatArray) -> FloatArray:
        """What whitens the features; events stay as they are."""
        root = np.linalg.inv(np.linalg.cholesky(covariance))
        same = self._place[:, None] == self._place[None, :]
        result = np.eye(len(self._averages))
        whole = np.where(same, root[np.ix_(self._column, self._column)], 0.0)
        result[np.ix_(self._averages, self._averages)] = whole
        return result

    def _slow_zeros(self, problem: Problem, here: Fit) -> FloatArray:
        """What a slow zero of each output adds, sine by sine, shape (windows * rows, outputs * sines)."""
        windows = len(here.residual)
        along = (np.arange(windows) + 0.5)[:, None] / windows
        sines = np.sin(np.pi * along * ORDERS) * math.sqrt(2.0)
        sines[:, 0] = 1.0
        blocks, model = [], self._problem.model
        sources = [model.measured_states.get(state.name, state.name) for state in model.states]
        scale = PRIOR * self._problem.state_scale
        # What a sensor shows too much it says of the window's start, too.
        shown = [
            (problem.zeros[int(j)], np.array([name == model.outputs[j].name for name in sources]) / scale)
            for j in self._outputs
        ]
        for added, start in (*shown, *((push, None) for push in self._inputs(here))):
            prior = None if start is None else start[:, None]
            unit = project(here, added[:, :, None], prior)[:, :, 0]
            unit = unit / (math.sqrt(float(np.mean(np.sum(unit**2, axis=1)))) + 1e-300)
            blocks.append((unit[:, :, None] * sines[:, None, :]).reshape(-1, len(ORDERS)))
        return np.concatenate(blocks, axis=1)

    def _inputs(self, fitted: Fit) -> list[FloatArray]:
        """What a unit too much adds in every direction, where inputs are what sensors show."""
        if self._pushed is None:
            model, self._pushed = self._problem.model, []
            if model.noisy_inputs and fitted.runs is None and len(fitted.parameters) == len(model.names):
                found = responses(self._problem, fitted)
                self._pushed = [one.sum(axis=2) for one in found.values()]
        return self._pushed


@compiled
def _by_prior(
    products: FloatArray, number: IntArray, floor: FloatArray, rows: int, windows: float, sizes: FloatArray
) -> tuple[float, FloatArray]:
    """Evidence of errors under a prior of so many windows, and their mean covariance.

    Args:
        products: Sum of the products of each row's errors, of size one.
        number: The output of each.
        floor: The least deviation of each.
        rows: How many rows.
        windows: Strength of the prior.
        sizes: Variance of each output by the prior; changed to the one that explains the errors best.
    """
    features, freedom = len(number), windows + len(number) + 1.0
    counts, least = np.bincount(number), 1e-12 + np.bincount(number, floor**2) / np.bincount(number)
    for _ in range(ROUNDS):
        prior = windows * (sizes[number] + floor**2)
        share = np.bincount(number, np.diag(np.linalg.inv(products + np.diag(prior))) * prior)
        sizes[:] = np.maximum(sizes * freedom * counts / ((freedom + rows) * share), 1e-3 * least)
    prior = windows * (sizes[number] + floor**2)
    whole = products + np.diag(prior)
    value = 0.5 * (freedom + rows) * np.linalg.slogdet(whole)[1] - 0.5 * freedom * np.sum(np.log(prior))
    for k in range(features):  # the multivariate gamma functions
        value += math.lgamma(0.5 * (freedom - k)) - math.lgamma(0.5 * (freedom + rows - k))
    return value, whole / (windows + rows)


def _by_distance(squares: FloatArray, size: int) -> tuple[FloatArray, float]:
    """Weights of errors that are distributed as Student's t has it, and what these cost [nats].

    Args:
        squares: Distances from zero, squared, in the errors' covariance.
        size: Errors in a row.
    """
    shape, rate = 0.5 * FREEDOM, 0.5 * (FREEDOM + squares)
    whole = shape + 0.5 * size
    cost = whole * np.log(rate) - shape * math.log(shape) + math.lgamma(shape) - math.lgamma(whole)
    weights = whole / rate
    return weights, float(np.sum(cost + weights * shape - whole))


def _solution(here: Fit, further: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
    """Columns of a fit, and of what else is fitted, of unit length; and how much of each fits best."""
    x = here.jacobian[:, :, here.active]
    x = stacked(x if further is None else np.concatenate([x, further], axis=2))
    size = np.sqrt(np.sum(x**2, axis=0))
    x = x[:, size > 1e-9] / size[size > 1e-9]
    return x, np.linalg.lstsq(x.T @ x, x.T @ here.residual.reshape(-1), rcond=1e-10)[0]


def _left(here: Fit, columns: FloatArray, b: FloatArray) -> FloatArray:
    """What some columns leave, whitened, shape (windows, features + states)."""
    return np.asarray((here.residual.reshape(-1) - columns @ b).reshape(here.residual.shape))


def _deviations(paces: Iterable[int]) -> FloatArray:
    """Of the sines of slow zeros of these paces, shape (paces, sines)."""
    return np.array([PACES[i][0] * ORDERS ** -PACES[i][1] for i in paces])


def _without(
    products: FloatArray, across: FloatArray, powers: FloatArray, sizes: FloatArray
) -> tuple[float, FloatArray, FloatArray, FloatArray]:
    """Price of sines of given deviations, what is left beside them of other columns, and their root."""
    used = sizes > 0.0
    own = sizes[used, None] * products[np.ix_(used, used)] * sizes[used]
    root = np.linalg.cholesky(np.eye(len(own)) + own)
    taken = np.linalg.solve(root, sizes[used, None] * across[used])
    rest = np.asarray(powers - taken.T @ taken)
    return float(np.sum(np.log(np.diag(root)))), rest, np.asarray(taken), np.asarray(root)


def _least(products: FloatArray, across: FloatArray, powers: FloatArray) -> list[int]:
    """The paces of slow zeros by which errors are most likely: each looked at in turn, from none at all.

    Args:
        products: Of all sines of all zeros with each other.
        across: Of these with the columns that are fitted, and the errors.
        powers: Of columns and errors with each other.
    """
    count, many = len(ORDERS), len(powers) - 1
    table, best = _deviations(range(len(PACES))), [0] * (len(products) // count)
    for _ in range(LOOKS):
        before = list(best)
        for j in range(len(best)):
            mine = np.arange(count) + j * count
            columns = np.concatenate([products[:, mine], across], axis=1)
            whole = np.block([[products[np.ix_(mine, mine)], across[mine]], [across[mine].T, powers]])
            others = _deviations(0 if k == j else pace for k, pace in enumerate(best)).ravel()
            _, left, _, _ = _without(products, columns, whole, others)
            near = np.arange(len(PACES)) if best[j] == 0 else np.array([best[j], *_near(best[j])])
            sizes = table[near]
            own = sizes[:, :, None] * left[:count, :count] * sizes[:, None, :]
            root = np.linalg.cholesky(np.eye(count) + own)
            taken = np.linalg.solve(root, sizes[:, :, None] * left[:count, count:])
            rest = left[count:, count:] - taken.transpose(0, 2, 1) @ taken
            b = np.linalg.solve(rest[:, :many, :many] + 1e-10 * np.eye(many), rest[:, :many, many:])
            loss = 0.5 * (rest[:, many, many] - np.sum(rest[:, many, :many] * b[:, :, 0], axis=1))
            half = np.sum(np.log(np.diagonal(root, axis1=1, axis2=2)), axis=1) + PACE * (near > 0)
            best[j] = int(near[np.argmin(half + loss)])
        if best == before:
            break
    return best


def _by_window(covariance: FloatArray, rows: FloatArray, windows: int) -> FloatArray:
    """What the errors of each window cost by the covariance of a row of them [nats], shape (windows,)."""
    root = np.linalg.cholesky(covariance)
    far = np.sum(np.linalg.solve(root, rows.T) ** 2, axis=0)
    costs = 0.5 * (FREEDOM + rows.shape[1]) * np.log1p(far / FREEDOM) + np.log(np.diag(root)).sum()
    return np.asarray(costs.reshape(windows, -1).sum(axis=1))


def climbed(at: Callable[[int], float], start: int, count: int) -> int:
    """The number of least value that is reached from a start by steps of one."""
    best = start
    while True:
        step = min((k for k in (best, best - 1, best + 1) if 0 <= k < count), key=at)
        if step == best:
            return best
        best = step


def _near(pace: int) -> NDArray[np.int64]:
    """Paces beside one: none, a step smaller, a step larger, and the other fall."""
    count = len(SIZES)
    size, fall = (pace - 1) % count, (pace - 1) // count
    larger = [pace + 1] if size < count - 1 else []
    return np.array([0, 1 + (1 - fall) * count + size, pace - 1 if size else 0, *larger])
