"""Random layouts, each with a route of two legs that no radar detects.

The first radar stands at the origin. The start lies outside the circle within which it detects the
aircraft side-on, the goal inside, where it can be reached nose first. The safe route leads past the circle
to the goal's radial, and in along it. Further radars keep their distance from it: from the first leg as
from a side-on aircraft, from the second one as from a banked one, so that a layout is never hopeless.
"""

from __future__ import annotations

import math

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import allocation_free_inlined as inlined
from fieldmodels.compiled import compiled
from fieldmodels.machines.uav_route.detection import detection_range
from fieldmodels.machines.uav_route.parameters import RADARS, Detection, Layout
from fieldmodels.machines.uav_route.signature import AZIMUTHS
from fieldmodels.model import ModelError
from fieldmodels.streams import drawn_key, symmetric, uniform

START_NEAR, START_FAR = 1.01, 1.29
"""Distance of the start from the first radar, in side-on ranges."""
GOAL_NEAR, GOAL_FAR = 0.69, 0.995
"""The same of the goal."""
SEPARATION = math.pi / 3
"""Largest angle between start and goal, seen from the first radar [rad]."""
MARGIN = 1.005
"""How much farther than it must the safe route keeps from the circles."""
FAR = 1.9
"""Largest distance of a further radar from the middle of start and goal, in side-on ranges."""
APART = 0.5
"""Smallest distance between two radars, in side-on ranges."""
WEDGE = float(AZIMUTHS[1])
"""Azimuth up to which the nose shows next to nothing [rad]."""


def side_on_range(detection: Detection) -> float:
    """Slant range at which a level aircraft is detected side-on [km]: signature 0.5."""
    return float(detection_range(0.5, detection.threshold, detection.interpolation))


def banked_range(detection: Detection) -> float:
    """Slant range at which the largest signature, 1, is detected [km]."""
    return float(detection_range(1.0, detection.threshold, detection.interpolation))


@inlined
def corner_radius(start_radius: float, separation: float, side_on: float) -> float:
    """Where the safe route meets the goal's radial [km]: on the start's tangent of the circle, or on it."""
    circle = MARGIN * side_on
    beyond = separation - math.acos(min(circle / start_radius, 1.0))
    return circle / math.cos(beyond) if beyond > 0.0 else circle


@inlined
def distance_from_leg(x: float, y: float, from_x: float, from_y: float, to_x: float, to_y: float) -> float:
    """Distance of a point from a leg [km]."""
    dx, dy = to_x - from_x, to_y - from_y
    square = dx * dx + dy * dy
    share = ((x - from_x) * dx + (y - from_y) * dy) / square if square > 0.0 else 0.0
    share = min(max(share, 0.0), 1.0)
    return math.hypot(x - from_x - share * dx, y - from_y - share * dy)


@inlined
def draw_ends(key: np.uint64, draw: int, side_on: float, start: FloatArray, goal: FloatArray) -> float:
    """Draw start and goal, shape (2,), by four numbers from ``draw`` on; returns the corner's radius [km]."""
    start_radius = side_on * (START_NEAR + (START_FAR - START_NEAR) * uniform(key, draw))
    goal_radius = side_on * (GOAL_NEAR + (GOAL_FAR - GOAL_NEAR) * uniform(key, draw + 1))
    bearing, separation = math.pi * symmetric(key, draw + 2), SEPARATION * symmetric(key, draw + 3)
    start[0], start[1] = start_radius * math.cos(bearing), start_radius * math.sin(bearing)
    north, east = math.cos(bearing + separation), math.sin(bearing + separation)
    goal[0], goal[1] = goal_radius * north, goal_radius * east
    return corner_radius(start_radius, abs(separation), side_on)


@inlined
def is_clear(
    x: float, y: float, start: FloatArray, goal: FloatArray, corner: float, side_on: float, banked: float
) -> bool:
    """Whether a radar at a place [km] leaves the safe route past a corner at a radius [km] undetected."""
    share = corner / math.hypot(goal[0], goal[1])
    north, east = share * goal[0], share * goal[1]
    first = distance_from_leg(x, y, start[0], start[1], north, east)
    second = distance_from_leg(x, y, north, east, goal[0], goal[1])
    return first > MARGIN * side_on and second > MARGIN * banked


@inlined
def draw_layout(
    key: np.uint64, count: int, side_on: float, banked: float, start: FloatArray, goal: FloatArray,
    radars: FloatArray,
) -> None:  # fmt: skip
    """Draw a layout into its arrays: start and goal, shape (2,), radars, shape (RADARS, 2)."""
    corner = draw_ends(key, 0, side_on, start, goal)
    radars[:, :] = 0.0
    placed, draw = 1, 4
    while placed < count:
        far = side_on * (1.0 + (FAR - 1.0) * uniform(key, draw))
        angle = math.pi * symmetric(key, draw + 1)
        draw += 2
        x = 0.5 * (start[0] + goal[0]) + far * math.cos(angle)
        y = 0.5 * (start[1] + goal[1]) + far * math.sin(angle)
        free = is_clear(x, y, start, goal, corner, side_on, banked)
        for other in range(placed):
            apart = math.hypot(x - radars[other, 0], y - radars[other, 1])
            free = free and apart > APART * side_on
        if free:
            radars[placed, 0], radars[placed, 1] = x, y
            placed += 1


