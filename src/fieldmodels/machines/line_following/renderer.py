"""What the camera sees: perspective images of tape and floor with light, shadow, exposure and noise."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled, inlined
from fieldmodels.machines.line_following.parameters import (
    FLOORS,
    FULL_LIGHT_GAIN,
    SHADOW_WIDTH,
    TAPES,
    Camera,
    Exposure,
    Lighting,
    Reflectance,
    Tape,
)
from fieldmodels.machines.line_following.tracks import Track, nearest, point_at
from fieldmodels.streams import GAMMA, mixed

Image = NDArray[np.uint8]

BEHIND, BEYOND = -0.3, 3.5
"""Part of the line, around the nearest point, that can be in view [m]."""
PIECE = 0.1
"""Length of a piece of tape that is drawn at once [m]."""
BLOCK = 20
"""Columns between which the light is interpolated."""


class View(NamedTuple):
    """Everything that an image depends on beside the camera's place, as the kernel takes it."""

    height: float
    pitch: float
    focal: float
    width: int
    rows: int
    tape_width: float
    tape: tuple[float, ...]
    floor: tuple[float, ...]
    mean: float
    gain: float
    pedestal: float
    noise: float
    ambient: float
    dark_x: float
    dark_y: float
    dark_radius: float
    dark_light: float
    sun_x: float
    sun_y: float
    sun_length: float
    sun_shade: float


def make_view(
    camera: Camera | None = None,
    tape: Tape | str = "duvetyne",
    floor: Reflectance | str = "linoleum",
    exposure: Exposure | None = None,
    lighting: Lighting | None = None,
    colour: bool = False,
) -> View:
    """Gather what an image depends on; names are those of ``TAPES`` and ``FLOORS``."""
    camera, exposure, lighting = camera or Camera(), exposure or Exposure(), lighting or Lighting()
    chosen = TAPES[tape] if isinstance(tape, str) else tape
    dark_x, dark_y, dark_radius, dark_light = lighting.dark_corner or (0.0, 0.0, 0.0, 1.0)
    azimuth, length = lighting.sun or (0.0, 0.0)
    return View(
        height=camera.height,
        pitch=camera.pitch,
        focal=camera.focal,
        width=camera.width,
        rows=camera.rows,
        tape_width=chosen.width,
        tape=_channels(chosen.reflectance, colour),
        floor=_channels(FLOORS[floor] if isinstance(floor, str) else floor, colour),
        mean=exposure.mean,
        gain=exposure.gain,
        pedestal=exposure.pedestal,
        noise=exposure.noise / FULL_LIGHT_GAIN,
        ambient=lighting.light,
        dark_x=dark_x,
        dark_y=dark_y,
        dark_radius=dark_radius,
        dark_light=dark_light,
        sun_x=math.cos(azimuth),
        sun_y=math.sin(azimuth),
        sun_length=length,
        sun_shade=lighting.sun_shade,
    )


def _channels(reflectance: Reflectance, colour: bool) -> tuple[float, ...]:
    """Reflectances of red, green and blue light, or that of all light."""
    three = reflectance if isinstance(reflectance, tuple) else (reflectance,) * 3
    return three if colour else (sum(three) / 3 if isinstance(reflectance, tuple) else reflectance,)


@inlined
def light_at(view: View, x: float, y: float) -> float:
    """Light on the floor at a place, without the robot's shadow."""
    if view.dark_radius <= 0.0:
        return view.ambient
    away = math.hypot(x - view.dark_x, y - view.dark_y) / view.dark_radius - 1.0
    part = min(max(away, 0.0), 1.0)
    smooth = part * part * (3.0 - 2.0 * part)
    return view.dark_light + (view.ambient - view.dark_light) * smooth


@inlined
def _cover(row: FloatArray, left: float, right: float) -> None:
    """Add the share of each pixel that lies between two columns."""
    width = len(row)
    left, right = max(left, 0.0), min(right, float(width))
    if right <= left:
        return
    first, last = int(left), min(int(right), width - 1)
    if first == last:
        row[first] = min(row[first] + right - left, 1.0)
        return
    row[first] = min(row[first] + first + 1 - left, 1.0)
    for column in range(first + 1, last):
        row[column] = 1.0
    row[last] = min(row[last] + right - last, 1.0)


