"""The picture of line following: the walk from above, what the camera sees, the six status lights."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fieldgym.rendering.canvas import Canvas, Color, Frame

BACKGROUND: Color = (250, 250, 247)
PANEL: Color = (255, 255, 255)
FLOOR: Color = (214, 214, 208)
DARK: Color = (150, 150, 148)
INK: Color = (38, 50, 64)
MUTED: Color = (122, 134, 148)
GRID: Color = (226, 230, 234)
TAPE: Color = (30, 30, 32)
ROBOT: Color = (226, 98, 22)
PATH: Color = (240, 168, 122)
FOUND: Color = (60, 160, 90)
LOST: Color = (205, 40, 40)

LEFT, TOP, SIZE = 24.0, 48.0, 468.0
"""Place and size of the view from above."""
METRES = 9.0
"""Width of the view from above [m]."""
LIGHTS = 6
SHOWN = 60
"""Strides in the traces."""


@dataclass(frozen=True)
class Picture:
    """What is drawn.

    Attributes:
        track: The line's points, shape (n, 2) [m].
        closed: Whether the line is closed.
        trail: Of each stride: x, y [m], heading [rad], offset [m], command [rad]; the last one is now.
        image: What the camera sees, uint8.
        band: First row of the band and the row after its last.
        column: The line's place that the camera board sent last, in columns.
        lost: Whether the line is lost.
        threshold: Level below which a pixel is tape.
        limit: Largest turn [rad].
        stride: Strides taken.
        strides: Strides of the episode.
        look_ahead: How far ahead the camera looks [m].
        dark: Centre, radius [m] and light of a dark corner, if there is one.
        operator: ``steering`` and ``joystick`` of an operator, if there is one.
    """

    track: NDArray[np.float64]
    closed: bool
    trail: NDArray[np.float64]
    image: NDArray[np.uint8]
    band: tuple[int, int]
    column: float
    lost: bool
    threshold: float
    limit: float
    stride: int
    strides: int
    look_ahead: float
    dark: tuple[float, float, float, float] | None = None
    operator: Mapping[str, Any] = field(default_factory=dict)


def draw(picture: Picture) -> Frame:
    """Draw the task.

    Returns:
        The frame, shape (540, 960, 3), uint8.
    """
    canvas = Canvas(BACKGROUND)
    _from_above(canvas, picture)
    canvas.rectangle(0, 0, 960, TOP, BACKGROUND)
    canvas.rectangle(0, TOP + SIZE, 960, 540 - TOP - SIZE, BACKGROUND)
    canvas.rectangle(0, TOP, LEFT, SIZE, BACKGROUND)
    canvas.rectangle(LEFT + SIZE, TOP, 960 - LEFT - SIZE, SIZE, BACKGROUND)
    canvas.text("Line following", (LEFT, 26), INK, 18, bold=True)
    canvas.text(f"stride {picture.stride} of {picture.strides}", (LEFT + SIZE, 27), MUTED, 12, align="right")
    _camera(canvas, picture)
    _lights(canvas, picture)
    _traces(canvas, picture)
    return canvas.frame()


def _from_above(canvas: Canvas, picture: Picture) -> None:
    x, y, heading = picture.trail[-1, :3]
    scale = SIZE / METRES
    middle = (LEFT + SIZE / 2, TOP + SIZE * 0.6)

    def place(points: NDArray[np.float64]) -> list[tuple[float, float]]:
        """Turned so that the robot walks up."""
        ahead = (points[:, 0] - x) * math.cos(heading) + (points[:, 1] - y) * math.sin(heading)
        beside = (points[:, 1] - y) * math.cos(heading) - (points[:, 0] - x) * math.sin(heading)
        return [(middle[0] - b * scale, middle[1] - a * scale) for a, b in zip(ahead, beside, strict=True)]

    canvas.rectangle(LEFT, TOP, SIZE, SIZE, FLOOR)
    if picture.dark is not None:
        centre = place(np.array([picture.dark[:2]]))[0]
        canvas.circle(centre, picture.dark[2] * scale, DARK)
    track = np.vstack([picture.track, picture.track[:1]]) if picture.closed else picture.track
    near = np.hypot(track[:, 0] - x, track[:, 1] - y) < METRES
    for piece in np.split(np.arange(len(track)), np.flatnonzero(np.diff(near.astype(int))) + 1):
        if near[piece[0]] and len(piece) > 1:
            canvas.line(place(track[piece]), TAPE, max(2.0, 0.05 * scale))
    canvas.line(place(picture.trail[:, :2]), PATH, 2.0)
    across = np.array([-math.sin(heading), math.cos(heading)])
    along = np.array([math.cos(heading), math.sin(heading)])
    here = np.array([x, y])
    for side, ahead in ((0.20, 0.17), (-0.20, 0.17), (0.15, -0.17), (-0.15, -0.17)):
        foot = here + side * across + ahead * along
        start, end = place(np.array([foot - 0.1 * along, foot + 0.1 * along]))
        canvas.bar(start, end, INK if ahead > 0 else MUTED, 0.07 * scale)
    body = np.array([here + 0.22 * across, here - 0.22 * across])
    left, right = place(body)
    canvas.bar(left, right, ROBOT, 0.12 * scale)
    canvas.line(place(np.array([here, here + picture.look_ahead * along])), ROBOT, 1.0)
    canvas.rectangle(LEFT + 14, TOP + SIZE - 20, scale, 3, INK)
    canvas.text("1 m", (LEFT + 14 + scale / 2, TOP + SIZE - 32), INK, 11, align="center")


def _camera(canvas: Canvas, picture: Picture) -> None:
    left, top, width, height = 516.0, 48.0, 300.0, 225.0
    rows, columns = picture.image.shape[:2]
    canvas.text("what the camera sees", (left, 34), MUTED, 12)
    canvas.image(picture.image, left, top, width, height)
    color = LOST if picture.lost else FOUND
    for row in picture.band:
        y = top + row / rows * height
        canvas.line([(left, y), (left + width, y)], color, 1.0)
    x = left + min(max(picture.column / columns, 0.0), 1.0) * width
    y = top + 0.5 * sum(picture.band) / rows * height
    canvas.line([(x - 8, y), (x + 8, y)], LOST, 2.0)
    canvas.line([(x, y - 8), (x, y + 8)], LOST, 2.0)


def _lights(canvas: Canvas, picture: Picture) -> None:
    """The six lights on the robot's back: all red where the line is lost (section 3.5.2)."""
    left, top = 836.0, 58.0
    for k in range(LIGHTS):
        canvas.circle(
            (left + 14 + 34 * (k % 3), top + 14 + 34 * (k // 3)), 12, LOST if picture.lost else FOUND
        )
    canvas.text("line lost" if picture.lost else "line in view", (left, top + 86), INK, 12)
    operator = picture.operator
    if operator:
        who = "operator" if operator.get("steering") else "self steering"
        canvas.text(who, (left, top + 112), ROBOT if operator.get("steering") else INK, 12, bold=True)
        canvas.rectangle(left, top + 128, 100, 6, GRID, 3)
        canvas.circle((left + 50 - 46 * float(operator.get("joystick", 0.0)), top + 131), 6, INK)
        canvas.text("S: switch", (left, top + 152), MUTED, 11)
        canvas.text("arrows: joystick", (left, top + 168), MUTED, 11)


def _traces(canvas: Canvas, picture: Picture) -> None:
    shown = picture.trail[-SHOWN:]
    _trace(canvas, 296, "distance from the line [cm]", shown[:, 3] * 100, 30.0)
    _trace(canvas, 414, "turn [mrad]", shown[:, 4] * 1000, picture.limit * 1000)


def _trace(canvas: Canvas, top: float, title: str, values: NDArray[np.float64], most: float) -> None:
    left, width, height = 516.0, 420.0, 78.0
    canvas.text(title, (left, top + 4), MUTED, 12)
    canvas.rectangle(left, top + 16, width, height, PANEL)
    middle = top + 16 + height / 2
    canvas.line([(left, middle), (left + width, middle)], GRID, 1.0)
    canvas.text(f"{most:g}", (left + width - 4, top + 24), MUTED, 10, align="right")
    xs = left + (np.arange(len(values)) + 1) / SHOWN * width
    ys = middle - np.clip(values / most, -1, 1) * height / 2
    points = list(zip(xs.tolist(), ys.tolist(), strict=True))
    canvas.line(points, ROBOT, 2.0)
    if points:
        canvas.circle(points[-1], 3, ROBOT)
        canvas.text(f"{values[-1]:.0f}", (left + width - 4, top + 4), INK, 12, bold=True, align="right")
