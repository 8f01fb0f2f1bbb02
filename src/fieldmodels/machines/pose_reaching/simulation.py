"""The compiled simulation of all windows, for a batch of parameter sets.

Time runs on each recording's samples. A command is held until the next; so a rim's travel since the
episode's start is known in closed form at every time, lag included, and a window is driven along the
differences of travel between its samples, cut where a (delayed) command switches.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled, inlined
from fieldmodels.machines.pose_reaching.drive import (
    DELAY,
    HEADING_BIAS,
    RADIUS,
    SENSOR_DELAY,
    SLOPE_X,
    SLOPE_Y,
    STEP_FACTOR,
    STEP_TIME,
    TRACK,
    body,
    excess_after,
    excess_travel,
    has_dynamics,
    rims,
)
from fieldmodels.machines.pose_reaching.unicycle import body_speeds, slipping_arc

IntArray = NDArray[np.int64]

AIM, EXCESS, TRAVEL = 0, 1, 2
"""Rows of a rim's course: what it aims at from a sample on [m/s], how far it then is from that [m/s], and
its travel since the episode's start [m]."""


ARCS = 4
"""Arcs between two samples, or a sample and a switch of the command, of a robot that speeds up."""


@compiled
def follow_commands(
    commands: FloatArray,
    wheel_front: bool,
    before: FloatArray,
    first: IntArray,
    time: FloatArray,
    step: float,
    q: FloatArray,
    course: FloatArray,
) -> None:
    """Course of both rims along the whole recording, without the delay.

    Args:
        commands: Speed [m/s] and turn rate [rad/s], or left and right wheel speed [rad/s], shape (n, 2).
        wheel_front: True for wheel speeds.
        before: Rim speeds at each sample's episode's start, NaN if unknown (then its first command's).
        first: First sample of each sample's episode, shape (n,).
        time: Sample times [s], shape (n,).
        step: Sampling interval [s].
        q: Parameters, shape (PARAMETERS,).
        course: Receives the course, shape (n, 2, 3).
    """
    for i in range(len(commands)):
        speed, rate = commands[i, 0], commands[i, 1]
        if wheel_front:
            speed, rate = body_speeds(speed, rate, q[RADIUS], q[TRACK])
        jumped = 0.0
        if q[STEP_FACTOR] != 1.0:
            jumped = min(max((time[i] - q[STEP_TIME]) / step + 1.0, 0.0), 1.0)
        left, right = rims(speed, rate, jumped, q)
        course[i, 0, AIM], course[i, 1, AIM] = left, right
        for side in range(2):
            aim = course[i, side, AIM]
            if i == first[i]:
                course[i, side, TRAVEL] = 0.0
                known = not math.isnan(before[i, side])
                course[i, side, EXCESS] = before[i, side] - aim if known and has_dynamics(q) else 0.0
            else:
                last, excess = course[i - 1, side, AIM], course[i - 1, side, EXCESS]
                now = last + excess_after(excess, step, q)
                course[i, side, TRAVEL] = (
                    course[i - 1, side, TRAVEL] + last * step + excess_travel(excess, step, q)
                )
                course[i, side, EXCESS] = now - aim if has_dynamics(q) else 0.0


@compiled
def follow_wheels(
    wheels: FloatArray, first: IntArray, step: float, radius: float, course: FloatArray
) -> None:
    """Course of both rims by their measured speeds, each the mean since the sample before.

    Args:
        wheels: Measured speeds [rad/s], shape (n, 2).
        first: First sample of each sample's episode, shape (n,).
        step: Sampling interval [s].
        radius: Radius of the wheels [m].
        course: Receives the course, shape (n, 2, 3).
    """
    n = len(wheels)
    for i in range(n):
        ahead = i + 1 if i + 1 < n and first[i + 1] == first[i] else i
        for side in range(2):
            course[i, side, AIM] = radius * wheels[ahead, side]
            course[i, side, EXCESS] = 0.0
            course[i, side, TRAVEL] = (
                0.0 if i == first[i] else course[i - 1, side, TRAVEL] + radius * wheels[i, side] * step
            )


@inlined
def travelled(
    course: FloatArray,
    side: int,
    sample: int,
    part: float,
    first: int,
    last: int,
    step: float,
    q: FloatArray,
    before: float,
) -> float:
    """Travel of a rim at a time between two samples, or outside its episode [m].

    Args:
        course: Course of both rims, shape (n, 2, 3).
        side: 0 left, 1 right.
        sample: Sample before that time; may lie before the episode's first.
        part: Share of the step since then.
        first: The episode's first sample.
        last: Its last.
        step: Sampling interval [s].
        q: Parameters, shape (PARAMETERS,).
        before: Speed of the rim before the episode [m/s].
    """
    if sample < first:
        return ((sample - first) + part) * step * before
    time = part * step
    if sample > last:
        time += (sample - last) * step
        sample = last
    beyond = excess_travel(course[sample, side, EXCESS], time, q)
    result: float = course[sample, side, TRAVEL] + course[sample, side, AIM] * time + beyond
    return result


