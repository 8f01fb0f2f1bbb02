"""Four ways to find the remembered state of largest lambda; all give the same one.

States that share a cell of the grids have equal lambdas, and only cells within two columns of a
measurement have any. So it is enough to look at the 4 x 4 (x 4) cells around it, however many states are
remembered. Each form weighs the columns by the same products, to the bit: ties are the same ties.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from itertools import product
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse
from scipy.spatial import KDTree

from fieldagents.tasks.pose_reaching.path_memory.matrices import (
    Floats,
    Grid,
    Integers,
    combined,
    input_vector,
    membership,
)
from fieldmodels.compiled import compiled

Fallback = Literal["nearest", "stop", "first"]
"""What answers where every lambda is zero (the source does not say): the remembered state that is nearest
in columns; none, so that the robot stops; or the first row, as an argmax of zeros gives it."""
Ties = Literal["first", "last"]
"""Which of several largest lambdas wins (the source does not say)."""

LARGEST_TABLE = 100_000_000
"""Cells that a table may have; 4 bytes each."""


class Lookup(ABC):
    """Finds the remembered states that win.

    Args:
        columns: Column of each remembered state in each grid, shape (states, inputs), int64.
        grids: The inputs' values.
        fallback: What answers where every lambda is zero.
        ties: Which of equal lambdas wins.
    """

    def __init__(
        self,
        columns: ArrayLike,
        grids: Sequence[Grid],
        fallback: Fallback = "nearest",
        ties: Ties = "first",
    ) -> None:
        self.columns = np.ascontiguousarray(columns, dtype=np.int64)
        self.grids, self.fallback, self.ties = tuple(grids), fallback, ties
        if self.columns.ndim != 2 or self.columns.shape[1] != len(self.grids) or not len(self.columns):
            raise ValueError(f"columns must have shape (states, {len(self.grids)}), not {self.columns.shape}")
        counts = np.array([grid.count for grid in self.grids])
        if ((self.columns < 0) | (self.columns >= counts)).any():
            raise ValueError("a remembered state lies in a column that its grid does not have")
        if any(grid.periodic and grid.count < 4 for grid in self.grids):
            raise ValueError("a periodic grid needs at least four values")

    def winners(self, measured: ArrayLike) -> Integers:
        """Number of the remembered state that wins for each measurement, -1 for none (``stop``).

        Args:
            measured: Shape (batch, inputs).
        """
        values = np.asarray(measured, dtype=np.float64)
        places = np.stack([grid.place(values[:, i]) for i, grid in enumerate(self.grids)], axis=1)
        found = self._likeliest(values, places)
        if self.fallback == "first":
            found[found < 0] = 0
        elif self.fallback == "nearest":
            for row in np.flatnonzero(found < 0):
                found[row] = self._nearest(_position(values[row], self.grids))
        return found

    @abstractmethod
    def _likeliest(self, values: Floats, places: Floats) -> Integers:
        """The states of largest lambda, -1 where every lambda is zero."""

    def _nearest(self, position: Floats) -> int:
        return self._chosen(-_squares(self.columns, position, self.grids))

    def _chosen(self, score: Floats) -> int:
        """The state of the largest score, by the rule for ties."""
        last = self.ties == "last"
        return int(len(score) - 1 - np.argmax(score[::-1])) if last else int(np.argmax(score))


class Dense(Lookup):
    """The matrices as printed: every state takes part in every decision."""

    def __init__(
        self, columns: ArrayLike, grids: Sequence[Grid], fallback: Fallback = "nearest", ties: Ties = "first"
    ) -> None:
        super().__init__(columns, grids, fallback, ties)
        self.matrices = [self._matrix(membership(self.columns[:, i], g)) for i, g in enumerate(self.grids)]

    @staticmethod
    def _matrix(full: Floats) -> Floats:
        return full

    def _likeliest(self, values: Floats, places: Floats) -> Integers:  # noqa: ARG002
        found = np.full(len(values), -1)
        for row, value in enumerate(values):
            vectors = [input_vector(x, grid) for x, grid in zip(value, self.grids, strict=True)]
            each = combined([matrix @ vector for matrix, vector in zip(self.matrices, vectors, strict=True)])
            best = self._chosen(each)
            if each[best] > 0:
                found[row] = best
        return found


class Sparse(Dense):
    """The same matrices without their zeros: two or three entries a row."""

    @staticmethod
    def _matrix(full: Floats) -> Floats:
        return sparse.csr_array(full)  # type: ignore[return-value]  # multiplies vectors alike


class _Cells(Lookup):
    """What the indexed forms share: the cells in use, each with the one state that can win there."""

    def __init__(
        self, columns: ArrayLike, grids: Sequence[Grid], fallback: Fallback = "nearest", ties: Ties = "first"
    ) -> None:
        super().__init__(columns, grids, fallback, ties)
        self.shape = np.array([grid.count for grid in self.grids])
        if math.prod(self.shape.tolist()) > LARGEST_TABLE:
            raise ValueError(f"grids of {'x'.join(map(str, self.shape))} cells are too fine; widen the steps")
        flat = np.ravel_multi_index(tuple(self.columns.T), tuple(self.shape))
        if self.ties == "last":
            self.used, first = np.unique(flat[::-1], return_index=True)
            self.state = len(flat) - 1 - first
        else:
            self.used, self.state = np.unique(flat, return_index=True)
        self.cells = np.stack(np.unravel_index(self.used, tuple(self.shape)), axis=1)
        self.periodic = np.array([grid.periodic for grid in self.grids])
        box = np.where(self.periodic, self.shape, 0)
        self.tree = KDTree(self.cells, boxsize=box if box.any() else None)

    def _nearest(self, position: Floats) -> int:
        away = self.tree.query(position)[0]
        near = np.asarray(self.tree.query_ball_point(position, away * (1 + 1e-9) + 1e-9))
        return self._chosen_of(near, -_squares(self.cells[near], position, self.grids))

    def _chosen_of(self, near: Integers, score: Floats) -> int:
        winners = self.state[near[score == score.max()]]
        return int(winners.max() if self.ties == "last" else winners.min())


class BinTable(_Cells):
    """A table of all cells: the measurement's place says where to look."""

    def __init__(
        self, columns: ArrayLike, grids: Sequence[Grid], fallback: Fallback = "nearest", ties: Ties = "first"
    ) -> None:
        super().__init__(columns, grids, fallback, ties)
        self.table = np.full(math.prod(self.shape.tolist()), -1, dtype=np.int32)
        self.table[self.used] = self.state
        self._around = np.array(list(product(range(-1, 3), repeat=len(self.grids))), dtype=np.int64)

    def _likeliest(self, values: Floats, places: Floats) -> Integers:  # noqa: ARG002
        return _search_table(places, self.table, self.shape, self.periodic, self._around, self.ties == "last")


