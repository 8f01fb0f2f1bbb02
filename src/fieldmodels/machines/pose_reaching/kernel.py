"""The kernels of a batch of robots: drawn starts, ticks of control, arrival and score, in one call."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled, inlined
from fieldmodels.machines.pose_reaching.drive import moved
from fieldmodels.machines.pose_reaching.dubins import shortest
from fieldmodels.machines.pose_reaching.extended import (
    Extended,
    at_rest,
    measured,
    remember,
    travelled,
    travelled_sideways,
)
from fieldmodels.machines.pose_reaching.parameters import GOAL_HEADING
from fieldmodels.machines.pose_reaching.unicycle import (
    arrival_share,
    arrived,
    slid_along_walls,
    slipping_arc,
    stopped_by_walls,
    wrapped,
)
from fieldmodels.streams import GAMMA, mixed, symmetric, uniform

NEAREST = 1e-3
"""Smallest distance whose logarithm is observed [m]."""
FACING_NEAR, FACING_FAR = 0.6, 1.6
"""Distances from the ball of the starts T1 and T2 [m]."""
SPREAD = math.pi / 4
"""Largest angle between heading and ball of the starts T2 [rad]."""

OBSERVED = ("x", "y", "cos heading", "sin heading", "log distance", "cos ball", "sin ball")
NUMBERS = ("success", "time", "path_length", "dubins_length", "dubins_time", "wall_hits")
T1, T2, T3 = range(3)
STOP, SLIDE = range(2)
SUCCESS, TIME, PATH, DUBINS, DUBINS_TIME, WALL_HITS = range(6)

ROBOT = np.dtype(
    [
        ("key", np.uint64),  # the robot's random stream
        ("episode", np.int64),  # episodes begun under this key
        ("ticks", np.int64),  # of this episode
        ("over", np.int64),  # arrived or out of time
        ("touching", np.int64),  # held by a wall
        ("x", np.float64),
        ("y", np.float64),
        ("heading", np.float64),  # [rad], in [-pi, pi]
        ("cosine", np.float64),  # of the heading
        ("sine", np.float64),
        ("distance", np.float64),  # from the ball [m]
        ("time", np.float64),  # of this episode [s]
        ("path_length", np.float64),  # [m]
        ("dubins_length", np.float64),  # from the episode's start to the goal [m]
        ("wall_hits", np.float64),
    ]
)
"""What a robot remembers between ticks, but for its effects (``Extended``)."""


@inlined
def put(robot: Any, x: float, y: float, heading: float, extended: Extended | None, b: int, c: Any) -> None:
    """Begin robot ``b``'s episode at a pose."""
    robot.ticks = 0
    robot.over = 0
    robot.touching = 0
    robot.x = x
    robot.y = y
    robot.heading = heading
    robot.cosine = math.cos(heading)
    robot.sine = math.sin(heading)
    robot.distance = math.sqrt(x * x + y * y)
    robot.time = 0.0
    robot.path_length = 0.0
    robot.dubins_length = shortest(x, y, heading, 0.0, 0.0, GOAL_HEADING, c.radius)[0]
    robot.wall_hits = 0.0
    if extended is not None:
        at_rest(extended, b, x, y, heading)


@inlined
def start(robot: Any, extended: Extended | None, b: int, c: Any) -> None:
    """Begin robot ``b``'s next episode at a start drawn from its stream; one in the goal is drawn anew."""
    robot.episode += 1
    key = mixed(robot.key + np.uint64(robot.episode) * GAMMA)
    draw = 0
    while True:
        first, second, third = uniform(key, draw), symmetric(key, draw + 1), symmetric(key, draw + 2)
        draw += 3
        if c.starts == T3:
            x, y = c.half_length * (2.0 * first - 1.0), c.half_width * second
            heading = math.pi * third
        else:
            distance = FACING_NEAR + (FACING_FAR - FACING_NEAR) * first
            bearing = 0.5 * math.pi * second if c.starts == T1 else math.pi * second
            x, y = distance * math.cos(bearing), distance * math.sin(bearing)
            heading = wrapped(bearing + math.pi + (SPREAD * third if c.starts == T2 else 0.0))
        inside = abs(x) <= c.half_length and abs(y) <= c.half_width
        if inside and not arrived(x, y, math.sin(heading), c.near, c.cosine_of_angle):
            break
    put(robot, x, y, heading, extended, b, c)


@inlined
def within_walls(x: float, y: float, new_x: float, new_y: float, c: Any) -> tuple[float, float, bool]:
    """Where a step ends that would end at the new position, and whether a wall was hit."""
    if c.walls == SLIDE:
        return slid_along_walls(new_x, new_y, c.half_length, c.half_width)
    return stopped_by_walls(x, y, new_x, new_y, c.half_length, c.half_width)


@inlined
def turned(heading: float, turn: float) -> float:
    """A heading after a turn, in [-pi, pi] [rad]."""
    heading += turn
    return heading if abs(heading) <= math.pi else wrapped(heading)


