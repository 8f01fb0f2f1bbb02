"""The picture of the pose-reaching task: field, ball, robot, its path, and what an agent remembers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fieldgym.rendering.canvas import Canvas, Color, Frame, Point
from fieldmodels.machines.pose_reaching.parameters import GOAL_HEADING, Arrival, Field, Limits

BACKGROUND: Color = (250, 250, 247)
PANEL: Color = (255, 255, 255)
INK: Color = (38, 50, 64)
MUTED: Color = (122, 134, 148)
GRID: Color = (226, 230, 234)
TURF: Color = (232, 240, 230)
WALL: Color = (126, 118, 104)
BALL: Color = (240, 150, 20)
GOAL_COLOR: Color = (46, 140, 90)
PATH: Color = (226, 98, 22)
DUBINS: Color = (140, 152, 166)
MEMORY: Color = (126, 162, 214)
CHOSEN: Color = (150, 60, 160)

CENTER = (400.0, 296.0)
SPACE = (744.0, 456.0)  # that the field may take
ROBOT_RADIUS = 0.09  # of a robot of the league [m]; the physics knows a point only


@dataclass(frozen=True)
class Scene:
    """What a picture shows.

    Attributes:
        field: The field.
        arrival: When the robot has arrived.
        trail: Poses since the start, x [m], y [m], heading [rad], shape (n, 3), the last one now.
        dubins: Poses along the shortest path from the start, shape (m, 3).
        command: Speed [m/s] and turn rate [rad/s] of the latest tick.
        limits: What can be commanded.
        numbers: The numbers of ``info``.
        memory: Remembered paths, each of shape (points, 2 or more): x [m], y [m].
        chosen: The remembered state that the agent acts on: x [m], y [m], ..., if it has one.
        steering: Whether a human operator steers.
    """

    field: Field
    arrival: Arrival
    trail: NDArray[np.float64]
    dubins: NDArray[np.float64]
    command: tuple[float, float]
    limits: Limits
    numbers: Mapping[str, float]
    memory: Sequence[NDArray[np.float64]] = ()
    chosen: NDArray[np.float64] | None = None
    steering: bool = False


def draw(scene: Scene) -> Frame:
    """Draw the task, shape (540, 960, 3), uint8."""
    canvas = Canvas(BACKGROUND)
    canvas.text("Pose reaching", (24, 26), INK, 18, bold=True)
    _legend(canvas, scene)
    scale = min(SPACE[0] / scene.field.length, SPACE[1] / scene.field.width)

    def at(pose: NDArray[np.float64]) -> Point:
        return CENTER[0] + scale * float(pose[0]), CENTER[1] - scale * float(pose[1])

    _ground(canvas, scene.field, scale)
    for path in scene.memory:
        canvas.line([at(point) for point in path], MEMORY, 1)
        for point in path:
            canvas.circle(at(point), 1.8, MEMORY)
    _dashed(canvas, [at(pose) for pose in scene.dubins])
    _goal(canvas, scene.arrival, scale)
    canvas.line([at(pose) for pose in scene.trail], PATH, 2.5)
    canvas.circle(at(scene.trail[0]), 4, PATH)
    if scene.chosen is not None:
        canvas.line([at(scene.trail[-1]), at(scene.chosen)], CHOSEN, 1.5)
    _robot(canvas, at(scene.trail[-1]), float(scene.trail[-1][2]), ROBOT_RADIUS * scale)
    if scene.chosen is not None:
        canvas.circle(at(scene.chosen), 5.5, CHOSEN)
        canvas.circle(at(scene.chosen), 2.5, PANEL)
    _numbers(canvas, scene)
    return canvas.frame()


def _legend(canvas: Canvas, scene: Scene) -> None:
    entries = [("path", PATH, 62.0), ("shortest (Dubins)", DUBINS, 146.0)]
    if len(scene.memory):
        entries.append(("remembered", MEMORY, 110.0))
    if scene.chosen is not None:
        entries.append(("chosen", CHOSEN, 82.0))
    if scene.steering:
        entries.append(("operator steers", GOAL_COLOR, 0.0))
    x = 200.0
    for name, color, width in entries:
        canvas.circle((x, 27), 5, color)
        canvas.text(name, (x + 12, 27), INK, 12)
        x += width


def _ground(canvas: Canvas, field: Field, scale: float) -> None:
    """The field with its walls and a line each metre."""
    half_length, half_width = scale * field.length / 2, scale * field.width / 2
    left, top = CENTER[0] - half_length, CENTER[1] - half_width
    canvas.rectangle(left - 8, top - 8, 2 * half_length + 16, 2 * half_width + 16, WALL, 4)
    canvas.rectangle(left, top, 2 * half_length, 2 * half_width, TURF)
    for metre in range(-int(field.length / 2), int(field.length / 2) + 1):
        x = CENTER[0] + scale * metre
        canvas.line([(x, top), (x, top + 2 * half_width)], PANEL, 1)
    for metre in range(-int(field.width / 2), int(field.width / 2) + 1):
        y = CENTER[1] - scale * metre
        canvas.line([(left, y), (left + 2 * half_length, y)], PANEL, 1)


def _goal(canvas: Canvas, arrival: Arrival, scale: float) -> None:
    """Where the robot is to arrive: the ring of success, the allowed headings, the ball."""
    x, y = CENTER
    reach = 44.0
    wedge = [
        (x + reach * math.cos(GOAL_HEADING + a), y - reach * math.sin(GOAL_HEADING + a))
        for a in np.linspace(-arrival.angle, arrival.angle, 9)
    ]
    canvas.polygon([(x, y), *wedge], (190, 222, 200))
    canvas.circle((x, y), arrival.distance * scale + 1.5, GOAL_COLOR)
    canvas.circle((x, y), arrival.distance * scale, (206, 232, 214))
    canvas.bar((x, y), (x, y - reach), GOAL_COLOR, 2.5)
    canvas.polygon([(x, y - reach - 10), (x - 6, y - reach), (x + 6, y - reach)], GOAL_COLOR)
    canvas.circle((x, y), 4, BALL)


def _robot(canvas: Canvas, place: Point, heading: float, radius: float) -> None:
    x, y = place
    canvas.circle(place, radius, INK)
    nose = [
        (x + radius * reach * math.cos(heading + a), y - radius * reach * math.sin(heading + a))
        for reach, a in ((0.95, 0.0), (0.6, 2.4), (0.6, -2.4))
    ]
    canvas.polygon(nose, PATH)


def _dashed(canvas: Canvas, points: Sequence[Point]) -> None:
    for i in range(0, len(points) - 1, 5):
        canvas.line(points[i : i + 4], DUBINS, 1.5)


def _numbers(canvas: Canvas, scene: Scene) -> None:
    """How the episode goes, and the latest command."""
    left, right = 800.0, 936.0
    canvas.rectangle(left - 12, 60, right - left + 24, 472, PANEL, 8)
    n = scene.numbers
    error = (float(scene.trail[-1][2]) - GOAL_HEADING + math.pi) % (2 * math.pi) - math.pi
    distance = float(np.hypot(*scene.trail[-1][:2]))
    rows = (
        ("time", f"{n['time']:.2f} s"),
        ("Dubins' time", f"{n['dubins_time']:.2f} s"),
        ("path", f"{n['path_length']:.2f} m"),
        ("Dubins' path", f"{n['dubins_length']:.2f} m"),
        ("wall hits", f"{n['wall_hits']:.0f}"),
        ("distance", f"{100 * distance:.0f} cm"),
        ("heading error", f"{math.degrees(error):+.0f}°"),
    )
    for k, (name, value) in enumerate(rows):
        canvas.text(name, (left, 84 + 42 * k), MUTED, 11)
        canvas.text(value, (left, 101 + 42 * k), INK, 14, bold=True)
    speed, rate = scene.command
    gauges = (
        ("speed", speed, "m/s", 0.0, speed / scene.limits.max_speed),
        # a positive rate turns to the left
        ("turn rate", rate, "rad/s", 0.5, 0.5 - 0.5 * rate / scene.limits.max_rate),
    )
    for k, (title, amount, unit, zero, share) in enumerate(gauges):
        y = 396.0 + 52 * k
        canvas.text(title, (left, y), MUTED, 11)
        canvas.text(f"{round(amount, 2) + 0.0:.2f} {unit}", (right, y), INK, 11, align="right")
        width = right - left
        canvas.rectangle(left, y + 16, width, 4, GRID, 2)
        begin, end = sorted((zero, min(max(share, 0.0), 1.0)))
        canvas.rectangle(left + width * begin, y + 16, width * (end - begin), 4, PATH, 2)
        canvas.circle((left + width * min(max(share, 0.0), 1.0), y + 18), 6, PATH)
    if n["success"]:
        canvas.rectangle(left, 492, right - left, 26, GOAL_COLOR, 6)
        canvas.text("arrived", ((left + right) / 2, 505), PANEL, 13, bold=True, align="center")
