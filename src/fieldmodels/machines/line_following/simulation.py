"""Predicting windows of measured walks: the kinematic plant relative to its line, batched."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled, inlined
from fieldmodels.machines.line_following.plant import MEMORY, measured, turn_of
from fieldmodels.machines.line_following.sensor import NODES, Optics

LINE, OFFSET, HEADING = range(3)
"""Outputs of a prediction, in the order of ``LineFollowing.outputs``."""
LEAD = 6
"""Strides before a window that are observed: what was wrong before them is forgotten."""
STRAIGHT = 1e-9
"""Curvature below which a line counts as straight [1/m]."""


@inlined
def follow(
    offset: float, misalignment: float, length: float, left: float, curvature: float
) -> tuple[float, float]:
    """Offset and misalignment against a circle after a straight piece of way, with a slip to the left."""
    cosine, sine = math.cos(misalignment), math.sin(misalignment)
    ahead, aside = length * cosine - left * sine, length * sine + left * cosine
    if abs(curvature) < STRAIGHT:
        return offset + aside, misalignment
    radius = 1.0 / curvature
    toward = radius - offset - aside
    return (
        radius - math.copysign(math.hypot(toward, ahead), radius),
        misalignment - math.atan2(ahead * math.copysign(1.0, radius), abs(toward)),
    )


@inlined
def line_in_view(
    offset: float, misalignment: float, near: float, far: float, stride: float, plant: Any, optics: Optics
) -> float:
    """Where the line appears in the band [m], for a line that bends by ``near``, a stride on by ``far``."""
    heading = misalignment + plant.camera_yaw.angle
    cosine, sine = math.cos(heading), math.sin(heading)
    pitch = optics.pitch + plant.camera_pitch.angle
    down, level = math.sin(pitch), math.cos(pitch)
    total = 0.0
    moment = 0.0
    for k in range(NODES):
        slope = (optics.nodes[k] - optics.middle) / optics.focal
        drop = down + slope * level
        if drop <= 1e-3:
            continue
        depth = plant.camera_height / drop
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


class Log(NamedTuple):
    """What a recording holds, stride by stride.

    Attributes:
        steering: Commanded turns [rad], shape (n,).
        curvature: The line's curvature [1/m], shape (n,).
        first: First sample of each sample's episode, shape (n,).
        last: Last sample of each sample's episode, shape (n,).
        force: Turn [rad], way ahead and to the left [m] added in each stride, shape (n, 3) or (0, 3).
        shown: Line [m], offset [m] and heading [rad] as measured, shape (n, 3) or (0, 3).
    """

    steering: FloatArray
    curvature: FloatArray
    first: NDArray[np.int64]
    last: NDArray[np.int64]
    force: FloatArray
    shown: FloatArray


@inlined
def stride_on(
    offset: float, misalignment: float, stride: float, i: int, log: Log, pushed: bool, commands: FloatArray,
    plant: Any, limit: float,
) -> tuple[float, float]:  # fmt: skip
    """Offset and misalignment after the stride that begins at sample ``i``; ``commands`` is overwritten."""
    for m in range(MEMORY):
        commands[m] = log.steering[i - m] if i - m >= log.first[i] else 0.0
    turn = turn_of(commands, plant, 0.0, limit)
    more = left = 0.0
    if pushed:
        turn, more, left = turn + log.force[i, 0], log.force[i, 1], log.force[i, 2]
    offset, misalignment = follow(offset, misalignment, stride + more, left, log.curvature[i])
    return offset, misalignment + turn


@inlined
def put_right(
    offset: float, misalignment: float, line: float, shown: FloatArray, after: tuple[float, float],
    gain: FloatArray,
) -> tuple[float, float]:  # fmt: skip
    """What a stride ends with, put right by what was measured where it began; a gap leaves it as it is."""
    result = after
    expected = (line, offset, misalignment)
    for j in range(3):
        error = shown[j] - expected[j]
        if not math.isnan(error):
            result = result[0] + gain[0, j] * error, result[1] + gain[1, j] * error
    return result


@inlined
def observed(
    start: int, stride: float, log: Log, gain: FloatArray, commands: FloatArray, plant: Any, limit: float,
    optics: Optics,
) -> tuple[float, float]:  # fmt: skip
    """Offset and misalignment at a sample by an observer of the strides before."""
    i = max(start - LEAD, log.first[start])
    offset, misalignment = log.shown[i, OFFSET], log.shown[i, HEADING]
    while i < start:
        near, far = log.curvature[i], log.curvature[min(i + 1, log.last[i])]
        place = line_in_view(offset, misalignment, near, far, stride, plant, optics)
        after = stride_on(offset, misalignment, stride, i, log, False, commands, plant, limit)
        offset, misalignment = put_right(
            offset, misalignment, measured(place, plant), log.shown[i], after, gain
        )
        i += 1
    return offset, misalignment


@compiled
def simulate(
    plants: NDArray[Any], log: Log, starts: NDArray[np.int64], lengths: NDArray[np.int64],
    states: FloatArray, optics: Optics, limit: float, gain: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Predict every window with every plant.

    Args:
        plants: What walk and camera truly are, shape (batch,), dtype ``PLANT``.
        log: The recording.
        starts: First sample of each window.
        lengths: Samples of each window.
        states: Offset [m] and misalignment [rad] at each window's start.
        optics: The camera's constants, for its nominal height.
        limit: Largest turn of a stride [rad].
        gain: Of an observer, shape (2, 3), whose prediction of every sample rests on all that was measured
            before; without one, shape (0, 3), on each window's start.
        out: Filled with line [m], offset [m], heading [rad]; shape (batch, windows, samples, 3).
    """
    commands = np.zeros(MEMORY)
    for p in range(len(plants)):
        plant = plants[p]
        stride = plant.stride * (1.0 - plant.foot_slip.step)
        for w in range(len(starts)):
            offset, misalignment = states[w, 0], states[w, 1]
            if len(gain) > 0:
                # States that differ from the measured ones move the start likewise.
                before = observed(starts[w], stride, log, gain, commands, plant, limit, optics)
                offset += before[0] - log.shown[starts[w], OFFSET]
                misalignment += before[1] - log.shown[starts[w], HEADING]
            for k in range(lengths[w]):
                i = starts[w] + k
                near, far = log.curvature[i], log.curvature[min(i + 1, log.last[i])]
                place = line_in_view(offset, misalignment, near, far, stride, plant, optics)
                out[p, w, k, LINE] = measured(place, plant)
                out[p, w, k, OFFSET] = offset
                out[p, w, k, HEADING] = misalignment
                after = stride_on(
                    offset, misalignment, stride, i, log, len(log.force) > 0, commands, plant, limit
                )
                if len(gain) > 0:
                    after = put_right(offset, misalignment, out[p, w, k, LINE], log.shown[i], after, gain)
                offset, misalignment = after
