"""The kernel that takes walkers through one stride each."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled, inlined
from fieldmodels.drivers.stepped import Signals, show
from fieldmodels.machines.heel_strike import kalman
from fieldmodels.machines.heel_strike.estimators import observer_step, ranger_step, reset
from fieldmodels.machines.heel_strike.leg import gyro_reading, leg_step, push_off, quantised, samples_late
from fieldmodels.machines.heel_strike.walker import (
    AGENT,
    BANK,
    COLLISION,
    COLLISION_NOISE,
    EKF,
    FLOOR,
    GYRO,
    HISTORY,
    IMM,
    INNOVATION,
    PROCESS,
    RANGER,
    RANGER_TUNED,
    SWITCH,
    TORQUE,
)
from fieldmodels.streams import GAMMA, gaussian, mixed, symmetric, uniform

GYRO_SHOWN, ANGLE_SHOWN = range(2)
"""Sensors around which stock effects can act."""
SMOOTHING = 0.7
"""Share of the past in a smoothed feature."""


@inlined
def start_filter(f: FloatArray, speed: float, levels: FloatArray, c: Any) -> None:
    """Start a filter in the known state, with the torque at its stationary spread."""
    f[:] = 0.0
    f[1] = speed
    f[11] = levels[0] / (1.0 - c.torque_memory**2)
    f[13] = levels[3]


@inlined
def begin_feature(features: FloatArray, position: int, square: float) -> None:
    """The log of a squared quantity before it was ever seen: its expected value, latest and smoothed."""
    features[position] = features[position + 1] = math.log(square + 1e-12)


@compiled
def start(walkers: NDArray[Any], i: int, key: np.uint64, walks: NDArray[Any]) -> None:
    """Put walker ``i`` upright at the nominal speed, just after a strike, with streams from ``key``."""
    w, c = walkers[i], walks[i]
    levels = c.levels
    for s in range(5):
        w.keys[s] = mixed(key + np.uint64(s + 1) * GAMMA)
    w.sample = 0
    w.stride = 0
    w.process_level = 1 if uniform(w.keys[SWITCH], -1) < 0.5 else 0
    w.floor_level = 1 if uniform(w.keys[SWITCH], -2) < 0.5 else 0
    w.collision_level = 1 if uniform(w.keys[SWITCH], -3) < 0.5 else 0
    w.theta = 0.0
    w.omega = c.speed
    w.torque = 0.0
    w.geometry = 0.0
    w.history[:] = c.speed
    w.agent_theta = 0.0
    w.agent_omega = c.speed
    w.ranger_theta = 0.0
    w.tuned_theta = 0.0
    w.ranger_gyro = c.speed
    start_filter(w.ekf, c.speed, levels[BANK], c)
    for m in range(BANK):
        start_filter(w.bank[m], c.speed, levels[m], c)
    w.weights[:] = 1.0 / BANK
    begin_feature(w.features, INNOVATION, levels[BANK, 2])
    begin_feature(w.features, TORQUE, w.ekf[11])
    begin_feature(w.features, COLLISION_NOISE, levels[BANK, 1])


@inlined
def remember(features: FloatArray, position: int, square: float) -> None:
    """Put the log of a squared quantity into the features: latest, and exponentially smoothed."""
    value = math.log(square + 1e-12)
    features[position] = value
    features[position + 1] = SMOOTHING * features[position + 1] + (1.0 - SMOOTHING) * value


class Swing(NamedTuple):
    """What a swing from one strike to the next leaves to be scored, beside the walker's state."""

    samples: int
    struck: bool  # whether it ended with a strike
    swung: float  # change of Ranger's angle [rad]
    torque_square: float  # sum of the reference filter's squared torque
    collision_square: float  # the same of its collision noise


@inlined
def push_all(w: Any, share: float, c: Any, levels: FloatArray, use_bank: bool) -> None:
    """What the latest strike left to do: the reset that the agent chose, and the push-off on all."""
    w.agent_theta = reset(w.agent_theta, w.geometry, share)
    if w.stride > 0:
        w.omega = push_off(w.omega, c.speed, c.push_off)
        w.agent_omega = push_off(w.agent_omega, c.speed, c.push_off)
        w.ranger_gyro = push_off(w.ranger_gyro, c.speed, c.push_off)
        kalman.strike(w.ekf, c.speed, c.push_off, levels[BANK, 3])
        if use_bank:
            for m in range(BANK):
                kalman.strike(w.bank[m], c.speed, c.push_off, levels[m, 3])


