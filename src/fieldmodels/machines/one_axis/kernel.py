"""The compiled physics of one axis: actuator, equation of motion, sensors.

    M dv/dt = F(t) - c v - (F_c + F_s exp(-(v/v_s)^2)) sign(v) - F_h - d v |v| - k x - G sin x - k_3 x^3
              + F_0 + A_s sin(2 pi f t) + A_c cos(2 pi f t)
              + B_s sin(2 pi x/p) + B_c cos(2 pi x/p) + disturbance(t),           dx/dt = v
    dF/dt   = (u - F)/T, at most r in size;    dF_h/dx = (F_m - F_h sign(v))/delta

``x`` is a position [m] or an angle [rad], ``F`` a force [N] or a torque [N m]. All parameters of one
simulation stand in a row ``q`` of length ``SLOTS``, one slot each. Commands and disturbances are held
from their sample to the next. Integration is by classical Runge-Kutta steps that end where the held
command switches and, with dry friction, where the velocity reverses; so the axis really sticks.

Friction that falls with speed is Stribeck's curve in its Gaussian form (Armstrong-Helouvry, Dupont and
Canudas de Wit 1994, Automatica 30(7)); hysteresis is Dahl's bristle (A solid friction model,
The Aerospace Corporation, 1968), whose force depends on the path alone and is carried on along it exactly.
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
RATE, STRIBECK, STRIBECK_VELOCITY, BRISTLE, BRISTLE_DISTANCE = 26, 27, 28, 29, 30
COGGING_SINE, COGGING_COSINE, COGGING_PERIOD = 31, 32, 33
SLOTS = 34

SHARED_SLOTS = {
    "quadratic_drag.coefficient": DRAG,
    "cubic_stiffness.coefficient": CUBIC,
    "periodic_force.sine": SINE,
    "periodic_force.cosine": COSINE,
    "periodic_force.frequency": FREQUENCY,
    "stribeck_friction.velocity": STRIBECK_VELOCITY,
    "hysteresis.distance": BRISTLE_DISTANCE,
    "cogging.sine": COGGING_SINE,
    "cogging.cosine": COGGING_COSINE,
    "cogging.period": COGGING_PERIOD,
    "backlash.gap": GAP,
    "actuator_gain.gain": GAIN,
    "actuator_asymmetry.difference": ASYMMETRY,
    "actuator_lag.time_constant": LAG,
    "actuator_delay.delay": DELAY,
    "actuator_rate_limit.rate": RATE,
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
"""A saturation or rate limit from this on means none."""
FRICTION_STEPS = 32
"""Integration steps within a sampling interval, at most, that dry friction and cogging ask for."""


def neutral() -> FloatArray:
    """A row with every effect off and unit inertia, shape (SLOTS,)."""
    q = np.zeros(SLOTS)
    q[[INERTIA, GAIN, STEP_FACTOR, SENSOR_GAIN]] = 1.0
    q[[STRIBECK_VELOCITY, BRISTLE_DISTANCE, COGGING_PERIOD]] = 1.0
    q[[LIMIT, RATE]] = NO_LIMIT
    return q


@inlined
def acceleration(x: float, v: float, t: float, force: float, q: FloatArray) -> float:
    """Acceleration without dry friction [m/s^2 or rad/s^2]."""
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
    if q[COGGING_SINE] != 0.0 or q[COGGING_COSINE] != 0.0:
        phase = 2.0 * math.pi * x / q[COGGING_PERIOD]
        total += q[COGGING_SINE] * math.sin(phase) + q[COGGING_COSINE] * math.cos(phase)
    result: float = total / q[INERTIA]
    return result


@inlined
def has_dynamics(q: FloatArray) -> bool:
    """Whether the actuator's force follows its target with a lag or at a limited rate."""
    return bool(q[LAG] > 0.0 or q[RATE] < NO_LIMIT)


@inlined
def ramp_time(force: float, target: float, q: FloatArray) -> float:
    """How long the actuator moves at its rate limit towards a held target [s]; negative if not at all."""
    return float(abs(target - force) / q[RATE] - q[LAG]) if q[RATE] < NO_LIMIT else -1.0


@inlined
def follow(force: float, target: float, h: float, q: FloatArray) -> float:
    """The actuator's force a time ``h`` later: a ramp, then a first-order lag (exact for a held target)."""
    ramp = ramp_time(force, target, q)
    if ramp > 0.0:
        if h <= ramp:
            return float(force + math.copysign(q[RATE] * h, target - force))
        force += math.copysign(q[RATE] * ramp, target - force)
        h -= ramp
    if q[LAG] > 0.0:
        return float(target + (force - target) * math.exp(-h / q[LAG]))
    return target


@inlined
def has_dry_friction(q: FloatArray) -> bool:
    """Whether a force depends on the direction of motion."""
    return bool(q[COULOMB] != 0.0 or q[STRIBECK] != 0.0 or q[BRISTLE] != 0.0)


