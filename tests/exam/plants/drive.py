"""A differential drive with anything wrong with it, integrated in plain Python by short arcs.

    command -> maps -> rims -> delay -> lag at a limited rate -> rims' speeds, whose means encoders count
    rims -> forward, sideways and turning speed -> ground -> pose; pose(t - late) -> shown pose, plus noise

A fault is whatever it appends to one of these lists.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from fieldmodels.arrays import FloatArray

Command = Callable[[float, float, float], tuple[float, float]]
"""(speed, turn rate, time) to what the drive is told; called once a sample, in order."""
Rim = Callable[[float, float, float], float]
"""(rim's speed, side -1 or 1, time) to what the motor is told; called once a sample, in order."""
Motion = tuple[float, float, float]
"""Forward and sideways speed (left positive) [m/s], turn rate [rad/s]."""
Pose = tuple[float, float, float]
"""x, y [m], heading [rad]."""
Ground = Callable[[Motion, Pose, float], Motion]
"""(motion so far, pose halfway through the step, time) to motion; called once a step, in order."""
Sensor = Callable[[Pose, Pose, float], Pose]
"""(shown so far, true pose, time) to what is shown; called once a sample."""
Control = Callable[[int, Pose], tuple[float, float]]
"""(sample, pose as shown a sample before) to speed and turn rate."""


@dataclass
class Drive:
    """A drive with what is wrong with it.

    Attributes:
        radius: Of the wheels [m].
        track: Distance of the wheels [m].
        commands: What becomes of each command.
        rims: What becomes of each rim's commanded speed.
        delay: By how much rims are late [s].
        lag: Their time constant [s].
        fall: Their time constant where they become slower [s]; None for the same.
        rate: Largest rate of a rim's speed [m/s^2].
        ground: What becomes of the motion that the wheels ask for.
        drift: Velocity of the ground itself [m/s].
        late: By how much the shown pose is late at a time [s].
        sensors: What becomes of the shown pose.
        holds: Samples at which a new pose is shown (others repeat the last one); None for all.
        across: Commanded speed to the left of an omnidirectional drive's third rim, by sample [m/s].
        start: Where it stands at first.
        steps: Steps in a sample.
    """

    radius: float
    track: float
    commands: list[Command] = field(default_factory=list)
    rims: list[Rim] = field(default_factory=list)
    delay: float = 0.0
    lag: float = 0.0
    fall: float | None = None
    rate: float = math.inf
    ground: list[Ground] = field(default_factory=list)
    drift: tuple[float, float] = (0.0, 0.0)
    late: Callable[[float], float] | None = None
    sensors: list[Sensor] = field(default_factory=list)
    holds: Callable[[int], bool] | None = None
    across: Callable[[int], float] | None = None
    start: Pose = (0.0, 0.0, 0.0)
    steps: int = 8


def simulate(drive: Drive, control: Control, noise: FloatArray, step: float) -> FloatArray:
    """Run a drive from rest.

    Args:
        drive: The drive, fresh: what remembers is used up.
        control: Gives speed and turn rate at each sample from the pose that was shown at the one before.
        noise: Added to the shown pose and to the wheels' speeds, shape (n, 5).
        step: Sampling interval [s].

    Returns:
        Speed and turn rate as commanded, shown x, y and heading (continuous), speed of left and right wheel
        [rad/s], the mean since the sample before, shape (n, 7).
    """
    return _Run(drive, step).run(control, noise)


class _Run:
    """One episode."""

    def __init__(self, drive: Drive, step: float) -> None:
        self.drive, self.step, self.h = drive, step, step / drive.steps
        self.pose = drive.start
        self.speeds = [0.0, 0.0, 0.0]
        self.aims: list[tuple[float, float, float]] = []
        self.path: list[Pose] = []
        self.travel = [0.0, 0.0]

    def run(self, control: Control, noise: FloatArray) -> FloatArray:
        result = np.empty((len(noise), 7))
        shown, drive = self.pose, self.drive
        for i, errors in enumerate(noise.tolist()):
            now = i * self.step
            command = given = control(i, shown)
            for change in drive.commands:
                given = change(*given, now)
            aside = self._rim((drive.across(i), 0.0), 0.0, now) if drive.across else 0.0
            self.aims.append((self._rim(given, -1.0, now), self._rim(given, 1.0, now), aside))
            wheels = [way / self.step / drive.radius for way in self.travel]
            self.travel = [0.0, 0.0]
            self.path.append(self.pose)
            shown = self._shown(i, now, errors, shown)
            for s in range(drive.steps):
                if s:
                    self.path.append(self.pose)
                self._advance(now + s * self.h)
            result[i] = *command, *shown, wheels[0] + errors[3], wheels[1] + errors[4]
        return result

    def _rim(self, given: tuple[float, float], side: float, now: float) -> float:
        rim = given[0] + 0.5 * side * self.drive.track * given[1]
        for change in self.drive.rims:
            rim = change(rim, side, now)
        return rim

    def _shown(self, i: int, now: float, errors: list[float], last: Pose) -> Pose:
        true = self._at(now - self.drive.late(now)) if self.drive.late else self.pose
        if self.drive.holds is not None and i > 0 and not self.drive.holds(i):
            return last
        shown = true
        for sensor in self.drive.sensors:
            shown = sensor(shown, true, now)
        return shown[0] + errors[0], shown[1] + errors[1], shown[2] + errors[2]

    def _at(self, time: float) -> Pose:
        """Pose at an earlier time, along lines between the steps."""
        place = max(time / self.h, 0.0)
        k = min(int(place), len(self.path) - 1)
        before, s = self.path[k], place - k
        if k + 1 >= len(self.path):
            return before
        after, r = self.path[k + 1], 1.0 - s
        return (
            r * before[0] + s * after[0],
            r * before[1] + s * after[1],
            r * before[2] + s * after[2],
        )

    def _mean(self, side: int, now: float) -> float:
        """Mean speed of a rim in the step from now on [m/s]; at rest before the first command acts."""
        drive, h = self.drive, self.h
        begin = (now - drive.delay) / self.step + 1e-9
        end = begin + h / self.step - 2e-9
        k, m = math.floor(begin), math.floor(end)
        aim = self.aims[k][side] if k >= 0 else 0.0
        if m > k:
            after = self.aims[m][side] if m >= 0 else 0.0
            aim += (after - aim) * (end - m) / (end - begin)
        before, lag = self.speeds[side], drive.lag
        if drive.fall is not None and abs(aim) < abs(before):
            lag = drive.fall
        decay = math.exp(-h / lag) if lag > 0.0 else 0.0
        change = (aim - before) * (1.0 - decay)
        if abs(change) > drive.rate * h:
            change = math.copysign(drive.rate * h, change)
            self.speeds[side] = before + change
            return before + 0.5 * change
        self.speeds[side] = before + change
        # The mean over a step in which an exponential, or a ramp, ends at the aim.
        share = lag / h * (1.0 - decay) if lag > 0.0 else 0.5 * abs(change) / (drive.rate * h)
        return aim + (before - aim) * share

    def _advance(self, now: float) -> None:
        left, right = self._mean(0, now), self._mean(1, now)
        self.travel[0] += left * self.h
        self.travel[1] += right * self.h
        aside = self._mean(2, now) if self.drive.across else 0.0
        motion: Motion = (0.5 * (left + right), aside, (right - left) / self.drive.track)
        x, y, heading = self.pose
        halfway = x, y, heading + 0.5 * motion[2] * self.h
        for change in self.drive.ground:
            motion = change(motion, halfway, now)
        turned = motion[2] * self.h
        middle = heading + 0.5 * turned
        # The chord of an arc of constant speeds.
        share = self.h * (math.sin(0.5 * turned) / (0.5 * turned) if abs(turned) > 1e-9 else 1.0)
        cosine, sine = share * math.cos(middle), share * math.sin(middle)
        drift = self.drive.drift
        self.pose = (
            x + cosine * motion[0] - sine * motion[1] + drift[0] * self.h,
            y + sine * motion[0] + cosine * motion[1] + drift[1] * self.h,
            heading + turned,
        )
