"""The kernel of shaken vehicles: one decision of every experiment, moved, sensed and turned into features."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import allocation_free, allocation_free_inlined, compiled, inlined
from fieldmodels.drivers.stepped import Signals, give
from fieldmodels.machines.excitation import lanes
from fieldmodels.machines.excitation.dynamics import GRAVITY, SUBSTEPS, advance_mode
from fieldmodels.machines.excitation.lanes import BESIDE, advance_modes
from fieldmodels.machines.excitation.motion import (
    CONSTANT,
    OFFSET,
    attainable,
    fill_motion,
    lag_motion,
    phase_after,
)
from fieldmodels.machines.excitation.parameters import MODES, RUNNING, SAMPLE, SAMPLES
from fieldmodels.machines.excitation.regression import (
    ANGLE,
    FEATURES,
    POSITION,
    RATE,
    SIGNALS,
    VELOCITY,
    add_feature_noise,
    fill_features,
)
from fieldmodels.machines.excitation.sensor_effects import compensate, measure_raw, show_raw
from fieldmodels.machines.excitation.sensors import corrupt, first_draw
from fieldmodels.machines.excitation.vectors import copy_to

BASE = 12
"""Numbers of a measured base state: dr, dr', dtheta, w, each x, y, z."""


@lru_cache
def room_for(batch: int) -> np.dtype[Any]:
    """Room for a decision: the arms' motion as commanded and as one lags, the command that is followed.

    Kept, since to tell a kernel's type from a new dtype takes longer than a tenth of a decision.
    """
    beside = BESIDE if batch > 1 else 1
    return np.dtype([
        ("paths", np.float64, (beside, SAMPLES * SUBSTEPS + 1, 3)),
        ("late", np.float64, (1, SAMPLES * SUBSTEPS + 1, 3)),
        ("following", np.float64, (3,)),
        ("lanes", lanes.room_for(beside)),
    ])  # fmt: skip


class Experiments(NamedTuple):
    """State of a batch of experiments.

    Attributes:
        vehicles: Numbers of vehicle, arm and sensors, shape (batch,), dtype ``ROW``.
        sensing: Which of them have an effect of the sensors, shape (batch,).
        keys: Random streams, shape (batch,).
        counts: Samples so far, shape (batch,).
        command: Command in force, shape (batch, 3).
        phase: Phase of the arm [rad], shape (batch,).
        states: States of the modes, shape (batch, 3, 24).
        maxima: Maximum sensed values, shape (batch, 3, 24).
        base: Measured base state at the latest sample, shape (batch, 3, 12).
        arm_motion: f, f', f'' of a lagging arm, shape (batch, 3).
        history: Latest turns for a late inclinometer, shape (batch, 3, 41, 9), or (batch, 3, 0, 9).
    """

    vehicles: NDArray[Any]
    sensing: NDArray[np.bool_]
    keys: NDArray[np.uint64]
    counts: NDArray[np.int64]
    command: FloatArray
    phase: FloatArray
    states: FloatArray
    maxima: FloatArray
    base: FloatArray
    arm_motion: FloatArray
    history: FloatArray


class Around(NamedTuple):
    """Stock effects around a batch of experiments.

    Attributes:
        arm: Of the arm's commanded angle.
        sensors: Of the outputs of all modes.
        given: The latest f, f', f'' that they make of the command, shape (batch, 3).
        senses: Whether any is around a sensor.
    """

    arm: Signals
    sensors: Signals
    given: FloatArray
    senses: bool


@inlined
def give_path(around: Around, b: int, time: float, path: FloatArray) -> None:
    """Let stock effects act on the angle that is commanded along a decision, in place.

    Its derivatives are taken by differences, to second order; where the decision began they go on.
    """
    arm, h, last = around.arm, SAMPLE / SUBSTEPS, len(path) - 1
    begins = arm.counts[b, 0] == 0
    path[0, 0] = give(arm, b, 0, path[0, 0], time, h) if begins else around.given[b, 0]
    for i in range(1, last + 1):
        path[i, 0] = give(arm, b, 0, path[i, 0], time + i * h, h)
    for i in range(1, last):
        path[i, 1] = (path[i + 1, 0] - path[i - 1, 0]) / (2.0 * h)
        path[i, 2] = (path[i + 1, 0] - 2.0 * path[i, 0] + path[i - 1, 0]) / (h * h)
    for end, step in ((0, 1), (last, -1)):
        f0, f1, f2, f3 = path[end, 0], path[end + step, 0], path[end + 2 * step, 0], path[end + 3 * step, 0]
        path[end, 1] = step * (-3.0 * f0 + 4.0 * f1 - f2) / (2.0 * h)
        path[end, 2] = (2.0 * f0 - 5.0 * f1 + 4.0 * f2 - f3) / (h * h)
    if not begins:
        copy_to(path[0], around.given[b])
    copy_to(around.given[b], path[last])