@inlined
def bend(bristle: float, moved: float, q: FloatArray) -> float:
    """Dahl's bristle after a motion in one direction: it approaches its largest force along the path."""
    level = math.copysign(q[BRISTLE], moved)
    return float(level + (bristle - level) * math.exp(-abs(moved) / q[BRISTLE_DISTANCE]))


@inlined
def resistance(moved: float, v: float, sign: float, bristle: float, q: FloatArray) -> float:
    """Dry friction and hysteresis while the axis moves in direction ``sign``, ``moved`` from its start."""
    total = sign * q[COULOMB]
    if q[STRIBECK] != 0.0:
        ratio = v / q[STRIBECK_VELOCITY]
        total += sign * q[STRIBECK] * math.exp(-ratio * ratio)
    if q[BRISTLE] != 0.0:
        total += bend(bristle, moved, q)
    return float(total)


@inlined
def runge_kutta(
    x: float,
    v: float,
    t: float,
    h: float,
    target: float,
    lagged: float,
    sign: float,
    bristle: float,
    q: FloatArray,
) -> tuple[float, float]:
    """One classical step of length ``h`` in one direction; the actuator goes from ``lagged`` to ``target``.

    A ``sign`` of 0 means that there is no dry friction.
    """
    if has_dynamics(q):
        force_1 = lagged
        force_2 = follow(force_1, target, 0.5 * h, q)
        force_3 = follow(force_2, target, 0.5 * h, q)
    else:
        force_1 = force_2 = force_3 = target
    f1, f2, f3, f4 = force_1, force_2, force_2, force_3
    if sign != 0.0:
        f1 -= resistance(0.0, v, sign, bristle, q)
    a1 = acceleration(x, v, t, f1, q)
    v2 = v + 0.5 * h * a1
    if sign != 0.0:
        f2 -= resistance(0.5 * h * v, v2, sign, bristle, q)
    a2 = acceleration(x + 0.5 * h * v, v2, t + 0.5 * h, f2, q)
    v3 = v + 0.5 * h * a2
    if sign != 0.0:
        f3 -= resistance(0.5 * h * v2, v3, sign, bristle, q)
    a3 = acceleration(x + 0.5 * h * v2, v3, t + 0.5 * h, f3, q)
    v4 = v + h * a3
    if sign != 0.0:
        f4 -= resistance(h * v3, v4, sign, bristle, q)
    a4 = acceleration(x + h * v3, v4, t + h, f4, q)
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
    x: float, v: float, t: float, h: float, target: float, lagged: float, bristle: float, q: FloatArray
) -> tuple[float, float, float]:
    """One step with dry friction: it opposes motion, and holds the axis while it can.

    Where the velocity reverses within the step, the step is cut there (linear interpolation).

    Returns:
        Position, velocity, and force of the bristle.
    """
    if not has_dry_friction(q):
        x, v = runge_kutta(x, v, t, h, target, lagged, 0.0, 0.0, q)
        return x, v, bristle
    for _ in range(2):
        if v == 0.0:
            force = (lagged if has_dynamics(q) else target) - bristle
            push = acceleration(x, v, t, force, q) * q[INERTIA]
            if abs(push) <= q[COULOMB] + q[STRIBECK]:
                return x, 0.0, bristle
            sign = 1.0 if push > 0.0 else -1.0
        else:
            sign = 1.0 if v > 0.0 else -1.0
        new_x, new_v = runge_kutta(x, v, t, h, target, lagged, sign, bristle, q)
        if new_v * sign >= 0.0 or v == 0.0:
            return new_x, new_v, bend(bristle, new_x - x, q)
        reversal = h * v / (v - new_v)
        new_x, _unused = runge_kutta(x, v, t, reversal, target, lagged, sign, bristle, q)
        bristle = bend(bristle, new_x - x, q)
        lagged = follow(lagged, target, reversal, q)
        x, v = new_x, 0.0
        t += reversal
        h -= reversal
    return x, v, bristle


@inlined
def advance_past_ramp(
    x: float, v: float, t: float, h: float, target: float, lagged: float, bristle: float, q: FloatArray
) -> tuple[float, float, float]:
    """A step of length ``h``, cut where the actuator leaves its rate limit."""
    ramp = ramp_time(lagged, target, q)
    if 0.0 < ramp < h:
        x, v, bristle = advance(x, v, t, ramp, target, lagged, bristle, q)
        lagged = follow(lagged, target, ramp, q)
        t += ramp
        h -= ramp
    return advance(x, v, t, h, target, lagged, bristle, q)


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
def respond(target: FloatArray, first: IntArray, step: float, q: FloatArray, out: FloatArray) -> None:
    """The actuator's force along every episode, from rest at its first command (exact for held commands).

    Args:
        target: What the actuator aims at, shape (n,).
        first: First sample of the episode that each sample belongs to, shape (n,).
        step: Sampling interval [s].
        q: Parameters, shape (SLOTS,).
        out: Receives the force at the sample times, shape (n,).
    """
    for i in range(len(target)):
        out[i] = target[i] if i == first[i] else follow(out[i - 1], target[i - 1], step, q)


