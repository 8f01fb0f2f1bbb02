"""Robots in play on the field: drawn starts, ticks of control, arrival and scores, a batch in one kernel.

The working surface of environments and evaluations. A robot's starts depend on its seed and the number
of its episode alone; its motion is deterministic.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fieldmodels.compiled import compiled, inlined
from fieldmodels.model import FloatArray, ModelError
from fieldmodels.pose_reaching.dubins import shortest
from fieldmodels.pose_reaching.parameters import STRICT, Arrival, Field, Limits
from fieldmodels.pose_reaching.unicycle import (
    arc,
    arrival_share,
    arrived,
    slid_along_walls,
    stopped_by_walls,
    wrapped,
)
from fieldmodels.streams import GAMMA, mixed, symmetric, uniform

StartSet = Literal["T1", "T2", "T3"]
Walls = Literal["stop", "slide"]

INSTANT = 0.01
"""Time between the instants at which arrival is tested [s]: 1 cm and 2.3 deg at full speed and rate."""
NEAREST = 1e-3
"""Smallest distance whose logarithm is observed [m]."""
FACING_NEAR, FACING_FAR = 0.6, 1.6
"""Distances from the ball of the starts T1 and T2 [m]."""
SPREAD = math.pi / 4
"""Largest angle between heading and ball of the starts T2 [rad]."""

OBSERVED = ("x", "y", "cos heading", "sin heading", "log distance", "cos ball", "sin ball")
NUMBERS = ("success", "time", "path_length", "dubins_length", "dubins_time", "wall_hits")
SUCCESS, TIME, PATH, DUBINS, DUBINS_TIME, WALL_HITS = range(6)

ROBOT = np.dtype(
    [
        ("key", np.uint64),  # the robot's random stream
        ("episode", np.int64),  # episodes begun under this key
        ("ticks", np.int64),  # of this episode
        ("over", np.bool_),  # arrived or out of time
        ("touching", np.bool_),  # held by a wall
        ("x", np.float64),
        ("y", np.float64),
        ("heading", np.float64),  # [rad], in (-pi, pi]
        ("cosine", np.float64),  # of the heading
        ("sine", np.float64),
        ("potential", np.float64),  # what is still to be made good, for the progress reward
        ("time", np.float64),  # of this episode [s]
        ("path_length", np.float64),  # [m]
        ("dubins_length", np.float64),  # from the episode's start to the goal [m]
        ("wall_hits", np.float64),
    ]
)
"""All that a robot remembers between ticks; a copy of the array is an exact snapshot."""


@dataclass(frozen=True)
class Score:
    """What a tick is worth.

    Attributes:
        time: Cost of a second.
        success: Reward of arriving.
        progress: Reward of one metre of potential made good; the sum over an episode depends on its
            first and last pose only.
        heading: Metres that a heading error of one radian counts in the potential, near the ball.
        reach: Distance from the ball at which the heading's part in the potential has halved [m].
        wall: Cost of driving into a wall.
    """

    time: float = 1.0
    success: float = 10.0
    progress: float = 1.0
    heading: float = 0.0
    reach: float = 0.5
    wall: float = 0.0


@dataclass(frozen=True)
class Rules:
    """What is played.

    Attributes:
        starts: Where episodes begin: ``T1`` on the right half, 0.6 to 1.6 m away, facing the ball; ``T2``
            on both sides, up to 45 deg off; ``T3`` anywhere in the field, any heading.
        arrival: When the robot has arrived.
        tick: Time for which a command holds [s].
        timeout: Longest episode [s].
        walls: ``stop`` holds the robot where it meets a wall, ``slide`` lets it slip along.
        limits: What can be commanded.
        field: The field.
        score: What a tick is worth.
    """

    starts: StartSet = "T3"
    arrival: Arrival = STRICT
    tick: float = 0.1
    timeout: float = 15.0
    walls: Walls = "stop"
    limits: Limits = Limits()  # noqa: RUF009 - frozen
    field: Field = Field()  # noqa: RUF009 - frozen
    score: Score = Score()


class Constants(NamedTuple):
    """The rules as the kernels take them."""

    starts: int
    tick: float
    substeps: int
    last_tick: int
    half_length: float
    half_width: float
    near: float
    cosine_of_angle: float
    max_speed: float
    max_rate: float
    radius: float
    slide: bool
    time_cost: float
    success: float
    progress: float
    heading: float
    reach: float
    wall_cost: float


def make_constants(rules: Rules) -> Constants:
    """Put the rules into the form of the kernels."""
    score = rules.score
    return Constants(
        starts=get_args(StartSet).index(rules.starts),
        tick=rules.tick,
        substeps=max(1, math.ceil(rules.tick / INSTANT - 1e-9)),
        last_tick=max(1, math.ceil(rules.timeout / rules.tick - 1e-9)),
        half_length=rules.field.length / 2,
        half_width=rules.field.width / 2,
        near=rules.arrival.distance,
        cosine_of_angle=math.cos(rules.arrival.angle),
        max_speed=rules.limits.max_speed,
        max_rate=rules.limits.max_rate,
        radius=rules.limits.radius,
        slide=rules.walls == "slide",
        time_cost=score.time,
        success=score.success,
        progress=score.progress,
        heading=score.heading,
        reach=score.reach,
        wall_cost=score.wall,
    )


@inlined
def potential(x: float, y: float, heading: float, c: Constants) -> float:
    """How far the robot is from its goal pose, in the progress reward's sense [m]."""
    distance = math.sqrt(x * x + y * y)
    if c.heading == 0.0:
        return distance
    return distance + c.heading * abs(wrapped(heading - 0.5 * math.pi)) * c.reach / (c.reach + distance)


