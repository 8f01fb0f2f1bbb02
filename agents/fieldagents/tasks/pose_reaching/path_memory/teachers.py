"""Who drives the training paths: a smooth control law, the shortest path, or an omnidirectional robot.

The source's teacher was one of the path generators of Cornell's RoboCup system, which it does not describe
(section 5.3.2); it says that any will do (5.4).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal

import numpy as np

from fieldagents.tasks.pose_reaching.path_memory.matrices import Floats
from fieldagents.tasks.pose_reaching.path_memory.memory import States
from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled
from fieldmodels.machines.pose_reaching.dubins import dubins_path
from fieldmodels.machines.pose_reaching.parameters import GOAL, GOAL_HEADING, Field, Limits
from fieldmodels.machines.pose_reaching.unicycle import arc, wrapped

Teacher = Literal["graceful", "dubins", "straight"]

LIMITS, FIELD = Limits(), Field()
FINE = 0.002
"""Time between the poses of a driven path [s]."""
DONE = 0.01
"""Distance from the ball at which a smooth path ends [m]."""
MARGIN = 0.1
"""How far training paths start from the walls at least [m]."""


@compiled
def _graceful(
    pose: FloatArray, goal_heading: float, max_speed: float, max_rate: float, step: float, longest: int
) -> FloatArray:
    poses = np.empty((longest, 3))
    x, y, heading = pose[0], pose[1], pose[2]
    count = 0
    for k in range(longest):
        poses[k, 0], poses[k, 1], poses[k, 2] = x, y, heading
        count = k + 1
        distance = math.hypot(x, y)
        if distance < DONE:
            break
        speed, rate = graceful_command(x, y, heading, goal_heading, max_speed, max_rate)
        x, y, _, _ = arc(x, y, math.cos(heading), math.sin(heading), speed * step, rate * step)
        heading += rate * step
    return poses[:count]


@compiled
def graceful_command(
    x: float, y: float, heading: float, goal_heading: float, max_speed: float, max_rate: float
) -> tuple[float, float]:
    """Speed [m/s] and turn rate [rad/s] of the smooth control law to a pose at the origin.

    Source: J. J. Park and B. Kuipers, "A smooth control law for graceful motion of differential
    wheeled mobile robots in 2D environment", ICRA 2011, with k1 = 1, k2 = 3, beta = 0.4, lambda = 2.
    The speed does not fall towards the goal: the robot may pass it.
    """
    distance = max(math.hypot(x, y), 1e-6)
    sight = math.atan2(-y, -x)
    goal = wrapped(goal_heading - sight)
    own = wrapped(heading - sight)
    curvature = (
        -(3.0 * (own - math.atan(-goal)) + (1.0 + 1.0 / (1.0 + goal * goal)) * math.sin(own)) / distance
    )
    speed = max_speed / (1.0 + 0.4 * curvature * curvature)
    speed = min(speed, max_rate / max(abs(curvature), 1e-9))
    return speed, curvature * speed


@compiled
def graceful_commands(
    poses: FloatArray, goal_heading: float, max_speed: float, max_rate: float
) -> FloatArray:
    """Speed and turn rate of the smooth control law at each pose, shape (batch, 2)."""
    commands = np.empty((len(poses), 2))
    for i in range(len(poses)):
        commands[i, 0], commands[i, 1] = graceful_command(
            poses[i, 0], poses[i, 1], poses[i, 2], goal_heading, max_speed, max_rate
        )
    return commands


def graceful_path(start: Floats, limits: Limits = LIMITS) -> Floats:
    """Poses of a path by the smooth control law, 2 ms apart, shape (n, 3); headings are continuous."""
    return _graceful(start, GOAL_HEADING, limits.max_speed, limits.max_rate, FINE, round(60 / FINE))


def shortest_path(start: Floats, limits: Limits = LIMITS) -> Floats:
    """Poses of the Dubins path at full speed, 2 ms apart, shape (n, 3); headings are continuous."""
    path = dubins_path(start, GOAL, limits.radius)
    return path.at(np.arange(0.0, path.length, FINE * limits.max_speed))


def straight_path(start: Floats, limits: Limits = LIMITS) -> Floats:
    """Poses of an omnidirectional robot that drives straight to the ball, 2 ms apart, shape (n, 3).

    It turns evenly on the way; section 5.3.2: "a more direct approach to the ball and change orientation
    independently of the path heading".
    """
    x, y, heading = start
    turn = wrapped(GOAL_HEADING - heading)
    duration = max(math.hypot(x, y) / limits.max_speed, abs(turn) / limits.max_rate)
    share = np.linspace(0.0, 1.0, max(2, math.ceil(duration / FINE)))
    return np.stack([x * (1 - share), y * (1 - share), heading + turn * share], axis=1)


TEACHERS: dict[str, Callable[[Floats, Limits], Floats]] = {
    "graceful": graceful_path,
    "dubins": shortest_path,
    "straight": straight_path,
}


def record(paths: list[Floats], points: int, tick: float, sideways: bool = False) -> States:
    """Remember some points of driven paths, each with the mean command of the tick that follows.

    A command holds for a whole tick, so what is remembered is what a tick of it did: averaging keeps the
    corners of a path where an instant's command would make the robot orbit.

    Args:
        paths: Poses 2 ms apart, each of shape (n, 3), headings continuous.
        points: States to keep of each path, evenly spaced along it; the last lies before the goal.
        tick: Time for which a command holds [s].
        sideways: Whether the robot drives where it does not head: the motion has a direction of its own.
    """
    ahead = max(1, round(tick / FINE))
    kept: list[States] = []
    for number, path in enumerate(paths):
        moved = np.hypot(*np.diff(path[:, :2], axis=0).T)
        length = np.concatenate([[0.0], np.cumsum(moved)])
        wanted = np.arange(points) * length[-1] / points
        at = np.minimum(np.searchsorted(length, wanted), len(path) - 2)
        after = np.minimum(at + ahead, len(path) - 1)
        took = (after - at) * FINE
        way = path[after] - path[at]
        kept.append(
            States(
                poses=path[at],
                speed=(length[after] - length[at]) / took,
                rate=(path[after, 2] - path[at, 2]) / took,
                direction=np.arctan2(way[:, 1], way[:, 0]) if sideways else path[after, 2],
                path=np.full(points, number),
            )
        )
    return States(
        *(np.concatenate([getattr(one, name) for one in kept]) for name in States.__dataclass_fields__)
    )


def starts_facing(paths: int, distance: float = 1.6, field: Field = FIELD) -> Floats:
    """Starts on the right half, facing the ball, evenly around it from below to above (Fig 5.3).

    Args:
        paths: How many; one alone starts to the right of the ball.
        distance: From the ball [m], less where a wall is in the way.
        field: The field.

    Returns:
        Shape (paths, 3).
    """
    # Straight above, both ways round the ball are equally long; a hair less leads round the right.
    bearing = np.linspace(0.0, math.pi - 0.01, paths) if paths > 1 else np.array([math.pi / 2])
    x, y = np.sin(bearing), -np.cos(bearing)
    with np.errstate(divide="ignore"):
        room = np.minimum((field.length / 2 - MARGIN) / np.abs(x), (field.width / 2 - MARGIN) / np.abs(y))
    far = np.minimum(distance, room)
    return np.stack([far * x, far * y, np.arctan2(-y, -x)], axis=1)


def starts_anywhere(paths: int, rng: np.random.Generator, field: Field = FIELD) -> Floats:
    """Starts anywhere on the right half with any heading, shape (paths, 3)."""
    low = (DONE * 10, -field.width / 2 + MARGIN, -math.pi)
    high = (field.length / 2 - MARGIN, field.width / 2 - MARGIN, math.pi)
    return rng.uniform(low, high, (paths, 3))


def taught(
    teacher: Teacher, starts: Floats, points: int = 14, tick: float = 0.1, limits: Limits = LIMITS
) -> States:
    """Training data of a teacher.

    Args:
        teacher: Who drives.
        starts: Where its paths start, shape (paths, 3).
        points: States kept of each path.
        tick: Time for which a command holds [s].
        limits: Speeds and turning circle.
    """
    return record([TEACHERS[teacher](start, limits) for start in starts], points, tick, teacher == "straight")
