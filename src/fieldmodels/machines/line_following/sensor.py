"""Where the line appears in the camera's band of rows, by geometry alone: the fast sensor."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import inlined
from fieldmodels.machines.line_following.parameters import Camera
from fieldmodels.machines.line_following.tracks import point_at

NODES = 5
"""Rows of the band that are looked at (Gauss-Legendre)."""


class Optics(NamedTuple):
    """The camera's constants as the kernels take them.

    Attributes:
        pitch: Angle of the optical axis below the horizon [rad].
        focal: Focal length [pixels].
        half_width: Half the image's width [pixels].
        middle: Row coordinate of the optical axis.
        scale: Sideways metres of one pixel at the band's middle row, as calibrated [m].
        least: Fewest tape pixels.
        nodes: Row coordinates of the band's nodes, shape (NODES,).
        weights: Rows that each node stands for, shape (NODES,).
    """

    pitch: float
    focal: float
    half_width: float
    middle: float
    scale: float
    least: float
    nodes: FloatArray
    weights: FloatArray


def make_optics(camera: Camera, first_row: int | None = None, last_row: int | None = None) -> Optics:
    """The constants of a camera's band, or of another band of the same camera."""
    first = camera.first_row if first_row is None else first_row
    last = camera.last_row if last_row is None else last_row
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    count = last - first
    return Optics(
        pitch=camera.pitch,
        focal=camera.focal,
        half_width=camera.width / 2.0,
        middle=camera.rows / 2.0,
        scale=camera.metres_per_pixel,
        least=camera.least_pixels * count / (camera.last_row - camera.first_row),
        nodes=first + 0.5 * count * (nodes + 1.0),
        weights=0.5 * count * weights,
    )


@inlined
def see_line(
    table: FloatArray,
    spacing: float,
    closed: bool,
    width: float,
    x: float,
    y: float,
    forward_x: float,
    forward_y: float,
    arc: float,
    pitch_error: float,
    height: float,
    optics: Optics,
) -> tuple[float, bool]:
    """Centroid of the line in the band, as the firmware sends it.

    Args:
        table: The track's points and tangents.
        spacing: Arc length between them [m].
        closed: Whether the track is closed.
        width: Width of the tape [m].
        x: Camera's place [m].
        y: Camera's place [m].
        forward_x: Unit vector of the viewing direction.
        forward_y: Unit vector of the viewing direction.
        arc: Arc length of the track's point nearest to the camera [m].
        pitch_error: True pitch minus calibrated pitch [rad].
        height: Of the camera above the floor [m].
        optics: The camera's constants.

    Returns:
        Sideways place of the line at the look-ahead distance [m], left positive, and whether enough of it
        is in view (else the place is 0).
    """
    total = 0.0
    moment = 0.0
    pitch = optics.pitch + pitch_error
    sine, cosine = math.sin(pitch), math.cos(pitch)
    for k in range(NODES):
        slope = (optics.nodes[k] - optics.middle) / optics.focal
        down = sine + slope * cosine
        if down <= 1e-3:
            continue  # above the horizon
        # the ray of this row meets the floor `ahead`; `depth` is its distance along the optical axis
        depth = height / down
        ahead = depth * (cosine - slope * sine)
        at = arc + ahead
        beside = 0.0
        tilt = 1.0
        for _ in range(3):
            px, py, tx, ty = point_at(table, spacing, closed, at)
            along = (px - x) * forward_x + (py - y) * forward_y
            beside = (py - y) * forward_x - (px - x) * forward_y
            tilt = tx * forward_x + ty * forward_y
            if abs(tilt) < 0.2:
                tilt = math.copysign(0.2, tilt)
            at += (ahead - along) / tilt
        column = -optics.focal * beside / depth
        half = 0.5 * width * optics.focal / (depth * abs(tilt))
        left = max(column - half, -optics.half_width)
        right = min(column + half, optics.half_width)
        if right > left:
            pixels = (right - left) * optics.weights[k]
            total += pixels
            moment += pixels * 0.5 * (left + right)
    if total < optics.least or total <= 0.0:
        return 0.0, False
    return -moment / total * optics.scale, True
