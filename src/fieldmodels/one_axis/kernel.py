"""The compiled physics of one axis: actuator, equation of motion, sensors.

    M dv/dt = F(t) - c v - F_c sign(v) - d v |v| - k x - G sin x - k_3 x^3
              + F_0 + A_s sin(2 pi f t) + A_c cos(2 pi f t) + disturbance(t),     dx/dt = v

``x`` is a position [m] or an angle [rad], ``F`` a force [N] or a torque [N m]. All parameters of one
simulation stand in a row ``q`` of length ``SLOTS``, one slot each. Commands and disturbances are held
from their sample to the next. Integration is by classical Runge-Kutta steps that end where the held
command switches and, with Coulomb friction, where the velocity reverses; so the axis really sticks.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from fieldmodels.compiled import compiled, inlined

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

INERTIA, DAMPING, STIFFNESS, GRAVITY = 0, 1, 2, 3
COULOMB, DRAG, CUBIC, CONSTANT, SINE, COSINE, FREQUENCY, GAP = 4, 5, 6, 7, 8, 9, 10, 11
GAIN, ASYMMETRY, LAG, DELAY, LIMIT, DEAD_ZONE, STEP_TIME, STEP_FACTOR = 12, 13, 14, 15, 16, 17, 18, 19
BIAS, VELOCITY_BIAS, DRIFT, SENSOR_GAIN, SENSOR_DELAY, QUANTUM = 20, 21, 22, 23, 24, 25
SLOTS = 26

SHARED_SLOTS = {
    "quadratic_drag.coefficient": DRAG,
    "cubic_stiffness.coefficient": CUBIC,
    "periodic_force.sine": SINE,
    "periodic_force.cosine": COSINE,
    "periodic_force.frequency": FREQUENCY,
    "backlash.gap": GAP,
    "actuator_gain.gain": GAIN,
    "actuator_asymmetry.difference": ASYMMETRY,
    "actuator_lag.time_constant": LAG,
    "actuator_delay.delay": DELAY,
    "actuator_saturation.limit": LIMIT,
    "actuator_dead_zone.width": DEAD_ZONE,
    "sensor_drift.rate": DRIFT,
    "sensor_gain.gain": SENSOR_GAIN,
    "sensor_delay.delay": SENSOR_DELAY,
    "sensor_quantisation.step": QUANTUM,
    "parameter_step.time": STEP_TIME,
    "parameter_step.factor": STEP_FACTOR,
}
"""Slot of every parameter that both benches have under one name."""

NO_LIMIT = 1e9
"""A saturation limit from this on means none."""


def neutral() -> FloatArray:
    """A row with every effect off and unit inertia, shape (SLOTS,)."""
    q = np.zeros(SLOTS)
    q[[INERTIA, GAIN, STEP_FACTOR, SENSOR_GAIN]] = 1.0
    q[LIMIT] = NO_LIMIT
    return q


@inlined
def acceleration(x: float, v: float, t: float, force: float, q: FloatArray) -> float:
    """Acceleration without Coulomb friction [m/s^2 or rad/s^2]."""
    total: float = force - q[DAMPING] * v - q[STIFFNESS] * x
    if q[GRAVITY] != 0.0:
        total -= q[GRAVITY] * math.sin(x)
    if q[DRAG] != 0.0:
        total -= q[DRAG] * v * abs(v)
    if q[CUBIC] != 0.0:
        total -= q[CUBIC] * x * x * x
    if q[SINE] != 0.0 or q[COSINE] != 0.0:
        phase = 2.0 * math.pi * q[FREQUENCY] * t
        total += q[SINE] * math.sin(phase) + q[COSINE] * math.cos(phase)
    result: float = total / q[INERTIA]
    return result


@inlined
def runge_kutta(
    x: float, v: float, t: float, h: float, target: float, lagged: float, friction: float, q: FloatArray
) -> tuple[float, float]:
    """One classical step of length ``h``; the actuator's force goes from ``lagged`` to ``target``."""
    if q[LAG] > 0.0:
        half = math.exp(-0.5 * h / q[LAG])
        force_1 = target + (lagged - target) - friction
        force_2 = target + (lagged - target) * half - friction
        force_3 = target + (lagged - target) * half * half - friction
    else:
        force_1 = force_2 = force_3 = target - friction
    a1 = acceleration(x, v, t, force_1, q)
    v2 = v + 0.5 * h * a1
    a2 = acceleration(x + 0.5 * h * v, v2, t + 0.5 * h, force_2, q)
    v3 = v + 0.5 * h * a2
    a3 = acceleration(x + 0.5 * h * v2, v3, t + 0.5 * h, force_2, q)
    v4 = v + h * a3
    a4 = acceleration(x + h * v3, v4, t + h, force_3, q)
    return x + h / 6.0 * (v + 2.0 * (v2 + v3) + v4), v + h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)


