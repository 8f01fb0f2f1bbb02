"""A route's waypoints moved to their best places, each leg staying in the mode that was chosen for it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.optimize import NonlinearConstraint, minimize

from fieldagents.reference.uav_route.limits import NOSE, TAIL, limits_of
from fieldmodels.model import FloatArray
from fieldmodels.uav_route.parameters import World

Kind = Literal["outside", "nose", "tail"]


@dataclass(frozen=True)
class Mode:
    """One convex way of passing a radar.

    Attributes:
        kind: Outside the circle, or the radar in the cone about nose or tail.
        bearing: Bearing from the radar of the touching line or of the sector's middle [rad].
        width: Half the sector [rad].
    """

    kind: Kind
    bearing: float
    width: float


def length_of(waypoints: FloatArray) -> float:
    """Length of a path [km]."""
    return float(np.hypot(*np.diff(waypoints, axis=0).T).sum())


def polished(
    waypoints: FloatArray,
    modes: Sequence[Sequence[Mode]],
    radars: FloatArray,
    world: World,
    heading: float | None,
    margin: float = 1e-6,
) -> FloatArray:
    """Move waypoints for the least length, by sequential quadratic programming from a valid route.

    Towards a radar's cone the exact condition holds at both ends of a leg, and so between them; an outside
    leg keeps beyond a line whose bearing is free now. The result may fail by the optimiser's tolerance:
    whoever asks re-flies it.

    Args:
        waypoints: Start, waypoints and goal [km], shape (n, 2).
        modes: Mode of each leg towards each radar.
        radars: North and east of each radar [km], shape (radars, 2).
        world: The continuous model.
        heading: Heading before the first leg [rad], or None.
        margin: What is kept from the limits [km, rad].
    """
    n, limits = len(waypoints), limits_of(world)
    bearings = np.array([m.bearing for leg in modes for m in leg if m.kind == "outside"])

    def points(x: FloatArray) -> FloatArray:
        return np.concatenate([waypoints[:1], x[: 2 * (n - 2)].reshape(-1, 2), waypoints[-1:]])

    def length(x: FloatArray) -> float:
        d = np.diff(points(x), axis=0)
        return float(np.sqrt(np.sum(d * d, axis=1) + 1e-12).sum())

    def room(x: FloatArray) -> FloatArray:
        p, lines, values = points(x), iter(x[2 * (n - 2) :]), []
        for i, leg in enumerate(modes):
            turns = i > 0 or (heading is not None and not _goes_on(waypoints, heading))
            course = p[i + 1] - p[i]
            for mode, radar in zip(leg, radars, strict=True):
                ends = p[i : i + 2] - radar
                if mode.kind == "outside":
                    b = next(lines)
                    distance = limits.banked_side if turns else limits.side
                    values += list(ends @ np.array([math.cos(b), math.sin(b)]) - distance - margin)
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
    if heading is not None and _goes_on(waypoints, heading):
        constraints.append(NonlinearConstraint(lambda x: np.array([_across(points(x), heading)]), 0.0, 0.0))
    begin = np.concatenate([waypoints[1:-1].ravel(), bearings])
    result = minimize(
        length, begin, method="SLSQP", constraints=constraints, options={"maxiter": 200, "ftol": 1e-9}
    )
    return points(result.x)


def split(
    waypoints: FloatArray, modes: Sequence[Sequence[Mode]], legs: int
) -> tuple[FloatArray, list[list[Mode]]]:
    """Divide the longest leg in which a turn shows nothing until there are ``legs`` of them."""
    path, kinds = list(waypoints), [list(leg) for leg in modes]
    while len(kinds) < legs:
        lengths = [
            math.dist(path[i], path[i + 1]) if i > 0 or all(m.kind != "outside" for m in kinds[i]) else 0.0
            for i in range(len(kinds))
        ]
        i = int(np.argmax(lengths))
        if lengths[i] == 0.0:
            break
        path.insert(i + 1, 0.5 * (path[i] + path[i + 1]))
        kinds.insert(i, kinds[i])
    return np.array(path), kinds


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
