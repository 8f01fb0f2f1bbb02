"""The evidence for a set of causes: the marginal likelihood of what its fit leaves.

The errors of a window are normal with a covariance that nobody knows. It is integrated out under an
inverse-Wishart prior about white noise, of which the size in every output and the strength are those that
explain the errors best (Gelman et al., Bayesian Data Analysis, 3rd ed., section 3.6). Two sets are so
compared without weights that either of them chose: weights by what a set leaves look away from what it lacks.
The slow zero of every sensor is integrated out, too (Laplace's approximation).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import multigammaln

from fieldmodels.arrays import FloatArray, IntArray
from fieldmodels.diagnosis.linearisation import Fit, project, reweighed, stacked
from fieldmodels.diagnosis.problem import Problem

STRENGTHS = (0.25, 1.0, 4.0, 16.0, 64.0)
"""Of the prior, in windows for each feature: from errors of any colour to white ones."""
ROUNDS = 6
"""Times that the sizes of the prior are improved, by a fixed point."""
SINES = 24
"""Sines over the record by which a slow zero is described: a walk that begins at zero."""
SIZES, FALLS = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0), (1.0, 0.5)
"""Sizes of a slow zero, in parts of the errors, and how it falls with frequency: a random walk, 1/f noise."""
PACES = ((0.0, 1.0), *((size, fall) for fall in FALLS for size in SIZES))
PACE = math.log(len(PACES))
"""Price of a sensor's pace [nats]: one is chosen of so many."""
LOOKS = 3
"""Times that the paces of all sensors are looked at again, one after the other."""

Paces = tuple[int, ...]


@dataclass(frozen=True)
class Errors:
    """What some errors say of their covariance.

    Attributes:
        value: Negative log marginal likelihood [nats].
        covariance: Mean of the posterior, shape (features, features).
    """

    value: float
    covariance: FloatArray


@dataclass(frozen=True)
class Marginal:
    """The evidence of a fit.

    Attributes:
        value: Negative log marginal likelihood [nats].
        whitener: By the covariance of its errors, shape (features, features).
    """

    value: float
    whitener: FloatArray


