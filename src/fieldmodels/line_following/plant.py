"""The walk stride by stride as plane kinematics, with everything that may differ from it as parameters.

A stride begins as the outer legs touch down. The camera looks there; then the body goes one step straight on
over the outer feet, and one more along the same heading over the inner feet, which turn it meanwhile (section
3.1.1: there is no turning while the inner legs swing). The turn thus shows in the direction of the *next*
stride. Chapter 3 does not say when within a stride the sensor is read or along which heading the second step
goes; reading it at the inner touchdown, or going along the new heading, makes the task easier.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from fieldmodels.compiled import compiled, inlined
from fieldmodels.line_following.sensor import Optics, see_line
from fieldmodels.line_following.tracks import nearest
from fieldmodels.model import FloatArray
from fieldmodels.streams import gaussian, symmetric

(
    STEERING_BIAS,
    TURN_GAIN,
    LATENCY,
    SLIP_TURN,
    SLIP_TWIST,
    SLIP_STEP,
    CAMERA_YAW,
    PITCH_ERROR,
    SENSOR_GAIN,
    QUANTUM,
    MOTOR_LIMIT,
) = range(11)
"""Entries of a plant's parameter vector."""
PARAMETERS = 11
MEMORY = 4
"""Strides whose commands, turns and line positions are remembered; the newest first."""
BANDS = 2
"""Bands of rows that can be looked at."""

NEUTRAL = np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, math.inf])
"""The plant as the nominal simulation has it."""

WALK = np.dtype(
    [
        ("key", np.uint64),
        ("count", np.int64),
        ("x", np.float64),
        ("y", np.float64),
        ("heading", np.float64),
        ("arc", np.float64),
        ("offset", np.float64),
        ("misalignment", np.float64),
        ("bias", np.float64),
        ("turned", np.float64),
        ("commands", np.float64, (MEMORY,)),
        ("lines", np.float64, (BANDS, MEMORY)),
        ("lost", np.uint8, (BANDS,)),  # 1 where the line is lost; Numba nests no booleans
        ("lost_strides", np.int64),
    ]
)
"""State of one walk. ``offset`` is the distance from the line, left positive [m]; ``misalignment`` the
heading against the line's [rad]; ``turned`` the last stride's turn [rad]; ``lines`` what the camera board
sent, as long as it sees the line, else what it sent last [m]."""


@inlined
def turn_of(commands: FloatArray, plant: FloatArray, bias: float, limit: float) -> float:
    """Turn of the body in this stride, before noise [rad]; ``commands`` hold the newest first."""
    late = min(max(plant[LATENCY], 0.0), MEMORY - 2.0)
    whole = min(int(late), MEMORY - 3)
    part = late - whole
    most = min(limit, plant[MOTOR_LIMIT])
    now = (1.0 - part) * commands[whole] + part * commands[whole + 1]
    before = (1.0 - part) * commands[whole + 1] + part * commands[whole + 2]
    now = min(max(now, -most), most)
    before = min(max(before, -most), most)
    # feet that slip lose a part of the turn; as the inner legs straighten in the air, the body goes on
    # turning over the slipping outer feet
    asked = (1.0 - plant[SLIP_TURN]) * now + plant[SLIP_TWIST] * before
    return float(plant[TURN_GAIN] * asked + plant[STEERING_BIAS] + bias)


@inlined
def look(
    walks: Any, i: int, table: FloatArray, spacing: float, closed: bool, width: float,
    bands: Any, with_inner: bool, plant: FloatArray, noise: float, counter: int,
) -> None:  # fmt: skip
    """Read the camera: one place of the line a band, or the lost flag."""
    heading = walks[i]["heading"] + plant[CAMERA_YAW]
    if with_inner:
        heading -= walks[i]["turned"]  # the inner feet still point where the last stride came from
    forward_x, forward_y = math.cos(heading), math.sin(heading)
    for b in range(len(bands)):
        place, found = see_line(
            table, spacing, closed, width, walks[i]["x"], walks[i]["y"], forward_x, forward_y,
            walks[i]["arc"], plant[PITCH_ERROR], bands[b],
        )  # fmt: skip
        for k in range(MEMORY - 1, 0, -1):
            walks[i]["lines"][b, k] = walks[i]["lines"][b, k - 1]
        walks[i]["lost"][b] = 0 if found else 1
        if found:
            place = plant[SENSOR_GAIN] * place + noise * gaussian(walks[i]["key"], counter + b)
            if plant[QUANTUM] > 0.0:
                place = plant[QUANTUM] * math.floor(place / plant[QUANTUM] + 0.5)
            walks[i]["lines"][b, 0] = place
    walks[i]["lost_strides"] = walks[i]["lost_strides"] + 1 if walks[i]["lost"][0] == 1 else 0


