"""Free parameters as numbers of order one."""

from __future__ import annotations

import numpy as np

from fieldmodels.arrays import FloatArray, IntArray
from fieldmodels.model import Parameter

STEP = 0.01  # finite-difference step of a parameter, in its scale


class Coordinates:
    """Free parameters as numbers of order one: the logarithm where a parameter spans decades."""

    def __init__(self, parameters: tuple[Parameter, ...], free: IntArray) -> None:
        chosen = [parameters[i] for i in free]
        self.log = np.array([p.lower > 0 and p.upper > 100 * p.lower for p in chosen], dtype=np.bool_)
        self.scale = np.array([p.scale for p in chosen])
        self._range = np.array([p.lower for p in chosen]), np.array([p.upper for p in chosen])
        self.lower, self.upper = map(self.encode, self._range)

    def encode(self, values: FloatArray) -> FloatArray:
        """Values to coordinates."""
        positive = np.where(self.log, values, 1.0)
        return np.where(self.log, np.log(positive), values / self.scale)

    def decode(self, coordinates: FloatArray) -> FloatArray:
        """Coordinates to values; the inverse of ``encode``, within the range to the last bit."""
        values = np.where(self.log, np.exp(np.where(self.log, coordinates, 0.0)), coordinates * self.scale)
        lower, upper = self._range
        values = np.where(coordinates >= self.lower, np.maximum(values, lower), values)
        return np.where(coordinates <= self.upper, np.minimum(values, upper), values)

    def slope(self, values: FloatArray) -> FloatArray:
        """Derivative of the values by the coordinates."""
        return np.where(self.log, values, self.scale)

    def difference(self, values: FloatArray) -> FloatArray:
        """Step of a finite difference: a hundredth of a parameter's scale.

        Where coordinates are logarithms, a hundredth of the value may be many scales: of a frequency it is
        several turns over a record.
        """
        share = self.scale / np.maximum(np.abs(values), self.scale)
        return np.asarray(STEP * np.where(self.log, share, 1.0))
