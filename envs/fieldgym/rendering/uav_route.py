"""The picture of a UAV's flight: the map with the radars' circles, the aircraft, and what each radar does."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fieldgym.rendering.canvas import Canvas, Color, Frame, Point
from fieldmodels.machines.uav_route.detection import detection_range
from fieldmodels.machines.uav_route.parameters import Layout, World
from fieldmodels.machines.uav_route.signature import AZIMUTHS, SIGNATURES
from fieldmodels.machines.uav_route.state import ARRIVED, DAMAGED, FLYING, LATE

BACKGROUND: Color = (250, 250, 247)
PANEL: Color = (255, 255, 255)
INK: Color = (38, 50, 64)
MUTED: Color = (122, 134, 148)
GRID: Color = (226, 230, 234)
FIELD: Color = (236, 240, 240)
SIDE: Color = (248, 228, 214)
NOSE: Color = (240, 196, 170)
RADAR: Color = (150, 60, 40)
GOAL: Color = (46, 140, 90)
PLAN: Color = (112, 126, 190)
CONE: Color = (196, 214, 236)
HIDDEN: Color = (60, 150, 110)
SEEN: Color = (205, 40, 40)
WARNING: Color = (232, 150, 30)

LEFT, TOP, SIZE = 24.0, 48.0, 468.0
"""Place and size of the map."""
LEAST_WIDTH = 150.0
"""Least width of the map [km]."""
CONE_LENGTH = 70.0
"""Length of the cones of small signature [pixels]."""
CONE_WIDTH = float(AZIMUTHS[1])
"""Half the angle of a cone [rad]: Table 4.1's step from nose to side."""
ENDS = {
    ARRIVED: ("arrived", GOAL),
    DAMAGED: ("hit by a missile", SEEN),
    LATE: ("no leg left", WARNING),
}


@dataclass(frozen=True)
class Picture:
    """What is drawn of one aircraft.

    Attributes:
        layout: Start, goal and radars.
        world: Detection and lock loss.
        capture: Distance from the goal at which a flight has arrived [km].
        max_legs: Legs of the episode.
        place: North and east of the aircraft [km].
        course: Cosine and sine of its course.
        trail: North, east [km] and largest probability of detection along the path, shape (n, 3), as in
            still air.
        probability: Each radar's probability of detection when it looked last, shape (radars,).
        detected: Whether it detected, shape (radars,).
        timers: Lock-loss, engage and launch timer [s], shape (radars, 3).
        over: 0 while the flight goes on, else how it ended.
        plan: An agent's waypoints, north and east [km], shape (points, 2), if it shows any.
    """

    layout: Layout
    world: World
    capture: float
    max_legs: int
    place: NDArray[np.float64]
    course: NDArray[np.float64]
    trail: NDArray[np.float64]
    probability: NDArray[np.float64]
    detected: NDArray[np.bool_]
    timers: NDArray[np.float64]
    over: int
    plan: NDArray[np.float64] | None = None


class Map:
    """From north and east [km] to pixels: north is up."""

    def __init__(self, pictures: Sequence[Picture]) -> None:
        points = np.vstack(
            [row for p in pictures for row in (p.layout.start, p.layout.goal, p.place, p.trail[:, :2])]
        )
        low, high = points.min(axis=0), points.max(axis=0)
        self.width = max(float((high - low).max()) * 1.3, LEAST_WIDTH)
        self.scale = SIZE / self.width
        self._middle = (low + high) / 2

    def __call__(self, place: NDArray[np.float64] | tuple[float, float]) -> Point:
        """Where a place is drawn."""
        return (
            LEFT + SIZE / 2 + (float(place[1]) - self._middle[1]) * self.scale,
            TOP + SIZE / 2 - (float(place[0]) - self._middle[0]) * self.scale,
        )


def draw(pictures: Sequence[Picture], numbers: Mapping[str, float]) -> Frame:
    """Draw the task, shape (540, 960, 3), uint8.

    Args:
        pictures: Of each aircraft, all under the same radars.
        numbers: Those of ``info``.
    """
    canvas, at, picture = Canvas(BACKGROUND), Map(pictures), pictures[0]
    canvas.rectangle(LEFT, TOP, SIZE, SIZE, FIELD)
    _circles(canvas, picture, at)
    for part in (_cones, _route, _ends, _aircraft):
        for own in pictures:
            part(canvas, own, at)
    _scale_bar(canvas, at)
    for x, y, w, h in ((0, 0, 960, TOP), (0, TOP + SIZE, 960, 540 - TOP - SIZE)):
        canvas.rectangle(x, y, w, h, BACKGROUND)
    canvas.rectangle(0, TOP, LEFT, SIZE, BACKGROUND)
    canvas.rectangle(LEFT + SIZE, TOP, 960 - LEFT - SIZE, SIZE, BACKGROUND)
    canvas.text("UAV route", (LEFT, 26), INK, 18, bold=True)
    legs = f"leg {numbers['legs']:.0f} of {len(pictures) * picture.max_legs}"
    canvas.text(legs, (LEFT + SIZE, 27), MUTED, 12, align="right")
    _legend(canvas, picture)
    _numbers(canvas, numbers, _end(pictures))
    _radars(canvas, pictures)
    return canvas.frame()


