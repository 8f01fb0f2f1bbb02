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
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled, inlined
from fieldmodels.machines.line_following.sensor import Optics, see_line
from fieldmodels.machines.line_following.tracks import nearest
from fieldmodels.streams import gaussian, symmetric

MEMORY = 4
"""Strides whose commands, turns and line positions are remembered; the newest first."""
BANDS = 2
"""Bands of rows that can be looked at."""
BODIES = 18
"""Numbers that hold the state of the rigid bodies, where they are the plant."""

DRAWS = 8
"""Random draws that are set aside for each stride: yaw, lateral, two bands, pixels."""

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
        ("bodies", np.float64, (BODIES,)),
    ]
)
"""State of one walk. ``offset`` is the distance from the line, left positive [m]; ``misalignment`` the
heading against the line's [rad]; ``turned`` the last stride's turn [rad]; ``lines`` what the camera board
sent, as long as it sees the line, else what it sent last [m]."""


@inlined
def turn_of(commands: FloatArray, plant: Any, bias: float, limit: float) -> float:
    """Turn of the body in this stride, before noise [rad]; ``commands`` hold the newest first."""
    late = min(max(plant.actuator_delay.strides, 0.0), MEMORY - 2.0)
    whole = min(int(late), MEMORY - 3)
    part = late - whole
    most = min(limit, plant.actuator_saturation.turn)
    now = (1.0 - part) * commands[whole] + part * commands[whole + 1]
    earliest = min(whole + 2, len(commands) - 1)  # a robot of its own latency remembers one command less
    before = (1.0 - part) * commands[whole + 1] + part * commands[earliest]
    now = min(max(now, -most), most)
    before = min(max(before, -most), most)
    # feet that slip lose a part of the turn; momentum turns the body on over the slipping feet that land next
    asked = (1.0 - plant.foot_slip.turn) * now + plant.foot_slip.twist * before
    return float(plant.turn_gain.factor * asked + plant.steering_bias.turn + bias)


@inlined
def remember(walks: Any, i: int, band: int, place: float, found: bool) -> None:
    """Take in what the camera board sent for a band: a place of the line [m], or the lost flag."""
    for k in range(MEMORY - 1, 0, -1):
        walks[i]["lines"][band, k] = walks[i]["lines"][band, k - 1]
    walks[i]["lost"][band] = 0 if found else 1
    if found:
        walks[i]["lines"][band, 0] = place
    if band == 0:
        walks[i]["lost_strides"] = 0 if found else walks[i]["lost_strides"] + 1


@inlined
def measured(place: float, plant: Any) -> float:
    """The place that a wrongly scaled and coarse sensor gives for the true one [m]."""
    place *= plant.sensor_gain.factor
    step = plant.sensor_quantisation.step
    return step * math.floor(place / step + 0.5) if step > 0.0 else place


@inlined
def draw_of(walks: Any, i: int, draw: int) -> float:
    """One of the standard normal draws of the current stride."""
    return gaussian(walks[i]["key"], DRAWS * (walks[i]["count"] + 1) + draw)


@inlined
def viewing(walks: Any, i: int, plant: Any, with_inner: bool) -> float:
    """Direction in which the camera looks [rad]."""
    heading = walks[i]["heading"] + plant.camera_yaw.angle
    # the inner feet still point where the last stride came from
    return float(heading - walks[i]["turned"] if with_inner else heading)


@compiled
def start(
    walks: Any, i: int, key: Any, table: FloatArray, spacing: float, closed: bool, rules: NDArray[Any]
) -> None:  # fmt: skip
    """Put a walk on its track.

    Args:
        walks: All walks, dtype ``WALK``.
        i: Which one.
        key: Key of its noise, uint64.
        table: The track's points and tangents.
        spacing: Arc length between them [m].
        closed: Whether the track is closed; then the walk starts anywhere on it.
        rules: The scene of each walk, see ``walks.kernel_scene``.
    """
    p = rules[i]
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
    walks[i]["bias"] = p.bias * symmetric(key, 0)
    count = len(table)
    first = (0.5 + 0.5 * symmetric(key, 1)) * count if closed else 0.0
    at = int(first) % count
    side = symmetric(key, 2)
    sideways = math.copysign(p.offset, side) if p.sided else p.offset * side
    crooked = p.misalignment * symmetric(key, 3)
    walks[i]["x"] = table[at, 0] - sideways * table[at, 3]
    walks[i]["y"] = table[at, 1] + sideways * table[at, 2]
    walks[i]["heading"] = math.atan2(table[at, 3], table[at, 2]) + crooked
    walks[i]["arc"] = at * spacing
    walks[i]["offset"] = sideways
    walks[i]["misalignment"] = crooked


