"""What the oracles of all one-axis benches share: their effects in the words of the stock oracle."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from exam.oracles import Values
from exam.oracles.stock import Axis, Episode, Parameters, Plant
from fieldmodels.arrays import FloatArray


def neutral(force: str) -> dict[str, dict[str, float]]:
    """Neutral values of the effects that all benches have.

    Args:
        force: What the bench calls its generalised force.
    """
    return {
        "coulomb_friction": {force: 0.0},
        "stribeck_friction": {force: 0.0, "velocity": 1.0},
        "hysteresis": {force: 0.0, "distance": 1.0},
        "cogging": {"sine": 0.0, "cosine": 0.0, "period": 1.0},
        "quadratic_drag": {"coefficient": 0.0},
        "cubic_stiffness": {"coefficient": 0.0},
        "backlash": {"gap": 0.0},
        "constant_force": {force: 0.0},
        "periodic_force": {"sine": 0.0, "cosine": 0.0, "frequency": 1.0},
        "actuator_gain": {"gain": 1.0},
        "actuator_asymmetry": {"difference": 0.0},
        "actuator_lag": {"time_constant": 0.0},
        "actuator_rate_limit": {"rate": math.inf},
        "actuator_delay": {"delay": 0.0},
        "actuator_saturation": {"limit": math.inf},
        "actuator_dead_zone": {"width": 0.0},
        "sensor_bias": {"bias": 0.0},
        "sensor_drift": {"rate": 0.0},
        "sensor_gain": {"gain": 1.0},
        "sensor_delay": {"delay": 0.0},
        "velocity_lag": {"time_constant": 0.0},
        "sensor_quantisation": {"step": 0.0},
        "parameter_step": {"time": 0.0, "factor": 1.0},
    }


def episode(
    force: Callable[[float, float, float], float],
    inertia: float,
    effects: Values,
    drive: FloatArray,
    step: float,
    biased: str = "position",
) -> Episode:
    """An axis with its effects in one episode.

    Args:
        force: What acts on the axis beside its effects: of position, velocity and what the actuator gives.
        inertia: Mass or inertia.
        effects: Values of the effects that all benches have, of those that are on.
        drive: Commands, held from sample to sample and the first one for ever before, shape (n,).
        step: Sampling interval [s].
        biased: The sensor that a bias adds to.
    """

    def rates(state: FloatArray, given: Sequence[float], _parameters: Parameters) -> tuple[float, float]:
        x, v = float(state[0]), float(state[1])
        return v, force(x, v, given[0]) / inertia

    plant = Plant(
        states=("position", "velocity"),
        inputs=("drive",),
        outputs=("position", "velocity"),
        rates=rates,
        axes=(Axis(velocity=1, position=0, inertia=lambda _p: inertia),),
    )
    faults = {
        _place(name, biased): {"force" if key == "torque" else key: value for key, value in values.items()}
        for name, values in effects.items()
    }
    return Episode(plant, {}, faults, (), drive[:, None], step)


def shown(one: Episode, start: Mapping[str, float] | None = None) -> FloatArray:
    """What the sensors of an axis show in an episode, position and velocity, shape (n, 2).

    Args:
        one: The episode.
        start: ``position``, ``velocity`` and ``hysteresis`` (its force) at the time that the position sensor
            shows first: a delay of the sensor before the first sample. Zero where it is not named.
    """
    begun = {"position": 0.0, "velocity": 0.0, "hysteresis": 0.0, **(start or {})}
    state = np.array([begun["position"], begun["velocity"]])
    return one.run(state, np.array([begun["hysteresis"]]))


def _place(effect: str, biased: str) -> tuple[str, str, str]:
    """Place, signal and kind of an effect, as the stock oracle calls them."""
    place, _, kind = effect.partition("_")
    if effect == "parameter_step":
        return "actuator", "drive", effect
    if place == "actuator":
        return "actuator", "drive", kind
    if effect == "velocity_lag":
        return "sensor", "velocity", "lag"
    if effect == "backlash":
        return "sensor", "position", effect
    if place == "sensor":
        return "sensor", biased if kind == "bias" else "position", kind
    return "force", "velocity", effect