@inlined
def drive(robot: Any, speed: float, sideways: float | None, rate: float, c: Any) -> tuple[bool, bool]:
    """Drive a nominal robot for a tick in one arc, or until it has arrived; faster than ``drive_extended``.

    ``sideways`` is None for a unicycle, and left out when this is compiled.

    Returns:
        Whether it has arrived, and whether a wall has held it.
    """
    x, y, cosine, sine = robot.x, robot.y, robot.cosine, robot.sine
    distance, turn, time = speed * c.tick, rate * c.tick, (robot.ticks + 1) * c.tick
    lateral, way = 0.0, distance
    if sideways is not None:
        lateral = sideways * c.tick
        way = math.hypot(distance, lateral)
    there = False
    if robot.distance < c.near + way:
        share = arrival_share(
            x, y, cosine, sine, distance, lateral, turn, c.near, c.cosine_of_angle, c.substeps
        )
        if share <= 1.0:
            there = True
            distance, lateral, way = share * distance, share * lateral, share * way
            turn, time = share * turn, (robot.ticks + share) * c.tick
    new_x, new_y, robot.cosine, robot.sine = slipping_arc(x, y, cosine, sine, distance, lateral, turn)
    held = abs(new_x) > c.half_length or abs(new_y) > c.half_width
    if held:
        new_x, new_y, _ = within_walls(x, y, new_x, new_y, c)
        way = math.hypot(new_x - x, new_y - y)
    robot.x = new_x
    robot.y = new_y
    robot.heading = turned(robot.heading, turn)
    robot.time = time
    robot.path_length += way
    return there, held


@compiled
def drive_extended(
    robot: Any, speed: float, sideways: float | None, rate: float, extended: Extended, b: int, c: Any
) -> tuple[bool, bool]:
    """As ``drive``, with effects: from instant to instant.

    Args:
        robot: The robot, dtype ``ROBOT``.
        speed: Commanded speed [m/s].
        sideways: Commanded speed to the left [m/s]; None for a unicycle.
        rate: Commanded turn rate [rad/s].
        extended: All robots, with their effects.
        b: Number of the robot.
        c: The rules.
    """
    step = c.tick / c.substeps
    held = False
    for k in range(1, c.substeps + 1):
        instant = robot.ticks * c.substeps + k
        left, right = travelled(extended, b, instant - 1, step, speed, rate)
        lateral = None
        if sideways is not None:
            lateral = travelled_sideways(extended, b, instant - 1, step, sideways)
        x, y, robot.cosine, robot.sine, turn = moved(
            robot.x, robot.y, robot.cosine, robot.sine, left, right, lateral, step, 0.0, extended.rows[b]
        )
        x, y, hit = within_walls(robot.x, robot.y, x, y, c)
        robot.path_length += math.hypot(x - robot.x, y - robot.y)
        robot.x = x
        robot.y = y
        robot.heading = turned(robot.heading, turn)
        robot.time = (robot.ticks + k / c.substeps) * c.tick
        held = held or hit
        remember(extended, b, instant, x, y, robot.heading)
        if arrived(x, y, robot.sine, c.near, c.cosine_of_angle):
            return True, held
    return False, held


@inlined
def driven(
    robot: Any, speed: float, sideways: float | None, rate: float, extended: Extended | None, b: int, c: Any
) -> tuple[bool, bool]:
    """Drive a robot for a tick, with its effects if it has any; see ``drive``."""
    if extended is not None:
        if extended.on[b]:
            return drive_extended(robot, speed, sideways, rate, extended, b, c)
        return drive(robot, speed, sideways, rate, c)
    return drive(robot, speed, sideways, rate, c)


@compiled
def measured_pose(robot: Any, extended: Extended, b: int, c: Any) -> tuple[float, float, float]:
    """The pose of robot ``b`` as it is measured: x [m], y [m], heading [rad]."""
    instant = round(robot.time / c.tick * c.substeps)
    return measured(extended, b, instant, c.tick / c.substeps)


@inlined
def see(
    b: int,
    x: float,
    y: float,
    heading: float,
    cosine: float,
    sine: float,
    distance: float,
    observed: Any,
    poses: Any,
) -> None:
    """Write down a measured pose, and what is observed of it."""
    distance = max(distance, NEAREST)
    to_ball = -(x * cosine + y * sine) / distance, (x * sine - y * cosine) / distance
    seen = (x, y, cosine, sine, math.log(distance), to_ball[0], to_ball[1])  # in the order of OBSERVED
    for i in range(len(seen)):
        observed[b, i] = seen[i]
    poses[b, 0] = x
    poses[b, 1] = y
    poses[b, 2] = heading


@compiled
def see_all(shown: FloatArray, observed: NDArray[np.float32], poses: FloatArray) -> None:
    """Write down the poses that sensors show, shape (batch, 3), and what is observed of these."""
    for b in range(len(shown)):
        x, y, heading = shown[b, 0], shown[b, 1], shown[b, 2]
        distance = math.sqrt(x * x + y * y)
        see(b, x, y, heading, math.cos(heading), math.sin(heading), distance, observed, poses)