@inlined
def put(robot: Any, x: float, y: float, heading: float, c: Constants) -> None:
    """Begin an episode at a pose."""
    robot.ticks = 0
    robot.over = False
    robot.touching = False
    robot.x = x
    robot.y = y
    robot.heading = heading
    robot.cosine = math.cos(heading)
    robot.sine = math.sin(heading)
    robot.potential = potential(x, y, heading, c)
    robot.time = 0.0
    robot.path_length = 0.0
    robot.dubins_length = shortest(x, y, heading, 0.0, 0.0, 0.5 * math.pi, c.radius)[0]
    robot.wall_hits = 0.0


@inlined
def start(robot: Any, c: Constants) -> None:
    """Begin the robot's next episode at a start drawn from its stream; one in the goal is drawn anew."""
    robot.episode += 1
    key = mixed(robot.key + np.uint64(robot.episode) * GAMMA)
    draw = 0
    while True:
        first, second, third = uniform(key, draw), symmetric(key, draw + 1), symmetric(key, draw + 2)
        draw += 3
        if c.starts == 2:
            x, y = c.half_length * (2.0 * first - 1.0), c.half_width * second
            heading = math.pi * third
        else:
            distance = FACING_NEAR + (FACING_FAR - FACING_NEAR) * first
            bearing = 0.5 * math.pi * second if c.starts == 0 else math.pi * second
            x, y = distance * math.cos(bearing), distance * math.sin(bearing)
            heading = wrapped(bearing + math.pi + (SPREAD * third if c.starts == 1 else 0.0))
        inside = abs(x) <= c.half_length and abs(y) <= c.half_width
        if inside and not arrived(x, y, math.sin(heading), c.near, c.cosine_of_angle):
            break
    put(robot, x, y, heading, c)


@inlined
def drive(robot: Any, speed: float, rate: float, c: Constants) -> tuple[bool, bool]:
    """Drive one robot for a tick, or until it has arrived.

    Returns:
        Whether it has arrived, and whether it has driven into a wall.
    """
    distance, turn = speed * c.tick, rate * c.tick
    share = arrival_share(
        robot.x, robot.y, robot.cosine, robot.sine, distance, turn, c.near, c.cosine_of_angle, c.substeps
    )
    there = share <= 1.0
    if there:
        distance, turn = share * distance, share * turn
        robot.time += share * c.tick
    else:
        robot.time = (robot.ticks + 1) * c.tick
    x, y, robot.cosine, robot.sine = arc(robot.x, robot.y, robot.cosine, robot.sine, distance, turn)
    if c.slide:
        new_x, new_y, held = slid_along_walls(x, y, c.half_length, c.half_width)
    else:
        new_x, new_y, held = stopped_by_walls(robot.x, robot.y, x, y, c.half_length, c.half_width)
    if held:
        distance = math.hypot(new_x - robot.x, new_y - robot.y)
    hit = held and not robot.touching
    robot.touching = held
    robot.wall_hits += hit
    robot.x = new_x
    robot.y = new_y
    heading = robot.heading + turn
    robot.heading = heading if abs(heading) < math.pi else wrapped(heading)
    robot.path_length += distance
    return there, hit