@inlined
def plain_runge_kutta(
    x: float, v: float, h: float, force: float, inertia: float, c: float, k: float, gravity: float
) -> tuple[float, float]:
    """The same step where no effect is on in the equation of motion: about twice as fast."""
    if gravity != 0.0:
        a1 = (force - c * v - k * x - gravity * math.sin(x)) / inertia
        v2 = v + 0.5 * h * a1
        x2 = x + 0.5 * h * v
        a2 = (force - c * v2 - k * x2 - gravity * math.sin(x2)) / inertia
        v3 = v + 0.5 * h * a2
        x3 = x + 0.5 * h * v2
        a3 = (force - c * v3 - k * x3 - gravity * math.sin(x3)) / inertia
        v4 = v + h * a3
        x4 = x + h * v3
        a4 = (force - c * v4 - k * x4 - gravity * math.sin(x4)) / inertia
    else:
        a1 = (force - c * v - k * x) / inertia
        v2 = v + 0.5 * h * a1
        a2 = (force - c * v2 - k * (x + 0.5 * h * v)) / inertia
        v3 = v + 0.5 * h * a2
        a3 = (force - c * v3 - k * (x + 0.5 * h * v2)) / inertia
        v4 = v + h * a3
        a4 = (force - c * v4 - k * (x + h * v3)) / inertia
    return x + h / 6.0 * (v + 2.0 * (v2 + v3) + v4), v + h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)


@inlined
def advance(
    x: float, v: float, t: float, h: float, target: float, lagged: float, q: FloatArray
) -> tuple[float, float]:
    """One step with Coulomb friction: it opposes motion, and holds the axis while it can.

    Where the velocity reverses within the step, the step is cut there (linear interpolation).
    """
    coulomb = q[COULOMB]
    if coulomb == 0.0:
        return runge_kutta(x, v, t, h, target, lagged, 0.0, q)
    for _ in range(2):
        if v == 0.0:
            push = acceleration(x, v, t, lagged if q[LAG] > 0.0 else target, q) * q[INERTIA]
            if abs(push) <= coulomb:
                return x, 0.0
            sign = 1.0 if push > 0.0 else -1.0
        else:
            sign = 1.0 if v > 0.0 else -1.0
        new_x, new_v = runge_kutta(x, v, t, h, target, lagged, sign * coulomb, q)
        if new_v * sign >= 0.0 or v == 0.0:
            return new_x, new_v
        reversal = h * v / (v - new_v)
        x, _unused = runge_kutta(x, v, t, reversal, target, lagged, sign * coulomb, q)
        if q[LAG] > 0.0:
            lagged = target + (lagged - target) * math.exp(-reversal / q[LAG])
        v = 0.0
        t += reversal
        h -= reversal
    return x, v


