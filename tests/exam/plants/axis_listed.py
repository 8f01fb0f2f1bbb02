"""The listed effects of the benches on an axis, written from the equations and tables of docs/models.md."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from exam.plants.axis import Axis, Bristle, Joint, Map, Sensor

Values = Mapping[str, float]
GRAVITY = 9.80665
"""Standard gravity [m/s^2] (CGPM 1901)."""
CROSSING = 0.02
"""Share of the largest command within which an axis with play crosses it."""
ORDER = (
    "thrust_curve", "actuator_gain", "actuator_asymmetry", "actuator_dead_zone", "actuator_saturation",
    "parameter_step", "sensor_gain", "sensor_bias", "sensor_drift", "backlash",
)  # fmt: skip
"""The order in which the documents let effects act on commands and on what sensors show."""


def install(axis: Axis, effects: Mapping[str, Values], largest: float, linear: bool) -> None:
    """Let listed effects act on an axis.

    Args:
        axis: The axis.
        effects: Values of their parameters.
        largest: Size of the largest command, which scales how play is crossed.
        linear: Whether it is the rig: its payload has no length, and its bias is the velocity sensor's.
    """
    for name in sorted(effects, key=lambda name: ORDER.index(name) if name in ORDER else -1):
        values = effects[name]
        if name in MAPS:
            axis.maps.append(MAPS[name](values))
        elif name in FORCES:
            FORCES[name](axis, values)
        elif name == "payload":
            axis.inertia += values["mass"] * (1.0 if linear else values["length"] ** 2)
            axis.gravity += 0.0 if linear else values["mass"] * GRAVITY * values["length"]
        elif name == "sensor_bias":
            _bias(axis.velocity if linear else axis.position, values["bias"])
        elif name in OF_JOINTS and isinstance(axis, Joint):
            OF_JOINTS[name](axis, values)
        elif name == "backlash":
            _backlash(axis, 0.5 * values["gap"], CROSSING * largest)
        else:
            SIMPLE[name](axis, values)


def _bias(sensor: list[Sensor], bias: float) -> None:
    sensor.append(lambda y, _t, _x, _v, _f: y + bias)


def _backlash(axis: Axis, half: float, width: float) -> None:
    axis.position.append(lambda y, _t, _x, _v, f: y + half * math.tanh(f / width))


def _friction(values: Values) -> float:
    return values["force"] if "force" in values else values["torque"]


def _stribeck(axis: Axis, values: Values) -> None:
    size, speed = _friction(values), values["velocity"]
    axis.dry.append(lambda _t, _x, v, _f: size * math.exp(-((v / speed) ** 2)))


def _coulomb(axis: Axis, values: Values) -> None:
    size = _friction(values)
    axis.dry.append(lambda _t, _x, _v, _f: size)


def _cogging(axis: Axis, values: Values) -> None:
    sine, cosine, turns = values["sine"], values["cosine"], 2.0 * math.pi / values["period"]
    axis.forces.append(lambda _t, x, _v, _f: sine * math.sin(turns * x) + cosine * math.cos(turns * x))


def _periodic(axis: Axis, values: Values) -> None:
    sine, cosine, turns = values["sine"], values["cosine"], 2.0 * math.pi * values["frequency"]
    axis.forces.append(lambda t, _x, _v, _f: sine * math.sin(turns * t) + cosine * math.cos(turns * t))


def _constant(axis: Axis, values: Values) -> None:
    size = _friction(values)
    axis.forces.append(lambda _t, _x, _v, _f: size)


def _asymmetric(axis: Axis, values: Values) -> None:
    size = values["coefficient"]
    axis.forces.append(lambda _t, _x, v, _f: -size * v if v > 0.0 else size * v)


def _drag(axis: Axis, values: Values) -> None:
    size = values["coefficient"]
    axis.forces.append(lambda _t, _x, v, _f: -size * v * abs(v))


def _cubic(axis: Axis, values: Values) -> None:
    size = values["coefficient"]
    axis.forces.append(lambda _t, x, _v, _f: -size * x**3)


def _viscous(axis: Axis, values: Values) -> None:
    axis.damping += values["coefficient"]


def _hysteresis(axis: Axis, values: Values) -> None:
    axis.bristles.append(Bristle(_friction(values), values["distance"]))


FORCES: Mapping[str, Callable[[Axis, Values], None]] = {
    "coulomb_friction": _coulomb,
    "stribeck_friction": _stribeck,
    "hysteresis": _hysteresis,
    "cogging": _cogging,
    "asymmetric_damping": _asymmetric,
    "quadratic_drag": _drag,
    "cubic_stiffness": _cubic,
    "constant_force": _constant,
    "periodic_force": _periodic,
    "viscous_friction": _viscous,
}


def _asymmetry(values: Values) -> Map:
    half = 0.5 * values["difference"]
    return lambda u, _t: u * (1.0 + half * math.copysign(1.0, u))


def _dead_zone(values: Values) -> Map:
    width = values["width"]
    return lambda u, _t: math.copysign(max(abs(u) - width, 0.0), u)


def _saturation(values: Values) -> Map:
    limit = values["limit"]
    return lambda u, _t: min(max(u, -limit), limit)


def _jump(values: Values) -> Map:
    factor, time = values["factor"], values["time"]
    return lambda u, t: u * factor if t >= time else u


MAPS: Mapping[str, Callable[[Values], Map]] = {
    "actuator_gain": lambda values: lambda u, _t: values["gain"] * u,
    "actuator_asymmetry": _asymmetry,
    "actuator_dead_zone": _dead_zone,
    "actuator_saturation": _saturation,
    "parameter_step": _jump,
    "thrust_curve": lambda values: lambda u, _t: math.copysign(abs(u) ** values["exponent"], u),
}


def _late(axis: Axis, values: Values) -> None:
    delay = values["delay"]
    axis.late = lambda _t: delay


def _velocity_lag(axis: Axis, values: Values) -> None:
    """A first-order filter of a speed that changes along a line from sample to sample, settled at first."""
    time_constant, last = values["time_constant"], [0.0, 0.0, 0.0]

    def follow(y: float, t: float, _x: float, _v: float, _f: float) -> float:
        before, speed, filtered = last
        if t > before:
            slope = (y - speed) / (t - before)
            rest = filtered - speed + slope * time_constant
            filtered = y - slope * time_constant + rest * math.exp(-(t - before) / time_constant)
        last[:] = t, y, filtered
        return filtered

    axis.velocity.append(follow)


def _gain(axis: Axis, values: Values) -> None:
    gain = values["gain"]
    axis.position.append(lambda y, _t, _x, _v, _f: gain * y)


def _drift(axis: Axis, values: Values) -> None:
    rate = values["rate"]
    axis.position.append(lambda y, t, _x, _v, _f: y + rate * t)


def _lag(axis: Axis, values: Values) -> None:
    axis.lag = values["time_constant"]


def _rate(axis: Axis, values: Values) -> None:
    axis.rate = values["rate"]


def _delay(axis: Axis, values: Values) -> None:
    axis.delay = values["delay"]


def _quantum(axis: Axis, values: Values) -> None:
    axis.quantum = values["step"]


def _dead_band(joint: Joint, values: Values) -> None:
    joint.dead_band = values["width"]


def _torque_limit(joint: Joint, values: Values) -> None:
    joint.limit = values["limit"]


def _gravity(joint: Joint, values: Values) -> None:
    sine, cosine = values["sine"], values["cosine"]
    joint.forces.append(lambda _t, x, _v, _f: sine * math.sin(x) + cosine * math.cos(x))


OF_JOINTS: Mapping[str, Callable[[Joint, Values], None]] = {
    "dead_band": _dead_band,
    "torque_limit": _torque_limit,
    "gravity": _gravity,
}
SIMPLE: Mapping[str, Callable[[Axis, Values], None]] = {
    "actuator_lag": _lag,
    "actuator_rate_limit": _rate,
    "actuator_delay": _delay,
    "sensor_delay": _late,
    "velocity_lag": _velocity_lag,
    "sensor_gain": _gain,
    "sensor_drift": _drift,
    "sensor_quantisation": _quantum,
}
