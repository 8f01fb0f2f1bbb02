"""The evidence for a set of causes: its marginal likelihood at the weights of one fit.

The model of a window is linear about a fit, y = J b + Z u + e. The parameters b are profiled, the slow zero u
of every sensor is integrated out, and so is the scale of the errors e, which is never below what rounding and
integration leave. Windows that lie far off count less, as by Student's t.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.linearisation import Fit, project, reweighed, stacked
from fieldmodels.diagnosis.problem import Problem

SINES = 24
"""Sines over the record by which a slow zero is described: a walk that begins at zero."""
FREEDOM = 10.0
"""Degrees of freedom of the windows' errors."""
SIZES, FALLS = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0), (1.0, 0.5)
"""Sizes of a slow zero, in parts of the errors, and how it falls with frequency: a random walk, 1/f noise."""
PACES = ((0.0, 1.0), *((size, fall) for fall in FALLS for size in SIZES))
PACE = math.log(len(PACES))
"""Price of a sensor's pace [nats]: one is chosen of so many."""
LOOKS = 3
"""Times that the paces of all sensors are looked at again, one after the other."""

Paces = tuple[int, ...]


class Reference:
    """Weights by which sets are compared, and the slow zeros of every sensor at them.

    Attributes:
        whitener: Of the fit.
        rows: Number of averages that are compared; of events, where there is nothing else.
    """

    def __init__(self, problem: Problem, fitted: Fit) -> None:
        self.problem, self.whitener = problem, fitted.whitener
        windows, features = fitted.residual.shape
        self._averages = np.ones(features, dtype=np.bool_)
        if fitted.observations is not None:
            self._averages[fitted.observations.rows(fitted.whitener)[0]] = False
        squares = np.sum(fitted.residual[:, self._averages] ** 2, axis=1)
        free = max(int(self._averages.sum()) - fitted.states.shape[1], 1)
        far = squares * free / max(float(squares.mean()), 1e-300)
        self._trust = np.sqrt(np.minimum((FREEDOM + free) / (FREEDOM + far), 1.0))[:, None]
        any_average = bool(self._averages[: fitted.raw.shape[1]].any())
        count = max(windows * int(self._averages.sum()) - fitted.states.size, 1) if any_average else 0
        self.rows = count or windows * features
        self._floor = count * _floor(problem, fitted)
        self._sines = self._slow_zeros(fitted)
        self._products = self._sines.T @ self._sines
        self._roots: dict[Paces, tuple[FloatArray, FloatArray | None, float]] = {}
        self._paces: Paces = (0,) * (self._sines.shape[1] // SINES)
        # The number of errors is that of what is left here: a whitener's floored directions hold none.
        left = self._columns((fitted.residual * self._averages)[:, :, None])
        self._count = float(count)
        if count:
            self._paces, rest = self._usual_paces(left)
            self._count = max(min(float(count), rest), 1.0)

    def value(self, fitted: Fit, problem: Problem, further: FloatArray | None = None) -> float:
        """Negative log marginal likelihood of a fit [nats].

        Args:
            fitted: The fit, of this problem or of one whose model has further effects.
            problem: Its problem.
            further: Columns like those of its Jacobian that are profiled, too.
        """
        fitted = reweighed(problem, fitted, self.whitener)
        columns = fitted.jacobian[:, :, fitted.active]
        if further is not None:
            columns = np.concatenate([columns, further], axis=2)
        x, y = self._columns(columns), self._columns(fitted.residual[:, :, None])
        size = np.sqrt(np.sum(x**2, axis=0))
        x = x[:, size > 1e-9] / size[size > 1e-9]
        both = np.concatenate([x, y], axis=1)
        powers, across = both.T @ both, self._sines.T @ both

        def at(paces: Paces) -> float:
            sizes, root, half = self._root(paces)
            rest = powers
            if root is not None:
                taken = np.linalg.solve(root, sizes[:, None] * across)
                rest = powers - taken.T @ taken
            b = np.linalg.lstsq(rest[:-1, :-1], rest[:-1, -1], rcond=1e-10)[0]
            squares, events = float(rest[-1, -1] - rest[:-1, -1] @ b), 0.0
            if fitted.observations is not None:
                squares, events = self._with_events(fitted, x, y[:, 0], b, squares)
            priced = half + events + PACE * sum(i > 0 for i in paces)
            if not self._count:
                return priced
            return priced + 0.5 * self._count * math.log(max(squares, self._floor, 1e-300) / self._count)

        return self._least(at)

    def _with_events(
        self, fitted: Fit, x: FloatArray, y: FloatArray, b: FloatArray, squares: float
    ) -> tuple[float, float]:
        """Sum of squares without that of events, and their exact loss in its place."""
        assert fitted.observations is not None
        event = np.broadcast_to(~self._averages, fitted.residual.shape).reshape(-1)
        left = y[event] - x[event] @ b
        exact = float(fitted.observations.loss(fitted.raw).sum())
        changed = 0.5 * float(left @ left - y[event] @ y[event])
        return max(squares - float(left @ left), 1e-300), exact + changed

    def _least(self, at: Callable[[Paces], float]) -> float:
        """The least value over the paces beside those of this reference."""
        seen: dict[Paces, float] = {}

        def of(paces: Paces) -> float:
            if paces not in seen:
                seen[paces] = at(paces)
            return seen[paces]

        best = min({self._paces, (0,) * len(self._paces)}, key=of)
        for _ in range(LOOKS):
            before = best
            for j in range(len(best)):
                best = min([best, *(_with(best, j, i) for i in _near(best[j]))], key=of)
            if best == before:
                break
        return of(best)

    def _usual_paces(self, left: FloatArray) -> tuple[Paces, float]:
        """Paces of what a fit leaves, and its sum of squares beside them."""
        across, power = self._sines.T @ left[:, 0], float(np.sum(left**2))

        def rest(paces: Paces) -> float:
            sizes, root, _ = self._root(paces)
            taken = np.zeros(1) if root is None else np.linalg.solve(root, sizes * across)
            return power - float(taken @ taken)

        def at(paces: Paces) -> float:
            return 0.5 * rest(paces) + self._root(paces)[2] + PACE * sum(i > 0 for i in paces)

        count = len(self._paces)
        best = min(((i,) * count for i in range(len(PACES))), key=at)
        for _ in range(2):
            for j in range(count):
                best = min([best, *(_with(best, j, i) for i in range(len(PACES)))], key=at)
        return best, rest(best)

    def _root(self, paces: Paces) -> tuple[FloatArray, FloatArray | None, float]:
        """Deviations of all sines, the root of what integrates them out, half its log determinant."""
        if paces not in self._roots:
            orders = np.arange(1, SINES + 1) - 0.5
            sizes = np.concatenate([np.zeros(0), *(PACES[i][0] * orders ** -PACES[i][1] for i in paces)])
            root, half = None, 0.0
            if sizes.any():
                root = np.linalg.cholesky(np.eye(len(sizes)) + sizes[:, None] * self._products * sizes)
                half = float(np.sum(np.log(np.diag(root))))
            self._roots[paces] = sizes, root, half
        return self._roots[paces]

    def _slow_zeros(self, fitted: Fit) -> FloatArray:
        """What a slow zero of each output adds, sine by sine, shape (windows * rows, outputs * sines)."""
        problem, windows = self.problem, len(fitted.residual)
        orders = np.arange(1, SINES + 1) - 0.5
        along = (np.arange(windows) + 0.5)[:, None] / windows
        sines = np.sin(np.pi * along * orders) * math.sqrt(2.0)
        blocks = [np.zeros((fitted.residual.size, 0))]
        for j in np.unique(problem.outputs[~problem.events]):
            unit = project(fitted, problem.zeros[int(j)][:, :, None])[:, :, 0] * self._averages
            unit = unit / (math.sqrt(float(np.mean(np.sum(unit**2, axis=1)))) + 1e-300) * self._trust
            blocks.append((unit[:, :, None] * sines[:, None, :]).reshape(-1, SINES))
        return np.concatenate(blocks, axis=1)

    def _columns(self, columns: FloatArray) -> FloatArray:
        """Columns of all windows below each other, each window by how far it is trusted."""
        return stacked(columns * np.where(self._averages, self._trust, 1.0)[:, :, None])


def _floor(problem: Problem, fitted: Fit) -> float:
    """Mean square of whitened errors that rounding and integration leave."""
    average = ~problem.events
    if not average.any():
        return 0.0
    floor = np.where(average, problem.floor, 0.0)
    return float(np.mean(((fitted.whitener * floor) ** 2).sum(axis=1)[average]))


def _with(paces: Paces, output: int, pace: int) -> Paces:
    return (*paces[:output], pace, *paces[output + 1 :])


def _near(pace: int) -> NDArray[np.int64]:
    """Paces beside one: a step smaller, a step larger, and the other fall."""
    count = len(SIZES)
    if pace == 0:
        return np.array([1, 1 + count])
    size, fall = (pace - 1) % count, (pace - 1) // count
    larger = [pace + 1] if size < count - 1 else []
    return np.array([1 + (1 - fall) * count + size, pace - 1 if size else 0, *larger])