@allocation_free_inlined
def move_arm(
    e: Experiments,
    b: int,
    around: Around | None,
    wanted: FloatArray,
    acceleration: float,
    path: FloatArray,
    following: FloatArray,
) -> None:
    """Move experiment ``b``'s arm towards a command, along ``path``; ``following`` is the one it follows."""
    attainable(e.command[b], e.phase[b], wanted, acceleration, following)
    fill_motion(e.command[b], e.phase[b], following, path)
    e.phase[b] = phase_after(e.phase[b], e.command[b], following)
    copy_to(e.command[b], following)
    if around is not None:  # noqa: SIM102 - compiled: without any, the rest is left out
        if around.arm.on[b, 0]:
            give_path(around, b, e.counts[b] * SAMPLE, path)


@allocation_free_inlined
def keep_motion(path: FloatArray, b: int, motion: FloatArray) -> None:
    """The arm's motion at the samples of a decision, where it is asked for."""
    if len(motion) > 0:
        for k in range(SAMPLES + 1):
            copy_to(motion[b, k], path[k * SUBSTEPS])


@inlined
def raise_maxima(signals: FloatArray, k: int, maxima: FloatArray) -> None:
    """Let the maximum sensed values, shape (3, 24), follow sample ``k`` of the signals, shape (3, n, 24)."""
    for mode in range(MODES):
        for i in range(SIGNALS):
            size = abs(signals[mode, k, i])
            for other in range(MODES):
                if size > maxima[other, i]:
                    maxima[other, i] = size


@inlined
def keep_base(measured: FloatArray, base: FloatArray) -> None:
    """The measured base state of a sample, shape (12,)."""
    for i in range(3):
        base[i], base[3 + i] = measured[POSITION + i], measured[VELOCITY + i]
        base[6 + i], base[9 + i] = measured[ANGLE + i], measured[RATE + i]


@inlined
def sense(
    e: Experiments,
    b: int,
    p: Any,
    gravity: float,
    signals: FloatArray,
    features: FloatArray,
    noise: FloatArray,
    measured: FloatArray,
    variance: FloatArray,
) -> None:
    """Measure a decision's signals, shape (3, 80, 24), with noise, and turn them into features.

    The last two are overwritten: signals of a sample and their noise's variances, shape (24,).
    """
    for mode in range(MODES):
        for i in range(FEATURES):
            for k in range(FEATURES):
                noise[mode, i, k] = 0.0
    running, fraction, maxima = p.noise == RUNNING, p.noise_fraction, e.maxima[b]
    for k in range(SAMPLES):
        if running:
            raise_maxima(signals, k, maxima)
        for mode in range(MODES):
            counter = first_draw(e.counts[b] + k, mode)
            corrupt(signals[mode, k], maxima[mode], fraction, e.keys[b], counter, measured)
            for i in range(SIGNALS):
                size = fraction * maxima[mode, i]
                variance[i] = size * size / 3.0
            fill_features(measured, variance, gravity, features[mode, k])
            add_feature_noise(measured, variance, gravity, noise[mode])
            if k == SAMPLES - 1:
                keep_base(measured, e.base[b, mode])


@allocation_free
def advance(
    e: Experiments,
    rules: NDArray[Any],
    arm: FloatArray,
    around: Around | None,
    wanted: FloatArray,
    signals: FloatArray,
    motion: FloatArray,
    room: NDArray[Any],
) -> None:
    """Move the arms and the vehicles under them, none of which has an effect: several go side by side.

    Fills the true signals, shape (batch, 3, 80, 24); ``room``, of a dtype of ``room_for``, is overwritten.
    """
    paths, following, beside = room[0].paths, room[0].following, room[0].lanes
    for first in range(0, len(wanted), len(paths)):
        end = first + len(paths) if first + len(paths) < len(wanted) else len(wanted)
        for b in range(first, end):
            move_arm(e, b, around, wanted[b], rules[b].acceleration, paths[b - first], following)
            keep_motion(paths[b - first], b, motion)
        advance_modes(
            e.vehicles[first:end], arm, paths[: end - first], CONSTANT[OFFSET], SAMPLE, SUBSTEPS,
            e.states[first:end], signals[first:end], beside,
        )  # fmt: skip


