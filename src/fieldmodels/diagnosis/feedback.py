"""Commands that hold what a sensor errs: a controller feeds its noise back.

Whatever such a command moves at once (an acceleration) runs as the sensor's error does, on data that had no
say, too: over it noise looks like a fault of the sensor, the clearer the slower it is (the bias of direct
identification in closed loop, Ljung 1999, section 13.4). A sensor that feels the command looks alike, unless
that rests at times, as no noise does, or is smooth; ``Curves.judge`` tells them apart by what it was before.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from fieldmodels.arrays import FloatArray, IntArray
from fieldmodels.diagnosis.problem import Problem

LAGS = 4
"""Samples from which a command is foretold."""
HELD = 0.02
"""Of a command's innovations that a sensor's must explain. Of 20 machines under commands of their own at most
0.002; of 30 in closed loop 0.07 to 1, less only where steps of the set-point outweigh the noise anyhow."""
RESTING = 0.5
"""Of the samples at which a command stays as it was, above which no controller moves it."""
ROWS = 5000
"""Samples that are looked at."""


def fed_back(problem: Problem, output: str) -> bool:
    """Whether a command holds what an output's sensor errs, of the same sample or of the one before."""
    recorded = (part.windows.recording for part in problem.parts)
    names = [s.name for s in problem.model.inputs]
    return any(
        output in one and name in one and _told(one[name], one[output], one.bounds) > HELD
        for one, name in product(recorded, names)
    )


def _told(command: FloatArray, shown: FloatArray, bounds: IntArray) -> float:
    """Share of a command's innovations that an output's explain, each given what came before."""
    sliding = np.lib.stride_tricks.sliding_window_view
    signals = np.column_stack([command, shown])
    parts = [sliding(signals[a:b], LAGS + 2, axis=0)[:ROWS] for a, b in bounds if b - a >= LAGS + 2]
    if not parts:
        return 0.0
    rows = np.concatenate(parts)[:ROWS]  # (rows, signals, lags), the latest last
    rows = rows[np.isfinite(rows).all(axis=(1, 2))]
    before = np.concatenate([rows[:, 0, :-1], rows[:, 1, :-2], np.ones((len(rows), 1))], axis=1)
    columns = np.concatenate([before, rows[:, 1, -2:], rows[:, :1, -1]], axis=1)
    columns = columns / (np.linalg.norm(columns, axis=0) + 1e-300)
    if len(columns) < 10 * columns.shape[1]:
        return 0.0
    if np.mean(rows[:, 0, -1] == rows[:, 0, -2]) > RESTING:
        return 0.0
    triangle = np.asarray(np.linalg.qr(columns, mode="r"))
    left = triangle[before.shape[1] :, -1] ** 2
    return float(left[:-1].sum() / max(left.sum(), 1e-300))
