"""What a walker remembers between strides, and the constants and levels that its kernel takes."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.machines.heel_strike import kalman
from fieldmodels.machines.heel_strike.parameters import Leg, Noise, Regimes

ESTIMATORS = ("agent", "ranger", "ranger_tuned", "ekf", "imm")
AGENT, RANGER, RANGER_TUNED, EKF, IMM = range(len(ESTIMATORS))
FEATURES = (
    "log innovation^2",
    "log innovation^2, smoothed",
    "log torque^2",
    "log torque^2, smoothed",
    "log collision^2",
    "log collision^2, smoothed",
)
INNOVATION, TORQUE, COLLISION_NOISE = (
    FEATURES.index(f"log {name}^2") for name in ("innovation", "torque", "collision")
)
"""Where each quantity's latest value stands among the features; its smoothed one follows."""
TRACES = ("time", "theta", "omega", "gyro", "theta_agent", "theta_ranger", "theta_ekf", "torque")
BANK = 8
HISTORY = 16
"""Past speeds kept for the gyro's delay: more than the longest delay, 20 ms, at 2 ms a sample."""
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
    """Variances that a Kalman filter is given for one set of noise levels.

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
    """What the filters are given: one row for each of the eight regimes, then the typical one, shape (9, 4).

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
