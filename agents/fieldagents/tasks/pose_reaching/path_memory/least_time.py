"""The ceiling of pose reaching: the shortest time to the goal, by value iteration over all poses.

The least time T(pose) obeys the Bellman equation T = min over commands of (step + T(pose after the step)),
with T = 0 at the goal. It is solved on a grid of log distance, bearing and angle to the ball, which is
fine where it has to be: near the ball. Commands are the ones that a time-optimal robot uses, by
Pontryagin's principle full speed or none, full turn rate to either side or none, and half of it for
smoother interpolation. The robot then tries many commands for one tick and takes the one after which
tick + T is least.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled, inlined
from fieldmodels.machines.pose_reaching.parameters import Arrival, Field, Limits
from fieldmodels.machines.pose_reaching.unicycle import arc, arrival_share, stopped_by_walls

LIMITS, FIELD = Limits(), Field()
NEAREST = 0.02
"""Distance of the grid's innermost shell [m]; within it the time is taken to be the shell's."""
NEVER = 60.0
"""Time that stands for "not reached yet" [s]."""


@dataclass(frozen=True)
class Resolution:
    """How fine the grid is.

    Attributes:
        shells: Distances from 2 cm to the field's corner, evenly in their logarithm.
        bearings: Bearings around the ball, over the right half; the left one is its mirror image.
        sights: Angles between the heading and the direction to the ball, over the full turn.
    """

    shells: int = 48
    bearings: int = 25
    sights: int = 48


@dataclass(frozen=True)
class Task:
    """What is to be solved: the robot, the field and the arrival."""

    arrival: Arrival
    limits: Limits = LIMITS
    field: Field = FIELD


@inlined
def interpolated(times: FloatArray, x: float, y: float, heading: float, low: float, shell: float) -> float:
    """Least time from a pose, linear between the grid's nodes.

    Args:
        times: Least time at the nodes [s], shape (shells, bearings, sights).
        x: Position [m].
        y: Position [m].
        heading: Heading [rad].
        low: Logarithm of the innermost distance.
        shell: Distance between shells, in logarithms.
    """
    n, m, k = times.shape
    if x < 0.0:
        x, heading = -x, math.pi - heading
    bearing = math.atan2(y, x)
    sight = heading - bearing - math.pi
    a = (0.5 * math.log(max(x * x + y * y, 1e-12)) - low) / shell
    a = min(max(a, 0.0), n - 1.000001)
    b = min(max((bearing / math.pi + 0.5) * (m - 1), 0.0), m - 1.000001)
    turn = sight / (2.0 * math.pi)
    c = (turn - math.floor(turn)) * k
    i, j, q = int(a), int(b), int(c)
    a, b, c = a - i, b - j, c - q
    q = q % k
    r = (q + 1) % k
    inner = (1.0 - b) * ((1.0 - c) * times[i, j, q] + c * times[i, j, r]) + b * (
        (1.0 - c) * times[i, j + 1, q] + c * times[i, j + 1, r]
    )
    outer = (1.0 - b) * ((1.0 - c) * times[i + 1, j, q] + c * times[i + 1, j, r]) + b * (
        (1.0 - c) * times[i + 1, j + 1, q] + c * times[i + 1, j + 1, r]
    )
    return float((1.0 - a) * inner + a * outer)


@inlined
def time_after(
    times: FloatArray,
    x: float,
    y: float,
    heading: float,
    speed: float,
    rate: float,
    step: float,
    near: float,
    cosine: float,
    half_length: float,
    half_width: float,
    low: float,
    shell: float,
) -> float:
    """Least time from a pose if a command holds for one step first."""
    c, s = math.cos(heading), math.sin(heading)
    distance, turn = speed * step, rate * step
    share = arrival_share(x, y, c, s, distance, 0.0, turn, near, cosine, 8)
    if share <= 1.0:
        return share * step
    new_x, new_y, _, _ = arc(x, y, c, s, distance, turn)
    new_x, new_y, _ = stopped_by_walls(x, y, new_x, new_y, half_length, half_width)
    return step + interpolated(times, new_x, new_y, heading + turn, low, shell)


@compiled
def _sweep(
    times: FloatArray,
    best: np.ndarray[tuple[int, int, int], np.dtype[np.int64]],
    improve: bool,
    commands: FloatArray,
    near: float,
    cosine: float,
    half_length: float,
    half_width: float,
    low: float,
    shell: float,
) -> float:
    """One sweep outwards over all nodes, in place; the largest change."""
    n, m, k = times.shape
    largest = 0.0
    for i in range(n):
        distance = math.exp(low + i * shell)
        step = min(max(1.5 * shell * distance, 0.01), 0.1)
        for j in range(m):
            bearing = math.pi * (j / (m - 1) - 0.5)
            x, y = distance * math.cos(bearing), distance * math.sin(bearing)
            # A node beyond the walls only helps to interpolate: it stands for the point at the wall.
            x = min(max(x, 0.0), half_length)
            y = min(max(y, -half_width), half_width)
            for q in range(k):
                heading = bearing + math.pi + q * 2.0 * math.pi / k
                if x * x + y * y < near * near and math.sin(heading) > cosine:
                    times[i, j, q] = 0.0
                    continue
                first, last = 0, len(commands)
                if not improve:
                    first = best[i, j, q]
                    last = first + 1
                least = NEVER if improve else 1e9
                for action in range(first, last):
                    after = time_after(
                        times, x, y, heading, commands[action, 0], commands[action, 1], step,
                        near, cosine, half_length, half_width, low, shell,
                    )  # fmt: skip
                    if after < least:
                        least = after
                        best[i, j, q] = action
                least = min(least, NEVER)
                largest = max(largest, abs(times[i, j, q] - least))
                times[i, j, q] = least
    return largest


@compiled
def _decide(
    times: FloatArray,
    poses: FloatArray,
    speeds: FloatArray,
    rates: FloatArray,
    tick: float,
    near: float,
    cosine: float,
    half_length: float,
    half_width: float,
    low: float,
    shell: float,
) -> FloatArray:
    result = np.empty((len(poses), 2))
    for row in range(len(poses)):
        least = math.inf
        for speed in speeds:
            for rate in rates:
                after = time_after(
                    times, poses[row, 0], poses[row, 1], poses[row, 2], speed, rate, tick,
                    near, cosine, half_length, half_width, low, shell,
                )  # fmt: skip
                if after < least:
                    least = after
                    result[row, 0] = speed
                    result[row, 1] = rate
    return result


@compiled
def _times_from(times: FloatArray, poses: FloatArray, low: float, shell: float) -> FloatArray:
    result = np.empty(len(poses))
    for row in range(len(poses)):
        result[row] = interpolated(times, poses[row, 0], poses[row, 1], poses[row, 2], low, shell)
    return result


class LeastTime:
    """The least time from every pose, and the commands that take it.

    Args:
        task: What is to be solved.
        resolution: How fine the grid is.
        tolerance: Largest change of the last sweep [s].

    Attributes:
        times: Least time at the nodes [s], shape (shells, bearings, sights).
        sweeps: Sweeps over the grid that it took.
    """

    def __init__(
        self, task: Task, resolution: Resolution | None = None, tolerance: float = 1e-2, most: int = 400
    ) -> None:
        fine = resolution or Resolution()
        self.task = task
        corner = math.hypot(task.field.length, task.field.width) / 2
        self._low = math.log(NEAREST)
        self._shell = (math.log(corner) - self._low) / (fine.shells - 1)
        v, w = task.limits.max_speed, task.limits.max_rate
        commands = np.array([(v, 0.0), (v, w), (v, -w), (0.0, w), (0.0, -w), (v, w / 2), (v, -w / 2)])
        self.times = np.full((fine.shells, fine.bearings, fine.sights), NEVER)
        best = np.zeros(self.times.shape, dtype=np.int64)
        self.sweeps = 0
        while self.sweeps < most:
            improve = self.sweeps % 4 == 0  # in between, the commands found so far are only evaluated
            change = _sweep(self.times, best, improve, commands, *self._numbers())
            self.sweeps += 1
            if improve and change < tolerance:
                break

    def _numbers(self) -> tuple[float, ...]:
        arrival, field = self.task.arrival, self.task.field
        return (
            arrival.distance,
            math.cos(arrival.angle),
            field.length / 2,
            field.width / 2,
            self._low,
            self._shell,
        )

    def commands(self, poses: FloatArray, tick: float) -> FloatArray:
        """The best of 3 speeds and 33 turn rates for one tick.

        Args:
            poses: x [m], y [m], heading [rad], shape (batch, 3).
            tick: Time for which a command holds [s].

        Returns:
            Speed [m/s] and turn rate [rad/s], shape (batch, 2).
        """
        limits = self.task.limits
        speeds = np.array([1.0, 0.5, 0.0]) * limits.max_speed
        rates = np.linspace(-1, 1, 33) * limits.max_rate
        return _decide(self.times, np.ascontiguousarray(poses), speeds, rates, tick, *self._numbers())

    def from_poses(self, poses: FloatArray) -> FloatArray:
        """Least time from each pose [s], shape (batch,)."""
        return _times_from(self.times, np.ascontiguousarray(poses), self._low, self._shell)


@cache
def least_time(task: Task) -> LeastTime:
    """Solve a task once a process."""
    return LeastTime(task)
