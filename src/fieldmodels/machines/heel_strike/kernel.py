"""The kernel that takes walkers through one stride each."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled, inlined
from fieldmodels.drivers.stepped import Signals, show
from fieldmodels.elementary import sine_and_cosine
from fieldmodels.machines.heel_strike import kalman
from fieldmodels.machines.heel_strike.estimators import reset
from fieldmodels.machines.heel_strike.lanes import (
    NONE,
    draw_ahead,
    enter,
    follow,
    leave,
    move,
    prepare,
    swing,
)
from fieldmodels.machines.heel_strike.leg import gyro_reading, push_off, quantised, samples_late
from fieldmodels.machines.heel_strike.walker import (
    AGENT,
    BANK,
    COLLISION_NOISE,
    EKF,
    FLOOR,
    HISTORY,
    IMM,
    INNOVATION,
    RANGER,
    RANGER_TUNED,
    SWITCH,
    TORQUE,
)
from fieldmodels.streams import GAMMA, mixed, uniform

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


@inlined
def push_all(w: Any, share: float, c: Any, use_bank: bool) -> None:
    """What the latest strike left to do: the reset that the agent chose, and the push-off on all."""
    w.agent_theta = reset(w.agent_theta, w.geometry, share)
    if w.stride > 0:
        w.omega = push_off(w.omega, c.speed, c.push_off)
        w.agent_omega = push_off(w.agent_omega, c.speed, c.push_off)
        w.ranger_gyro = push_off(w.ranger_gyro, c.speed, c.push_off)
        kalman.strike(w.ekf, c.speed, c.push_off, c.levels[BANK, 3])
        if use_bank:
            for m in range(BANK):
                kalman.strike(w.bank[m], c.speed, c.push_off, c.levels[m, 3])


@inlined
def filter_gyro(f: FloatArray, gyro: float, envelope: float, own: FloatArray, c: Any) -> float:
    """Let a filter, given its own levels of noise, take in a reading; returns its log-likelihood."""
    sines = sine_and_cosine(kalman.middle(f, c.step))
    kalman.predict(f, sines, c.step, c.stiffness, c.torque_memory, own[0], c.correlation, own[1])
    innovation, variance = kalman.update_gyro(f, gyro, envelope, c.gyro_variance)
    return kalman.log_likelihood(innovation, variance)


@inlined
def sense(s: Any, m: int, w: Any, plant: Any, extended: bool, sensors: Signals | None) -> float:
    """What the gyro of a lane's walker reads, with effects [rad/s]."""
    b, sample, step = s.walker[m], s.sample[m], s.step[m]
    gyro: float = s.omega[m]
    if extended:
        whole, part = samples_late(plant, step)
        w.history[sample % HISTORY] = gyro
        newer, older = w.history[(sample - whole) % HISTORY], w.history[(sample - whole - 1) % HISTORY]
        gyro = gyro_reading(newer, older, part, sample * step, plant)
    gyro += s.error[m]
    if extended:
        gyro = quantised(gyro, plant)
    if sensors is not None:
        gyro = show(sensors, b, GYRO_SHOWN, gyro, sample * step, step)
    return gyro


@inlined
def follow_bank(s: Any, m: int, w: Any, c: Any, log_weights: FloatArray) -> None:
    """Let a walker's bank of filters follow the gyro of its lane, and add up their log-likelihoods."""
    for k in range(BANK):
        log_weights[k] += filter_gyro(w.bank[k], s.gyro[m], s.fade[m], c.levels[k], c)


@inlined
def keep_sample(s: Any, m: int, w: Any, row: FloatArray) -> None:
    """Write the sample of a lane into a row of its trace, shape (8,)."""
    row[0], row[1], row[2], row[3] = s.sample[m] * s.step[m], s.theta[m], s.omega[m], s.gyro[m]
    row[4], row[5] = s.agent_theta[m], w.ranger_theta + s.swung[m]
    row[6], row[7] = s.ekf[0, m], s.torque[m]


@inlined
def floor_error(w: Any, c: Any) -> float:
    """Height error of the floor at the strike [rad]."""
    floor: float = c.floor[w.floor_level]
    draw = uniform(w.keys[FLOOR], w.stride)
    return floor * (draw if c.floor_one_sided else 2.0 * draw - 1.0)