@compiled
def actuate(command: FloatArray, step: float, q: FloatArray, out: FloatArray) -> None:
    """Static actuator effects: what the motor is told to give on each sample.

    Args:
        command: Commanded force, shape (n,).
        step: Sampling interval [s].
        q: Parameters, shape (SLOTS,).
        out: Receives the force that the actuator aims at, shape (n,).
    """
    for i in range(len(command)):
        u = q[GAIN] * command[i]
        if q[ASYMMETRY] != 0.0:
            u *= 1.0 + 0.5 * q[ASYMMETRY] if u > 0.0 else 1.0 - 0.5 * q[ASYMMETRY]
        if q[DEAD_ZONE] > 0.0:
            u = math.copysign(max(abs(u) - q[DEAD_ZONE], 0.0), u)
        if abs(u) > q[LIMIT]:
            u = math.copysign(q[LIMIT], u)
        if q[STEP_FACTOR] != 1.0:
            after = min(max((i + 1) - q[STEP_TIME] / step, 0.0), 1.0)
            u *= 1.0 + (q[STEP_FACTOR] - 1.0) * after
        out[i] = u


@compiled
def lag(target: FloatArray, first: IntArray, step: float, time_constant: float, out: FloatArray) -> None:
    """First-order lag along every episode, from rest at its first command (exact for held commands).

    Args:
        target: What the actuator aims at, shape (n,).
        first: First sample of the episode that each sample belongs to, shape (n,).
        step: Sampling interval [s].
        time_constant: Time constant [s].
        out: Receives the force at the sample times, shape (n,).
    """
    decay = math.exp(-step / time_constant)
    for i in range(len(target)):
        out[i] = target[i] if i == first[i] else target[i - 1] + (out[i - 1] - target[i - 1]) * decay


@inlined
def is_plain(q: FloatArray) -> bool:
    """Whether no effect is on in the equation of motion or in the actuator's dynamics."""
    return bool(
        q[COULOMB] == 0.0
        and q[DRAG] == 0.0
        and q[CUBIC] == 0.0
        and q[SINE] == 0.0
        and q[COSINE] == 0.0
        and q[LAG] == 0.0
    )


@inlined
def is_static(q: FloatArray) -> bool:
    """Whether a static effect of the actuator is on."""
    return bool(
        q[GAIN] != 1.0
        or q[ASYMMETRY] != 0.0
        or q[DEAD_ZONE] > 0.0
        or q[LIMIT] < NO_LIMIT
        or q[STEP_FACTOR] != 1.0
    )


@inlined
def substeps_for(q: FloatArray, step: float, least: int) -> int:
    """Steps within a sampling interval: a power of two times ``least`` that resolves the fastest mode."""
    fastest = math.sqrt((q[STIFFNESS] + abs(q[GRAVITY])) / q[INERTIA]) + q[DAMPING] / q[INERTIA]
    count = least
    while fastest * step > 0.2 * count and count < 256:
        count *= 2
    return count