@compiled
def begin(
    walks: Any, i: int, key: Any, table: FloatArray, spacing: float, closed: bool, width: float,
    bands: tuple[Optics, ...], with_inner: bool, plant: FloatArray, noises: FloatArray,
    offset: float, misalignment: float,
) -> None:  # fmt: skip
    """Put a walk on its track and look for the first time.

    Args:
        walks: All walks, dtype ``WALK``.
        i: Which one.
        key: Key of its noise, uint64.
        table: The track's points and tangents.
        spacing: Arc length between them [m].
        closed: Whether the track is closed.
        width: Width of the tape [m].
        bands: Optics of each band.
        with_inner: Whether the camera turns with the inner legs.
        plant: Parameter vector of the plant.
        noises: Sensor [m], yaw [rad], lateral [m], bias [rad].
        offset: Largest offset at the start [m].
        misalignment: Largest misalignment at the start [rad].
    """
    for k in range(MEMORY):
        walks[i]["commands"][k] = 0.0
        for b in range(BANDS):
            walks[i]["lines"][b, k] = 0.0
    for b in range(BANDS):
        walks[i]["lost"][b] = 1
    walks[i]["key"] = key
    walks[i]["count"] = 0
    walks[i]["lost_strides"] = 0
    walks[i]["turned"] = 0.0
    walks[i]["bias"] = noises[3] * symmetric(key, 0)
    count = len(table)
    start = (0.5 + 0.5 * symmetric(key, 1)) * spacing * count if closed else 0.0
    at = int(start / spacing) % count
    sideways = offset * symmetric(key, 2)
    crooked = misalignment * symmetric(key, 3)
    walks[i]["x"] = table[at, 0] - sideways * table[at, 3]
    walks[i]["y"] = table[at, 1] + sideways * table[at, 2]
    walks[i]["heading"] = math.atan2(table[at, 3], table[at, 2]) + crooked
    walks[i]["arc"] = at * spacing
    walks[i]["offset"] = sideways
    walks[i]["misalignment"] = crooked
    look(walks, i, table, spacing, closed, width, bands, with_inner, plant, noises[0], 4)


@inlined
def locate(walks: Any, i: int, table: FloatArray, spacing: float, closed: bool, moved: float) -> None:
    """Where along the line, how far from it and how askew a walk is now."""
    arc, offset, tx, ty = nearest(
        table, spacing, closed, walks[i]["x"], walks[i]["y"], walks[i]["arc"] + moved
    )
    cosine, sine = math.cos(walks[i]["heading"]), math.sin(walks[i]["heading"])
    walks[i]["arc"] = arc
    walks[i]["offset"] = offset
    walks[i]["misalignment"] = math.atan2(sine * tx - cosine * ty, cosine * tx + sine * ty)


@compiled
def advance(
    walks: Any, commands: FloatArray, table: FloatArray, spacing: float, closed: bool, width: float,
    bands: tuple[Optics, ...], with_inner: bool, latency: int, plants: FloatArray, noises: FloatArray,
    stride: float, limit: float,
) -> None:  # fmt: skip
    """Take every walk through one stride and look again.

    Args:
        walks: All walks, dtype ``WALK``.
        commands: Commanded turns [rad], shape (batch,).
        table: The track's points and tangents.
        spacing: Arc length between them [m].
        closed: Whether the track is closed.
        width: Width of the tape [m].
        bands: Optics of each band.
        with_inner: Whether the camera turns with the inner legs.
        latency: Strides that a command waits beside the gait's own delay.
        plants: Parameter vectors, shape (batch, PARAMETERS).
        noises: Sensor [m], yaw [rad], lateral [m], bias [rad].
        stride: Length of a stride [m].
        limit: Largest turn of a stride [rad].
    """
    waiting = np.zeros(MEMORY)
    for i in range(len(walks)):
        plant = plants[i]
        counter = 8 + 8 * walks[i]["count"]
        key = walks[i]["key"]
        for k in range(MEMORY - 1, 0, -1):
            walks[i]["commands"][k] = walks[i]["commands"][k - 1]
        walks[i]["commands"][0] = min(max(commands[i], -limit), limit)
        for k in range(MEMORY):
            waiting[k] = walks[i]["commands"][k + latency] if k + latency < MEMORY else 0.0
        turn = turn_of(waiting, plant, walks[i]["bias"], limit) + noises[1] * gaussian(key, counter)
        sideways = noises[2] * gaussian(key, counter + 1)
        cosine, sine = math.cos(walks[i]["heading"]), math.sin(walks[i]["heading"])
        length = stride * (1.0 - plant[SLIP_STEP])
        walks[i]["x"] += length * cosine - sideways * sine
        walks[i]["y"] += length * sine + sideways * cosine
        walks[i]["heading"] += turn
        walks[i]["turned"] = turn
        walks[i]["count"] += 1
        locate(walks, i, table, spacing, closed, length)
        look(walks, i, table, spacing, closed, width, bands, with_inner, plant, noises[0], counter + 2)