@inlined
def observe(robot: Any, b: int, there: bool, c: Constants, observed: Any, numbers: Any, poses: Any) -> None:
    """Write down what is seen of one robot."""
    x, y, cosine, sine = robot.x, robot.y, robot.cosine, robot.sine
    distance = math.sqrt(x * x + y * y)
    safe = max(distance, NEAREST)
    row = observed[b]
    row[0] = x
    row[1] = y
    row[2] = cosine
    row[3] = sine
    row[4] = math.log(safe)
    row[5] = -(x * cosine + y * sine) / safe
    row[6] = (x * sine - y * cosine) / safe
    numbers[SUCCESS, b] = 1.0 if there else 0.0
    numbers[TIME, b] = robot.time
    numbers[PATH, b] = robot.path_length
    numbers[DUBINS, b] = robot.dubins_length
    numbers[DUBINS_TIME, b] = robot.dubins_length / c.max_speed
    numbers[WALL_HITS, b] = robot.wall_hits
    poses[b, 0] = x
    poses[b, 1] = y
    poses[b, 2] = robot.heading


@compiled
def play(
    robots: NDArray[Any],
    actions: NDArray[np.float32],
    restarting: bool,
    c: Constants,
    observed: NDArray[np.float32],
    reward: FloatArray,
    success: NDArray[np.bool_],
    late: NDArray[np.bool_],
    numbers: FloatArray,
    poses: FloatArray,
) -> bool:
    """Take every robot through one tick; with ``restarting``, one whose episode is over begins its next.

    See ``Robots.advance`` for the arrays.

    Returns:
        False if an action is not a finite number; then nothing has happened.
    """
    for b in range(len(robots)):
        if not (math.isfinite(actions[b, 0]) and math.isfinite(actions[b, 1])):
            return False
    for b in range(len(robots)):
        robot = robots[b]
        if restarting and robot.over:
            start(robot, c)
            there = late[b] = False
            reward[b] = 0.0
        else:
            speed = 0.5 * c.max_speed * (1.0 + min(max(float(actions[b, 0]), -1.0), 1.0))
            rate = c.max_rate * min(max(float(actions[b, 1]), -1.0), 1.0)
            before = robot.time
            there, hit = drive(robot, speed, rate, c)
            robot.ticks += 1
            late[b] = robot.ticks >= c.last_tick and not there
            robot.over = there or late[b]
            left = potential(robot.x, robot.y, robot.heading, c)
            gain = c.progress * (robot.potential - left) - c.time_cost * (robot.time - before)
            if there:
                gain += c.success
            if hit:
                gain -= c.wall_cost
            robot.potential = left
            reward[b] = gain
        success[b] = there
        observe(robot, b, there, c, observed, numbers, poses)
    return True


@compiled
def look(
    robots: NDArray[Any],
    c: Constants,
    observed: NDArray[np.float32],
    numbers: FloatArray,
    poses: FloatArray,
) -> None:
    """Write down what is seen of every robot, as it stands."""
    for b in range(len(robots)):
        observe(robots[b], b, False, c, observed, numbers, poses)


@compiled
def begin(robots: NDArray[Any], which: NDArray[np.int64], c: Constants) -> None:
    """Begin the next episode of some robots."""
    for b in which:
        start(robots[b], c)


@compiled
def begin_at(robots: NDArray[Any], which: NDArray[np.int64], poses: FloatArray, c: Constants) -> None:
    """Begin the next episode of some robots at given poses."""
    for i in range(len(which)):
        robot = robots[which[i]]
        robot.episode += 1
        put(robot, poses[i, 0], poses[i, 1], wrapped(poses[i, 2]), c)


@dataclass(frozen=True, slots=True)
class Tick:
    """What one tick of every robot gave; fresh arrays, nobody writes to them again.

    Attributes:
        observed: What is seen of each robot, shape (batch, 7), float32, columns as in ``OBSERVED``.
        numbers: Shape (6, batch), rows as in ``NUMBERS``: 1 where the robot has just arrived; time since
            the start [s]; length of the path [m]; length of the shortest Dubins path from the start [m];
            the time that it takes at full speed [s]; times that the robot drove into a wall.
        poses: x [m], y [m], heading [rad] of each robot as measured, shape (batch, 3).
        true_poses: The same as it is (privileged).
        reward: Score of the tick, shape (batch,).
        success: True where the robot has arrived in this tick, shape (batch,).
        late: True where time has run out, shape (batch,).
    """

    observed: NDArray[np.float32]
    numbers: FloatArray
    poses: FloatArray
    true_poses: FloatArray
    reward: FloatArray
    success: NDArray[np.bool_]
    late: NDArray[np.bool_]


