"""A one-axis bench with anything wrong with it, integrated in plain Python by fixed steps.

    M dv/dt = F - c v - k x - G sin x + forces(t, x, v, F) - dry(t, x, v, F) sign(v) - bristles
    command -> maps -> delay -> lag at a limited rate -> F
    x(t - late) -> shown position, v -> shown velocity, each through its maps, plus noise, then rounded

A fault is whatever it appends to one of these lists. Smooth forces by Runge and Kutta's fourth-order step,
dry friction as a limit to the change of momentum in a step.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from fieldmodels.arrays import FloatArray

Force = Callable[[float, float, float, float], float]
"""(time, position, velocity, actuator's force) to a force."""
Map = Callable[[float, float], float]
"""(command, time) to what acts; called once a sample, in order, so it may remember."""
Sensor = Callable[[float, float, float, float, float], float]
"""(shown so far, time, position, velocity, actuator's force) to what is shown; called once a sample."""
Control = Callable[[int, float, float], float]
"""(sample, position and velocity as shown a sample before) to a command."""
SMOOTH, DRY = 4, 8
"""Steps in a sample, without and with dry friction or bristles."""


@dataclass
class Bristle:
    """Friction with presliding: ``dB/dx = (limit - B sign(v)) / distance``."""

    limit: float
    distance: float
    force: float = 0.0

    def after(self, way: float) -> float:
        """Its force after a way in one direction."""
        settled = math.copysign(self.limit, way)
        return settled + (self.force - settled) * math.exp(-abs(way) / self.distance)


class Memory:
    """A part with a state of its own that pushes the axis: a second mass, a spring behind a damper."""

    def force(self, x: float, v: float) -> float:
        """What it pushes with."""
        raise NotImplementedError

    def advance(self, h: float, x: float, v: float) -> None:
        """Let a time pass."""
        raise NotImplementedError


@dataclass
class Axis:
    """An axis with what is wrong with it.

    Attributes:
        inertia: Mass or inertia.
        damping: Viscous friction.
        stiffness: Of a linear spring.
        gravity: Moment of gravity, horizontal arm.
        forces: Further smooth forces.
        inertia_factor: By what the inertia is multiplied at a position.
        dry: Sizes of dry friction.
        bristles: Frictions with presliding.
        memories: Parts with a state of their own.
        maps: What becomes of each command, in order.
        delay: By how much the actuator is late [s].
        lag: Time constant of the actuator [s].
        fall: Its time constant where the force falls in size [s]; None for the same.
        rate: Largest rate of its force.
        ring: Natural frequency [rad/s] of an actuator that rings, damping ratio 0.3; 0 for none.
        late: By how much the position sensor is late at a time [s].
        position: What becomes of the shown position, in order.
        velocity: What becomes of the shown velocity, in order.
        quantum: To what the shown position is rounded, noise included.
        clip: Where the shown position is cut off, noise included.
        holds: Samples at which a new position is shown (others repeat the last one); None for all.
        finer: By what the steps are shorter than of other axes.
    """

    inertia: float
    damping: float = 0.0
    stiffness: float = 0.0
    gravity: float = 0.0
    forces: list[Force] = field(default_factory=list)
    inertia_factor: Callable[[float], float] | None = None
    dry: list[Force] = field(default_factory=list)
    bristles: list[Bristle] = field(default_factory=list)
    memories: list[Memory] = field(default_factory=list)
    maps: list[Map] = field(default_factory=list)
    delay: float = 0.0
    lag: float = 0.0
    fall: float | None = None
    rate: float = math.inf
    ring: float = 0.0
    late: Callable[[float], float] | None = None
    position: list[Sensor] = field(default_factory=list)
    velocity: list[Sensor] = field(default_factory=list)
    quantum: float = 0.0
    clip: tuple[float, float] = (-math.inf, math.inf)
    holds: Callable[[int], bool] | None = None
    finer: int = 1


@dataclass
class Joint(Axis):
    """An axis whose motor is under position control: the actuator's chain gives a set-point.

    Attributes:
        derivative_gain: Of the controller, in units of its proportional gain.
        offset: A constant torque.
        dead_band: Error of position that the controller lets be.
        limit: Largest torque of the motor.
    """

    derivative_gain: float = 0.0
    offset: float = 0.0
    dead_band: float = 0.0
    limit: float = math.inf
    finer: int = 4

    def __post_init__(self) -> None:
        """Put the motor's torque in the place of the set-point, which an axis takes for its force."""
        self.forces.append(lambda _t, x, v, drive: self.torque(drive - x, v) + self.offset - drive)

    def torque(self, error: float, speed: float) -> float:
        """Of the motor, for an error of position."""
        noticed = math.copysign(max(abs(error) - self.dead_band, 0.0), error)
        return max(-self.limit, min(self.limit, noticed - self.derivative_gain * speed))


def simulate(axis: Axis, control: Control, noise: FloatArray, step: float) -> FloatArray:
    """Run an axis from rest at zero.

    Args:
        axis: The axis, fresh: what remembers is used up.
        control: Gives the command at each sample from what was shown at the one before.
        noise: Added to shown position and velocity, shape (n, 2).
        step: Sampling interval [s].

    Returns:
        Command, shown position and shown velocity at each sample, shape (n, 3); not finite once it runs away.
    """
    return _Run(axis, control, noise, step).run()


class _Run:
    """One episode."""

    def __init__(self, axis: Axis, control: Control, noise: FloatArray, step: float) -> None:
        self.axis, self.control, self.noise, self.step = axis, control, noise, step
        self.slow = bool(axis.lag or axis.fall is not None or axis.rate < math.inf or axis.ring)
        self.parts = axis.finer * (DRY if axis.dry or axis.bristles else SMOOTH)
        self.h = step / self.parts
        self.x = self.v = self.given = self.rising = 0.0
        self.aims: list[float] = []
        self.path: list[tuple[float, float, float]] = []

    def run(self) -> FloatArray:
        result = np.full((len(self.noise), 3), np.nan)
        position = velocity = 0.0
        errors = self.noise.tolist()
        try:
            for i in range(len(errors)):
                now = i * self.step
                command = aim = self.control(i, position, velocity)
                for change in self.axis.maps:
                    aim = change(aim, now)
                self.aims.append(aim)
                if i == 0:
                    self.given = aim
                for s in range(self.parts):
                    time = now + s * self.h
                    self.path.append((self.x, self.v, self._force(time)))
                    if s == 0:
                        position, velocity = self._shown(i, errors[i], position)
                    self._advance(time)
                result[i] = command, position, velocity
                if not abs(self.x) < 1e6:
                    break
        except OverflowError:
            pass
        return result

    def _shown(self, i: int, error: list[float], last: float) -> tuple[float, float]:
        """What both sensors show at a sample."""
        axis, now = self.axis, i * self.step
        x, v, given = self._at(now - axis.late(now)) if axis.late else self.path[-1]
        position, velocity = x, self.v
        for sensor in axis.position:
            position = sensor(position, now, x, v, given)
        for sensor in axis.velocity:
            velocity = sensor(velocity, now, *self.path[-1])
        position = min(max(position + error[0], axis.clip[0]), axis.clip[1])
        if axis.quantum:
            position = axis.quantum * math.floor(position / axis.quantum + 0.5)
        if axis.holds is not None and i > 0 and not axis.holds(i):
            position = last
        return position, velocity + error[1]

    def _at(self, time: float) -> tuple[float, float, float]:
        """Position, velocity and force at an earlier time, by cubics between the steps."""
        place = max(time / self.h, 0.0)
        k = min(int(place), len(self.path) - 1)
        x0, v0, f0 = self.path[k]
        s = place - k
        if s < 1e-9 or k + 1 >= len(self.path):
            return x0, v0, f0
        x1, v1, f1 = self.path[k + 1]
        h, r = self.h, 1.0 - s
        x = r * r * (1.0 + 2.0 * s) * x0 + s * s * (3.0 - 2.0 * s) * x1 + s * r * h * (r * v0 - s * v1)
        return x, r * v0 + s * v1, r * f0 + s * f1 if self.slow else f0

    def _force(self, now: float) -> float:
        """Force of the actuator right after a time."""
        if self.slow:
            return self.given
        k = math.floor((now - self.axis.delay) / self.step + 1e-9)
        return self.aims[min(max(k, 0), len(self.aims) - 1)]

    def _drive(self, now: float) -> float:
        """Mean force of the actuator in the step from now on."""
        axis, h, aims = self.axis, self.h, self.aims
        begin = (now - axis.delay) / self.step + 1e-9
        end = begin + h / self.step - 2e-9
        k, m = math.floor(begin), math.floor(end)
        newest = len(aims) - 1
        aim = aims[min(max(k, 0), newest)]
        if m > k:
            aim += (aims[min(max(m, 0), newest)] - aim) * (end - m) / (end - begin)
        if axis.ring:
            before = self.given
            self.rising += h * (axis.ring**2 * (aim - before) - 0.6 * axis.ring * self.rising)
            self.given = before + h * self.rising
            return 0.5 * (before + self.given)
        if not self.slow:
            self.given = aim
            return aim
        before, lag = self.given, axis.lag
        if axis.fall is not None and abs(aim) < abs(before):
            lag = axis.fall
        # The mean of an exponential or a ramp in the step, not of its ends: either may be shorter.
        decay = math.exp(-h / lag) if lag > 0.0 else 0.0
        change = (aim - before) * (1.0 - decay)
        if abs(change) > axis.rate * h:
            change = math.copysign(axis.rate * h, change)
            self.given = before + change
            return before + 0.5 * change
        self.given = before + change
        share = lag / h * (1.0 - decay) if lag > 0.0 else 0.5 * abs(change) / (axis.rate * h)
        return aim + (before - aim) * share

    def _advance(self, now: float) -> None:
        """One step of the integration."""
        axis, h = self.axis, self.h
        drive, x, v = self._drive(now), self.x, self.v
        pushes, factor = axis.forces, axis.inertia_factor
        m, c, k, g = axis.inertia, axis.damping, axis.stiffness, axis.gravity
        held = drive - sum(b.after(0.5 * h * v) for b in axis.bristles)
        held += sum(memory.force(x, v) for memory in axis.memories)

        def acceleration(t: float, x: float, v: float) -> float:
            force = held - c * v - k * x
            if g:
                force -= g * math.sin(x)
            for push in pushes:
                force += push(t, x, v, drive)
            return force / (m if factor is None else m * factor(x))

        half, middle = 0.5 * h, now + 0.5 * h
        a1 = acceleration(now, x, v)
        v2 = v + half * a1
        a2 = acceleration(middle, x + half * v, v2)
        v3 = v + half * a2
        a3 = acceleration(middle, x + half * v2, v3)
        v4 = v + h * a3
        a4 = acceleration(now + h, x + h * v3, v4)
        after = v + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
        there = x + h / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4)
        if axis.dry:
            speed = 0.5 * (v + after) if v else 0.0
            size = sum(dry(middle, x, speed, drive) for dry in axis.dry)
            after = math.copysign(max(abs(after) - h * size / m, 0.0), after)
            there = x + half * (v + after)
        for bristle in axis.bristles:
            bristle.force = bristle.after(there - x)
        for memory in axis.memories:
            memory.advance(h, x, v)
        self.x, self.v = there, after
