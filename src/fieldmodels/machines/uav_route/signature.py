"""What a radar sees of the aircraft: range, azimuth and elevation in body axes, and Table 4.1's signature."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled, inlined

AZIMUTHS = np.radians([0.0, 30.0, 31.0, 159.0, 160.0, 180.0])
"""Columns of Table 4.1 [rad]; the table is symmetric."""
NOSE = float(AZIMUTHS[2])
"""Where the nose cone ends: from here to the tail cone the table does not depend on the azimuth [rad]."""
ELEVATIONS = np.radians([0.0, 20.0, 45.0, 90.0])
"""Rows of Table 4.1 [rad]; the table is symmetric."""
_FRONT, _BESIDE, _BEHIND, _BACK = np.tan(np.radians([29.9, 31.1, 180.0 - 158.9, 180.0 - 160.1])).tolist()
"""Sides of triangles well within the cones and well between them."""
_LEVEL = math.tan(math.radians(19.9)) ** 2
SIGNATURES = np.array(
    [
        [5e-5, 5e-5, 5e-1, 5e-1, 5e-5, 5e-5],
        [5e-4, 5e-4, 5e-1, 5e-1, 5e-4, 5e-4],
        [5e-3, 5e-3, 1.0, 1.0, 5e-3, 5e-3],
        [1.0, 1.0, 1.0, 1.0, 1.0, 1.0],
    ]
)
"""Table 4.1: signature by elevation and azimuth."""


@inlined
def body_axes(
    north: float, east: float, down: float, cosine: float, sine: float, bank_cosine: float, bank_sine: float
) -> tuple[float, float, float]:  # fmt: skip
    """Place of a radar ahead of the nose, to the right, below [km]; arguments as of ``aspect``."""
    nose = north * cosine + east * sine
    level = east * cosine - north * sine
    return nose, level * bank_cosine + down * bank_sine, down * bank_cosine - level * bank_sine


@inlined
def angles_of_table(nose: float, right: float, belly: float) -> tuple[float, float]:
    """Azimuth and elevation [rad], or others with the same signature to the bit that cost no arctangent.

    Within a cone, or between them, Table 4.1 does not depend on the azimuth; level from the side, not on the
    elevation either.
    """
    flat, aside = nose * nose + right * right, abs(right)
    if aside < (_FRONT if nose > 0.0 else _BACK) * abs(nose):
        return 0.0 if nose > 0.0 else math.pi, math.atan2(-belly, math.sqrt(flat))
    if aside > (_BESIDE if nose > 0.0 else _BEHIND) * abs(nose):
        level = belly * belly < _LEVEL * flat
        return 0.5 * math.pi, 0.0 if level else math.atan2(-belly, math.sqrt(flat))
    return math.atan2(right, nose), math.atan2(-belly, math.sqrt(flat))


@inlined
def aspect(
    north: float,
    east: float,
    down: float,
    cosine: float,
    sine: float,
    bank_cosine: float,
    bank_sine: float,
) -> tuple[float, float, float]:
    """Slant range [km], azimuth and elevation [rad] of a radar in the aircraft's body axes.

    Args:
        north: From the aircraft to the radar [km].
        east: The same [km].
        down: The same: the aircraft's altitude [km].
        cosine: Cosine of the heading.
        sine: Sine of the heading.
        bank_cosine: Cosine of the bank.
        bank_sine: Sine of the bank.

    Returns:
        Azimuth is positive to the right of the nose, elevation above the wings' plane.
    """
    nose, right, belly = body_axes(north, east, down, cosine, sine, bank_cosine, bank_sine)
    flat = nose * nose + right * right
    return (
        math.sqrt(flat + belly * belly),
        math.atan2(right, nose),
        math.atan2(-belly, math.sqrt(flat)),
    )


@inlined
def cell(nodes: FloatArray, value: float) -> tuple[int, float]:
    """Which interval of rising nodes holds a value, and where in it (0 to 1); values outside are clamped."""
    i = 0
    while i < len(nodes) - 2 and value > nodes[i + 1]:
        i += 1
    share = (value - nodes[i]) / (nodes[i + 1] - nodes[i])
    return i, min(max(share, 0.0), 1.0)


@inlined
def signature(azimuth: float, elevation: float) -> float:
    """Table 4.1, linear between its entries; angles in [rad]."""
    i, across = cell(AZIMUTHS, abs(azimuth))
    j, up = cell(ELEVATIONS, abs(elevation))
    lower = SIGNATURES[j, i] + across * (SIGNATURES[j, i + 1] - SIGNATURES[j, i])
    upper = SIGNATURES[j + 1, i] + across * (SIGNATURES[j + 1, i + 1] - SIGNATURES[j + 1, i])
    return float(lower + up * (upper - lower))


@compiled
def _signatures(azimuths: FloatArray, elevations: FloatArray, out: FloatArray) -> None:
    for i in range(len(out)):
        out[i] = signature(azimuths[i], elevations[i])


def signature_of(azimuth: ArrayLike, elevation: ArrayLike) -> FloatArray:
    """Table 4.1 for arrays of any shapes that fit together; angles in [rad]."""
    a, e = np.broadcast_arrays(np.asarray(azimuth, dtype=np.float64), np.asarray(elevation, dtype=np.float64))
    out = np.empty(a.size)
    _signatures(a.ravel(), e.ravel(), out)
    return out.reshape(a.shape)