@inlined
def filter_gyro(f: FloatArray, gyro: float, envelope: float, own: FloatArray, c: Any) -> float:
    """Let a filter, given its own levels of noise, take in a reading; returns its log-likelihood."""
    kalman.predict(f, c.step, c.stiffness, c.torque_memory, own[0], c.correlation, own[1])
    innovation, variance = kalman.update_gyro(f, gyro, envelope, c.gyro_variance)
    return kalman.log_likelihood(innovation, variance)


@inlined
def swing(
    w: Any,
    b: int,
    gains: FloatArray,
    plant: Any,
    extended: bool,
    sensors: Signals | None,
    c: Any,
    levels: FloatArray,
    log_weights: FloatArray,
    use_bank: bool,
    trace: FloatArray,
) -> Swing:
    """Swing the leg to its next strike, read the gyro, and let all estimators follow.

    Args:
        w: The walker.
        b: Its number.
        gains: Of the agent's estimator, shape (4,).
        plant: What leg and gyro truly are.
        extended: Whether any effect is on.
        sensors: Stock effects around all walkers' sensors, or None.
        c: Leg and noise.
        levels: What the filters are given, shape (9, 4).
        log_weights: Receives the log-likelihoods of the bank's filters, shape (8,).
        use_bank: Whether the bank runs.
        trace: Receives the samples, shape (samples, 8), or has none.
    """
    stiffness, (whole, part) = c.gravity / plant.length, samples_late(plant, c.step)
    gyro_key, collision_key, process_key = w.keys[GYRO], w.keys[COLLISION], w.keys[PROCESS]
    process = c.process[w.process_level]
    collision = c.collision[w.collision_level]
    theta, omega, torque, sample = w.theta, w.omega, w.torque, w.sample
    agent_theta, agent_omega, ranger_gyro, ekf = w.agent_theta, w.agent_omega, w.ranger_gyro, w.ekf
    noise = c.first * symmetric(collision_key, -1 - w.stride)
    n, struck, swung, torque_square, collision_square = 0, False, 0.0, 0.0, 0.0
    while not struck and n < c.limit:
        if sample % c.hold == 0:
            torque = process * symmetric(process_key, sample // c.hold)
        before = theta
        theta, omega = leg_step(theta, omega, torque, sample * c.step, c.step, stiffness, plant, extended)
        sample += 1
        n += 1
        noise = c.correlation * noise + c.drive * symmetric(collision_key, sample)
        envelope = max(0.0, 1.0 - n / c.envelope)
        gyro = omega
        if extended:
            w.history[sample % HISTORY] = omega
            newer, older = w.history[(sample - whole) % HISTORY], w.history[(sample - whole - 1) % HISTORY]
            gyro = gyro_reading(newer, older, part, sample * c.step, plant)
        gyro += envelope * collision * noise + c.gyro * gaussian(gyro_key, sample)
        if extended:
            gyro = quantised(gyro, plant)
        if sensors is not None:
            gyro = show(sensors, b, GYRO_SHOWN, gyro, sample * c.step, c.step)
        ratio = gains[0] if n <= c.envelope else gains[1]
        agent_theta, agent_omega = observer_step(
            agent_theta, agent_omega, gyro, c.step, c.stiffness, ratio, gains[3], c.cromer
        )
        swung = ranger_step(swung, ranger_gyro, gyro, c.step)
        ranger_gyro = gyro
        filter_gyro(ekf, gyro, envelope, levels[BANK], c)
        if n <= c.envelope:
            collision_square += ekf[3] * ekf[3]
        else:
            torque_square += ekf[2] * ekf[2]
        if use_bank:
            for m in range(BANK):
                log_weights[m] += filter_gyro(w.bank[m], gyro, envelope, levels[m], c)
        if len(trace) > 0:
            row = trace[n - 1]
            row[0], row[1], row[2], row[3] = sample * c.step, theta, omega, gyro
            row[4], row[5], row[6], row[7] = agent_theta, w.ranger_theta + swung, ekf[0], torque
        struck = (before < 0.0 <= theta) or (before > 0.0 >= theta)
    w.theta, w.omega, w.torque, w.sample = theta, omega, torque, sample
    w.agent_theta, w.agent_omega, w.ranger_gyro = agent_theta, agent_omega, ranger_gyro
    return Swing(n, struck, swung, torque_square, collision_square)


@inlined
def floor_error(w: Any, c: Any) -> float:
    """Height error of the floor at the strike [rad]."""
    floor: float = c.floor[w.floor_level]
    draw = uniform(w.keys[FLOOR], w.stride)
    return floor * (draw if c.floor_one_sided else 2.0 * draw - 1.0)


@inlined
def bank_estimate(
    w: Any, geometry: float, levels: FloatArray, transition: FloatArray, log_weights: FloatArray
) -> float:
    """Angle that the bank of filters gives at a strike [rad]; then it takes in the geometry and mixes."""
    kalman.reweight(w.weights, log_weights)
    estimate = 0.0
    for m in range(BANK):
        estimate += w.weights[m] * w.bank[m, 0]
    for m in range(BANK):
        innovation, variance = kalman.update_angle(w.bank[m], geometry, levels[m, 2])
        log_weights[m] = kalman.log_likelihood(innovation, variance)
    kalman.reweight(w.weights, log_weights)
    kalman.mix(w.bank, w.weights, transition)
    return estimate


@inlined
def strike(
    w: Any,
    b: int,
    done: Swing,
    sensors: Signals | None,
    c: Any,
    levels: FloatArray,
    transition: FloatArray,
    log_weights: FloatArray,
    use_bank: bool,
    errors: FloatArray,
) -> float:
    """Score all estimators at a strike, before their reset; returns the floor's height error [rad]."""
    w.ranger_theta += done.swung
    w.tuned_theta += done.swung
    height = floor_error(w, c)
    w.geometry = w.theta + height
    if sensors is not None:
        w.geometry = show(sensors, b, ANGLE_SHOWN, w.geometry, w.sample * c.step, 0.0)
    errors[AGENT] = w.agent_theta - w.theta
    errors[RANGER] = w.ranger_theta - w.theta
    errors[RANGER_TUNED] = w.tuned_theta - w.theta
    errors[EKF] = w.ekf[0] - w.theta
    errors[IMM] = np.nan
    if use_bank:
        errors[IMM] = bank_estimate(w, w.geometry, levels, transition, log_weights) - w.theta
    for e in range(len(errors)):
        errors[e] *= c.millimetres
    w.ranger_theta = reset(w.ranger_theta, w.geometry, c.ranger_reset)
    w.tuned_theta = reset(w.tuned_theta, w.geometry, c.tuned_reset)
    innovation, _ = kalman.update_angle(w.ekf, w.geometry, levels[BANK, 2])
    remember(w.features, INNOVATION, innovation * innovation)
    remember(w.features, TORQUE, done.torque_square / max(done.samples - c.envelope, 1))
    remember(w.features, COLLISION_NOISE, done.collision_square / min(done.samples, c.envelope))
    return height


@inlined
def switch_regimes(w: Any, c: Any) -> None:
    """Draw the regimes of the next stride."""
    if uniform(w.keys[SWITCH], 3 * w.stride) < c.switch:
        w.process_level = 1 - w.process_level
    if uniform(w.keys[SWITCH], 3 * w.stride + 1) < c.switch:
        w.floor_level = 1 - w.floor_level
    if uniform(w.keys[SWITCH], 3 * w.stride + 2) < c.switch:
        w.collision_level = 1 - w.collision_level


@inlined
def read_levels(w: Any, levels: NDArray[np.int64]) -> None:
    """Regimes of a walker, shape (3,): process, floor, collision."""
    levels[0], levels[1], levels[2] = w.process_level, w.floor_level, w.collision_level


@compiled
def advance(
    walkers: NDArray[Any],
    gains: FloatArray,
    plants: NDArray[Any],
    extended: NDArray[np.bool_],
    sensors: Signals | None,
    walks: NDArray[Any],
    use_bank: bool,
    errors: FloatArray,
    floors: FloatArray,
    duration: FloatArray,
    samples: NDArray[np.int64],
    fallen: NDArray[np.bool_],
    regimes: NDArray[np.int64],
    traces: FloatArray,
) -> None:
    """Take every walker from just after one strike to the first sample after the next.

    First the agent's reset and the push-off of the latest strike are applied; then the leg swings; at the
    next strike all estimators are scored before their reset. See ``Strides.advance`` for the arrays.
    """
    log_weights = np.empty(BANK)
    for b in range(len(walkers)):
        w, c = walkers[b], walks[b]
        levels = c.levels
        read_levels(w, regimes[b, 0])
        push_all(w, gains[b, 2], c, levels, use_bank)
        log_weights[:] = 0.0
        done = swing(
            w, b, gains[b], plants[b], extended[b], sensors, c, levels, log_weights, use_bank, traces[b]
        )
        height = strike(w, b, done, sensors, c, levels, c.transition, log_weights, use_bank, errors[b])
        floors[b] = height * c.millimetres
        samples[b] = done.samples
        duration[b] = done.samples * c.step
        fallen[b] = not done.struck
        switch_regimes(w, c)
        read_levels(w, regimes[b, 1])
        w.stride += 1
