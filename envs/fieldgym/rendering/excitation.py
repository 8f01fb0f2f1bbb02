"""The picture of the excitation task: the shaken vehicle, the arm's motion, and what is known by now."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fieldgym.rendering.canvas import Canvas, Color, Frame, Point

BACKGROUND: Color = (250, 250, 247)
PANEL: Color = (255, 255, 255)
INK: Color = (38, 50, 64)
MUTED: Color = (122, 134, 148)
GRID: Color = (226, 230, 234)
HONEST: Color = (226, 98, 22)
NAIVE: Color = (150, 170, 196)
BODY: Color = (196, 206, 218)
TOP: Color = (218, 226, 234)
SIDE: Color = (170, 182, 196)
GROUND: Color = (206, 198, 182)
WHEEL: Color = (70, 80, 92)

MODES = ("about x", "about y", "about z")
HALF = np.array([0.22, 0.32, 0.08])
"""Half the body's size along x, y (forward) and z, for the picture only [m]."""
HEIGHT = 0.3
"""Of the body's middle above the ground, for the picture only [m]."""
SHOWN_SHIFT, SHOWN_TURN = 0.05, 0.16
"""The largest motion of an episode is drawn at least this large [m], [rad]."""


@dataclass(frozen=True)
class Scene:
    """What a picture shows.

    Attributes:
        time: Of the picture [s].
        duration: Of an episode [s].
        base: Shift [m] and turn [rad] of the body in each run, shape (3, 6).
        largest: Largest shift [m] and turn [rad] of the episode so far.
        joint: Where the arm's joint is in the body, from its middle [m], shape (3,).
        length: Of the arm [m].
        times: Since the start [s], shape (n,).
        angles: Of the arm at these times [rad], shape (n,).
        command: Amplitude [rad], frequency [rad/s] and offset [rad] in force.
        names: Of the unknowns.
        groups: Title of a group to the places of its unknowns.
        bits: Information about each unknown, shape (22,).
        bits_naive: What the naive filter believes to know, shape (22,).
        most: Bits of a parameter that is known.
        errors: Error of each unknown in percent of its prior range, shape (22,).
        errors_naive: The same of the naive filter, shape (22,).
        percent: Average error [%], of the honest and the naive filter.
    """

    time: float
    duration: float
    base: NDArray[np.float64]
    largest: tuple[float, float]
    joint: NDArray[np.float64]
    length: float
    times: NDArray[np.float64]
    angles: NDArray[np.float64]
    command: tuple[float, float, float]
    names: Sequence[str]
    groups: Mapping[str, Sequence[int]]
    bits: NDArray[np.float64]
    bits_naive: NDArray[np.float64]
    most: int
    errors: NDArray[np.float64]
    errors_naive: NDArray[np.float64]
    percent: tuple[float, float]


def draw(scene: Scene) -> Frame:
    """Draw the task, shape (540, 960, 3), uint8."""
    canvas = Canvas(BACKGROUND)
    canvas.text("Excitation", (24, 26), INK, 18, bold=True)
    canvas.text(f"{scene.time:.1f} of {scene.duration:.1f} s", (236, 27), MUTED, 12, align="right")
    for x, color, name, bits, percent in (
        (330.0, HONEST, "estimator", scene.bits.sum(), scene.percent[0]),
        (640.0, NAIVE, "naive filter", scene.bits_naive.sum(), scene.percent[1]),
    ):
        canvas.circle((x, 27), 5, color)
        canvas.text(f"{name}: {bits:.0f} bits, error {_short(percent)} %", (x + 12, 27), INK, 12)
    for mode in range(3):
        _vehicle(canvas, scene, mode, 16.0 + 314.0 * mode)
    _bits(canvas, scene)
    _arm(canvas, scene)
    _errors(canvas, scene)
    return canvas.frame()


def arm_direction(mode: int, angle: float) -> NDArray[np.float64]:
    """Where the arm points in the body's frame: it swings about x, y or z."""
    sine, cosine = math.sin(angle), math.cos(angle)
    return np.array(((0.0, cosine, sine), (sine, 0.0, cosine), (-sine, cosine, 0.0))[mode])


