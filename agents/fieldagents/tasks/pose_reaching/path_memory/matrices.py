"""The matrices M_d, M_theta, M_psi and what is done with them, as sections 5.2.2 to 5.2.4 print it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

FULL_TURN = 2 * math.pi


@dataclass(frozen=True)
class Grid:
    """The evenly spaced values that one input may take.

    Attributes:
        low: The smallest value.
        step: Distance between neighbours.
        count: Number of values: columns of the input's matrix.
        periodic: Whether the last and the first are neighbours too, as angles of a full turn are; the
            source does not say. ``count * step`` must then be a full turn.
        clamp: Whether a measurement beyond the ends counts as one at the end. Without it no value is near
            and every lambda is zero; the source does not say.
    """

    low: float
    step: float
    count: int
    periodic: bool = False
    clamp: bool = True

    def __post_init__(self) -> None:
        if not (math.isfinite(self.low) and self.step > 0 and self.count >= 2):
            raise ValueError(f"a grid needs a finite low end, a positive step and two values, not {self}")
        if self.periodic and not math.isclose(self.count * self.step, FULL_TURN, rel_tol=1e-9):
            raise ValueError(f"a periodic grid must cover a full turn, not {self.count * self.step:.6g} rad")

    @property
    def values(self) -> Floats:
        """The values, shape (count,)."""
        return np.asarray(self.low + self.step * np.arange(self.count, dtype=np.float64))

    def place(self, values: ArrayLike) -> Floats:
        """Positions of measurements in units of columns; NaN where nothing is near (see ``clamp``)."""
        position = (np.asarray(values, dtype=np.float64) - self.low) / self.step
        if self.periodic:
            position = np.mod(position, self.count)
            return np.where(position >= self.count, 0.0, position)  # np.mod rounds -1e-17 up to count
        inside = np.clip(position, 0.0, self.count - 1.0)
        return inside if self.clamp else np.where(position == inside, position, np.nan)

    def nearest(self, values: ArrayLike) -> Integers:
        """Columns of the nearest values; beyond the ends the end's, halves to the upper one (assumed)."""
        column = np.floor((np.asarray(values, dtype=np.float64) - self.low) / self.step + 0.5).astype(
            np.int64
        )
        return np.mod(column, self.count) if self.periodic else np.clip(column, 0, self.count - 1)


EXAMPLE_DISTANCE = Grid(0.0, 1.0, 5)
EXAMPLE_ANGLE = Grid(-math.pi, math.pi / 10, 20, periodic=True)
"""Discretisation of the worked example (section 5.2.2)."""

DISTANCE = Grid(0.1, 0.1, 16)
BEARING = Grid(0.0, 0.1, 33)
"""Discretisation of the simulation (section 5.3.2); 0, 0.1, ... 3.2 are 33 values, the source says 32."""


def membership(columns: Integers, grid: Grid) -> Floats:
    """An input matrix: 0.5 in a state's own column, 0.25 in the columns beside it (section 5.2.3).

    Args:
        columns: Column of each remembered state, shape (states,).
        grid: The input's values.

    Returns:
        Shape (states, count).
    """
    states = np.arange(len(columns))
    matrix = np.zeros((len(columns), grid.count))
    for beside in (-1, 1):
        column = columns + beside
        if grid.periodic:
            column = np.mod(column, grid.count)
        inside = (column >= 0) & (column < grid.count)
        matrix[states[inside], column[inside]] = 0.25
    matrix[states, columns] = 0.5
    return matrix


def input_vector(value: float, grid: Grid) -> Floats:
    """The column vector of a measurement: how close it is to its two neighbours (section 5.2.3).

    3.2 among 0, 1, 2, 3, 4 gives 0, 0, 0, 0.8, 0.2. Zero where nothing is near.
    """
    vector = np.zeros(grid.count)
    place = float(grid.place(value))
    if not math.isnan(place):
        lower = int(place)
        vector[lower] = 1.0 - (place - lower)
        upper = (lower + 1) % grid.count if grid.periodic else min(lower + 1, grid.count - 1)
        vector[upper] += place - lower
    return vector


def lambdas(matrices: Sequence[Floats], measured: Sequence[float], grids: Sequence[Grid]) -> list[Floats]:
    """One lambda vector for each input: its matrix times its measurement's vector (section 5.2.3)."""
    return [m @ input_vector(x, grid) for m, x, grid in zip(matrices, measured, grids, strict=True)]


def combined(each: Sequence[ArrayLike]) -> Floats:
    """Multiply lambda vectors element by element (section 5.2.4)."""
    return np.asarray(np.prod([np.asarray(one, dtype=np.float64) for one in each], axis=0))