def _end(pictures: Sequence[Picture]) -> int:
    """How an episode has ended: while one flies, it goes on; all arrived, or as the first that did not."""
    ends = [picture.over for picture in pictures]
    return FLYING if FLYING in ends else next((end for end in ends if end != ARRIVED), ARRIVED)


def ground_range(picture: Picture, signature: float) -> float:
    """Distance on the map within which a signature is detected above the threshold [km]."""
    detection = picture.world.detection
    slant = float(detection_range(signature, detection.threshold, detection.interpolation))
    return math.sqrt(max(min(slant, detection.reach) ** 2 - picture.world.aircraft.altitude**2, 0.0))


def _circles(canvas: Canvas, picture: Picture, at: Map) -> None:
    """Where an aircraft is detected from the side, and where even with its nose to the radar."""
    side, nose = ground_range(picture, SIGNATURES[0, 2]), ground_range(picture, SIGNATURES[0, 0])
    for radius, color in ((side, SIDE), (nose, NOSE)):
        for radar in picture.layout.radars:
            canvas.circle(at(radar), radius * at.scale, color)
    for radar in picture.layout.radars:
        x, y = at(radar)
        canvas.circle((x, y), 6, RADAR)
        canvas.circle((x, y), 2.5, PANEL)
        angles = np.linspace(0.0, 2 * math.pi, 361)
        reach = side * at.scale
        canvas.line([(x + reach * math.sin(a), y - reach * math.cos(a)) for a in angles.tolist()], RADAR, 1.0)


def _cones(canvas: Canvas, picture: Picture, at: Map) -> None:
    """The cones of nose and tail within which a radar sees next to nothing."""
    x, y = at(picture.place)
    heading = math.atan2(picture.course[1], picture.course[0])
    for way in (heading, heading + math.pi):
        edge = [way + a for a in np.linspace(-CONE_WIDTH, CONE_WIDTH, 13).tolist()]
        arc = [(x + CONE_LENGTH * math.sin(a), y - CONE_LENGTH * math.cos(a)) for a in edge]
        canvas.polygon([(x, y), *arc], CONE)


def _route(canvas: Canvas, picture: Picture, at: Map) -> None:
    """The plan, and the path coloured by whether it is detected."""
    if picture.plan is not None:
        canvas.line([at(point) for point in picture.plan], PLAN, 1.5)
        for point in picture.plan:
            canvas.circle(at(point), 3.0, PLAN)
    threshold = picture.world.detection.threshold
    points = [at(picture.layout.start), *(at(row[:2]) for row in picture.trail), at(picture.place)]
    over = [False, *(picture.trail[:, 2] > threshold).tolist()]
    over.append(over[-1])
    if len(points) > 2:
        for k in range(1, len(points)):
            canvas.bar(points[k - 1], points[k], SEEN if over[k] else HIDDEN, 3.0)


def _ends(canvas: Canvas, picture: Picture, at: Map) -> None:
    """Start and goal."""
    goal, radius = at(picture.layout.goal), max(picture.capture * at.scale, 5.0)
    canvas.circle(goal, radius + 1.5, GOAL)
    canvas.circle(goal, radius, (206, 232, 214))
    canvas.circle(goal, 2.5, GOAL)
    canvas.text("goal", (goal[0], goal[1] - radius - 10), GOAL, 11, align="center")
    start = at(picture.layout.start)
    canvas.circle(start, 4.5, INK)
    canvas.text("start", (start[0], start[1] - 14), INK, 11, align="center")


def _aircraft(canvas: Canvas, picture: Picture, at: Map) -> None:
    x, y = at(picture.place)
    cosine, sine = picture.course.tolist()
    outline = (
        (11, 0),
        (2, 2),
        (-1, 10),
        (-4, 10),
        (-4, 2),
        (-9, 4),
        (-9, -4),
        (-4, -2),
        (-4, -10),
        (-1, -10),
        (2, -2),
    )
    canvas.polygon(
        [(x + ahead * sine + right * cosine, y - ahead * cosine + right * sine) for ahead, right in outline],
        INK,
    )