@compiled
def advance_odd(
    e: Experiments,
    rules: NDArray[Any],
    arm: FloatArray,
    around: Around | None,
    wanted: FloatArray,
    signals: FloatArray,
    motion: FloatArray,
    room: NDArray[Any],
) -> None:
    """``advance`` where a vehicle has an effect: each mode by itself, and an arm may lag."""
    path, following, late = room[0].paths[0], room[0].following, room[0].late[0]
    for b in range(len(wanted)):
        q, time, moved = e.vehicles[b], e.counts[b] * SAMPLE, path
        move_arm(e, b, around, wanted[b], rules[b].acceleration, path, following)
        if q.actuator_lag.time_constant > 0.0:
            copy_to(late[0], e.arm_motion[b])
            lag_motion(path, SAMPLE / SUBSTEPS, q.actuator_lag.time_constant, late)
            copy_to(e.arm_motion[b], late[-1])
            moved = late
        for mode in range(MODES):
            advance_mode(
                q, arm, mode, moved, CONSTANT[OFFSET], SAMPLE, SUBSTEPS, time, e.states[b, mode],
                signals[b, mode],
            )  # fmt: skip
        keep_motion(moved, b, motion)


@compiled
def show(e: Experiments, gravity: float, around: Around | None, signals: FloatArray) -> None:
    """Let the sensors' effects act on the signals of those experiments that have any, in place."""
    for b in range(len(signals)):
        erring = e.sensing[b]
        if around is not None:
            erring = erring or around.senses
        if erring:
            for mode in range(MODES):
                measure_raw(e.vehicles[b], gravity, e.history[b, mode], signals[b, mode])
                if around is not None:
                    show_raw(around.sensors, b, mode, e.counts[b] * SAMPLE, signals[b, mode])
                compensate(gravity, signals[b, mode])


@allocation_free
def measure(
    e: Experiments,
    rules: NDArray[Any],
    gravity: float,
    signals: FloatArray,
    features: FloatArray,
    noise: FloatArray,
    room: FloatArray,
) -> None:
    """Sense what the sensors show, and count the samples; ``room``, (2, 24), is overwritten."""
    for b in range(len(signals)):
        sense(e, b, rules[b], gravity, signals[b], features[b], noise[b], room[0], room[1])
        e.counts[b] += SAMPLES


def shake(
    e: Experiments,
    rules: NDArray[Any],
    arm: FloatArray,
    around: Around | None,
    odd: bool,
    wanted: FloatArray,
    signals: FloatArray,
    features: FloatArray,
    noise: FloatArray,
    motion: FloatArray,
    bodies: FloatArray,
) -> None:
    """Advance every experiment by one decision, in place.

    Args:
        e: The experiments.
        rules: What is shaken and sensed in each, see ``shaker.kernel_rules``, shape (batch,).
        arm: ``Arm.row()``, shape (5,).
        around: Stock effects around them, or None.
        odd: Whether a vehicle has an effect; where none has, the modes go side by side.
        wanted: Commands that the agents want, shape (batch, 3).
        signals: Receives what is sensed without noise, shape (batch, 3, 80, 24).
        features: Receives the features, shape (batch, 3, 80, 30).
        noise: Receives the sums of their noise's covariance, shape (batch, 3, 30, 30).
        motion: Receives f, f', f'' of the arm, shape (batch, 81, 3), or (0, 81, 3).
        bodies: Receives true dr and dtheta, shape (batch, 3, 80, 6), with ``motion``.
    """
    move = advance_odd if odd else advance
    move(e, rules, arm, around, wanted, signals, motion, np.empty(1, room_for(len(wanted))))
    if len(bodies) > 0:
        bodies[..., 0:3] = signals[..., POSITION : POSITION + 3]
        bodies[..., 3:6] = signals[..., ANGLE : ANGLE + 3]
    if e.sensing.any() or (around is not None and around.senses):
        show(e, arm[GRAVITY], around, signals)
    measure(e, rules, arm[GRAVITY], signals, features, noise, np.empty((2, SIGNALS)))