class Tree(_Cells):
    """A KD-tree of the cells in use: also where a table would be too large."""

    def _likeliest(self, values: Floats, places: Floats) -> Integers:  # noqa: ARG002
        found = np.full(len(places), -1)
        for row, place in enumerate(places):
            if np.isnan(place).any():
                continue
            near = np.asarray(self.tree.query_ball_point(place, 2.0, p=np.inf), dtype=np.int64)
            if not len(near):
                continue
            score = np.ones(len(near))
            for i, grid in enumerate(self.grids):
                score *= _lambda_of(place[i], self.cells[near, i], grid)
            if score.max() > 0:
                found[row] = self._chosen_of(near, score)
        return found


def _lambda_of(place: float, columns: Integers, grid: Grid) -> Floats:
    """Lambda of states in these columns for a measurement at a place, bit for bit as the matrix gives it."""
    lower = int(place)
    above = place - lower
    away = columns - lower
    if grid.periodic:
        away = (away + grid.count // 2) % grid.count - grid.count // 2
    return _ROW[np.clip(away, -2, 3) + 2] * (1.0 - above) + _ROW[np.clip(away - 1, -2, 3) + 2] * above


_ROW = np.array([0.0, 0.25, 0.5, 0.25, 0.0, 0.0])
"""Entry of a row at -2 to 3 columns from its state."""


@compiled
def _search_table(
    places: Floats,
    table: NDArray[np.int32],
    shape: Integers,
    periodic: NDArray[np.bool_],
    around: Integers,
    last: bool,
) -> Integers:
    found = np.full(len(places), -1, dtype=np.int64)
    inputs = places.shape[1]
    for row in range(len(places)):
        best, state = 0.0, -1
        for cell in range(len(around)):
            score, flat = 1.0, 0
            for i in range(inputs):
                place = places[row, i]
                if math.isnan(place):
                    score = 0.0
                    break
                lower = int(place)
                above = place - lower
                away = around[cell, i]
                column = lower + away
                if periodic[i]:
                    column %= shape[i]
                elif column < 0 or column >= shape[i]:
                    score = 0.0
                    break
                at_lower = 0.5 if away == 0 else (0.25 if abs(away) == 1 else 0.0)
                at_upper = 0.5 if away == 1 else (0.25 if away == 0 or away == 2 else 0.0)
                score *= at_lower * (1.0 - above) + at_upper * above
                flat = flat * shape[i] + column
            if score <= 0.0 or score < best or table[flat] < 0:
                continue
            candidate = table[flat]
            if score > best or (candidate > state) == last:
                best, state = score, candidate
        found[row] = state
    return found


def _position(values: Floats, grids: Sequence[Grid]) -> Floats:
    """Places in columns; beyond the ends of a grid that does not clamp, those outside."""
    places = [
        float(grid.place(x)) if grid.periodic or grid.clamp else float((x - grid.low) / grid.step)
        for x, grid in zip(values, grids, strict=True)
    ]
    return np.array(places)


def _squares(columns: Integers, position: Floats, grids: Sequence[Grid]) -> Floats:
    """Squared distances of states from a position, in columns."""
    total = np.zeros(len(columns))
    for i, grid in enumerate(grids):
        away = np.abs(columns[:, i] - position[i])
        total += (np.minimum(away, grid.count - away) if grid.periodic else away) ** 2
    return total


FORMS: dict[str, Callable[..., Lookup]] = {"dense": Dense, "sparse": Sparse, "table": BinTable, "tree": Tree}
"""The forms by name."""
