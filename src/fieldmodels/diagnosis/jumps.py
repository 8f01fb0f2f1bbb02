"""Jumps that may be missing: a force or a sensor's zero that is another one from some time on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.result import JUMP
from fieldmodels.diagnosis.shapes import Curve

EDGE = 3
"""Windows before and after a jump, at least."""
POINTS = 257
"""Of its table."""


def jump(place: Curve, time: FloatArray, begun: float, tried: int) -> Curve:
    """A jump at a place.

    Args:
        place: A curve over time there, whose values are replaced.
        time: Of every segment [s], shape (windows, segments).
        begun: When it happens [s].
        tried: Of how many it is the best.
    """
    knots = np.linspace(time.min(), time.max(), POINTS)
    return replace(
        place,
        values=(time >= begun)[:, :, None].astype(np.float64),
        knots=knots,
        shapes=(knots >= begun)[:, None].astype(np.float64),
        formula=f"{JUMP} {begun:.4g} {place.over_unit}",
        tried=tried,
    )


def jumps_near(place: Curve, time: FloatArray, begun: float, tried: int) -> list[Curve]:
    """Jumps at every segment within a window's length of a time; arguments as of ``jump``."""
    width = float(np.median(time[:, -1] - time[:, 0]))
    near = np.unique(time[np.abs(time - begun) <= width])
    return [jump(place, time, float(t), tried) for t in near]


def strongest_jump(
    time: FloatArray, whole: FloatArray, others: FloatArray, left: FloatArray, sine: float
) -> tuple[float, int] | None:
    """When the strongest jump is, at the start of one of the windows, and of how many; None if of too few.

    Args:
        time: Of every segment [s], shape (windows, segments).
        whole: Square of what each window answers to a unit, shape (windows,).
        others: Products of that with an orthonormal basis of the free parameters and with the residual, shape
            (windows, free + 1).
        left: Of the basis with the residual, shape (free,).
        sine: Of the angle to the free parameters below which they are what the jump does.
    """
    order = np.argsort(time[:, 0], kind="stable")
    if len(order) < 3 * EDGE:
        return None

    def from_there_on(values: FloatArray) -> FloatArray:
        return np.asarray(np.cumsum(values[order][::-1], axis=0)[::-1][EDGE:-EDGE])

    size, cross = from_there_on(whole), from_there_on(others)
    own = size - np.sum(cross[:, :-1] ** 2, axis=1)
    told = own > sine**2 * size
    slope = cross[:, -1] - cross[:, :-1] @ left
    power = np.where(told, slope**2 / np.where(told, own, 1.0), 0.0)
    return float(time[order[EDGE + int(np.argmax(power))], 0]), len(power)
