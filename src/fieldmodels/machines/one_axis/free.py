"""One free run of an axis under a force from outside the effect library."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.machines.one_axis import kernel
from fieldmodels.model import ModelError


def respond_to(
    q: FloatArray,
    command: FloatArray,
    step: float,
    force: Callable[[float, float, float, float], float],
    episodes: int = 1,
) -> FloatArray:
    """Simulate from rest, step by step, with an additional force held over each step.

    Args:
        q: Kernel row, shape (kernel.SLOTS,); sensor effects must be off.
        command: Commands of all episodes, each equally long, shape (episodes * n,) or (episodes * n, 1).
        step: Step of integration [s].
        force: Additional force f(t, position, velocity, command).
        episodes: Number of episodes.

    Returns:
        Position and velocity, shape (episodes, n, 2).

    Raises:
        ModelError: If a sensor effect is on.
    """
    sensor = [
        kernel.BIAS,
        kernel.VELOCITY_BIAS,
        kernel.DRIFT,
        kernel.SENSOR_DELAY,
        kernel.GAP,
        kernel.QUANTUM,
    ]
    if np.any(q[sensor] != 0.0) or q[kernel.SENSOR_GAIN] != 1.0:
        raise ModelError("a force from outside the library cannot be combined with an effect of a sensor")
    commands = command.reshape(episodes, -1)
    out = np.empty((*commands.shape, 2))
    shift = round(float(q[kernel.DELAY]) / step)
    for episode, u in enumerate(commands):
        target = np.empty(len(u))
        kernel.actuate(np.ascontiguousarray(u), step, q, target)
        lagged = target.copy()
        if kernel.has_dynamics(q):
            kernel.respond(target, np.zeros(len(u), dtype=np.int64), step, q, lagged)
        x = v = bristle = 0.0
        for i in range(len(u)):
            out[episode, i] = x, v
            source = max(i - shift, 0)
            extra = force(i * step, x, v, float(u[i])) + q[kernel.CONSTANT]
            aim, now = float(target[source] + extra), float(lagged[source] + extra)
            x, v, bristle = kernel.advance_past_ramp(x, v, i * step, step, aim, now, bristle, q)
    return out