@inlined
def _draw_tape(
    cover: FloatArray, view: View, table: FloatArray, spacing: float, closed: bool,
    x: float, y: float, cosine: float, sine: float, from_arc: float, to_arc: float,
) -> None:  # fmt: skip
    """Fill the share of tape in every pixel, piece by piece: each piece is a convex quadrilateral."""
    down, level = math.sin(view.pitch), math.cos(view.pitch)
    half = 0.5 * view.tape_width
    count = max(1, math.ceil((to_arc - from_arc) / PIECE))
    u = np.empty(4)
    v = np.empty(4)
    drawable = False
    for k in range(count + 1):
        arc = from_arc + (to_arc - from_arc) * k / count
        px, py, tx, ty = point_at(table, spacing, closed, arc)
        u[0], v[0], u[3], v[3] = u[1], v[1], u[2], v[2]
        before = drawable
        drawable = True
        for side in range(2):
            sign = 1.0 - 2.0 * side
            gx, gy = px - sign * half * ty - x, py + sign * half * tx - y
            ahead, beside = gx * cosine + gy * sine, gy * cosine - gx * sine
            depth = ahead * level + view.height * down
            if depth < 0.2:
                drawable = False
                break
            u[1 + side] = 0.5 * view.width - view.focal * beside / depth
            v[1 + side] = 0.5 * view.rows + view.focal * (view.height * level - ahead * down) / depth
        if k == 0 or not before or not drawable:
            continue
        top, bottom = min(v[0], v[1], v[2], v[3]), max(v[0], v[1], v[2], v[3])
        for row in range(max(0, math.ceil(top - 0.5)), min(view.rows, math.ceil(bottom - 0.5))):
            centre = row + 0.5
            left, right = 1e9, -1e9
            for corner in range(4):
                other = (corner + 1) % 4
                a, b = v[corner], v[other]
                if (a <= centre) != (b <= centre):
                    crossing = u[corner] + (centre - a) / (b - a) * (u[other] - u[corner])
                    left, right = min(left, crossing), max(right, crossing)
            _cover(cover[row], left, right)


@inlined
def _shadow(view: View, ahead: float, cosine: float, sine: float) -> tuple[float, float]:
    """Between which sideways places [m] a row at a distance ahead lies in the robot's own shadow."""
    along = view.sun_x * cosine + view.sun_y * sine
    across = view.sun_y * cosine - view.sun_x * sine
    low, high = -1e9, 1e9
    # 0 <= ahead along + s across <= length, and |s along - ahead across| <= half the width
    if abs(across) > 1e-9:
        a, b = -ahead * along / across, (view.sun_length - ahead * along) / across
        low, high = max(low, min(a, b)), min(high, max(a, b))
    elif not 0.0 <= ahead * along <= view.sun_length:
        return 0.0, 0.0
    if abs(along) > 1e-9:
        a = (ahead * across - 0.5 * SHADOW_WIDTH) / along
        b = (ahead * across + 0.5 * SHADOW_WIDTH) / along
        low, high = max(low, min(a, b)), min(high, max(a, b))
    elif abs(ahead * across) > 0.5 * SHADOW_WIDTH:
        return 0.0, 0.0
    return low, high