@inlined
def observe(
    robot: Any,
    extended: Extended | None,
    b: int,
    c: Any,
    there: bool,
    observed: Any,
    numbers: Any,
    poses: Any,
    true_poses: Any,
) -> None:
    """Write down what is observed of one robot."""
    x, y, heading = robot.x, robot.y, robot.heading
    cosine, sine, distance = robot.cosine, robot.sine, robot.distance
    if extended is not None:
        true_poses[b, 0] = x
        true_poses[b, 1] = y
        true_poses[b, 2] = heading
        q = extended.rows[b]
        if q.sensor_delay.delay != 0.0 or q.heading_bias.angle != 0.0:
            x, y, heading = measured_pose(robot, extended, b, c)
            cosine, sine, distance = math.cos(heading), math.sin(heading), math.sqrt(x * x + y * y)
    see(b, x, y, heading, cosine, sine, distance, observed, poses)
    numbers[SUCCESS, b] = 1.0 if there else 0.0
    numbers[TIME, b] = robot.time
    numbers[PATH, b] = robot.path_length
    numbers[DUBINS, b] = robot.dubins_length
    numbers[DUBINS_TIME, b] = robot.dubins_length / c.max_speed
    numbers[WALL_HITS, b] = robot.wall_hits


@compiled
def advance_all(
    robots: NDArray[Any],
    actions: NDArray[np.floating[Any]],
    restarting: bool,
    given: FloatArray | None,
    sideways: FloatArray | None,
    extended: Extended | None,
    rules: NDArray[Any],
    observed: NDArray[np.float32],
    numbers: FloatArray,
    poses: FloatArray,
    true_poses: FloatArray,
    reward: FloatArray,
    success: NDArray[np.bool_],
    late: NDArray[np.bool_],
) -> bool:
    """Take every robot through one tick; with ``restarting``, one whose episode is over begins its next.

    See ``Robots.advance`` and ``Tick`` for the arrays; ``given`` are speeds [m/s] and turn rates [rad/s] in
    the place of those that the actions command, shape (batch, 2), or None; ``sideways`` are the speeds to the
    left of omnidirectional robots [m/s], shape (batch,), or None.

    Returns:
        False if an action is not a finite number; then nothing has happened.
    """
    for b in range(len(robots)):
        for i in range(actions.shape[1]):
            if not math.isfinite(actions[b, i]):
                return False
    for b in range(len(robots)):
        robot, c = robots[b], rules[b]
        there, out_of_time, gain = False, False, 0.0
        if restarting and robot.over == 1:
            start(robot, extended, b, c)
        else:
            speed = 0.5 * c.max_speed * (1.0 + min(max(float(actions[b, 0]), -1.0), 1.0))
            rate = c.max_rate * min(max(float(actions[b, 1]), -1.0), 1.0)
            if given is not None:
                speed, rate = given[b, 0], given[b, 1]
            time, distance = robot.time, robot.distance
            if sideways is not None:
                there, held = driven(robot, speed, sideways[b], rate, extended, b, c)
            else:
                there, held = driven(robot, speed, None, rate, extended, b, c)
            robot.distance = math.sqrt(robot.x * robot.x + robot.y * robot.y)
            robot.ticks += 1
            out_of_time = robot.ticks >= c.last_tick and not there
            robot.over = 1 if there or out_of_time else 0
            gain = c.progress_reward * (distance - robot.distance) - c.time_cost * (robot.time - time)
            if there:
                gain += c.success_reward
            if held and robot.touching == 0:
                robot.wall_hits += 1.0
                gain -= c.wall_cost
            robot.touching = 1 if held else 0
        reward[b] = gain
        success[b] = there
        late[b] = out_of_time
        observe(robot, extended, b, c, there, observed, numbers, poses, true_poses)
    return True


@compiled
def observe_all(
    robots: NDArray[Any],
    extended: Extended | None,
    rules: NDArray[Any],
    observed: NDArray[np.float32],
    numbers: FloatArray,
    poses: FloatArray,
    true_poses: FloatArray,
) -> None:
    """Write down what is observed of every robot, as it stands."""
    for b in range(len(robots)):
        observe(robots[b], extended, b, rules[b], False, observed, numbers, poses, true_poses)


@compiled
def start_all(
    robots: NDArray[Any], which: NDArray[np.int64], extended: Extended | None, rules: NDArray[Any]
) -> None:
    """Begin the next episode of some robots."""
    for b in which:
        start(robots[b], extended, b, rules[b])


@compiled
def start_all_at(
    robots: NDArray[Any],
    which: NDArray[np.int64],
    poses: FloatArray,
    extended: Extended | None,
    rules: NDArray[Any],
) -> None:
    """Begin the next episode of some robots at given poses."""
    for i in range(len(which)):
        robot = robots[which[i]]
        robot.episode += 1
        put(robot, poses[i, 0], poses[i, 1], wrapped(poses[i, 2]), extended, which[i], rules[which[i]])
