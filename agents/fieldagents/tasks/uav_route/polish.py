"""A route's waypoints moved to their best places, each leg staying in the mode that was chosen for it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.optimize import NonlinearConstraint, minimize

from fieldagents.tasks.uav_route.limits import NOSE, TAIL, banked_limits, limits_of
from fieldmodels.arrays import FloatArray
from fieldmodels.machines.uav_route.aircraft import turn_time
from fieldmodels.machines.uav_route.parameters import World

Kind = Literal["outside", "nose", "tail", "free"]

Span = tuple[float, float]
"""Shortest and longest length of a leg [km]."""

SLACK = 0.05
"""What legs that use lock loss keep from the radars' times [km]: detections begin and end between scans."""


@dataclass(frozen=True)
class Mode:
    """One convex way of passing a radar.

    Attributes:
        kind: Outside the circle, the radar in the cone about nose or tail, or detected for a while.
        bearing: Bearing from the radar of the touching line or of the sector's middle [rad].
        width: Half the sector [rad].
    """

    kind: Kind
    bearing: float
    width: float


def length_of(waypoints: FloatArray) -> float:
    """Length of a path [km]."""
    return float(np.hypot(*np.diff(waypoints, axis=0).T).sum())


def bank_length(world: World, turn: float) -> float:
    """Length that is flown in the bank of a turn [km]."""
    return world.aircraft.speed * turn_time(turn, world.aircraft.speed, world.aircraft.bank)


def free_length(world: World) -> float:
    """Length that may be flown under detection before a missile is launched [km]; 0 if none may."""
    return max(0.0, world.aircraft.speed * world.lock_loss.engage - SLACK)


def lock_length(world: World) -> float:
    """Length that must be flown undetected for a lock to be lost [km]."""
    return world.aircraft.speed * world.lock_loss.lose + SLACK


def polished(
    waypoints: FloatArray,
    modes: Sequence[Sequence[Mode]],
    spans: Sequence[Span],
    radars: FloatArray,
    world: World,
    heading: float | None,
    margin: float = 1e-6,
) -> FloatArray:
    """Move waypoints for the least length, by sequential quadratic programming from a valid route.

    Towards a radar's cone the exact condition holds at both ends of a leg, and so between them; an outside
    leg keeps beyond a line whose bearing is free now, and in its bank, at some places, from where it would be
    seen at that azimuth. The result may fail between these or by the optimiser's tolerance: whoever asks
    simulates it.

    Args:
        waypoints: Start, waypoints and goal [km], shape (n, 2).
        modes: Mode of each leg towards each radar.
        spans: Shortest and longest length of each leg.
        radars: North and east of each radar [km], shape (radars, 2).
        world: The continuous model.
        heading: Heading before the first leg [rad], or None.
        margin: What is kept from the limits [km, rad].
    """
    n, limits = len(waypoints), limits_of(world)
    on = heading is not None and _goes_on(waypoints, heading)
    turns = [(i > 0 or (heading is not None and not on)) and world.aircraft.bank > 0.0 for i in range(n - 1)]
    bearings = [m.bearing for leg in modes for m in leg if m.kind == "outside"]
    in_bank = banked_limits(world)

    def points(x: FloatArray) -> FloatArray:
        return np.concatenate([waypoints[:1], x[: 2 * (n - 2)].reshape(-1, 2), waypoints[-1:]])

    def length(x: FloatArray) -> float:
        d = np.diff(points(x), axis=0)
        return float(np.sqrt(np.sum(d * d, axis=1) + 1e-12).sum())

    def room(x: FloatArray) -> FloatArray:
        p, values = points(x), []
        lines = iter(x[2 * (n - 2) :])
        course = None if heading is None else np.array([math.cos(heading), math.sin(heading)])
        for i, leg in enumerate(modes):
            before, course = course, p[i + 1] - p[i]
            flown = math.hypot(*course)
            shortest, longest = spans[i]
            values += [flown - shortest] if shortest > 0.0 else []
            values += [longest - flown] if longest < math.inf else []
            for mode, radar in zip(leg, radars, strict=True):
                ends = p[i : i + 2] - radar
                if mode.kind == "free":
                    continue
                if mode.kind == "outside":
                    values += _beyond(ends, next(lines), limits.side + margin)
                    if turns[i] and before is not None:
                        bank = min(bank_length(world, _angle(before, course)), flown)
                        for share in (0.0, 0.25, 0.5, 0.75, 1.0):
                            place = ends[0] + course * (share * bank / max(flown, 1e-9))
                            least = float(np.interp(_angle(course, -place), *in_bank))
                            values.append(math.hypot(*place) - least - margin)
                    continue
                nose = mode.kind == "nose"
                least, steep = (limits.nose, NOSE) if nose else (limits.tail, TAIL)
                for end in ends:
                    r = math.hypot(*end)
                    along = float(course @ end) / r * (-1.0 if nose else 1.0)
                    across = float(course[0] * end[1] - course[1] * end[0]) / r
                    values += [math.tan(steep - margin) * along + s * across for s in (-1.0, 1.0)]
                    values.append(r - least - margin)
        return np.array(values)

    constraints = [NonlinearConstraint(room, 0.0, np.inf)]
    if heading is not None and on:
        constraints.append(NonlinearConstraint(lambda x: np.array([_across(points(x), heading)]), 0.0, 0.0))
    begin = np.concatenate([waypoints[1:-1].ravel(), bearings])
    result = minimize(
        length, begin, method="SLSQP", constraints=constraints, options={"maxiter": 200, "ftol": 1e-9}
    )
    better = points(result.x)
    return better if length_of(better) < length_of(waypoints) else waypoints


def _beyond(places: FloatArray, bearing: float, distance: float) -> list[float]:
    """How far places relative to a radar lie beyond a line at a distance from it [km]."""
    return list(places @ np.array([math.cos(bearing), math.sin(bearing)]) - distance)


def _angle(a: FloatArray, b: FloatArray) -> float:
    """Angle between two courses [rad]."""
    return math.atan2(abs(float(a[0] * b[1] - a[1] * b[0])), float(a @ b))


def split(
    waypoints: FloatArray, modes: Sequence[Sequence[Mode]], spans: Sequence[Span], legs: int
) -> tuple[FloatArray, list[list[Mode]], list[Span]]:
    """Divide the longest leg in which a turn shows nothing until there are ``legs`` of them."""
    path, kinds, lengths = list(waypoints), [list(leg) for leg in modes], list(spans)
    while len(kinds) < legs:
        room = [
            math.dist(path[i], path[i + 1])
            if lengths[i] == (0.0, math.inf) and all(m.kind != "outside" for m in kinds[i])
            else 0.0
            for i in range(len(kinds))
        ]
        i = int(np.argmax(room))
        if room[i] == 0.0:
            break
        path.insert(i + 1, 0.5 * (path[i] + path[i + 1]))
        kinds.insert(i, kinds[i])
        lengths.insert(i, lengths[i])
    return np.array(path), kinds, lengths


def _goes_on(waypoints: FloatArray, heading: float) -> bool:
    """Whether the first leg keeps the heading before it."""
    d = waypoints[1] - waypoints[0]
    return (
        abs(_across(waypoints, heading)) < 1e-6 * math.hypot(*d)
        and math.cos(heading) * d[0] + math.sin(heading) * d[1] > 0.0
    )


def _across(waypoints: FloatArray, heading: float) -> float:
    d = waypoints[1] - waypoints[0]
    return float(math.cos(heading) * d[1] - math.sin(heading) * d[0])
