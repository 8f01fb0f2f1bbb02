"""One walker's state, and the kernel that takes walkers through one stride each."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled, inlined
from fieldmodels.machines.heel_strike import kalman
from fieldmodels.machines.heel_strike.estimators import observer_step, ranger_step, reset
from fieldmodels.machines.heel_strike.parameters import Leg, Noise, Regimes
from fieldmodels.machines.heel_strike.truth import (
    DELAY,
    HISTORY,
    LENGTH,
    QUANTUM,
    delayed,
    extended_step,
    push_off,
    quantised,
    sensed,
    truth_step,
)
from fieldmodels.streams import GAMMA, gaussian, mixed, symmetric, uniform

ESTIMATORS = ("agent", "ranger", "ranger_tuned", "ekf", "imm")
FEATURES = (
    "log innovation^2",
    "log innovation^2, smoothed",
    "log torque^2",
    "log torque^2, smoothed",
    "log collision^2",
    "log collision^2, smoothed",
)
TRACES = ("time", "theta", "omega", "gyro", "theta_agent", "theta_ranger", "theta_ekf", "torque")
BANK = 8
SMOOTHING = 0.7
GYRO, COLLISION, PROCESS, FLOOR, SWITCH = range(5)

WALKER = np.dtype(
    [
        ("keys", np.uint64, (5,)),  # one random stream a noise
        ("sample", np.int64),  # samples since the start
        ("stride", np.int64),  # strides since the start
        ("process_level", np.int64),  # hidden regimes: 0 low, 1 high
        ("floor_level", np.int64),
        ("collision_level", np.int64),
        ("theta", np.float64),  # truth [rad]
        ("omega", np.float64),  # truth, before the push-off of a pending strike [rad/s]
        ("torque", np.float64),  # process torque per inertia [rad/s2]
        ("geometry", np.float64),  # angle that the geometry gave at the latest strike [rad]
        ("history", np.float64, (HISTORY,)),  # past speeds, for a delayed gyro
        ("agent_theta", np.float64),
        ("agent_omega", np.float64),
        ("ranger_theta", np.float64),
        ("tuned_theta", np.float64),
        ("ranger_gyro", np.float64),
        ("ekf", np.float64, (kalman.ROW,)),
        ("bank", np.float64, (BANK, kalman.ROW)),
        ("weights", np.float64, (BANK,)),
        ("features", np.float64, (len(FEATURES),)),
    ]
)
"""All that a walker remembers between strides; a copy of the array is an exact snapshot."""


class Constants(NamedTuple):
    """Leg and noise as the kernels take them; lengths of time in samples, heights as angles."""

    step: float
    stiffness: float
    gravity: float
    millimetres: float
    speed: float
    share: float
    limit: int
    gyro: float
    memory: float
    drive: float
    first: float
    envelope: int
    hold: int
    one_sided: bool
    process_low: float
    process_high: float
    floor_low: float
    floor_high: float
    collision_low: float
    collision_high: float
    switch: float
    gyro_variance: float
    torque_memory: float
    cromer: bool
    ranger_reset: float
    tuned_reset: float


def make_constants(
    leg: Leg, regimes: Regimes, cromer: bool, ranger_reset: float, tuned_reset: float
) -> Constants:
    """Put leg and noise into the units of the kernels."""
    noise = regimes.noise
    return Constants(
        step=leg.step,
        stiffness=leg.gravity / leg.length,
        gravity=leg.gravity,
        millimetres=1000 * leg.step_length,
        speed=leg.speed,
        share=leg.push_off,
        limit=round(leg.limit / leg.step),
        gyro=noise.gyro,
        memory=noise.correlation,
        drive=noise.collision_drive,
        first=noise.collision_first,
        envelope=max(1, round(noise.envelope / leg.step)),
        hold=max(1, round(noise.hold / leg.step)),
        one_sided=noise.floor_one_sided,
        process_low=regimes.process[0],
        process_high=regimes.process[1],
        floor_low=regimes.floor[0] / leg.step_length,
        floor_high=regimes.floor[1] / leg.step_length,
        collision_low=regimes.collision[0],
        collision_high=regimes.collision[1],
        switch=1 / regimes.dwell,
        gyro_variance=max(noise.gyro, 1e-6) ** 2,
        torque_memory=math.exp(-2 * leg.step / noise.hold),
        cromer=cromer,
        ranger_reset=ranger_reset,
        tuned_reset=tuned_reset,
    )


def filter_levels(leg: Leg, noise: Noise, process: float, floor: float, collision: float) -> FloatArray:
    """Variances that a Kalman filter is told for one set of noise levels.

    A torque of amplitude A held for T has variance A^2/3 and the correlation area of a Gauss-Markov process
    with time constant T/2.

    Returns:
        Driving variance of the torque, of the collision noise, variance of the geometry's angle, and
        variance of the collision noise at its start.
    """
    memory = math.exp(-2 * leg.step / noise.hold)
    return np.array(
        [
            (1 - memory**2) * process**2 / 3,
            (noise.collision_drive * collision) ** 2 / 3,
            max(floor / leg.step_length, 1e-6) ** 2 / 3,
            (noise.collision_first * collision) ** 2 / 3,
        ]
    )


def bank_levels(leg: Leg, regimes: Regimes) -> FloatArray:
    """What the filters are told: one row for each of the eight regimes, then the typical one, shape (9, 4).

    Regime number: 4 * process + 2 * floor + collision. The typical filter, the reference, takes the
    geometric mean of each pair of levels.
    """
    rows = [
        filter_levels(leg, regimes.noise, regimes.process[p], regimes.floor[f], regimes.collision[c])
        for p in (0, 1)
        for f in (0, 1)
        for c in (0, 1)
    ]
    typical = [math.sqrt(low * high) for low, high in (regimes.process, regimes.floor, regimes.collision)]
    return np.array([*rows, filter_levels(leg, regimes.noise, *typical)])


def bank_transition(regimes: Regimes) -> FloatArray:
    """Probability that regime i (row) becomes regime j (column) at a strike, shape (8, 8)."""
    p = 1 / regimes.dwell
    one = np.array([[1 - p, p], [p, 1 - p]])
    return np.kron(one, np.kron(one, one))


@inlined
def start_filter(f: FloatArray, speed: float, levels: FloatArray, c: Constants) -> None:
    """Start a filter in the known state, with the torque at its stationary spread."""
    f[:] = 0.0
    f[1] = speed
    f[11] = levels[0] / (1.0 - c.torque_memory**2)
    f[13] = levels[3]


@compiled
def start(walkers: NDArray[Any], i: int, key: np.uint64, c: Constants, levels: FloatArray) -> None:
    """Put walker ``i`` upright at the nominal speed, just after a strike, with streams from ``key``."""
    w = walkers[i]
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
    w.features[0] = math.log(levels[BANK, 2] + 1e-12)
    w.features[2] = math.log(w.ekf[11] + 1e-12)
    w.features[4] = math.log(levels[BANK, 1] + 1e-12)
    w.features[1], w.features[3], w.features[5] = w.features[0], w.features[2], w.features[4]


@inlined
def remember(features: FloatArray, position: int, square: float) -> None:
    """Put the log of a squared quantity into the features: latest, and exponentially smoothed."""
    value = math.log(square + 1e-12)
    features[position] = value
    features[position + 1] = SMOOTHING * features[position + 1] + (1.0 - SMOOTHING) * value


@compiled
def advance(
    walkers: NDArray[Any],
    gains: FloatArray,
    realities: FloatArray,
    extended: bool,
    c: Constants,
    levels: FloatArray,
    transition: FloatArray,
    use_bank: bool,
    errors: FloatArray,
    floors: FloatArray,
    samples: NDArray[np.int64],
    fallen: NDArray[np.bool_],
    traces: FloatArray,
) -> None:
    """Take every walker from just after one strike to the first sample after the next.

    First the agent's reset and the push-off of the latest strike are applied; then the leg swings; at the
    next strike all estimators are scored before their reset. See ``Strides.advance`` for the arrays.
    """
    log_weights = np.empty(BANK)
    tracing = traces.shape[1] > 0
    for b in range(len(walkers)):
        w = walkers[b]
        reality = realities[b]
        stiffness = c.gravity / reality[LENGTH]
        ekf, bank, weights, history = w.ekf, w.bank, w.weights, w.history
        gyro_key, collision_key, process_key = w.keys[GYRO], w.keys[COLLISION], w.keys[PROCESS]
        process = c.process_high if w.process_level == 1 else c.process_low
        collision = c.collision_high if w.collision_level == 1 else c.collision_low
        floor = c.floor_high if w.floor_level == 1 else c.floor_low
        q_torque, q_collision, r_floor = levels[BANK, 0], levels[BANK, 1], levels[BANK, 2]
        early, late, decay = gains[b, 0], gains[b, 1], gains[b, 3]
        theta, torque, sample = w.theta, w.torque, w.sample
        # What the latest strike left to do: the reset that the agent chose, and the push-off on all.
        agent_theta = reset(w.agent_theta, w.geometry, gains[b, 2])
        omega = push_off(w.omega, c.speed, c.share) if w.stride > 0 else w.omega
        agent_omega = push_off(w.agent_omega, c.speed, c.share) if w.stride > 0 else w.agent_omega
        ranger_gyro = push_off(w.ranger_gyro, c.speed, c.share) if w.stride > 0 else w.ranger_gyro
        swung = 0.0
        if w.stride > 0:
            kalman.strike(ekf, c.speed, c.share, levels[BANK, 3])
            if use_bank:
                for m in range(BANK):
                    kalman.strike(bank[m], c.speed, c.share, levels[m, 3])
        noise = c.first * symmetric(collision_key, -1 - w.stride)
        log_weights[:] = 0.0
        torque_square, collision_square = 0.0, 0.0
        n = 0
        struck = False
        while not struck and n < c.limit:
            if sample % c.hold == 0:
                torque = process * symmetric(process_key, sample // c.hold)
            before = theta
            if extended:
                theta, omega = extended_step(
                    theta, omega, torque, sample * c.step, c.step, stiffness, reality
                )
            else:
                theta, omega = truth_step(theta, omega, torque, c.step, stiffness)
            sample += 1
            n += 1
            noise = c.memory * noise + c.drive * symmetric(collision_key, sample)
            envelope = max(0.0, 1.0 - n / c.envelope)
            white = c.gyro * gaussian(gyro_key, sample)
            gyro = omega
            if extended:
                history[sample % HISTORY] = omega
                gyro = sensed(delayed(history, sample, reality[DELAY], c.step), sample * c.step, reality)
            gyro += envelope * collision * noise + white
            if extended:
                gyro = quantised(gyro, reality[QUANTUM])
            agent_theta, agent_omega = observer_step(
                agent_theta,
                agent_omega,
                gyro,
                c.step,
                c.stiffness,
                early if n <= c.envelope else late,
                decay,
                c.cromer,
            )
            swung = ranger_step(swung, ranger_gyro, gyro, c.step)
            ranger_gyro = gyro
            kalman.predict(ekf, c.step, c.stiffness, c.torque_memory, q_torque, c.memory, q_collision)
            kalman.update_gyro(ekf, gyro, envelope, c.gyro_variance)
            if n <= c.envelope:
                collision_square += ekf[3] * ekf[3]
            else:
                torque_square += ekf[2] * ekf[2]
            if use_bank:
                for m in range(BANK):
                    f = bank[m]
                    kalman.predict(
                        f, c.step, c.stiffness, c.torque_memory, levels[m, 0], c.memory, levels[m, 1]
                    )
                    innovation, variance = kalman.update_gyro(f, gyro, envelope, c.gyro_variance)
                    log_weights[m] += kalman.log_likelihood(innovation, variance)
            if tracing:
                row = traces[b, n - 1]
                row[0], row[1], row[2], row[3] = sample * c.step, theta, omega, gyro
                row[4], row[5], row[6], row[7] = agent_theta, w.ranger_theta + swung, ekf[0], torque
            struck = (before < 0.0 <= theta) or (before > 0.0 >= theta)
        w.ranger_theta += swung
        w.tuned_theta += swung
        draw = uniform(w.keys[FLOOR], w.stride)
        height = floor * (draw if c.one_sided else 2.0 * draw - 1.0)
        geometry = theta + height
        errors[b, 0] = agent_theta - theta
        errors[b, 1] = w.ranger_theta - theta
        errors[b, 2] = w.tuned_theta - theta
        errors[b, 3] = ekf[0] - theta
        errors[b, 4] = np.nan
        if use_bank:
            kalman.reweight(weights, log_weights)
            estimate = 0.0
            for m in range(BANK):
                estimate += weights[m] * bank[m, 0]
            errors[b, 4] = estimate - theta
            for m in range(BANK):
                innovation, variance = kalman.update_angle(bank[m], geometry, levels[m, 2])
                log_weights[m] = kalman.log_likelihood(innovation, variance)
            kalman.reweight(weights, log_weights)
            kalman.mix(bank, weights, transition)
        w.ranger_theta = reset(w.ranger_theta, geometry, c.ranger_reset)
        w.tuned_theta = reset(w.tuned_theta, geometry, c.tuned_reset)
        innovation, _ = kalman.update_angle(ekf, geometry, r_floor)
        remember(w.features, 0, innovation * innovation)
        remember(w.features, 2, torque_square / max(n - c.envelope, 1))
        remember(w.features, 4, collision_square / min(n, c.envelope))
        for e in range(5):
            errors[b, e] *= c.millimetres
        floors[b] = height * c.millimetres
        samples[b] = n
        fallen[b] = not struck
        # The regimes of the next stride.
        if uniform(w.keys[SWITCH], 3 * w.stride) < c.switch:
            w.process_level = 1 - w.process_level
        if uniform(w.keys[SWITCH], 3 * w.stride + 1) < c.switch:
            w.floor_level = 1 - w.floor_level
        if uniform(w.keys[SWITCH], 3 * w.stride + 2) < c.switch:
            w.collision_level = 1 - w.collision_level
        w.theta, w.omega, w.torque, w.sample = theta, omega, torque, sample
        w.agent_theta, w.agent_omega, w.ranger_gyro = agent_theta, agent_omega, ranger_gyro
        w.geometry = geometry
        w.stride += 1
