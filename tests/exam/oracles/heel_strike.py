"""The walker's leg and gyro by SciPy, written from docs/heel_strike.md and the effects' equations.

    theta' = omega,  omega' = torque - g/length sin(theta) + forces of the effects      (2.11)

Just after the first sample at or past the lowest point, the push-off removes a share of the speed error.
The gyro is read before it. Nothing here is shared with the simulation that it is compared with.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from exam.oracles import Values, filled
from fieldmodels.arrays import FloatArray

NEUTRAL: Values = {
    "viscous_friction": {"rate": 0.0},
    "coulomb_friction": {"acceleration": 0.0},
    "quadratic_drag": {"coefficient": 0.0},
    "constant_force": {"acceleration": 0.0},
    "periodic_force": {"sine": 0.0, "cosine": 0.0, "frequency": 1.0},
    "gyro_bias": {"rate": 0.0},
    "gyro_drift": {"rate": 0.0},
    "gyro_gain": {"gain": 1.0},
    "gyro_delay": {"delay": 0.0},
    "gyro_quantisation": {"step": 0.0},
    "parameter_step": {"rate": 0.0, "time": 0.0},
}
GRAVITY = 9.81
SPEED = 1.0
PUSH_OFF = 0.5
FADE = 0.01
"""Speed at which dry friction fades [rad/s]."""
AROUND = 0.03
"""Time before and after a strike over which the gyro is averaged [s]."""


@dataclass(frozen=True)
class Walk:
    """Samples of a walk, the first at ``time[0]``, shape (n,).

    Attributes:
        time: Sample times [s].
        angle: Angle of the leg [rad].
        speed: Angular speed, before the push-off at a strike [rad/s].
        gyro: Noise-free reading of the gyro [rad/s].
        strike: True at the first sample after a strike.
    """

    time: FloatArray
    angle: FloatArray
    speed: FloatArray
    gyro: FloatArray
    strike: NDArray[np.bool_]


@dataclass(frozen=True)
class Leg:
    """A leg with effects.

    Attributes:
        effects: Values of the effects that are on.
        length: Length of the pendulum [m].
    """

    effects: Values
    length: float = 1.0

    def value(self, effect: str, name: str) -> float:
        """Value of one parameter of an effect."""
        return self._given[effect][name]

    @cached_property
    def _given(self) -> Values:
        return filled(self.effects, NEUTRAL)

    def acceleration(self, time: float, angle: float, speed: float, torque: float) -> float:
        """Angular acceleration [rad/s2]."""
        turns = 2.0 * np.pi * self.value("periodic_force", "frequency") * time
        return float(
            torque
            - GRAVITY / self.length * np.sin(angle)
            - self.value("viscous_friction", "rate") * speed
            - self.value("coulomb_friction", "acceleration") * speed / np.hypot(speed, FADE)
            - self.value("quadratic_drag", "coefficient") * speed * abs(speed)
            + self.value("constant_force", "acceleration")
            + self.value("periodic_force", "sine") * np.sin(turns)
            + self.value("periodic_force", "cosine") * np.cos(turns)
        )

    def swing(
        self, angle: float, speed: float, time: FloatArray, torque: float = 0.0
    ) -> tuple[FloatArray, FloatArray]:
        """Angle and speed at given times, forward or backward, from the state at the first of them."""
        if len(time) < 2:
            return np.full(len(time), angle), np.full(len(time), speed)
        result = solve_ivp(
            lambda t, y: (y[1], self.acceleration(t, y[0], y[1], torque)),
            (time[0], time[-1]),
            (angle, speed),
            method="DOP853",
            t_eval=time,
            rtol=1e-11,
            atol=1e-13,
        )
        return result.y[0], result.y[1]

    def pushed(self, speed: float) -> float:
        """Speed after the push-off [rad/s]."""
        return speed + PUSH_OFF * (float(np.sign(speed)) * SPEED - speed)

    def offset(self, time: FloatArray) -> FloatArray:
        """What the gyro shows when nothing turns [rad/s]."""
        jump = self.value("parameter_step", "rate") * (time >= self.value("parameter_step", "time"))
        return np.asarray(self.value("gyro_bias", "rate") + self.value("gyro_drift", "rate") * time + jump)

    def read(self, time: FloatArray, speed: FloatArray, first: int = 0) -> FloatArray:
        """The gyro's noise-free reading at the samples from ``first`` on, before it is rounded [rad/s]."""
        late = np.interp(time - self.value("gyro_delay", "delay"), time, speed)[first:]
        return np.asarray(self.value("gyro_gain", "gain") * late + self.offset(time[first:]))

    def rounded(self, reading: FloatArray) -> FloatArray:
        """What a coarse gyro shows of a reading [rad/s]."""
        step = self.value("gyro_quantisation", "step")
        return step * np.round(reading / step) if step > 0 else reading


