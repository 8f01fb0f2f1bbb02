"""The compiled simulation of all windows, for a batch of parameter sets.

Time runs on each recording's samples. A command is held until the next; so a rim's travel since the
episode's start is known in closed form at every time, lag included, and a window is driven along the
differences of travel between its samples, cut where a (delayed) command switches.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled, inlined
from fieldmodels.machines.pose_reaching.drive import (
    excess_of,
    has_dynamics,
    moved,
    rim_speed,
    rim_travel,
    rims,
)
from fieldmodels.machines.pose_reaching.unicycle import body_speeds

IntArray = NDArray[np.int64]

X, Y, HEADING, LEFT_WHEEL = 0, 1, 2, 3
"""Outputs of a prediction, in the order of ``PoseReaching.outputs``; the right wheel follows the left."""

RIM = np.dtype([("aim", np.float64), ("excess", np.float64), ("travel", np.float64)])
"""A rim's course: what it aims at from a sample on [m/s], how far it then is from that [m/s], and its travel
since the episode's start [m]."""

ARCS = 4
"""Arcs between two samples, or a sample and a switch of the command, of a robot that speeds up."""


class Log(NamedTuple):
    """What a recording holds, sample by sample.

    Attributes:
        commands: Speed [m/s] and turn rate [rad/s], or left and right wheel speed [rad/s], shape (n, 2).
        wheel_front: True for wheel speeds.
        wheels: Measured wheel speeds [rad/s], shape (n, 2), or (0, 2) if there are none.
        first: First sample of each sample's episode, shape (n,).
        last: Last sample of each sample's episode, shape (n,).
        time: Sample times [s], shape (n,).
        step: Sampling interval [s].
        disturbance: Additional turn rate [rad/s], speed ahead and to the left, and along x and y [m/s] of the
            body on the ground, shape (n, 5), or (0, 5).
        drive: Additional turn rate [rad/s] and speed ahead [m/s] of the wheels, shape (n, 2), or (0, 2).
    """

    commands: FloatArray
    wheel_front: bool
    wheels: FloatArray
    first: IntArray
    last: IntArray
    time: FloatArray
    step: float
    disturbance: FloatArray
    drive: FloatArray


@inlined
def disturbance_at(log: Log, i: int) -> tuple[float, float, float, float, float]:
    """Additional turn rate [rad/s], speed ahead and to the left, along x and y [m/s] from sample ``i`` on."""
    if len(log.disturbance) == 0:
        return 0.0, 0.0, 0.0, 0.0, 0.0
    return (
        log.disturbance[i, 0],
        log.disturbance[i, 1],
        log.disturbance[i, 2],
        log.disturbance[i, 3],
        log.disturbance[i, 4],
    )


@inlined
def speed_before(log: Log, i: int, side: int, q: Any) -> float:
    """Speed of a rim before sample ``i``'s episode [m/s]: as first measured; NaN without measured wheels."""
    return q.wheel_radius * log.wheels[log.first[i], side] if len(log.wheels) > 0 else math.nan


@compiled
def follow_commands(log: Log, rows: NDArray[Any], p: int, course: NDArray[Any]) -> None:
    """Course of both rims along the whole recording, without the delay.

    Args:
        log: The recording.
        rows: Numbers of robots, dtype ``ROW``.
        p: Which of them.
        course: Receives the course, shape (n, 2), dtype ``RIM``.
    """
    q, step = rows[p], log.step
    for i in range(len(log.commands)):
        speed, rate = log.commands[i, 0], log.commands[i, 1]
        if log.wheel_front:
            speed, rate = body_speeds(speed, rate, q.wheel_radius, q.track)
        course[i, 0].aim, course[i, 1].aim = rims(speed, rate, log.time[i], step, q)
        for side in range(2):
            rim = course[i, side]
            if i == log.first[i]:
                before = speed_before(log, i, side, q)
                rim.travel = 0.0
                rim.excess = 0.0 if math.isnan(before) else excess_of(before, rim.aim, q)
            else:
                last = course[i - 1, side]
                rim.travel = last.travel + rim_travel(last.aim, last.excess, step, q)
                rim.excess = excess_of(rim_speed(last.aim, last.excess, step, q), rim.aim, q)