@compiled
def simulate(
    parameters: FloatArray,
    commands: FloatArray,
    wheel_front: bool,
    wheels: FloatArray,
    first: IntArray,
    last: IntArray,
    time: FloatArray,
    step: float,
    disturbance: FloatArray,
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
        parameters: Parameter vectors, shape (batch, PARAMETERS).
        commands: Of the whole recording, as in ``follow_commands``, shape (n, 2).
        wheel_front: True if they are wheel speeds.
        wheels: Measured wheel speeds [rad/s], shape (n, 2), or (0, 2) if there are none.
        first: First sample of each sample's episode, shape (n,).
        last: Last sample of each sample's episode, shape (n,).
        time: Sample times [s], shape (n,).
        step: Sampling interval [s].
        disturbance: Additional turn rate [rad/s], shape (n,), or (0,) for none.
        starts: First sample of each window, shape (windows,).
        lengths: Samples of each window, shape (windows,).
        states: x [m], y [m], heading [rad] as shown at the window's start, shape (windows, 3).
        pose_driven_by_wheels: True drives the body by the measured wheels, False by the simulated ones.
        with_pose: Whether the pose is wanted.
        with_wheels: Whether the wheels are.
        out: Receives x, y, heading (not wrapped) and both wheels' mean speeds since the sample before
            [rad/s], shape (batch, windows, samples, 5), filled with NaN; what is not wanted stays so.
    """
    n = len(commands)
    simulated = np.empty((n, 2, 3))
    measured = np.empty((n if pose_driven_by_wheels else 0, 2, 3))
    before = np.full((n, 2), np.nan)
    for p in range(len(parameters)):
        q = parameters[p]
        for i in range(n if len(wheels) > 0 else 0):
            for side in range(2):
                before[i, side] = q[RADIUS] * wheels[first[i], side]
        if with_wheels or not pose_driven_by_wheels:
            follow_commands(commands, wheel_front, before, first, time, step, q, simulated)
        course = simulated
        pose_shift = (q[DELAY] + q[SENSOR_DELAY]) / step
        if pose_driven_by_wheels:
            follow_wheels(wheels, first, step, q[RADIUS], measured)
            course = measured
            pose_shift = q[SENSOR_DELAY] / step  # and wheels that were measured have no excess
        wheel_whole = math.ceil(q[DELAY] / step)
        wheel_part = wheel_whole - q[DELAY] / step
        # While the rims change their speed, the body's way is cut into shorter arcs.
        cuts = ARCS if has_dynamics(q) and not pose_driven_by_wheels else 1
        whole = math.ceil(pose_shift)
        part = whole - pose_shift
        for w in range(len(starts)):
            start = starts[w]
            low, high = first[start], last[start]
            rest = np.empty(2)
            for side in range(2):
                rest[side] = before[start, side]
                if math.isnan(rest[side]):  # then no wheels are measured, and the command is all there is
                    rest[side] = simulated[low, side, AIM]
            x, y = states[w, 0], states[w, 1]
            heading = states[w, 2] - q[HEADING_BIAS]
            cosine, sine = math.cos(heading), math.sin(heading)
            for j in range(lengths[w] if with_wheels else 0):
                # A turn rate that nobody commanded shows in both stages.
                extra = 0.5 * q[TRACK] * (disturbance[start + j] if len(disturbance) > 0 else 0.0)
                at = start + j - wheel_whole
                for side in range(2):
                    way = travelled(
                        simulated, side, at, wheel_part, low, high, step, q, rest[side]
                    ) - travelled(simulated, side, at - 1, wheel_part, low, high, step, q, rest[side])
                    out[p, w, j, 3 + side] = (way / step + (2 * side - 1) * extra) / q[RADIUS]
            for j in range(lengths[w] if with_pose else 0):
                out[p, w, j, 0] = x
                out[p, w, j, 1] = y
                out[p, w, j, 2] = heading + q[HEADING_BIAS]
                if j == lengths[w] - 1:
                    break
                extra = disturbance[start + j] if len(disturbance) > 0 else 0.0
                # From `part` of a step after sample `at` to as much after the next, where a command
                # switches in between.
                at = start + j - whole
                for piece in range(2 * cuts):
                    # The first half of the pieces fills up sample `at`, the second begins the next one.
                    sample = at if piece < cuts else at + 1
                    low_part, high_part = (part, 1.0) if piece < cuts else (0.0, part)
                    # Short arcs after a switch, where the speed changes most.
                    first_share, last_share = ((piece % cuts) / cuts) ** 2, ((piece % cuts + 1) / cuts) ** 2
                    begin = low_part + (high_part - low_part) * first_share
                    duration = (high_part - low_part) * (last_share - first_share) * step
                    if duration <= 0.0:
                        continue
                    end, end_part = sample, low_part + (high_part - low_part) * last_share
                    if piece == cuts - 1:
                        end, end_part = sample + 1, 0.0
                    left = travelled(course, 0, end, end_part, low, high, step, q, rest[0]) - travelled(
                        course, 0, sample, begin, low, high, step, q, rest[0]
                    )
                    right = travelled(course, 1, end, end_part, low, high, step, q, rest[1]) - travelled(
                        course, 1, sample, begin, low, high, step, q, rest[1]
                    )
                    distance, lateral, turn = body(left, right, duration, extra, q)
                    x, y, cosine, sine = slipping_arc(x, y, cosine, sine, distance, lateral, turn)
                    heading += turn
                    if q[SLOPE_X] != 0.0 or q[SLOPE_Y] != 0.0:
                        x += q[SLOPE_X] * abs(distance)
                        y += q[SLOPE_Y] * abs(distance)
