"""Oracle of the static map: ``response = gain command + offset`` row by row, and docs/models.md."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from exam.oracles import Values, filled
from fieldmodels.arrays import FloatArray

VALUES = [f"value_{k}" for k in range(1, 8)]
NEUTRAL: Values = {
    "dead_zone": {"width": 0.0, "centre": 0.0},
    "upper_limit": {"limit": math.inf},
    "lower_limit": {"limit": -math.inf},
    "curvature": {"low": -1.0, "high": 1.0, **dict.fromkeys(VALUES, 0.0)},
    "actuator_play": {"width": 0.0},
    "sensor_drift": {"rate": 0.0},
    "sensor_quantisation": {"step": 0.0},
}


def simulate(
    base: Mapping[str, float],
    effects: Values,
    commands: FloatArray,
    step: float,
    start: Mapping[str, float] | None = None,
) -> FloatArray:
    """Look one episode up; see ``Simulate``. A map begins anywhere."""
    del start
    given = filled(effects, NEUTRAL)
    play, (width, centre) = given["actuator_play"]["width"], given["dead_zone"].values()
    u = commands[:, 0].copy()
    for k in range(1, len(u)):
        u[k] = np.clip(u[k - 1], u[k] - 0.5 * play, u[k] + 0.5 * play)
    beyond = u - centre
    u = centre + beyond - np.clip(beyond, -width, width)
    curve = given["curvature"]
    knots = np.linspace(curve["low"], curve["high"], 9)
    bent = np.interp(u, knots, [0.0, *(curve[name] for name in VALUES), 0.0])
    y = base["gain"] * u + base["offset"] + bent
    y = np.minimum(np.maximum(y, given["lower_limit"]["limit"]), given["upper_limit"]["limit"])
    y = y + given["sensor_drift"]["rate"] * step * np.arange(len(y))
    quantum = given["sensor_quantisation"]["step"]
    return np.asarray(quantum * np.round(y / quantum) if quantum else y)[:, None]
