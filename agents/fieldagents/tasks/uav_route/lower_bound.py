"""A length below which no path is undetected: tangent, arc and spiral about one radar, without a bank.

Outside the circle in which the side is seen, any heading is allowed. Inside it, the radar must stay within
about 30 degrees of the nose or 20 of the tail, so that each radius gained or lost allows only so much angle:
along the limit the path is a logarithmic spiral, and where a straight line keeps within it, that line.

It is the length that results are divided by. A bank hides what level flight shows between 30 and 39 degrees
from the nose, for as long as it lasts: a route may be shorter by up to 0.2 %, which ``banked_bound`` knows.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from fieldagents.tasks.uav_route.limits import NOSE, STEEP, TAIL, limits_of, steepest
from fieldgym.info import part
from fieldmodels.arrays import FloatArray
from fieldmodels.machines.uav_route.parameters import Layout, World


def lower_bound(layout: Layout, world: World) -> float:
    """Shortest length of a path that is nowhere detected [km], bank ignored.

    Each radar is taken by itself, and the largest bound holds. Where the argument does not cover a radar
    (start and goal both inside its circle, or flying in and out again could be shorter than around) only
    the straight line bounds the path.
    """
    start, goal = np.array(layout.start), np.array(layout.goal)
    straight = float(np.hypot(*(goal - start)))
    return max(
        (_about(start - np.array(r), goal - np.array(r), world) for r in layout.radars), default=straight
    )


def bound_to_capture(layout: Layout, world: World, capture: float) -> tuple[float, float]:
    """The same to the nearest place on the circle in which a flight has arrived, and where that is.

    Returns:
        The length [km], at least 1e-3, and the bearing of the place from the goal [rad].
    """
    return _bound_to_capture(layout, that_matters(world), capture)


def that_matters(world: World) -> World:
    """A world without what does not matter to the bound: lock loss, luck, and how equations are read."""
    return World(world.aircraft, replace(world.detection, detection="deterministic"))


@lru_cache(maxsize=4096)
def _bound_to_capture(layout: Layout, world: World, capture: float) -> tuple[float, float]:
    def bound(bearing: float) -> float:
        return lower_bound(moved_goal(layout, capture, bearing), world)

    coarse = np.linspace(-math.pi, math.pi, 16, endpoint=False)
    best = float(min(coarse, key=lambda a: bound(float(a))))
    around = (best - coarse[1] + coarse[0], best + coarse[1] - coarse[0])
    least = minimize_scalar(bound, bounds=around, method="bounded", options={"xatol": 1e-3})
    if least.fun < bound(best):
        best = float(least.x)
    return max(bound(best), 1e-3), best


def moved_goal(layout: Layout, distance: float, bearing: float) -> Layout:
    """A layout with its goal moved by a distance [km] along a bearing [rad]."""
    north, east = layout.goal
    goal = (north + distance * math.cos(bearing), east + distance * math.sin(bearing))
    return Layout(layout.start, goal, layout.radars)


def layouts_of(info: Mapping[str, Any]) -> list[Layout]:
    """The layout of each episode of a batch, or of each aircraft in turn, from its ``info``."""
    known = part(info, "layout")
    starts, goals = (np.reshape(known[name], (-1, 2)) for name in ("start", "goal"))
    count = len(starts) // len(known["radars"])
    return [
        Layout(
            (float(start[0]), float(start[1])),
            (float(goal[0]), float(goal[1])),
            tuple((float(x), float(y)) for x, y in radars),
        )
        for start, goal, radars in zip(starts, goals, np.repeat(known["radars"], count, axis=0), strict=True)
    ]


def _about(start: FloatArray, goal: FloatArray, world: World) -> float:
    """The bound for one radar at the origin."""
    straight = float(np.hypot(*(goal - start)))
    circle = limits_of(world).side
    r_start, r_goal = float(np.hypot(*start)), float(np.hypot(*goal))
    cosine = float(start @ goal) / max(r_start * r_goal, 1e-12)
    angle = math.acos(min(1.0, max(-1.0, cosine)))
    if min(r_start, r_goal) >= circle:
        return _around(r_start, r_goal, angle, circle)
    if max(r_start, r_goal) < circle or not _around_is_shorter(min(r_start, r_goal), angle, circle):
        return straight
    outer, inner = max(r_start, r_goal), min(r_start, r_goal)
    spiral = _Spiral(inner, circle, world, nose=r_goal < r_start)

    def turned(closest: float) -> float:
        """How much farther from the radar the way outside, straight on, would pass than that inside."""
        return _to_circle(outer, angle - spiral.way(closest)[0], circle)[1] - closest

    closest = float(spiral.radius[-1])
    if turned(closest) < 0.0:  # the shortest way does not turn where it enters the circle
        closest = float(brentq(turned, 0.0, closest))
    gained, inside = spiral.way(closest)
    return max(straight, _to_circle(outer, angle - gained, circle)[0] + inside)


def _around_is_shorter(inner: float, angle: float, circle: float) -> bool:
    """Whether flying in and out along the limits gains an angle less cheaply than the circle does."""
    nose, tail = NOSE + STEEP, TAIL + STEEP
    per_logarithm = math.tan(nose) + math.tan(tail)
    per_radius = 1.0 / math.cos(nose) + 1.0 / math.cos(tail)
    return per_radius * inner * (1.0 - math.exp(-angle / per_logarithm)) >= circle * angle


def _to_circle(r: float, angle: float, circle: float) -> tuple[float, float]:
    """Shortest way from a place outside the circle to one on it, ``angle`` further, and what a radian adds.

    What it adds is how near the way's last straight would pass the radar.
    """
    tangent = math.acos(min(1.0, circle / r))
    if angle <= tangent:
        length = math.hypot(r - circle, 2.0 * math.sqrt(r * circle) * math.sin(0.5 * angle))
        return length, r * circle * math.sin(angle) / max(length, 1e-12)
    return math.sqrt(max(r * r - circle * circle, 0.0)) + circle * (angle - tangent), circle


def _around(r: float, s: float, angle: float, circle: float) -> float:
    """Shortest way between two places outside the circle."""
    tangents = math.acos(circle / r) + math.acos(circle / s)
    if angle <= tangents:
        return math.sqrt(max(r * r + s * s - 2.0 * r * s * math.cos(angle), 0.0))
    return (
        math.sqrt(r * r - circle * circle) + math.sqrt(s * s - circle * circle) + circle * (angle - tangents)
    )


class _Spiral:
    """Ways between the circle and a place inside it, as steep to the radial as the threshold allows."""

    def __init__(self, inner: float, circle: float, world: World, *, nose: bool) -> None:
        edges = np.linspace(inner, circle, 401)
        self.radius, self.step = 0.5 * (edges[1:] + edges[:-1]), edges[1] - edges[0]
        radius, limit = steepest(world, nose)
        self.limit = limit[np.minimum(np.searchsorted(radius, edges[1:]), len(limit) - 1)]

    def way(self, closest: float) -> tuple[float, float]:
        """Angle gained [rad] and length [km] along straights that would pass the radar at ``closest`` [km].

        Where the limit forbids such a straight, the way is along the limit. A radian more adds ``closest``
        to the length, so that no other way gains the angle in less.
        """
        steepness = np.minimum(np.arcsin(np.minimum(closest / self.radius, 1.0)), self.limit)
        angle = np.sum(np.tan(steepness) / self.radius) * self.step
        return float(angle), float(np.sum(1.0 / np.cos(steepness)) * self.step)
