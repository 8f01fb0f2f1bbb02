"""Predicting windows of measured walks: the kinematic plant relative to its line, batched."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled, inlined
from fieldmodels.machines.line_following.plant import (
    CAMERA_YAW,
    MEMORY,
    PITCH_ERROR,
    SLIP_STEP,
    measured,
    turn_of,
)
from fieldmodels.machines.line_following.sensor import NODES, Optics

STRAIGHT = 1e-9
"""Curvature below which a line counts as straight [1/m]."""


@inlined
def follow(offset: float, misalignment: float, length: float, curvature: float) -> tuple[float, float]:
    """Offset and misalignment against a circle after a straight piece of way."""
    ahead, aside = length * math.cos(misalignment), length * math.sin(misalignment)
    if abs(curvature) < STRAIGHT:
        return offset + aside, misalignment
    radius = 1.0 / curvature
    toward = radius - offset - aside
    return (
        radius - math.copysign(math.hypot(toward, ahead), radius),
        misalignment - math.atan2(ahead * math.copysign(1.0, radius), abs(toward)),
    )


@inlined
def seen(
    offset: float, misalignment: float, near: float, far: float, stride: float,
    plant: FloatArray, height: float, optics: Optics,
) -> float:  # fmt: skip
    """Where the line appears in the band [m], for a line that bends by ``near``, a stride on by ``far``."""
    heading = misalignment + plant[CAMERA_YAW]
    cosine, sine = math.cos(heading), math.sin(heading)
    pitch = optics.pitch + plant[PITCH_ERROR]
    down, level = math.sin(pitch), math.cos(pitch)
    total = 0.0
    moment = 0.0
    for k in range(NODES):
        slope = (optics.nodes[k] - optics.middle) / optics.focal
        drop = down + slope * level
        if drop <= 1e-3:
            continue
        depth = height / drop
        ahead = depth * (level - slope * down)
        # the line in its own frame: y = bend(x); the robot stands at (0, offset)
        place = -(offset + ahead * sine) / cosine
        for _ in range(3):
            x = ahead * cosine - place * sine
            beyond = max(x - stride, 0.0)
            bend = 0.5 * near * x * x + 0.5 * (far - near) * beyond * beyond
            place = (bend - offset - ahead * sine) / cosine
        weight = optics.weights[k] / depth
        total += weight
        moment += weight * optics.focal * place / depth
    return moment / max(total, 1e-12) * optics.scale


@compiled
def simulate(
    parameters: FloatArray, steering: FloatArray, curvature: FloatArray, first: NDArray[np.int64],
    last: NDArray[np.int64], force: FloatArray, starts: NDArray[np.int64], lengths: NDArray[np.int64],
    states: FloatArray, optics: Optics, limit: float, out: FloatArray,
) -> None:  # fmt: skip
    """Predict every window with every parameter vector.

    Args:
        parameters: Stride [m], camera height [m], then the plant's; shape (batch, 13).
        steering: Commanded turns of the recording [rad], shape (n,).
        curvature: The line's curvature [1/m], shape (n,).
        first: First sample of each sample's episode, shape (n,).
        last: Last sample of each sample's episode, shape (n,).
        force: Turn that is added in each stride [rad], shape (n,), or empty.
        starts: First sample of each window.
        lengths: Samples of each window.
        states: Offset [m] and misalignment [rad] at each window's start.
        optics: The camera's constants, for its nominal height.
        limit: Largest turn of a stride [rad].
        out: Filled with line [m], offset [m], heading [rad]; shape (batch, windows, samples, 3).
    """
    commands = np.zeros(MEMORY)
    for p in range(len(parameters)):
        length, height = parameters[p, 0], parameters[p, 1]
        plant = parameters[p, 2:]
        stride = length * (1.0 - plant[SLIP_STEP])
        for w in range(len(starts)):
            offset, misalignment = states[w, 0], states[w, 1]
            for k in range(lengths[w]):
                i = starts[w] + k
                near, far = curvature[i], curvature[min(i + 1, last[i])]
                place = seen(offset, misalignment, near, far, stride, plant, height, optics)
                out[p, w, k, 0] = measured(place, plant)
                out[p, w, k, 1] = offset
                out[p, w, k, 2] = misalignment
                for m in range(MEMORY):
                    commands[m] = steering[i - m] if i - m >= first[i] else 0.0
                turn = turn_of(commands, plant, 0.0, limit)
                if len(force):
                    turn += force[i]
                offset, misalignment = follow(offset, misalignment, stride, near)
                misalignment += turn