@compiled
def follow_wheels(log: Log, radius: float, course: NDArray[Any]) -> None:
    """Course of both rims by their measured speeds, each the mean since the sample before.

    Args:
        log: The recording.
        radius: Radius of the wheels [m].
        course: Receives the course, shape (n, 2), dtype ``RIM``.
    """
    n = len(log.wheels)
    for i in range(n):
        ahead = i + 1 if i + 1 < n and log.first[i + 1] == log.first[i] else i
        for side in range(2):
            rim = course[i, side]
            rim.aim = radius * log.wheels[ahead, side]
            rim.excess = 0.0
            rim.travel = 0.0
            if i != log.first[i]:
                rim.travel = course[i - 1, side].travel + radius * log.wheels[i, side] * log.step


class Episode(NamedTuple):
    """The episode of a window: where it begins and ends, and how fast its rims turned before it [m/s]."""

    first: int
    last: int
    left: float
    right: float


@inlined
def episode_of(log: Log, start: int, simulated: NDArray[Any], q: Any) -> Episode:
    """The episode in which a window starts; without measured wheels the first command held before it."""
    first = log.first[start]
    left, right = speed_before(log, start, 0, q), speed_before(log, start, 1, q)
    left = simulated[first, 0].aim if math.isnan(left) else left
    right = simulated[first, 1].aim if math.isnan(right) else right
    return Episode(first, log.last[start], left, right)


@inlined
def travelled(
    course: NDArray[Any], side: int, sample: int, part: float, episode: Episode, step: float, q: Any
) -> float:
    """Travel of a rim at a time between two samples, or outside its episode [m].

    Args:
        course: Course of both rims, shape (n, 2), dtype ``RIM``.
        side: 0 left, 1 right.
        sample: Sample before that time; may lie before the episode's first.
        part: Share of the step since then.
        episode: The episode.
        step: Sampling interval [s].
        q: Numbers of the robot.
    """
    if sample < episode.first:
        before = episode.left if side == 0 else episode.right
        return ((sample - episode.first) + part) * step * before
    time = part * step
    if sample > episode.last:
        time += (sample - episode.last) * step
        sample = episode.last
    rim = course[sample, side]
    result: float = rim.travel + rim_travel(rim.aim, rim.excess, time, q)
    return result


@inlined
def predict_wheels(
    simulated: NDArray[Any], episode: Episode, log: Log, start: int, q: Any, out: FloatArray
) -> None:
    """Both wheels' mean speeds since the sample before, from the commands; ``out`` as in ``simulate``."""
    late = q.actuator_delay.delay / log.step
    whole = math.ceil(late)
    part = whole - late
    for j in range(len(out)):
        turning, forward = 0.0, 0.0
        if len(log.drive) > 0:
            turning, forward = log.drive[start + j, 0], log.drive[start + j, 1]
        extra = 0.5 * q.track * turning
        at = start + j - whole
        for side in range(2):
            way = travelled(simulated, side, at, part, episode, log.step, q)
            way -= travelled(simulated, side, at - 1, part, episode, log.step, q)
            more = (2 * side - 1) * extra + forward
            out[j, LEFT_WHEEL + side] = (way / log.step + more) / q.wheel_radius