class Evidence:
    """Evidence of fits to the windows of a problem, by its model or by one with further effects.

    Attributes:
        rows: Number of averages that say something; of events, where there is nothing else.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self._averages = ~problem.events
        self._outputs = problem.outputs[self._averages]
        self._floor = np.asarray(problem.floor[self._averages])
        windows, features = problem.features.shape
        some = windows * len(self._outputs)
        self.rows = max(some - problem.states.size, 1) if some else windows * features
        self._samples = int(np.bincount(self._outputs).max(initial=0)) if problem.alike else 1

    def of(self, problem: Problem, fitted: Fit) -> Marginal:
        """Evidence of a fit of this problem's windows, with or without slow zeros."""
        events, events_only = 0.0, not self._averages.any()
        if problem.observations is not None:
            events = float(problem.observations.loss(fitted.raw)[:, ~self._averages].sum())
        if events_only:
            return Marginal(events, fitted.whitener)
        shown = self._shown(fitted.raw)
        here = reweighed(problem, fitted, self._whitener(self._errors(shown).covariance))
        found = [self._value(here, _left(here, *_solution(here)))]
        # A slow zero hardly shows in the changes from one window to the next.
        changes = self._errors(np.diff(shown, axis=0) / math.sqrt(2.0)) if len(shown) > 2 else None
        if changes is not None:
            found += self._beside_slow_zeros(
                problem, reweighed(problem, fitted, self._whitener(changes.covariance))
            )
        value, covariance = min(found, key=lambda one: one[0])
        return Marginal(value + events, self._whitener(covariance))

    def first_order(self, here: Fit, further: FloatArray) -> float:
        """Evidence of a fit with further columns, without slow zeros, to first order.

        Args:
            here: The fit, whitened as the columns are to be fitted.
            further: Columns like those of its Jacobian.
        """
        return self._value(here, _left(here, *_solution(here, further)))[0]

    def _beside_slow_zeros(self, problem: Problem, here: Fit) -> list[tuple[float, FloatArray]]:
        """Evidence and covariance of the errors beside slow zeros, if there are any."""
        slow, (x, _) = self._slow_zeros(problem, here), _solution(here)
        both = np.concatenate([x, here.residual.reshape(-1, 1)], axis=1)
        products, across, powers = slow.T @ slow, slow.T @ both, both.T @ both

        def solved(paces: Paces) -> tuple[float, FloatArray, FloatArray, FloatArray]:
            """Loss [nats], the root of what integrates zeros out, how much of each is there, the rest."""
            sizes = _deviations(paces)
            used = sizes > 0.0
            own = sizes[used, None] * products[np.ix_(used, used)] * sizes[used]
            root = np.linalg.cholesky(np.eye(len(own)) + own)
            taken = np.linalg.solve(root, sizes[used, None] * across[used])
            rest = powers - taken.T @ taken
            b = np.linalg.lstsq(rest[:-1, :-1], rest[:-1, -1], rcond=1e-10)[0]
            u = np.zeros(len(sizes))
            u[used] = np.linalg.solve(root.T, taken[:, -1] - taken[:, :-1] @ b)
            half = float(np.sum(np.log(np.diag(root)))) + PACE * sum(i > 0 for i in paces)
            return half, 0.5 * float(rest[-1, -1] - rest[:-1, -1] @ b), b, u

        paces = _least(lambda p: sum(solved(p)[:2]), (0,) * (slow.shape[1] // SINES))
        if not any(paces):
            return []
        half, _, b, u = solved(paces)
        left = _left(here, np.concatenate([x, slow], axis=1), np.concatenate([b, _deviations(paces) * u]))
        value, covariance = self._value(here, left)
        return [(value + half + 0.5 * float(u @ u), covariance)]

    def _value(self, here: Fit, left: FloatArray) -> tuple[float, FloatArray]:
        """Evidence of what is left, whitened, with what the starts are off; and its covariance."""
        features = len(here.whitener)
        raw = np.linalg.solve(here.whitener, left[:, :features].T).T
        errors = self._errors(self._shown(raw))
        return errors.value + 0.5 * float(np.sum(left[:, features:] ** 2)), errors.covariance

    def _shown(self, raw: FloatArray) -> FloatArray:
        """Rows of errors that have one covariance: windows, or samples where all are alike."""
        known = np.where(np.isfinite(raw), raw, 0.0)[:, self._averages]
        if self._samples == 1:
            return known
        outputs = np.unique(self._outputs)
        return np.stack([known[:, self._outputs == j].ravel() for j in outputs], axis=1)

    def _errors(self, errors: FloatArray) -> Errors:
        """Evidence of independent rows of errors, by the best prior of their covariance."""
        outputs, floor = self._outputs, self._floor
        if self._samples > 1:
            outputs, first = np.unique(outputs, return_index=True)
            floor = floor[first]
        _, number = np.unique(outputs, return_inverse=True)
        rows, features = errors.shape
        counts = np.bincount(number)
        squares = np.bincount(number, np.sum(errors**2, axis=0)) / (counts * rows)
        unit = np.sqrt(np.maximum(squares, np.bincount(number, floor**2) / counts) + 1e-300)[number]
        errors, floor = errors / unit, floor / unit
        products = errors.T @ errors
        least = np.bincount(number, floor**2) / counts + 1e-12
        sizes = np.ones(len(counts))
        best = Errors(math.inf, np.zeros((0, 0)))
        for strength in STRENGTHS:
            windows = strength * features
            freedom = windows + features + 1.0
            for _ in range(ROUNDS):
                prior = windows * (sizes[number] + floor**2)
                inverse = np.linalg.inv(products + np.diag(prior))
                share = np.bincount(number, np.diag(inverse) * prior)
                sizes = np.maximum(sizes * freedom * counts / ((freedom + rows) * share), 1e-3 * least)
            prior = windows * (sizes[number] + floor**2)
            whole = products + np.diag(prior)
            value = (
                rows * float(np.sum(np.log(math.sqrt(math.pi) * unit)))
                + float(multigammaln(0.5 * freedom, features))
                - float(multigammaln(0.5 * (freedom + rows), features))
                - 0.5 * freedom * float(np.sum(np.log(prior)))
                + 0.5 * (freedom + rows) * float(np.linalg.slogdet(whole)[1])
            )
            if value > best.value:
                break  # in the order of their strengths the values have one least
            best = Errors(value, whole * np.outer(unit, unit) / (windows + rows))
        return best

    def _whitener(self, covariance: FloatArray) -> FloatArray:
        """What whitens the features; events stay as they are."""
        root = np.linalg.inv(np.linalg.cholesky(covariance))
        features = len(self.problem.outputs)
        result = np.eye(features)
        if self._samples == 1:
            result[np.ix_(self._averages, self._averages)] = root
            return result
        number: IntArray = np.unique(self._outputs, return_inverse=True)[1]
        place = np.sum(np.tril(number[:, None] == number[None, :], -1), axis=1)
        same = place[:, None] == place[None, :]
        result[np.ix_(self._averages, self._averages)] = np.where(
            same, root[number[:, None], number[None, :]], 0.0
        )
        return result

    def _slow_zeros(self, problem: Problem, here: Fit) -> FloatArray:
        """What a slow zero of each output adds, sine by sine, shape (windows * rows, outputs * sines)."""
        windows = len(here.residual)
        orders = np.arange(1, SINES + 1) - 0.5
        along = (np.arange(windows) + 0.5)[:, None] / windows
        sines = np.sin(np.pi * along * orders) * math.sqrt(2.0)
        blocks = [np.zeros((here.residual.size, 0))]
        for j in np.unique(self._outputs):
            unit = project(here, problem.zeros[int(j)][:, :, None])[:, :, 0]
            unit = unit / (math.sqrt(float(np.mean(np.sum(unit**2, axis=1)))) + 1e-300)
            blocks.append((unit[:, :, None] * sines[:, None, :]).reshape(-1, SINES))
        return np.concatenate(blocks, axis=1)


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


def _deviations(paces: Paces) -> FloatArray:
    """Of every sine of every slow zero."""
    orders = np.arange(1, SINES + 1) - 0.5
    return np.concatenate([PACES[i][0] * orders ** -PACES[i][1] for i in paces])


def _least(at: Callable[[Paces], float], none: Paces) -> Paces:
    """The paces of least value: each looked at in turn, from none at all."""
    seen: dict[Paces, float] = {}

    def of(paces: Paces) -> float:
        if paces not in seen:
            seen[paces] = at(paces)
        return seen[paces]

    best = none
    for _ in range(LOOKS):
        before = best
        for j in range(len(best)):
            near = range(len(PACES)) if best[j] == 0 else _near(best[j])
            best = min([best, *((*best[:j], int(i), *best[j + 1 :]) for i in near)], key=of)
        if best == before:
            break
    return best


def _near(pace: int) -> NDArray[np.int64]:
    """Paces beside one: none, a step smaller, a step larger, and the other fall."""
    count = len(SIZES)
    size, fall = (pace - 1) % count, (pace - 1) // count
    larger = [pace + 1] if size < count - 1 else []
    return np.array([0, 1 + (1 - fall) * count + size, pace - 1 if size else 0, *larger])