@compiled
def simulate(
    q: FloatArray,
    command: FloatArray,
    disturbance: FloatArray,
    first: IntArray,
    last: IntArray,
    step: float,
    backlash_force: float,
    velocity_shown: bool,
    starts: IntArray,
    lengths: IntArray,
    states: FloatArray,
    least_substeps: int,
    out: FloatArray,
) -> None:
    """Simulate every window for every row of parameters.

    A sensor delay shifts the simulated clock: a window starts where the delayed position sensor shows
    its first sample, and the velocity sensor, which has no delay, is read that much later.

    Args:
        q: Parameters, shape (batch, SLOTS).
        command: Commanded force over the whole recording, shape (n,).
        disturbance: Additional force, shape (n,), or shape (0,) for none.
        first: First sample of each sample's episode, shape (n,).
        last: Last sample of each sample's episode, shape (n,).
        step: Sampling interval [s].
        backlash_force: Force over which the play is crossed.
        velocity_shown: Whether states' velocities come from a velocity sensor.
        starts: First sample of each window, shape (windows,).
        lengths: Samples of each window, shape (windows,).
        states: Position and velocity as the sensors show them, shape (windows, 2).
        least_substeps: Integration steps within a sampling interval, at least.
        out: Receives position and velocity, shape (batch, windows, samples, 2), filled with NaN.
    """
    n = len(command)
    actuated = np.empty(n)
    filtered = np.empty(n)
    edges = np.zeros(4)
    for p in range(q.shape[0]):
        r = q[p]
        target = command
        if is_static(r):
            target = actuated
            actuate(command, step, r, target)
        plain = is_plain(r)
        inertia, damping, stiffness, gravity = r[INERTIA], r[DAMPING], r[STIFFNESS], r[GRAVITY]
        if r[LAG] > 0.0:
            lag(target, first, step, r[LAG], filtered)
        substeps = substeps_for(r, step, least_substeps)
        shift = (r[DELAY] + r[SENSOR_DELAY]) / step
        whole = math.floor(shift)
        part = shift - whole
        ahead = math.floor(r[SENSOR_DELAY] / step)
        ahead_part = r[SENSOR_DELAY] / step - ahead
        # Within a sampling interval the held command switches at `part`, the velocity is read at
        # `ahead_part`: the integration stops at both.
        edges[1] = min(part, ahead_part)
        edges[2] = max(part, ahead_part)
        edges[3] = 1.0
        for w in range(len(starts)):
            start = starts[w]
            low = first[start]
            high = last[start]
            # The true state behind what the sensors show at the window's start.
            shown_velocity = states[w, 1]
            source = max(start - whole - (1 if part > 0.0 else 0), low)
            now = target[source]
            if r[LAG] > 0.0:
                now = filtered[source]
                if part > 0.0 and start - whole - 1 >= low:
                    now = target[source] + (filtered[source] - target[source]) * math.exp(
                        -(1.0 - part) * step / r[LAG]
                    )
            play = 0.5 * r[GAP] * math.tanh(now / backlash_force) if r[GAP] != 0.0 else 0.0
            clock = start * step
            x = (states[w, 0] - r[BIAS] - r[DRIFT] * clock - play) / r[SENSOR_GAIN]
            if velocity_shown:
                v = shown_velocity - r[VELOCITY_BIAS]
                if r[SENSOR_DELAY] > 0.0:
                    v -= r[SENSOR_DELAY] * acceleration(x, v, clock, now + r[CONSTANT], r)
            else:
                v = (shown_velocity - r[DRIFT]) / r[SENSOR_GAIN]
            lagged = now
            samples = lengths[w]
            for j in range(samples + ahead + 1):
                if j < samples:
                    # The play is on the motor's side, where the position sensor sits: between motor
                    # and load the force pushes one flank or the other.
                    shown = r[SENSOR_GAIN] * x + r[BIAS] + r[DRIFT] * (start + j) * step
                    if r[GAP] != 0.0:
                        source = max(start + j - whole - (1 if part > 0.0 else 0), low)
                        force = lagged if r[LAG] > 0.0 else target[source]
                        shown += 0.5 * r[GAP] * math.tanh(force / backlash_force)
                    if r[QUANTUM] > 0.0:
                        shown = r[QUANTUM] * math.floor(shown / r[QUANTUM] + 0.5)
                    out[p, w, j, 0] = shown
                if ahead_part == 0.0 and j >= ahead and j - ahead < samples:
                    out[p, w, j - ahead, 1] = v + r[VELOCITY_BIAS]
                if j == samples + ahead or (ahead_part == 0.0 and j == samples + ahead - 1):
                    break
                index = min(start + j, high)
                extra = r[CONSTANT]
                if len(disturbance) > 0:
                    extra += disturbance[index]
                for piece in range(3):
                    length = edges[piece + 1] - edges[piece]
                    if length <= 0.0:
                        continue
                    source = start + j - whole - (1 if edges[piece] < part else 0)
                    aim = target[min(max(source, low), high)]
                    t = ((start + j) + edges[piece]) * step - r[SENSOR_DELAY]
                    h = length * step / substeps
                    if plain:
                        for _ in range(substeps):
                            x, v = plain_runge_kutta(
                                x, v, h, aim + extra, inertia, damping, stiffness, gravity
                            )
                    else:
                        for i in range(substeps):
                            x, v = advance(x, v, t + i * h, h, aim + extra, lagged + extra, r)
                            if r[LAG] > 0.0:
                                lagged = aim + (lagged - aim) * math.exp(-h / r[LAG])
                    if edges[piece + 1] == ahead_part and j >= ahead and j - ahead < samples:
                        out[p, w, j - ahead, 1] = v + r[VELOCITY_BIAS]
