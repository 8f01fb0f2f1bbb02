"""One free run of an axis under a force from outside the effect library."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.drivers.declaration import params_of
from fieldmodels.effects import actuators, sensors
from fieldmodels.machines.one_axis.model import OneAxis
from fieldmodels.model import ModelError


def respond_to(
    model: OneAxis,
    parameters: FloatArray,
    command: FloatArray,
    step: float,
    force: Callable[[float, float, float, float], float],
    episodes: int = 1,
) -> FloatArray:
    """Simulate from rest, step by step, with an additional force held over each step.

    Args:
        model: The axis.
        parameters: One parameter vector; sensor effects must be off.
        command: Commands of all episodes, each equally long, shape (episodes * n,) or (episodes * n, 1).
        step: Step of integration [s].
        force: Additional force f(t, position, velocity, command).
        episodes: Number of episodes.

    Returns:
        Position and velocity, shape (episodes, n, 2).

    Raises:
        ModelError: If a sensor effect is on.
    """
    driver = model.driver
    vector = np.atleast_2d(parameters)
    if np.any(driver.rows.of("sensor", vector) != sensors.ROW.neutral):
        raise ModelError("a force from outside the library cannot be combined with an effect of a sensor")
    rows, forces = driver.rows.of("actuator", vector)[0], driver.rows.of("force", vector)[0]
    r = actuators.Row(*rows[0])
    p = driver.module.Params(*params_of(model, vector[0]))
    commands = command.reshape(episodes, -1)
    out = np.empty((*commands.shape, 2))
    shift = round(r.delay_delay / step)
    nothing = np.zeros(0)
    for episode, u in enumerate(commands):
        target = np.empty(len(u))
        whole = np.array([[0, len(u)]])
        actuators.actuate(np.ascontiguousarray(u), whole, step, False, r, nothing, target)
        x = v = bristle = 0.0
        given = float(target[0])
        for i in range(len(u)):
            out[episode, i] = x, v
            aim = float(target[max(i - shift, 0)])
            extra = float(force(i * step, x, v, float(u[i])))
            x, v, given, bristle = driver.module.advance_past_ramps(
                i * step, step, x, v, given, aim, 0.0, extra, p, rows, forces, nothing, bristle
            )
    return out
