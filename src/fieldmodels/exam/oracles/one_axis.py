"""What the oracles of all one-axis benches share, written from the equations and tables of docs/models.md.

    M dv/dt = F - c v - k x - G sin x - (F_c + F_s exp(-(v/v_s)^2)) sign(v) - F_h - d v |v| - k_3 x^3
              + F_0 + A_s sin(2 pi f t) + A_c cos(2 pi f t) + B_s sin(2 pi x/p) + B_c cos(2 pi x/p)
    dF_h/dx = (F_m - F_h sign(v)) / distance

    command -> gain, asymmetry, dead zone, saturation, jump -> lag at a limited rate -> delay -> F

Dry friction holds the axis as long as the other forces do not exceed F_c + F_s. So an episode is a sequence
of stretches in each of which the axis moves in one direction or sticks; an event ends each.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from fieldmodels.arrays import FloatArray
from fieldmodels.exam.oracles import Values
from fieldmodels.exam.oracles.piecewise import (
    ABSOLUTE,
    RELATIVE,
    Piece,
    current,
    edges_between,
    follow,
    jumps,
)

LOOKS = 65
"""Times at which a sticking axis is looked at between two jumps, to find where it breaks away."""
TINY = 1e-12
"""A hair later, so that a command counts that begins just now [s]."""


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
        "sensor_quantisation": {"step": 0.0},
        "parameter_step": {"time": 0.0, "factor": 1.0},
    }


@dataclass(frozen=True)
class Axis:
    """An axis with its effects.

    Attributes:
        force: Name of the generalised force.
        inertia: Mass or inertia.
        given: Values of all effects' parameters.
        damping: Viscous friction.
        stiffness: Of a linear spring.
        gravity: Moment of gravity, horizontal arm.
        bias: What the position sensor adds.
        velocity_bias: What the velocity sensor adds.
    """

    force: str
    inertia: float
    given: Values
    damping: float = 0.0
    stiffness: float = 0.0
    gravity: float = 0.0
    bias: float = 0.0
    velocity_bias: float = 0.0

    def push(self, x: float, v: float, time: float, actuator: float) -> float:
        """All forces but dry friction and hysteresis."""
        given = self.given
        cogging, periodic = given["cogging"], given["periodic_force"]
        place = 2.0 * math.pi * x / cogging["period"]
        phase = 2.0 * math.pi * periodic["frequency"] * time
        return (
            actuator
            - self.damping * v
            - self.stiffness * x
            - self.gravity * math.sin(x)
            - given["quadratic_drag"]["coefficient"] * v * abs(v)
            - given["cubic_stiffness"]["coefficient"] * x**3
            + given["constant_force"][self.force]
            + periodic["sine"] * math.sin(phase)
            + periodic["cosine"] * math.cos(phase)
            + cogging["sine"] * math.sin(place)
            + cogging["cosine"] * math.cos(place)
        )

    def dry(self, v: float) -> float:
        """Size of dry friction at a speed."""
        stribeck = self.given["stribeck_friction"]
        falling = math.exp(-((v / stribeck["velocity"]) ** 2)) if stribeck[self.force] else 0.0
        return self.given["coulomb_friction"][self.force] + stribeck[self.force] * falling

    def sliding(self, actuator: Piece, sign: float) -> Callable[[float, FloatArray], Sequence[float]]:
        """Derivative of position, velocity and hysteresis while the axis moves in a direction."""
        bristle = self.given["hysteresis"]

        def derivative(time: float, state: FloatArray) -> Sequence[float]:
            x, v, bent = float(state[0]), float(state[1]), float(state[2])
            force = self.push(x, v, time, actuator.at(time)) - sign * self.dry(v) - bent
            bending = (bristle[self.force] * v - bent * abs(v)) / bristle["distance"]
            return v, force / self.inertia, bending

        return derivative


def simulate(
    axis: Axis, drive: FloatArray, step: float, start: Mapping[str, float] | None = None
) -> FloatArray:
    """What the sensors of an axis show in one episode, position and velocity, shape (n, 2).

    Args:
        axis: The axis.
        drive: Commands, held from sample to sample and the first one for ever before, shape (n,).
        step: Sampling interval [s].
        start: ``position``, ``velocity`` and ``hysteresis`` (its force) at the time that the position sensor
            shows first: a delay of the sensor before the first sample. Zero where it is not named.
    """
    given, begun = axis.given, {"position": 0.0, "velocity": 0.0, "hysteresis": 0.0, **(start or {})}
    times = np.arange(len(drive)) * step
    pieces = actuator(drive, step, given)
    late = times - given["sensor_delay"]["delay"]
    wanted = np.union1d(times, late)
    path = move(axis, pieces, wanted, [begun["position"], begun["velocity"], begun["hysteresis"]])
    position, velocity = path[np.searchsorted(wanted, late), 0], path[np.searchsorted(wanted, times), 1]
    shown = given["sensor_gain"]["gain"] * position + axis.bias + given["sensor_drift"]["rate"] * times
    if given["backlash"]["gap"]:
        crossing = 0.02 * np.abs(drive).max()
        forces = np.array([current(pieces, t + TINY).at(t) for t in late])
        shown += 0.5 * given["backlash"]["gap"] * np.tanh(forces / crossing)
    if quantum := given["sensor_quantisation"]["step"]:
        shown = quantum * np.floor(shown / quantum + 0.5)
    return np.column_stack([shown, velocity + axis.velocity_bias])


def actuator(drive: FloatArray, step: float, given: Values) -> list[Piece]:
    """Force of the actuator in the course of time."""
    jump, delay = given["parameter_step"], given["actuator_delay"]["delay"]
    begins = np.arange(len(drive)) * step
    aims = []
    for moment in np.union1d(begins, [t for t in [jump["time"]] if 0.0 < t < begins[-1]]):
        force = given["actuator_gain"]["gain"] * drive[np.searchsorted(begins, moment, side="right") - 1]
        force *= 1.0 + 0.5 * given["actuator_asymmetry"]["difference"] * np.sign(force)
        force = math.copysign(max(abs(force) - given["actuator_dead_zone"]["width"], 0.0), force)
        force = math.copysign(min(abs(force), given["actuator_saturation"]["limit"]), force)
        if moment >= jump["time"]:
            force *= jump["factor"]
        aims.append((moment + delay, force))
    lag, rate = given["actuator_lag"]["time_constant"], given["actuator_rate_limit"]["rate"]
    return follow(aims, aims[0][1], lag, rate)


def move(axis: Axis, pieces: Sequence[Piece], wanted: FloatArray, state: Sequence[float]) -> FloatArray:
    """Position, velocity and hysteresis at the wanted times [s], rising, from the state at the first one."""
    result = np.empty((len(wanted), 3))
    now = np.asarray(state, dtype=float)
    for begin, end in edges_between(float(wanted[0]), float(wanted[-1]), jumps(pieces)):
        inside = np.flatnonzero((wanted >= begin) & (wanted <= end))
        result[inside], now = move_between(
            axis, current(pieces, 0.5 * (begin + end)), begin, end, now, wanted[inside]
        )
    return result


def move_between(
    axis: Axis, actuator: Piece, begin: float, end: float, state: FloatArray, wanted: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The same between two jumps of the actuator; also the state at the end.

    One turn of the loop is one stretch of sticking, or of motion in one direction.
    """
    result = np.empty((len(wanted), 3))
    time = begin
    while True:
        sign = float(np.sign(state[1]))
        if sign == 0.0:
            pushed = axis.push(state[0], 0.0, time, actuator.at(time)) - state[2]
            if abs(pushed) <= axis.dry(0.0):
                free = breaks_away(axis, actuator, time, end, state)
                result[wanted >= time] = state
                if free >= end:
                    return result, state
                time = free
                pushed = axis.push(state[0], 0.0, time, actuator.at(time)) - state[2]
            sign = math.copysign(1.0, pushed)
        solution = solve_ivp(
            axis.sliding(actuator, sign), (time, end), state, method="DOP853", dense_output=True,
            events=reversal(sign) if axis.dry(0.0) else None, rtol=RELATIVE, atol=ABSOLUTE,
        )  # fmt: skip
        reached = float(solution.t[-1])
        within = (wanted >= time) & (wanted <= reached)
        if within.any() and solution.sol is not None:
            result[within] = solution.sol(wanted[within]).T
        state = solution.y[:, -1]
        if solution.status == 0:
            return result, state
        state[1] = 0.0
        time = reached


def reversal(sign: float) -> Callable[[float, FloatArray], float]:
    """Event that ends a motion in a direction: its velocity falls to zero."""

    def event(_time: float, state: FloatArray) -> float:
        return sign * float(state[1])

    event.terminal, event.direction = True, -1.0  # type: ignore[attr-defined]
    return event


def breaks_away(axis: Axis, actuator: Piece, begin: float, end: float, state: FloatArray) -> float:
    """When the forces on a sticking axis exceed what holds it [s]; the end if they do not before."""

    def excess(time: float) -> float:
        pushed = axis.push(float(state[0]), 0.0, time, actuator.at(time)) - float(state[2])
        return abs(pushed) - axis.dry(0.0)

    looks = np.linspace(begin, end, LOOKS)
    over = [k for k in range(1, LOOKS) if excess(looks[k]) > 0.0]
    if not over:
        return end
    return float(brentq(excess, looks[over[0] - 1], looks[over[0]], xtol=1e-15))
