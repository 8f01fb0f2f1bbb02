"""Benches that share no code with the project: simulated by NumPy alone, with one cause hidden in each."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

FINE = 10  # steps of integration a row


@dataclass(frozen=True)
class Run:
    """What a bench really did, in SI units, and what was wrong with it.

    Attributes:
        model: Name of the simulation that is held against it.
        cause: The effect that the simulation lacks.
        time: Shape (n,).
        signals: The model's signals, as sensors show them, each of shape (n,).
    """

    model: str
    cause: str
    time: np.ndarray
    signals: dict[str, np.ndarray]

    def only(self, *names: str) -> Run:
        """The same, of which only some signals are logged."""
        return replace(self, signals={name: self.signals[name] for name in names})


def commands(rng: np.random.Generator, n: int, step: float, size: float) -> np.ndarray:
    """Steps of random height and length, and a swept sine after them."""
    result, k = np.zeros(n), 0
    while k < n:
        length = int(rng.uniform(0.1, 0.9) / step)
        result[k : k + length] = size * rng.uniform(-1, 1)
        k += length
    time = step * np.arange(n)
    late = time > 0.6 * time[-1]
    sweep = size * np.sin(2 * np.pi * (0.3 + 0.04 * time) * time)
    return np.where(late, sweep, result)


class Actuator:
    """What of a command acts, a fine step at a time."""

    def __init__(self, cause: str, step: float, size: float) -> None:
        self.cause, self.size = cause, size
        self.late = [0.0] * (round(0.043 / step * FINE) if cause == "actuator_delay" else 0)
        self.share = 1 - np.exp(-step / FINE / 0.08) if cause == "actuator_lag" else 1.0
        self.state = 0.0

    def __call__(self, command: float) -> float:
        self.late.append(command)
        value = self.late.pop(0)
        if self.cause == "actuator_dead_zone":
            value = np.sign(value) * max(abs(value) - 0.2 * self.size, 0.0)
        if self.cause == "actuator_saturation":
            value = min(max(value, -0.5 * self.size), 0.5 * self.size)
        self.state += self.share * (value - self.state)
        return self.state


def axis(model: str, cause: str, seed: int, rate: float = 100.0, seconds: float = 40.0, hold: int = 1) -> Run:
    """A mass on a spring (``rig``), or a pendulum whose controller brakes it, by a symplectic Euler rule.

    Commands last ``hold`` rows.
    """
    rng = np.random.default_rng(seed)
    n, step = int(rate * seconds), 1 / rate
    rotary = model == "pendulum"
    inertia, stiffness, damping, brake, size = (
        (0.05, 0.8, 0.0, 0.06, 0.6) if rotary else (1.6, 70.0, 5.0, 0.0, 8.0)
    )
    friction = 0.12 * size if cause == "coulomb_friction" else 0.0
    wanted, command = commands(rng, n, step, size), np.empty(n)
    actuator = Actuator(cause, step, size)
    x = v = 0.0
    place, speed = np.empty(n), np.empty(n)
    for k in range(n):
        place[k], speed[k] = x, v
        command[k] = command[k - 1] if k % hold else wanted[k] - brake * v
        for _ in range(FINE):
            force = actuator(command[k]) - stiffness * (np.sin(x) if rotary else x) - damping * v
            free = v + step / FINE * force / inertia
            v = np.sign(free) * max(abs(free) - step / FINE * friction / inertia, 0.0)
            x += step / FINE * v
    noise = (1e-3, 2e-2) if rotary else (1e-4, 2e-3)
    names = ("torque", "angle", "velocity") if rotary else ("force", "position", "velocity")
    place += noise[0] * rng.standard_normal(n)
    speed += noise[1] * rng.standard_normal(n)
    return Run(model, cause, step * np.arange(n), dict(zip(names, (command, place, speed), strict=True)))


def drive(cause: str, seed: int, rate: float = 50.0, seconds: float = 60.0) -> Run:
    """A robot on two wheels (radius 0.03 m, track 0.15 m) that is told its wheels' speeds."""
    rng = np.random.default_rng(seed)
    n, step = int(rate * seconds), 1 / rate
    told = [4.0 + commands(rng, n, step, 3.0) for _ in range(2)]
    actuators = [Actuator(cause, step, 3.0) for _ in told]
    x = y = heading = 0.0
    pose = np.empty((n, 3))
    for k in range(n):
        pose[k] = x, y, heading
        for _ in range(FINE):
            left, right = (act(one[k]) for act, one in zip(actuators, told, strict=True))
            speed, turn = 0.015 * (left + right), 0.03 * (right - left) / 0.15
            heading += 0.5 * step / FINE * turn
            x += step / FINE * speed * np.cos(heading)
            y += step / FINE * speed * np.sin(heading)
            heading += 0.5 * step / FINE * turn
    pose += [1e-3, 1e-3, 2e-3] * rng.standard_normal((n, 3))
    names = ("left_command", "right_command", "x", "y", "heading")
    signals = dict(zip(names, (*told, *pose.T), strict=True))
    return Run("differential_drive", cause, step * np.arange(n), signals)


def joint(
    cause: str, seed: int, rate: float = 100.0, seconds: float = 40.0, hold: int = 1, pace: float = 10.0
) -> Run:
    """A joint that a PD controller leads to set-points, at its natural frequency ``pace`` [rad/s]."""
    rng = np.random.default_rng(seed)
    n, step = int(rate * seconds), 1 / rate
    told = commands(rng, n, step, 0.6)[np.arange(n) // hold * hold]
    actuator, friction = Actuator(cause, step, 0.6), 0.05 if cause == "coulomb_friction" else 0.0
    x = v = 0.0
    place = np.empty(n)
    for k in range(n):
        place[k] = x
        for _ in range(FINE):
            free = v + step / FINE * ((actuator(told[k]) - x) * pace**2 - 1.4 * pace * v)
            v = np.sign(free) * max(abs(free) - step / FINE * friction * pace**2, 0.0)
            x += step / FINE * v
    place += 5e-4 * rng.standard_normal(n)
    return Run("servo", cause, step * np.arange(n), {"set_point": told, "position": place})


def swing(seed: int, rate: float = 100.0, seconds: float = 30.0) -> Run:
    """A pendulum that swings out from 1 rad against Coulomb friction; nothing commands it."""
    rng = np.random.default_rng(seed)
    n, step = int(rate * seconds), 1 / rate
    place, x, v = np.empty(n), 1.0, 0.0
    for k in range(n):
        place[k] = x
        for _ in range(FINE):
            free = v - step / FINE * (16 * np.sin(x) + 0.02 * v)
            v = np.sign(free) * max(abs(free) - step / FINE * 0.12, 0.0)
            x += step / FINE * v
    place += 1e-3 * rng.standard_normal(n)
    return Run("pendulum", "coulomb_friction", step * np.arange(n), {"angle": place})


def follower(
    model: str, cause: str, told: np.ndarray, step: float, lag: float, late: float = 0.0, noise: float = 0.02
) -> Run:
    """What follows ``told`` with a lag [s], ``late`` seconds after it: ``command`` and ``response``."""
    rng = np.random.default_rng(len(told))
    rows = np.arange(len(told)) - round(late / step)
    acted = np.where(rows < 0, told[0], told[rows.clip(0)])
    response, share = np.empty(len(told)), -np.expm1(-step / lag)
    state = acted[0]
    for k, value in enumerate(acted):
        response[k] = state
        state += share * (value - state)
    response += noise * rng.standard_normal(len(told))
    return Run(model, cause, step * np.arange(len(told)), {"command": told, "response": response})
