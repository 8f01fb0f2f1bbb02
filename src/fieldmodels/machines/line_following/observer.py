"""How a robot's place follows what is measured of it: the gain of an observer, from the record itself.

A robot that is moved by chance, and whose law answers to that, has commands that hold past chance. Errors
over several strides hold it, too, and a fit to them finds turns that are too small (the bias of direct
identification in closed loop; Ljung 1999, section 13.4). The errors of an observer that is put right at every
stride are innovations: nothing that was measured before foretells them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.recording import Recording

LAGS = 4
"""Strides that the next one is foretold from."""
ROWS = 5
"""Strides that each coefficient of the regression needs."""
HELD = 0.01
"""Share of a turn's variance by which its effect is held at the nominal one: a law that adds nothing to what
it sees leaves no other way to tell what follows the turn from what follows the sight."""


def observer_gain(recordings: Sequence[Recording], outputs: Sequence[str]) -> FloatArray | None:
    """By how much offset and heading of the next stride follow an error of what is measured now.

    Both are regressed on all that was measured in the strides before, which takes no model of the robot but
    where the regression is undecided: whatever is wrong with the robot, what is measured last has the gain of
    a Kalman filter in its steady state, since the other terms are known beforehand.

    Args:
        recordings: With line, offset and heading, steering and curvature.
        outputs: Names of the first three, in the order of the gain's columns.

    Returns:
        Shape (2, 3); None where too few strides are without gaps.
    """
    rows, targets = [], []
    for one in recordings:
        signals = np.column_stack([one[name] for name in ("steering", *outputs, "curvature")])
        turned = np.column_stack([one["offset"][1:], one["heading"][1:] - one["steering"][:-1]])
        for first, last in one.bounds:
            if last - first > LAGS:
                past = [signals[first + LAGS - lag : last - lag] for lag in range(1, LAGS + 1)]
                rows.append(np.hstack([*past, np.ones((last - first - LAGS, 1))]))
                targets.append(turned[first + LAGS - 1 : last - 1])
    if not rows:
        return None
    told, now = np.concatenate(rows), np.concatenate(targets)
    known = np.isfinite(told).all(axis=1) & np.isfinite(now).all(axis=1)
    told, now = told[known], now[known]
    if len(told) < ROWS * told.shape[1]:
        return None
    held = np.eye(1, told.shape[1]) * np.sqrt(HELD) * np.linalg.norm(told[:, 0])
    found = np.linalg.lstsq(np.vstack([told, held]), np.vstack([now, np.zeros((1, 2))]), rcond=None)[0]
    return np.ascontiguousarray(found[1 : 1 + len(outputs)].T)