def walk(leg: Leg, count: int, step: float = 0.002, torque: Callable[[int], float] | None = None) -> Walk:
    """Walk from the lowest point at the nominal speed, just after a strike.

    Args:
        leg: The leg.
        count: Samples.
        step: Time between them [s].
        torque: Process torque per inertia [rad/s2] from sample k to the next.

    Returns:
        Samples 1 to ``count``; before the start the leg turned at the nominal speed.
    """
    torques = np.array([torque(k) if torque else 0.0 for k in range(count)])
    time = step * np.arange(count + 1.0)
    angle, speed, after = np.zeros(count + 1), np.full(count + 1, SPEED), SPEED
    strike = np.zeros(count + 1, dtype=np.bool_)
    k = 0
    while k < count:
        held = np.flatnonzero(torques[k:] != torques[k])
        end = min(count, k + (int(held[0]) if len(held) else count), k + round(0.25 / step))
        angles, speeds = leg.swing(angle[k], after, time[k : end + 1], torques[k])
        crossed = np.flatnonzero((angles[:-1] * angles[1:] < 0) | ((angles[1:] == 0) & (angles[:-1] != 0)))
        if len(crossed):
            end = k + int(crossed[0]) + 1
        angle[k + 1 : end + 1], speed[k + 1 : end + 1] = angles[1 : end - k + 1], speeds[1 : end - k + 1]
        after = speed[end]
        if len(crossed):
            strike[end] = True
            after = leg.pushed(after)
        k = end
    gyro = leg.rounded(leg.read(time, speed, 1))
    return Walk(time[1:], angle[1:], speed[1:], gyro, strike[1:])


def simulate(
    base: Mapping[str, float],
    effects: Values,
    commands: FloatArray,
    step: float,
    start: Mapping[str, float] | None = None,
) -> FloatArray:
    """Work out what ``HeelStrikeModel`` describes; see ``Simulate``.

    The gyro's reading is the expected one: noise dithers its rounding. ``closure`` is the change of the angle
    less the gyro's sum since the latest strike; ``push_off``, 30 ms after the start or a strike, the mean
    reading since then less the speed that the push-off makes of the mean reading before.

    Args:
        base: ``length`` [m].
        effects: Values of the effects that are on.
        commands: ``strike``, 1 at a sample after which the push-off acts; and a second column, if there is
            one, torque per inertia [rad/s2], its mean acting from a sample to the next.
        step: Sampling interval [s].
        start: ``theta`` [rad], ``omega`` [rad/s] and the ``time`` [s] of the first sample (default: 0). The
            leg swung freely to there.
    """
    leg, begun = Leg(effects, base["length"]), {"theta": 0.0, "omega": SPEED, "time": 0.0, **(start or {})}
    count, around = len(commands), max(3, round(AROUND / step))
    time = begun["time"] + step * np.arange(float(count))
    strike = commands[:, 0] > 0.5
    torque = commands[:, 1] if commands.shape[1] > 1 else np.zeros(count)
    past = around + int(np.ceil(leg.value("gyro_delay", "delay") / step)) + 1
    before = time[0] - step * np.arange(past + 1.0)
    _, earlier = leg.swing(begun["theta"], begun["omega"], before)
    held = 0.5 * (torque[:-1] + torque[1:])
    angle, speed = np.empty(count), np.empty(count)
    angle[0], speed[0] = begun["theta"], begun["omega"]
    edges = [n for n in range(1, count - 1) if strike[n] or held[n] != held[n - 1]]
    for first, last in zip([0, *edges], [*edges, count - 1], strict=True):
        after = leg.pushed(speed[first]) if strike[first] else speed[first]
        angles, speeds = leg.swing(angle[first], after, time[first : last + 1], held[first])
        angle[first + 1 : last + 1], speed[first + 1 : last + 1] = angles[1:], speeds[1:]
    whole = np.concatenate([before[::-1], time[1:]])
    reading = leg.read(whole, np.concatenate([earlier[::-1], speed[1:]]))
    closure, push = np.empty(count), np.zeros(count)
    opened, turned = angle[0], 0.0
    for n in range(count):
        turned += reading[past + n] * step if n else 0.0
        closure[n] = angle[n] - opened - turned
        if strike[n]:
            opened, turned = angle[n], 0.0
        if (strike[n] or n == 0) and n + around < count:
            means = [reading[past + n + k - around : past + n + k].mean() for k in (1, 1 + around)]
            push[n + around] = means[1] - leg.pushed(means[0])
    return np.column_stack([reading[past:], angle, closure, push])