@compiled
def render(
    view: View, table: FloatArray, spacing: float, closed: bool,
    x: float, y: float, heading: float, expected: float, key: Any,
    cover: FloatArray, light: FloatArray, image: Image,
) -> float:  # fmt: skip
    """Render one image.

    Args:
        view: What it depends on.
        table: The track's points and tangents.
        spacing: Arc length between them [m].
        closed: Whether the track is closed.
        x: Camera's place [m].
        y: Camera's place [m].
        heading: Camera's viewing direction [rad].
        expected: Arc length near which the camera is [m].
        key: Key of the pixels' noise, uint64.
        cover: Working space; gives each pixel's share of tape, shape (rows, width).
        light: Working space, shape (channels, rows, width).
        image: Filled with the levels, shape (channels, rows, width), uint8.

    Returns:
        The gain that auto exposure chose [levels].
    """
    cosine, sine = math.cos(heading), math.sin(heading)
    arc, _, _, _ = nearest(table, spacing, closed, x, y, expected)
    cover[:] = 0.0
    _draw_tape(cover, view, table, spacing, closed, x, y, cosine, sine, arc + BEHIND, arc + BEYOND)
    total = 0.0
    for row in range(view.rows):
        slope = (row + 0.5 - 0.5 * view.rows) / view.focal
        depth = view.height / (math.sin(view.pitch) + slope * math.cos(view.pitch))
        ahead = depth * (math.cos(view.pitch) - slope * math.sin(view.pitch))
        low = high = 0.0
        if view.sun_length > 0.0:
            low, high = _shadow(view, ahead, cosine, sine)
        before = 0.0
        for block in range(view.width // BLOCK + 1):
            column = block * BLOCK
            beside = (0.5 * view.width - column) / view.focal * depth
            here = light_at(view, x + ahead * cosine - beside * sine, y + ahead * sine + beside * cosine)
            if block > 0:
                for k in range(BLOCK):
                    at = column - BLOCK + k
                    share = (k + 0.5) / BLOCK
                    lit = before + share * (here - before)
                    if high > low:
                        place = (0.5 * view.width - at - 0.5) / view.focal * depth
                        if low < place < high:
                            lit *= view.sun_shade
                    for c in range(len(view.tape)):
                        reflectance = view.floor[c] + cover[row, at] * (view.tape[c] - view.floor[c])
                        light[c, row, at] = reflectance * lit + view.pedestal
                        total += light[c, row, at]
            before = here
    gain = min(view.mean * len(view.tape) * view.rows * view.width / total, view.gain)
    # the difference of two uniform bytes stands for a Gaussian: its standard deviation is 104.5
    spread = view.noise * gain / 104.51
    state = key
    bits = np.uint64(0)
    for c in range(len(view.tape)):
        for row in range(view.rows):
            for column in range(view.width):
                if column % 4 == 0:
                    state = state + GAMMA
                    bits = mixed(state)
                noise = float(bits & np.uint64(255)) - float((bits >> np.uint64(8)) & np.uint64(255))
                bits = bits >> np.uint64(16)
                level = gain * light[c, row, column] + spread * noise + 0.5
                image[c, row, column] = np.uint8(min(max(level, 0.0), 255.0))
    return gain


class Renderer:
    """Renders one image after the other without making new working arrays.

    Attributes:
        camera: The camera.
        track: The line.
        view: What an image depends on beside the camera's place.
        shape: Of an image: (rows, width), and 3 if it has colours.
    """

    def __init__(self, track: Track, camera: Camera | None = None, view: View | None = None) -> None:
        self.camera = camera or Camera()
        self.track = track
        self.view = view or make_view(self.camera)
        shape = (self.camera.rows, self.camera.width)
        channels = len(self.view.tape)
        self.shape = shape if channels == 1 else (*shape, channels)
        self._cover, self._light = np.empty(shape), np.empty((channels, *shape))

    def image(
        self,
        pose: tuple[float, float, float],
        expected: float,
        key: int,
        out: Image | None = None,
        pitch_error: float = 0.0,
    ) -> Image:
        """Render what a camera sees.

        Args:
            pose: Place [m] and heading [rad].
            expected: Arc length near which the camera is [m].
            key: Key of the pixels' noise.
            out: Image to fill, shape ``shape``, uint8; None makes a new one.
            pitch_error: True pitch minus the camera's own [rad].
        """
        image = np.empty(self.shape, dtype=np.uint8) if out is None else out
        view = self.view
        if pitch_error:
            view = view._replace(pitch=view.pitch + pitch_error)
        render(
            view, self.track.table, self.track.spacing, self.track.closed,
            *pose, expected, np.uint64(key), self._cover, self._light,
            image[None] if image.ndim == 2 else image.transpose(2, 0, 1),
        )  # fmt: skip
        return image
