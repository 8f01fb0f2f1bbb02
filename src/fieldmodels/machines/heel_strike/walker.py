"""What a walker remembers between strides, and what it walks with as its kernel reads it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.machines.heel_strike import kalman
from fieldmodels.machines.heel_strike.parameters import CommonNoise, Leg, Regimes
from fieldmodels.settings import Setting, check_declared, kernel_rows

ESTIMATORS = ("agent", "ranger", "ranger_tuned", "ekf", "imm")
AGENT, RANGER, RANGER_TUNED, EKF, IMM = range(len(ESTIMATORS))
LIBRARY = ("ekf_filterpy", "imm_filterpy")
"""The same Kalman filters by the library filterpy; their columns follow those of ``ESTIMATORS``."""
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


@dataclass(frozen=True)
class Walk:
    """What walkers walk with: leg, noise, and the estimators beside the agent's.

    Attributes:
        leg: The nominal leg, which the estimators believe in.
        regimes: The noise.
    """

    leg: Leg = field(default_factory=Leg)
    regimes: Regimes = field(default_factory=Regimes)
    cromer: Annotated[
        bool, Setting("Whether the agent's estimator is integrated by (2.14), not by (2.9).")
    ] = True
    ranger_reset: Annotated[
        float, Setting("Share of the geometry in Ranger's reset (2.3).", least=0, most=1)
    ] = 0.1
    tuned_reset: Annotated[float, Setting("The same of the tuned Ranger.", least=0, most=1)] = 1.0

    def __post_init__(self) -> None:
        """Check the numbers; see ``check_declared``."""
        check_declared(self)


def kernel_walk(walk: Walk, batch: int) -> NDArray[Any]:
    """A walk as the kernels read it, shape (batch,): times in samples, heights as angles."""
    leg, regimes = walk.leg, walk.regimes
    derived = {
        "stiffness": leg.gravity / leg.length,
        "millimetres": 1000 * leg.step_length,
        "limit": round(leg.limit / leg.step),
        "drive": regimes.collision_drive,
        "first": regimes.collision_first,
        "envelope": max(1, round(regimes.envelope / leg.step)),
        "hold": max(1, round(regimes.hold / leg.step)),
        "floor": np.array(regimes.floor) / leg.step_length,
        "collision": np.array(regimes.collision_levels),
        "switch": 1 / regimes.dwell,
        "gyro_variance": max(regimes.gyro, 1e-6) ** 2,
        "torque_memory": math.exp(-2 * leg.step / regimes.hold),
        "levels": bank_levels(leg, regimes),
        "transition": bank_transition(regimes),
    }
    return kernel_rows(walk, batch, derived)


def filter_levels(leg: Leg, noise: CommonNoise, process: float, floor: float, collision: float) -> FloatArray:
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
    collision = regimes.collision_levels
    rows = [
        filter_levels(leg, regimes, regimes.process[p], regimes.floor[f], collision[c])
        for p in (0, 1)
        for f in (0, 1)
        for c in (0, 1)
    ]
    typical = [math.sqrt(low * high) for low, high in (regimes.process, regimes.floor, collision)]
    return np.array([*rows, filter_levels(leg, regimes, *typical)])


def bank_transition(regimes: Regimes) -> FloatArray:
    """Probability that regime i (row) becomes regime j (column) at a strike, shape (8, 8)."""
    p = 1 / regimes.dwell
    one = np.array([[1 - p, p], [p, 1 - p]])
    return np.kron(one, np.kron(one, one))