def _scale_bar(canvas: Canvas, at: Map) -> None:
    length = 10.0 ** math.floor(math.log10(at.width / 4))
    length *= 5.0 if at.width / 4 >= 5 * length else 2.0 if at.width / 4 >= 2 * length else 1.0
    canvas.rectangle(LEFT + 14, TOP + SIZE - 20, length * at.scale, 3, INK)
    middle = LEFT + 14 + length * at.scale / 2
    canvas.text(f"{length:g} km", (middle, TOP + SIZE - 32), INK, 11, align="center")


def _legend(canvas: Canvas, picture: Picture) -> None:
    entries = [("hidden", HIDDEN, 74.0), ("detected", SEEN, 88.0), ("small signature", CONE, 128.0)]
    if picture.plan is not None:
        entries.append(("plan", PLAN, 0.0))
    x = 516.0
    for name, color, width in entries:
        canvas.circle((x + 5, 27), 5, color)
        canvas.text(name, (x + 16, 27), INK, 12)
        x += width


def _numbers(canvas: Canvas, n: Mapping[str, float], end: int) -> None:
    """How the flight goes."""
    left = 516.0
    canvas.rectangle(left, TOP, 420, 118, PANEL, 8)
    rows = (
        ("path", f"{n['path_length']:.1f} km"),
        ("to the goal", f"{n['remaining']:.1f} km"),
        ("time", f"{n['time']:.0f} s"),
        ("detected for", f"{n['time_over']:.0f} s"),
        ("without a break", f"{n['longest_detection']:.0f} s"),
        ("lock losses", f"{n['lock_losses']:.0f}"),
    )
    for k, (name, value) in enumerate(rows):
        x, y = left + 16 + 112 * (k % 3), TOP + 20 + 52 * (k // 3)
        canvas.text(name, (x, y), MUTED, 11)
        canvas.text(value, (x, y + 18), INK, 14, bold=True)
    if end != FLYING:
        word, color = ENDS[end]
        canvas.rectangle(left + 336, TOP + 12, 76, 94, color, 6)
        for k, part in enumerate(word.split(" ")):
            canvas.text(
                part,
                (left + 374, TOP + 60 + 18 * (k - word.count(" ") / 2)),
                PANEL,
                12,
                bold=True,
                align="center",
            )


def _radars(canvas: Canvas, pictures: Sequence[Picture]) -> None:
    """Of each radar the probability of detection and the timers, of the aircraft that it threatens most."""
    left, top, height = 516.0, TOP + 130, 84.0
    world = pictures[0].world
    threshold, lock = world.detection.threshold, world.lock_loss
    for r in range(len(pictures[0].layout.radars)):
        picture = max(pictures, key=lambda p: (p.over == FLYING, p.timers[r, 1], p.probability[r]))
        y = top + (height + 4) * r
        canvas.rectangle(left, y, 420, height, PANEL, 8)
        seen = bool(picture.detected[r])
        canvas.circle((left + 20, y + 18), 6, SEEN if seen else HIDDEN)
        canvas.text("detects" if seen else "sees nothing", (left + 34, y + 18), INK, 12, bold=True)
        canvas.text(f"radar {r + 1}", (left + 16, y + 40), MUTED, 11)
        share = float(picture.probability[r])
        _bar(canvas, left + 16, y + 68, 110, share, SEEN if share > threshold else HIDDEN)
        canvas.rectangle(left + 16 + 110 * threshold - 1, y + 62, 2, 14, INK)
        canvas.text(f"P {share:.2f}", (left + 16 + 110, y + 40), INK, 11, align="right")
        timers = (
            ("engaged", picture.timers[r, 1], lock.engage, WARNING),
            ("launched", picture.timers[r, 2], lock.target, SEEN),
            ("hidden", picture.timers[r, 0], lock.lose, HIDDEN),
        )
        if not math.isfinite(lock.lose):
            canvas.text("no lock is lost: detected is destroyed", (left + 150, y + 42), MUTED, 11)
            continue
        for k, (name, time, most, color) in enumerate(timers):
            line = y + 18 + 24 * k
            canvas.text(name, (left + 150, line), MUTED, 11)
            _bar(canvas, left + 216, line + 1, 110, float(time) / most if most else float(time > 0), color)
            canvas.text(f"{min(time, most):.0f} of {most:.4g} s", (left + 410, line), INK, 11, align="right")


def _bar(canvas: Canvas, x: float, y: float, width: float, share: float, color: Color) -> None:
    canvas.rectangle(x, y - 3, width, 6, GRID, 3)
    if share > 0.0:
        canvas.rectangle(x, y - 3, width * min(share, 1.0), 6, color, 3)