@inlined
def ordered(walks: Any, i: int, command: float, plant: Any, p: Any) -> float:
    """Take in a command; the turn that it and its forerunners make, before noise [rad]."""
    for k in range(MEMORY - 1, 0, -1):
        walks[i]["commands"][k] = walks[i]["commands"][k - 1]
    walks[i]["commands"][0] = min(max(command, -p.limit), p.limit)
    return turn_of(walks[i]["commands"][p.latency_strides :], plant, walks[i]["bias"], p.limit)


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
def move(
    walks: Any, commands: FloatArray, table: FloatArray, spacing: float, closed: bool,
    plants: NDArray[Any], rules: NDArray[Any],
) -> None:  # fmt: skip
    """Take every walk through one stride.

    Args:
        walks: All walks, dtype ``WALK``.
        commands: Commanded turns [rad], shape (batch,).
        table: The track's points and tangents.
        spacing: Arc length between them [m].
        closed: Whether the track is closed.
        plants: What each walk truly is, shape (batch,), dtype ``PLANT``.
        rules: The scene of each walk, see ``walks.kernel_scene``.
    """
    for i in range(len(walks)):
        plant, p = plants[i], rules[i]
        turn = ordered(walks, i, commands[i], plant, p) + p.yaw * draw_of(walks, i, 0)
        sideways = p.lateral * draw_of(walks, i, 1)
        cosine, sine = math.cos(walks[i]["heading"]), math.sin(walks[i]["heading"])
        length = plant.stride * (1.0 - plant.foot_slip.step)
        walks[i]["x"] += length * cosine - sideways * sine
        walks[i]["y"] += length * sine + sideways * cosine
        walks[i]["heading"] += turn
        walks[i]["turned"] = turn
        walks[i]["count"] += 1
        locate(walks, i, table, spacing, closed, length)


@compiled
def scan(
    walks: Any, which: NDArray[np.int64], table: FloatArray, spacing: float, closed: bool,
    bands: tuple[Optics, ...], plants: NDArray[Any], rules: NDArray[Any],
) -> None:  # fmt: skip
    """Let walks scan the floor with their cameras, by geometry.

    Args:
        walks: All walks, dtype ``WALK``.
        which: Indices of those that scan.
        table: The track's points and tangents.
        spacing: Arc length between them [m].
        closed: Whether the track is closed.
        bands: Optics of each band.
        plants: What each walk truly is, shape (batch,), dtype ``PLANT``.
        rules: The scene of each walk, see ``walks.kernel_scene``.
    """
    for i in which:
        plant, p = plants[i], rules[i]
        heading = viewing(walks, i, plant, p.camera_yaws_with_inner)
        forward_x, forward_y = math.cos(heading), math.sin(heading)
        for b in range(len(bands)):
            place, found = see_line(
                table, spacing, closed, p.tape_width, walks[i]["x"], walks[i]["y"], forward_x, forward_y,
                walks[i]["arc"], plant.camera_pitch.angle, plant.camera_height, bands[b],
            )  # fmt: skip
            remember(walks, i, b, measured(place + p.sensor * draw_of(walks, i, 2 + b), plant), found)


@compiled
def take_in(walks: Any, i: int, band: int, place: float, found: bool, plant: Any) -> None:
    """Let one walk take in what its camera board read from an image."""
    remember(walks, i, band, measured(place, plant), found)


@compiled
def order(walks: Any, i: int, command: float, plant: Any, rules: Any) -> float:
    """Let one walk take in a command; gives the turn that is asked of the bodies [rad]."""
    return ordered(walks, i, command, plant, rules[i])


@compiled
def land(
    walks: Any, i: int, x: float, y: float, heading: float,
    table: FloatArray, spacing: float, closed: bool, stride: float,
) -> None:  # fmt: skip
    """Put one walk where its bodies have come to."""
    turned = heading - walks[i]["heading"]
    moved = (x - walks[i]["x"]) * math.cos(walks[i]["heading"]) + (y - walks[i]["y"]) * math.sin(
        walks[i]["heading"]
    )
    walks[i]["x"], walks[i]["y"], walks[i]["heading"], walks[i]["turned"] = x, y, heading, turned
    walks[i]["count"] += 1
    locate(walks, i, table, spacing, closed, min(moved, stride))


@compiled
def draw(walks: Any, i: int, which: int) -> float:
    """One of the standard normal draws of a walk's current stride."""
    return draw_of(walks, i, which)