@inlined
def predict_pose(
    course: NDArray[Any],
    episode: Episode,
    late: float,
    cuts: int,
    log: Log,
    start: int,
    state: FloatArray,
    q: Any,
    out: FloatArray,
) -> None:
    """The pose as it is measured, driven by a course of the rims.

    Args:
        course: Course of both rims, shape (n, 2), dtype ``RIM``.
        episode: The window's episode.
        late: How late the body's motion is measured [samples].
        cuts: Arcs between a sample and a switch of the command.
        log: The recording.
        start: First sample of the window.
        state: x [m], y [m], heading [rad] as measured there.
        q: Numbers of the robot.
        out: Receives the pose, as in ``simulate``.
    """
    whole, step = math.ceil(late), log.step
    part = whole - late
    x, y, heading = state[0], state[1], state[2] - q.heading_bias.angle
    cosine, sine = math.cos(heading), math.sin(heading)
    for j in range(len(out)):
        out[j, X], out[j, Y], out[j, HEADING] = x, y, heading + q.heading_bias.angle
        if j == len(out) - 1:
            break
        extra, forward, aside, drift_x, drift_y = disturbance_at(log, start + j)
        # From `part` of a step after sample `at` to as much after the next, where a command switches in
        # between: the first half of the pieces fills up sample `at`, the second begins the next one.
        at = start + j - whole
        for piece in range(2 * cuts):
            sample = at if piece < cuts else at + 1
            low, high = (part, 1.0) if piece < cuts else (0.0, part)
            # Short arcs after a switch, where the speed changes most.
            first_share, last_share = ((piece % cuts) / cuts) ** 2, ((piece % cuts + 1) / cuts) ** 2
            begin = low + (high - low) * first_share
            duration = (high - low) * (last_share - first_share) * step
            if duration <= 0.0:
                continue
            end, end_part = sample, low + (high - low) * last_share
            if piece == cuts - 1:
                end, end_part = sample + 1, 0.0
            left = travelled(course, 0, end, end_part, episode, step, q)
            left -= travelled(course, 0, sample, begin, episode, step, q)
            right = travelled(course, 1, end, end_part, episode, step, q)
            right -= travelled(course, 1, sample, begin, episode, step, q)
            left, right = left + forward * duration, right + forward * duration
            x, y, cosine, sine, turn = moved(
                x, y, cosine, sine, left, right, aside * duration, duration, extra, q
            )
            heading += turn
            x, y = x + drift_x * duration, y + drift_y * duration


@compiled
def simulate(
    rows: NDArray[Any],
    log: Log,
    starts: IntArray,
    lengths: IntArray,
    states: FloatArray,
    pose_driven_by_wheels: bool,
    with_pose: bool,
    with_wheels: bool,
    out: FloatArray,
) -> None:
    """Simulate every window for every row of parameters.

    Args:
        rows: Numbers of each robot, shape (batch,), dtype ``ROW``.
        log: The recording.
        starts: First sample of each window, shape (windows,).
        lengths: Samples of each window, shape (windows,).
        states: x [m], y [m], heading [rad] as measured at the window's start, shape (windows, 3).
        pose_driven_by_wheels: True drives the body by the measured wheels, False by the simulated ones.
        with_pose: Whether the pose is wanted.
        with_wheels: Whether the wheels are.
        out: Receives x, y, heading (not wrapped) and both wheels' mean speeds since the sample before
            [rad/s], shape (batch, windows, samples, 5), filled with NaN; what is not wanted stays so.
    """
    n = len(log.commands)
    simulated = np.zeros((n, 2), RIM)
    measured = np.zeros((n if pose_driven_by_wheels else 0, 2), RIM)
    for p in range(len(rows)):
        q = rows[p]
        if with_wheels or not pose_driven_by_wheels:
            follow_commands(log, rows, p, simulated)
        # While the rims change their speed, the body's way is cut into shorter arcs.
        course, cuts = simulated, ARCS if has_dynamics(q) else 1
        late = (q.actuator_delay.delay + q.sensor_delay.delay) / log.step
        if pose_driven_by_wheels:
            follow_wheels(log, q.wheel_radius, measured)
            course, cuts = measured, 1
            late = q.sensor_delay.delay / log.step  # and wheels that were measured have no excess
        for w in range(len(starts)):
            episode = episode_of(log, starts[w], simulated, q)
            window = out[p, w, : lengths[w]]
            if with_wheels:
                predict_wheels(simulated, episode, log, starts[w], q, window)
            if with_pose:
                predict_pose(course, episode, late, cuts, log, starts[w], states[w], q, window)