@inlined
def draw_further(
    key: np.uint64, count: int, side_on: float, banked: float, start: FloatArray, goal: FloatArray,
    radars: FloatArray,
) -> None:  # fmt: skip
    """Draw start and goal of a further aircraft, until the radars of a layout leave it a safe route too."""
    draw, free = 0, False
    while not free:
        corner = draw_ends(key, draw, side_on, start, goal)
        draw, free = draw + 4, True
        for r in range(1, count):
            free = free and is_clear(radars[r, 0], radars[r, 1], start, goal, corner, side_on, banked)


@compiled
def _draw(
    key: np.uint64, count: int, side_on: float, banked: float, start: FloatArray, goal: FloatArray,
    radars: FloatArray,
) -> None:  # fmt: skip
    draw_layout(key, count, side_on, banked, start, goal, radars)


def random_layout(rng: np.random.Generator, radars: int = 1, detection: Detection | None = None) -> Layout:
    """Draw a layout.

    Args:
        rng: Source of randomness; one draw is taken.
        radars: Number of radars, 1 to 4.
        detection: What the layout must leave a way around; the default one if None.

    Raises:
        ModelError: If there is no such number of radars.
    """
    if radars not in range(1, RADARS + 1):
        raise ModelError(f"a layout has 1 to {RADARS} radars, not {radars}")
    detection = detection or Detection()
    start, goal, sites = np.zeros(2), np.zeros(2), np.zeros((RADARS, 2))
    key = drawn_key(rng)
    _draw(key, radars, side_on_range(detection), banked_range(detection), start, goal, sites)
    return Layout(
        (float(start[0]), float(start[1])),
        (float(goal[0]), float(goal[1])),
        tuple((float(x), float(y)) for x, y in sites[:radars]),
    )


def safe_route(layout: Layout, detection: Detection | None = None) -> FloatArray:
    """The two legs around the first radar of a layout, which none of a drawn layout's radars detects.

    Returns:
        Start, corner, goal: north and east [km], shape (3, 2).

    Raises:
        ModelError: If start and goal lie on opposite sides of the radar or the start lies in its circle.
    """
    side_on = side_on_range(detection or Detection())
    radar = np.array(layout.radars[0])
    start, goal = np.array(layout.start) - radar, np.array(layout.goal) - radar
    start_radius, goal_radius = np.hypot(*start), np.hypot(*goal)
    separation = math.acos(float(np.clip(start @ goal / (start_radius * goal_radius), -1.0, 1.0)))
    corner = corner_radius(float(start_radius), separation, side_on)
    if start_radius < side_on or corner < 0.0:
        raise ModelError("no route of two legs leads around the radar: the start is too near or behind it")
    route: FloatArray = np.array([start, goal * corner / goal_radius, goal]) + radar
    return route


@inlined
def distance_around(place: FloatArray, goal: FloatArray, radars: FloatArray, side_on: float) -> float:
    """How far it is to the goal past the circle of the radar next to it, about as an unseen flight goes.

    Straight from where the nose points at the radar all the way, a wedge that opens outwards at the goal;
    else along the circle's tangent, around it, and in along the wedge's edge. A measure of progress without
    jumps, no certificate: other radars and banks do not count.

    Args:
        place: North and east [km], shape (2,).
        goal: The same of the goal.
        radars: The same of the radars, shape (radars, 2).
        side_on: Radius of the radar's circle on the ground [km].

    Returns:
        Distance [km].
    """
    nearest, least = 0, math.inf
    for r in range(len(radars)):
        square = (radars[r, 0] - goal[0]) ** 2 + (radars[r, 1] - goal[1]) ** 2
        if square < least:
            nearest, least = r, square
    north, east = place[0] - radars[nearest, 0], place[1] - radars[nearest, 1]
    goal_north, goal_east = goal[0] - radars[nearest, 0], goal[1] - radars[nearest, 1]
    straight = math.hypot(goal_north - north, goal_east - east)
    outer = max(math.hypot(north, east), 1e-9)
    inner = max(math.hypot(goal_north, goal_east), 1e-9)
    cosine = (north * goal_north + east * goal_east) / (outer * inner)
    separation = math.acos(min(max(cosine, -1.0), 1.0))
    edge = 0.0
    if outer >= inner:
        edge = WEDGE - math.asin(math.sin(WEDGE) * inner / outer)
        if separation <= edge:
            return straight
    radius = max(min(outer, side_on), inner)  # at which the wedge is entered
    if radius != outer:
        edge = WEDGE - math.asin(math.sin(WEDGE) * inner / radius)  # its bearing there, from the goal's
    to_edge = separation - edge
    # angle seen from the radar to the tangent's point
    seen = math.acos(side_on / outer) if outer > side_on else 0.0
    if outer < side_on:
        way = abs(outer - radius) + side_on * to_edge
    elif to_edge > seen:
        way = math.sqrt(outer * outer - side_on * side_on) + side_on * (to_edge - seen)
    else:
        square = outer * outer + radius * radius - 2.0 * outer * radius * math.cos(max(to_edge, 0.0))
        way = math.sqrt(max(square, 0.0))
    entered = radius * math.sin(edge) / math.sin(WEDGE)  # distance of goal and edge
    return max(way + entered, straight)