@inlined
def bank_estimate(w: Any, geometry: float, c: Any, log_weights: FloatArray) -> float:
    """Angle that the bank of filters gives at a strike [rad]; then it takes in the geometry and mixes."""
    kalman.reweight(w.weights, log_weights)
    estimate = 0.0
    for m in range(BANK):
        estimate += w.weights[m] * w.bank[m, 0]
    for m in range(BANK):
        innovation, variance = kalman.update_angle(w.bank[m], geometry, c.levels[m, 2])
        log_weights[m] = kalman.log_likelihood(innovation, variance)
    kalman.reweight(w.weights, log_weights)
    kalman.mix(w.bank, w.weights, c.transition)
    return estimate


@inlined
def strike(
    s: Any, m: int, b: int, w: Any, sensors: Signals | None, c: Any, use_bank: bool,
    log_weights: FloatArray, errors: FloatArray,
) -> float:  # fmt: skip
    """Score all estimators at a strike, before their reset; returns the floor's height error [rad]."""
    w.ranger_theta += s.swung[m]
    w.tuned_theta += s.swung[m]
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
        errors[IMM] = bank_estimate(w, w.geometry, c, log_weights) - w.theta
    for e in range(len(errors)):
        errors[e] *= c.millimetres
    w.ranger_theta = reset(w.ranger_theta, w.geometry, c.ranger_reset)
    w.tuned_theta = reset(w.tuned_theta, w.geometry, c.tuned_reset)
    innovation, _ = kalman.update_angle(w.ekf, w.geometry, c.levels[BANK, 2])
    remember(w.features, INNOVATION, innovation * innovation)
    remember(w.features, TORQUE, s.torque_square[m] / max(s.taken[m] - c.envelope, 1))
    remember(w.features, COLLISION_NOISE, s.collision_square[m] / min(s.taken[m], c.envelope))
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
    room: NDArray[Any],
) -> None:
    """Take every walker from just after one strike to the first sample after the next.

    First the agent's reset and the push-off of the latest strike are applied; then the leg swings; at the
    next strike all estimators are scored before their reset. A lane whose walker has struck takes in the next
    one. See ``Strides.advance`` for the arrays; ``room``, which is empty, has a dtype of ``lanes.room_for``.
    """
    swings = np.zeros(1, room.dtype)
    swings[0].walker[:] = NONE
    lanes = len(swings[0].walker)
    traced = traces.shape[1] > 0
    plain = not (use_bank or traced or extended.any() or sensors is not None)
    log_weights = np.zeros((lanes, BANK))
    entered, left = 0, 0
    while left < len(walkers):
        s = swings[0]  # here, so that the array lives as long as the loop
        for m in range(lanes):
            b = s.walker[m]
            if b != NONE:
                draw_ahead(s, m, walkers[b], walks[b])
            elif entered < len(walkers):
                w, c = walkers[entered], walks[entered]
                read_levels(w, regimes[entered, 0])
                push_all(w, gains[entered, 2], c, use_bank)
                enter(s, m, entered, w, gains[entered], plants[entered].length, c)
                entered += 1
        if plain:
            swing(s, plants)
        else:
            prepare(s)
            for m in range(lanes):
                b = s.walker[m]
                if b != NONE:
                    move(s, m, m + 1, plants[b], extended[b])
                    s.gyro[m] = sense(s, m, walkers[b], plants[b], extended[b], sensors)
            follow(s)
            for m in range(lanes):
                b = s.walker[m]
                if b != NONE and use_bank:
                    follow_bank(s, m, walkers[b], walks[b], log_weights[m])
                if b != NONE and traced:
                    keep_sample(s, m, walkers[b], traces[b, s.taken[m] - 1])
        for m in range(lanes):
            b = s.walker[m]
            if b != NONE and s.over[m] > 0:
                w, c = walkers[b], walks[b]
                leave(s, m, w)
                height = strike(s, m, b, w, sensors, c, use_bank, log_weights[m], errors[b])
                floors[b] = height * c.millimetres
                samples[b] = s.taken[m]
                duration[b] = s.taken[m] * c.step
                fallen[b] = s.struck[m] == 0
                switch_regimes(w, c)
                read_levels(w, regimes[b, 1])
                w.stride += 1
                left += 1