def _projected(point: NDArray[np.float64], left: float) -> Point:
    """Seen from the left, the front and above; y is forward (to the right), z up."""
    x, y, z = (float(v) for v in point)
    return left + 126.0 + 165.0 * (0.80 * y + 0.55 * x), 222.0 - 165.0 * (z + 0.20 * x - 0.26 * y + 0.10)


def _vehicle(canvas: Canvas, scene: Scene, mode: int, left: float) -> None:
    """One of the three runs: the body on its springs, its motion enlarged, and the swinging arm."""
    canvas.rectangle(left, 48, 300, 208, PANEL, 8)
    canvas.text(f"run {mode + 1}: arm turns {MODES[mode]}", (left + 12, 245), MUTED, 10)
    shift_scale = max(SHOWN_SHIFT / scene.largest[0], 1.0) if scene.largest[0] > 0 else 1.0
    turn_scale = max(SHOWN_TURN / scene.largest[1], 1.0) if scene.largest[1] > 0 else 1.0
    if mode == 2 and scene.largest[0] > 0:
        text = f"motion x{_rounded(shift_scale)}, turns x{_rounded(turn_scale)}"
        canvas.text(text, (left + 288, 62), MUTED, 10, align="right")
    shift = shift_scale * scene.base[mode, :3]
    turn = _rotation(turn_scale * scene.base[mode, 3:])

    def place(point: NDArray[np.float64]) -> Point:
        return _projected(turn @ point + shift + [0.0, 0.0, HEIGHT], left)

    ground = [np.array([sx * 0.42, sy * 0.55, 0.0]) for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    canvas.polygon([_projected(p, left) for p in ground], GROUND)
    corners = {(sx, sy): np.array([sx * 0.9, sy * 0.8, -1.0]) * HALF for sx in (-1, 1) for sy in (-1, 1)}
    # Far wheels first, then the body, then the near wheels.
    for sx in (1, -1):
        for sy in (-1, 1):
            wheel = np.array([sx * 0.9 * HALF[0], sy * 0.8 * HALF[1], 0.055])
            x, y = _projected(wheel, left)
            _spring(canvas, (x, y), place(corners[sx, sy]))
            canvas.circle((x, y), 10, WHEEL)
            canvas.circle((x, y), 4, PANEL)
        if sx == 1:
            _box(canvas, place)
    joint = scene.joint
    for angle in scene.angles[-60:-10:10]:
        canvas.bar(place(joint), place(joint + scene.length * arm_direction(mode, float(angle))), GRID, 3)
    angle = float(scene.angles[-1]) if len(scene.angles) else scene.command[2]
    tip = place(joint + scene.length * arm_direction(mode, angle))
    canvas.bar(place(joint), tip, HONEST, 6)
    canvas.circle(place(joint), 7, INK)
    canvas.circle(tip, 5, INK)


def _box(canvas: Canvas, place: Callable[[NDArray[np.float64]], Point]) -> None:
    """The three visible faces of the body."""
    for color, fixed, sign in ((TOP, 2, 1), (SIDE, 1, 1), (BODY, 0, -1)):
        others = [k for k in range(3) if k != fixed]
        face = []
        for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
            corner = np.empty(3)
            corner[fixed], corner[others[0]], corner[others[1]] = sign, a, b
            face.append(place(corner * HALF))
        canvas.polygon(face, color)


def _spring(canvas: Canvas, low: Point, high: Point) -> None:
    """A zigzag from a wheel to the body."""
    points = [low]
    for k in range(1, 8):
        share = k / 8
        side = 5.0 if k % 2 else -5.0
        points.append((low[0] + share * (high[0] - low[0]) + side, low[1] + share * (high[1] - low[1])))
    canvas.line([*points, high], MUTED, 1.5)


def _rotation(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation matrix of small turns about x, y and z."""
    x, y, z = (float(v) for v in vector)
    rx = np.array([[1, 0, 0], [0, math.cos(x), -math.sin(x)], [0, math.sin(x), math.cos(x)]])
    ry = np.array([[math.cos(y), 0, math.sin(y)], [0, 1, 0], [-math.sin(y), 0, math.cos(y)]])
    rz = np.array([[math.cos(z), -math.sin(z), 0], [math.sin(z), math.cos(z), 0], [0, 0, 1]])
    return np.asarray(rz @ ry @ rx)


def _short(percent: float) -> str:
    """A percentage to two digits, whole from ten on."""
    return f"{percent:.0f}" if percent >= 10 else f"{percent:.2g}"


def _rounded(value: float) -> int:
    """A factor to two digits."""
    return int(float(f"{value:.1e}"))


def _bits(canvas: Canvas, scene: Scene) -> None:
    """Information about each unknown, group by group."""
    canvas.rectangle(16, 268, 470, 256, PANEL, 8)
    canvas.text(f"information about each unknown [bits of {scene.most}]", (30, 284), MUTED, 11)
    left, right, base, height = 44.0, 476.0, 474.0, 170.0
    for level in (0, scene.most // 2, scene.most):
        y = base - height * level / scene.most
        canvas.line([(left, y), (right, y)], GRID, 1)
        canvas.text(str(level), (left - 6, y), MUTED, 9, align="right")
    count = sum(len(places) for places in scene.groups.values())
    gap = 10.0
    pitch = (right - left - gap * len(scene.groups)) / max(count, 1)
    x = left + gap / 2
    for title, places in scene.groups.items():
        middle = x + pitch * len(places) / 2
        canvas.text(title, (middle, 510), INK, 10, align="center")
        canvas.line([(x + 1, 499), (x + pitch * len(places) - 1, 499)], GRID, 1.5)
        for k in places:
            tall = height * min(max(scene.bits_naive[k], 0.0), scene.most) / scene.most
            canvas.rectangle(x + 1, base - tall, pitch - 2, tall, NAIVE)
            tall = height * min(max(scene.bits[k], 0.0), scene.most) / scene.most
            canvas.rectangle(x + 4, base - tall, pitch - 8, tall, HONEST)
            label = scene.names[k].split("_", 1)[-1]
            canvas.text(
                "m" if label == "mass" else label[:3], (x + pitch / 2, base + 12), MUTED, 9, align="center"
            )
            x += pitch
        x += gap


def _arm(canvas: Canvas, scene: Scene) -> None:
    """The arm's angle since the start, and the command in force."""
    canvas.rectangle(498, 268, 446, 122, PANEL, 8)
    a, w, a0 = scene.command
    canvas.text("arm angle [rad]", (512, 284), MUTED, 11)
    canvas.text(f"a {a:.2f} rad   w {w:.2f} rad/s   a0 {a0:.2f} rad", (930, 284), INK, 11, align="right")
    left, width, middle, half = 540.0, 390.0, 338.0, 38.0
    limit = 1.0
    if len(scene.angles):
        limit = max(limit, 0.5 * math.ceil(2 * float(np.abs(scene.angles).max())))
    for level in (-1, 0, 1):
        y = middle - half * level
        canvas.line([(left, y), (left + width, y)], GRID, 1)
        canvas.text(f"{level * limit:.1f}", (left - 6, y), MUTED, 9, align="right")
    if len(scene.angles):
        across = left + width * scene.times / scene.duration
        path = list(zip(across, middle - half * scene.angles / limit, strict=True))
        canvas.line(path, INK, 1.5)
        canvas.circle(path[-1], 4, HONEST)


def _errors(canvas: Canvas, scene: Scene) -> None:
    """Mean error of each group, on a logarithmic scale."""
    canvas.rectangle(498, 402, 446, 122, PANEL, 8)
    canvas.text("mean error of a group [% of the prior range]", (512, 418), MUTED, 11)
    left, width = 580.0, 330.0
    for power, label in ((-2, "0.01"), (-1, "0.1"), (0, "1"), (1, "10"), (2, "100")):
        x = left + width * (power + 2) / 4
        canvas.line([(x, 430), (x, 508)], GRID, 1)
        canvas.text(label, (x, 515), MUTED, 9, align="center")
    pitch = 78.0 / max(len(scene.groups), 1)
    for row, (title, places) in enumerate(scene.groups.items()):
        y = 430.0 + pitch * (row + 0.5)
        canvas.text(title, (left - 8, y), INK, 10, align="right")
        thick = min(5.0, pitch / 2 - 1)
        for offset, errors, color in ((-thick, scene.errors, HONEST), (0.0, scene.errors_naive, NAIVE)):
            value = float(np.mean(np.abs(errors[list(places)])))
            share = (math.log10(min(max(value, 0.01), 100.0)) + 2.0) / 4.0
            canvas.rectangle(left, y + offset, max(1.0, width * share), thick - 1, color)