class Robots:
    """A batch of robots, each with an episode of its own.

    Attributes:
        robots: All state, shape (batch,), dtype ``ROBOT``.
        rules: What is played.
    """

    def __init__(self, batch: int, rules: Rules | None = None) -> None:
        """Make robots; seed each before the first tick.

        Args:
            batch: Number of robots.
            rules: What is played.

        Raises:
            ModelError: If the batch is empty.
        """
        if batch < 1:
            raise ModelError(f"a batch needs at least one robot, not {batch}")
        self.rules = rules or Rules()
        self.robots: NDArray[Any] = np.zeros(batch, dtype=ROBOT)
        self._constants = make_constants(self.rules)
        self._seeded = np.zeros(batch, dtype=np.bool_)
        self._ready = False

    def __len__(self) -> int:
        """Number of robots."""
        return len(self.robots)

    def seed(self, i: int, rng: np.random.Generator) -> None:
        """Give robot ``i`` a stream keyed by one draw from ``rng``; its next episode is its first."""
        self.robots[i]["key"] = rng.integers(0, 2**64, dtype=np.uint64)
        self.robots[i]["episode"] = 0
        self._seeded[i] = True
        self._ready = False

    @property
    def seeded(self) -> NDArray[np.bool_]:
        """Which robots have a stream, shape (batch,)."""
        return self._seeded

    def restart(self, which: Iterable[int], poses: ArrayLike | None = None) -> None:
        """Begin the next episode of some robots.

        Args:
            which: Their numbers.
            poses: Where they start: x [m], y [m], heading [rad], shape (3,) or (len(which), 3); drawn from
                the robots' own streams if None.

        Raises:
            ModelError: If a robot was never seeded, or a pose is not one in the field.
        """
        rows = np.fromiter(which, dtype=np.int64)
        if not self._seeded[rows].all():
            raise ModelError("seed every robot before its first episode")
        if poses is None:
            begin(self.robots, rows, self._constants)
        else:
            begin_at(self.robots, rows, self._inside(poses, len(rows)), self._constants)
        self._ready = bool(self._seeded.all())

    def _inside(self, poses: ArrayLike, count: int) -> FloatArray:
        try:
            values = np.asarray(poses, dtype=np.float64)
        except (TypeError, ValueError):
            raise ModelError(f"a start is x [m], y [m] and heading [rad], not {poses!r:.80}") from None
        if values.shape not in ((3,), (count, 3)) or not np.isfinite(values).all():
            raise ModelError(
                f"starts are x [m], y [m] and heading [rad], shape (3,) or ({count}, 3), not {poses!r:.80}"
            )
        values = np.ascontiguousarray(np.broadcast_to(values, (count, 3)))
        edge = np.array([self._constants.half_length, self._constants.half_width])
        if (np.abs(values[:, :2]) > edge).any():
            raise ModelError(f"a start must lie within +-{edge[0]} m and +-{edge[1]} m, not {poses!r:.80}")
        return values

    def look(self) -> Tick:
        """What is seen of every robot as it stands; the rewards are zero."""
        tick = self._empty()
        look(self.robots, self._constants, tick.observed, tick.numbers, tick.poses)
        for array in (tick.reward, tick.success, tick.late):
            array[...] = 0
        return tick

    def advance(self, actions: NDArray[np.float32], restarting: bool = False) -> Tick:
        """Take every robot through one tick.

        Args:
            actions: Speed from 0 (-1) to the largest (1), turn rate from the largest to the right (-1) to
                the largest to the left (1), clipped; shape (batch, 2), float32.
            restarting: True lets a robot whose episode is over begin its next one instead; its action is
                ignored, its reward 0, and what is seen of it is the new episode's start.

        Raises:
            ModelError: If the actions are not finite, or a robot never began an episode.
        """
        if not self._ready:
            raise ModelError("seed and restart every robot before the first tick")
        tick = self._empty()
        finite = play(
            self.robots,
            actions,
            restarting,
            self._constants,
            tick.observed,
            tick.reward,
            tick.success,
            tick.late,
            tick.numbers,
            tick.poses,
        )
        if not finite:
            raise ModelError(f"actions must be finite numbers, not {actions}")
        return tick

    def _empty(self) -> Tick:
        batch = len(self.robots)
        poses = np.empty((batch, 3))
        return Tick(
            np.empty((batch, len(OBSERVED)), dtype=np.float32),
            np.empty((len(NUMBERS), batch)),
            poses,
            poses,
            np.empty(batch),
            np.empty(batch, dtype=np.bool_),
            np.empty(batch, dtype=np.bool_),
        )

    def state(self) -> NDArray[Any]:
        """An exact snapshot of all robots: a plain structured array, shape (batch,)."""
        return self.robots.copy()

    def set_state(self, state: NDArray[Any]) -> None:
        """Return to a snapshot.

        Raises:
            ModelError: If the snapshot is of another batch size or kind.
        """
        if state.dtype != ROBOT or state.shape != self.robots.shape:
            raise ModelError(f"a snapshot of {len(self)} robots is needed, not {state.shape} {state.dtype}")
        self.robots[...] = state
        self._seeded[:] = True
        self._ready = True