@compiled
def bend_along(path: FloatArray, first: IntArray, q: FloatArray, out: FloatArray) -> None:
    """The bristle's force along a measured path, unbent at the start of every episode.

    Args:
        path: Measured position, freed of noise, shape (n,).
        first: First sample of the episode that each sample belongs to, shape (n,).
        q: Parameters, shape (SLOTS,).
        out: Receives the bristle's force, shape (n,).
    """
    for i in range(len(path)):
        out[i] = 0.0 if i == first[i] else bend(out[i - 1], path[i] - path[i - 1], q)


@inlined
def is_plain(q: FloatArray) -> bool:
    """Whether no effect is on in the equation of motion or in the actuator's dynamics."""
    return bool(
        not has_dry_friction(q)
        and q[DRAG] == 0.0
        and q[CUBIC] == 0.0
        and q[SINE] == 0.0
        and q[COSINE] == 0.0
        and q[COGGING_SINE] == 0.0
        and q[COGGING_COSINE] == 0.0
        and not has_dynamics(q)
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
def substeps_for(q: FloatArray, step: float, least: int, speed: float) -> int:
    """Steps within a sampling interval: a power of two times ``least`` that resolves the fastest mode.

    Friction's slope, the bristle's stiffness and cogging at the given ``speed`` count too, in bounds: a
    slope without end is a jump, which more steps do not resolve.
    """
    fastest = math.sqrt((q[STIFFNESS] + abs(q[GRAVITY])) / q[INERTIA]) + q[DAMPING] / q[INERTIA]
    count = least
    while fastest * step > 0.2 * count and count < 256:
        count *= 2
    if q[STRIBECK] != 0.0:
        fastest += q[STRIBECK] / (q[STRIBECK_VELOCITY] * q[INERTIA])
    if q[BRISTLE] != 0.0:
        fastest += math.sqrt(q[BRISTLE] / (q[BRISTLE_DISTANCE] * q[INERTIA]))
    if q[COGGING_SINE] != 0.0 or q[COGGING_COSINE] != 0.0:
        fastest += 0.4 * 2.0 * math.pi * speed / q[COGGING_PERIOD]  # half a radian a step is fine enough
    while fastest * step > 0.2 * count and count < FRICTION_STEPS:
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
    path: FloatArray,
    speed: float,
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
        path: Measured position over the whole recording, freed of noise, shape (n,): along it the
            bristle was bent before a window; shape (0,) if hysteresis is off in every row.
        speed: A high speed of this axis, at which cogging is still resolved.
        least_substeps: Integration steps within a sampling interval, at least.
        out: Receives position and velocity, shape (batch, windows, samples, 2), filled with NaN.
    """
    n = len(command)
    actuated = np.empty(n)
    filtered = np.empty(n)
    bent = np.empty(len(path))
    edges = np.zeros(4)
    for p in range(q.shape[0]):
        r = q[p]
        target = command
        if is_static(r):
            target = actuated
            actuate(command, step, r, target)
        plain = is_plain(r)
        inertia, damping, stiffness, gravity = r[INERTIA], r[DAMPING], r[STIFFNESS], r[GRAVITY]
        dynamic = has_dynamics(r)
        if dynamic:
            respond(target, first, step, r, filtered)
        if r[BRISTLE] != 0.0:
            bend_along(path, first, r, bent)
        substeps = substeps_for(r, step, least_substeps, speed)
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
            if dynamic:
                now = filtered[source]
                if part > 0.0 and start - whole - 1 >= low:
                    now = follow(now, target[source], (1.0 - part) * step, r)
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
            bristle = bent[start] if r[BRISTLE] != 0.0 else 0.0
            samples = lengths[w]
            for j in range(samples + ahead + 1):
                if j < samples:
                    # The play is on the motor's side, where the position sensor sits: between motor
                    # and load the force pushes one flank or the other.
                    shown = r[SENSOR_GAIN] * x + r[BIAS] + r[DRIFT] * (start + j) * step
                    if r[GAP] != 0.0:
                        source = max(start + j - whole - (1 if part > 0.0 else 0), low)
                        force = lagged if dynamic else target[source]
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
                            x, v, bristle = advance_past_ramp(
                                x, v, t + i * h, h, aim + extra, lagged + extra, bristle, r
                            )
                            if dynamic:
                                lagged = follow(lagged, aim, h, r)
                    if edges[piece + 1] == ahead_part and j >= ahead and j - ahead < samples:
                        out[p, w, j - ahead, 1] = v + r[VELOCITY_BIAS]
