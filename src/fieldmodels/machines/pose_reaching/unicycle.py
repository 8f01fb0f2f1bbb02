"""The unicycle of section 5.1.4, integrated exactly: dx/dt = v cos h, dy/dt = v sin h, dh/dt = w.

Speed v and turn rate w are constant over a step, so the robot drives an arc: along the chord, whose
direction is the heading at half of the turn, and whose length is the arc's times sin(a)/a at half of the
turn a. That holds for every turn, zero included, without cancellation. Kernels carry the heading's cosine
and sine, which half of the turn rotates: one sine and cosine a step, of a small angle.
"""

from __future__ import annotations

import math

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled, inlined

_SERIES = 0.4  # half turn [rad] up to which the series below are exact to the last bits
_C8, _C10, _C12 = (sign / math.factorial(n) for n, sign in ((8, 1.0), (10, -1.0), (12, 1.0)))
_S8, _S10, _S12 = (sign / math.factorial(n + 1) for n, sign in ((8, 1.0), (10, -1.0), (12, 1.0)))


@inlined
def half_turn(a: float) -> tuple[float, float, float]:
    """Cosine, sine, and sine over angle of half of a step's turn [rad]."""
    if abs(a) > _SERIES:
        return math.cos(a), math.sin(a), math.sin(a) / a
    z = a * a
    cosine = 1.0 + z * (-1 / 2 + z * (1 / 24 + z * (-1 / 720 + z * (_C8 + z * (_C10 + z * _C12)))))
    chord = 1.0 + z * (-1 / 6 + z * (1 / 120 + z * (-1 / 5040 + z * (_S8 + z * (_S10 + z * _S12)))))
    return cosine, a * chord, chord


@inlined
def slipping_arc(
    x: float, y: float, cosine: float, sine: float, distance: float, lateral: float, turn: float
) -> tuple[float, float, float, float]:
    """Drive an arc, sliding to the side.

    Args:
        x: Position [m].
        y: Position [m].
        cosine: Cosine of the heading.
        sine: Sine of the heading.
        distance: Length of the arc, speed times time [m].
        lateral: The same of the sideways motion or slip, positive to the left [m].
        turn: Change of heading, turn rate times time [rad].

    Returns:
        Position and the heading's cosine and sine at the end. Rounding takes them off the unit circle
        by about 1e-16 a step.
    """
    c, s, chord = half_turn(0.5 * turn)
    middle_cosine = cosine * c - sine * s
    middle_sine = sine * c + cosine * s
    return (
        x + chord * (distance * middle_cosine - lateral * middle_sine),
        y + chord * (distance * middle_sine + lateral * middle_cosine),
        middle_cosine * c - middle_sine * s,
        middle_sine * c + middle_cosine * s,
    )


@inlined
def arc(
    x: float, y: float, cosine: float, sine: float, distance: float, turn: float
) -> tuple[float, float, float, float]:
    """Drive an arc without slip; arguments and result as of ``slipping_arc``."""
    return slipping_arc(x, y, cosine, sine, distance, 0.0, turn)


@inlined
def stopped_by_walls(
    x: float, y: float, new_x: float, new_y: float, half_length: float, half_width: float
) -> tuple[float, float, bool]:
    """Cut a step's chord where it meets a wall of the field; wheels slip for the rest, the turn goes on.

    The start must lie inside. An arc may bulge beyond its chord by a millimetre; that is let pass.

    Returns:
        Position [m], and whether a wall was hit.
    """
    if abs(new_x) <= half_length and abs(new_y) <= half_width:
        return new_x, new_y, False
    share = 1.0
    if abs(new_x) > half_length:
        share = (math.copysign(half_length, new_x) - x) / (new_x - x)
    if abs(new_y) > half_width:
        share = min(share, (math.copysign(half_width, new_y) - y) / (new_y - y))
    met_x = x + share * (new_x - x)
    met_y = y + share * (new_y - y)
    return (
        min(max(met_x, -half_length), half_length),
        min(max(met_y, -half_width), half_width),
        True,
    )


@inlined
def slid_along_walls(
    new_x: float, new_y: float, half_length: float, half_width: float
) -> tuple[float, float, bool]:
    """Let a wall of the field take only the component of a step that leads through it.

    Returns:
        Position [m], and whether a wall was hit.
    """
    inside_x = min(max(new_x, -half_length), half_length)
    inside_y = min(max(new_y, -half_width), half_width)
    return inside_x, inside_y, inside_x != new_x or inside_y != new_y


@inlined
def arrived(x: float, y: float, sine: float, distance: float, cosine_of_angle: float) -> bool:
    """Whether a pose is the goal's, within a distance and a heading error (given by its cosine)."""
    # The goal's heading is +y, so the cosine of the heading error is the heading's sine.
    return x * x + y * y < distance * distance and sine > cosine_of_angle


@inlined
def arrival_share(
    x: float,
    y: float,
    cosine: float,
    sine: float,
    distance: float,
    lateral: float,
    turn: float,
    arrival_distance: float,
    cosine_of_angle: float,
    substeps: int,
) -> float:
    """Share of a step's arc after which the robot has arrived, tested at equal substeps; 2.0 if never.

    Distance and heading must be right at one instant. Steps that cannot come near cost one comparison.
    """
    reach = arrival_distance + abs(distance) + abs(lateral)
    if x * x + y * y >= reach * reach:
        return 2.0
    for k in range(1, substeps + 1):
        x, y, cosine, sine = slipping_arc(
            x, y, cosine, sine, distance / substeps, lateral / substeps, turn / substeps
        )
        if arrived(x, y, sine, arrival_distance, cosine_of_angle):
            return k / substeps
    return 2.0


@inlined
def wheel_speeds(speed: float, rate: float, radius: float, track: float) -> tuple[float, float]:
    """Speeds of the left and the right wheel [rad/s] of a differential drive without slip."""
    return (speed - 0.5 * track * rate) / radius, (speed + 0.5 * track * rate) / radius


@inlined
def body_speeds(left: float, right: float, radius: float, track: float) -> tuple[float, float]:
    """Speed [m/s] and turn rate [rad/s] of a differential drive without slip, from its wheels' speeds."""
    return 0.5 * radius * (left + right), radius * (right - left) / track


@inlined
def wrapped(angle: float) -> float:
    """The same angle in (-pi, pi]."""
    return math.pi - (math.pi - angle) % (2.0 * math.pi)


@compiled
def advance(poses: FloatArray, speeds: FloatArray, rates: FloatArray, duration: float) -> FloatArray:
    """Drive a batch of robots for a time, without walls.

    Args:
        poses: x [m], y [m], heading [rad], shape (batch, 3).
        speeds: Speeds [m/s], shape (batch,).
        rates: Turn rates [rad/s], shape (batch,).
        duration: Time [s].

    Returns:
        Poses at the end, headings wrapped to (-pi, pi], shape (batch, 3).
    """
    result = np.empty_like(poses)
    for i in range(len(poses)):
        heading, turn = poses[i, 2], rates[i] * duration
        x, y, _, _ = arc(
            poses[i, 0], poses[i, 1], math.cos(heading), math.sin(heading), speeds[i] * duration, turn
        )
        result[i, 0] = x
        result[i, 1] = y
        result[i, 2] = wrapped(heading + turn)
    return result
