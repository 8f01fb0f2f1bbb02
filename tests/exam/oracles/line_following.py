"""The walking robot, its line and its camera in the plane, written from docs/line_following.md.

The line is made of straight pieces and arcs as they are, places are complex numbers, x + i y [m]. A stride
goes straight along the heading at its beginning, then the heading turns. The camera sees the centroid of the
tape in the middle third of its rows. Nothing here is shared with the simulation that it is compared with.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import brentq

from exam.oracles import Values, filled
from fieldmodels.arrays import FloatArray

NEUTRAL: Values = {
    "steering_bias": {"turn": 0.0},
    "turn_gain": {"factor": 1.0},
    "actuator_delay": {"strides": 0.0},
    "foot_slip": {"turn": 0.0, "twist": 0.0, "step": 0.0},
    "camera_yaw": {"angle": 0.0},
    "camera_pitch": {"angle": 0.0},
    "sensor_gain": {"factor": 1.0},
    "sensor_quantisation": {"step": 0.0},
    "actuator_saturation": {"turn": 10.0},
}
LIMIT = 0.15
"""Largest turn of a stride [rad]."""
HEIGHT, PITCH, VIEW = 1.0, math.radians(45.0), math.radians(50.0)
"""The camera as calibrated: height [m], depression of its axis, horizontal field of view."""
COLUMNS, ROWS, BAND = 160, 120, (40, 80)
"""The image, and the rows that are looked at."""
FOCAL = 0.5 * COLUMNS / math.tan(0.5 * VIEW)
"""Focal length [pixels]."""


@dataclass(frozen=True)
class Line:
    """A line of straight pieces and arcs, straight on beyond its ends.

    Attributes:
        pieces: Length [m] and curvature [1/m] (left positive) of each.
        start: Where it begins.
        heading: Its heading there [rad].
    """

    pieces: tuple[tuple[float, float], ...]
    start: complex = 0j
    heading: float = 0.0

    @cached_property
    def _corners(self) -> list[tuple[float, complex, float, float]]:
        """Arc length, place, heading and curvature where pieces begin, and beyond the last one."""
        corners, arc, place, heading = [], 0.0, self.start, self.heading
        for length, curvature in (*self.pieces, (0.0, 0.0)):
            corners.append((arc, place, heading, curvature))
            place += cmath.rect(1.0, heading) * chord(length, curvature)
            arc, heading = arc + length, heading + curvature * length
        return corners

    def at(self, arc: float) -> tuple[complex, complex]:
        """Place and direction at an arc length."""
        begun = [corner for corner in self._corners if corner[0] <= arc]
        begin, place, heading, curvature = begun[-1] if begun else (0.0, self.start, self.heading, 0.0)
        forward = cmath.rect(1.0, heading)
        along = arc - begin
        return place + forward * chord(along, curvature), forward * cmath.exp(1j * curvature * along)

    def nearest(self, place: complex, expected: float, within: float = 1.5) -> float:
        """Arc length of the point nearest to a place, near an expected one."""
        return float(brentq(self._ahead, expected - within, expected + within, (place, 0.0, None), 1e-13))

    def crossing(self, place: complex, forward: complex, ahead: float, expected: float) -> float:
        """Arc length where the line is a distance ahead of a place in a direction."""
        ends = expected - 3.0, expected + 3.0
        return float(brentq(self._ahead, *ends, (place, ahead, forward), 1e-13))

    def _ahead(self, arc: float, place: complex, ahead: float, forward: complex | None) -> float:
        point, along = self.at(arc)
        return ((point - place) * (forward or along).conjugate()).real - ahead


def chord(length: float, curvature: float) -> complex:
    """Way along an arc that begins along x."""
    if abs(curvature * length) < 1e-12:
        return complex(length)
    return (cmath.exp(1j * curvature * length) - 1.0) / (1j * curvature)


@dataclass(frozen=True)
class Robot:
    """A robot with effects.

    Attributes:
        effects: Values of the effects that are on.
        stride: Length of a stride [m].
        height: Height of the camera [m].
        width: Width of the tape [m].
        columns: Columns of the image, outside of which the tape is not seen; infinitely many in a prediction.
    """

    effects: Values
    stride: float = 0.7
    height: float = HEIGHT
    width: float = 0.0508
    columns: float = COLUMNS

    @cached_property
    def given(self) -> Values:
        """Values of every effect."""
        return filled(self.effects, NEUTRAL)

    @property
    def length(self) -> float:
        """Length of a stride of feet that slip [m]."""
        return self.stride * (1.0 - self.given["foot_slip"]["step"])

    def turn(self, commands: Sequence[float]) -> float:
        """Turn of a stride [rad] by all commands up to it, the newest last; earlier ones were zero."""
        slip = self.given["foot_slip"]
        asked = (1.0 - slip["turn"]) * self._carried(commands) + slip["twist"] * self._carried(commands[:-1])
        return self.given["turn_gain"]["factor"] * asked + self.given["steering_bias"]["turn"]

    def _carried(self, commands: Sequence[float]) -> float:
        """The command that the motor carries out: late, and limited."""
        known = [0.0, 0.0, 0.0, 0.0, *commands]
        now = len(known) - 1 - self.given["actuator_delay"]["strides"]
        late = np.interp(now, np.arange(len(known)), known)
        most = min(LIMIT, self.given["actuator_saturation"]["turn"])
        return float(np.clip(late, -most, most))

    def sight(self, line: Line, place: complex, heading: float, expected: float) -> float:
        """What the camera board sends: the place of the tape's centroid in the band [m], left positive."""
        forward = cmath.rect(1.0, heading + self.given["camera_yaw"]["angle"])
        pitch = PITCH + self.given["camera_pitch"]["angle"]
        nodes, weights = np.polynomial.legendre.leggauss(24)
        low, high = (math.atan((row - 0.5 * ROWS) / FOCAL) for row in BAND)
        pixels = moment = 0.0
        for node, weight in zip(nodes, weights, strict=True):
            # Equal pieces of the angle of a row below the axis, whose rows are sec^2 as many.
            below = 0.5 * (low + high) + 0.5 * (high - low) * float(node)
            rows = float(weight) * FOCAL / math.cos(below) ** 2
            ahead = self.height / math.tan(pitch + below)
            depth = math.hypot(ahead, self.height) * math.cos(below)
            arc = line.crossing(place, forward, ahead, expected + ahead)
            point, along = line.at(arc)
            side = ((point - place) * forward.conjugate()).imag
            half = 0.5 * self.width / abs((along * forward.conjugate()).real)
            ends = np.clip(
                FOCAL / depth * np.array([side - half, side + half]), -0.5 * self.columns, 0.5 * self.columns
            )
            pixels += rows * (ends[1] - ends[0])
            moment += rows * (ends[1] - ends[0]) * 0.5 * (ends[0] + ends[1])
        middle = math.atan(((BAND[0] + BAND[1] - ROWS) / 2.0) / FOCAL)
        calibrated = HEIGHT / math.sin(PITCH + middle) * math.cos(middle) / FOCAL
        shown = self.given["sensor_gain"]["factor"] * calibrated * moment / pixels
        step = self.given["sensor_quantisation"]["step"]
        return float(step * np.round(shown / step) if step > 0.0 else shown)


def walk(robot: Robot, line: Line, offset: float, misalignment: float, commands: FloatArray) -> FloatArray:
    """Walk along a line that begins where the robot is.

    Args:
        robot: The robot.
        line: The line.
        offset: Distance from it at its beginning, left positive [m].
        misalignment: Heading against it there [rad].
        commands: Turns [rad], shape (n,).

    Returns:
        The line's place in the camera [m], offset [m] and misalignment [rad] before each stride and after the
        last one, shape (n + 1, 3).
    """
    point, along = line.at(0.0)
    place, heading = point + 1j * along * offset, cmath.phase(along) + misalignment
    arc, rows = 0.0, []
    for k in range(len(commands) + 1):
        arc = line.nearest(place, arc + (robot.length if k else 0.0))
        point, along = line.at(arc)
        against = cmath.phase(cmath.rect(1.0, heading) / along)
        rows.append((robot.sight(line, place, heading, arc), ((place - point) / along).imag, against))
        if k < len(commands):
            place += cmath.rect(robot.length, heading)
            heading += robot.turn(commands[: k + 1].tolist())
    return np.array(rows)


def simulate(
    base: Mapping[str, float],
    effects: Values,
    commands: FloatArray,
    step: float,
    start: Mapping[str, float] | None = None,
) -> FloatArray:
    """Work out what ``LineFollowing`` describes; see ``Simulate``.

    Args:
        base: ``stride`` and ``camera_height`` [m].
        effects: Values of the effects that are on.
        commands: Turn of each stride [rad] and curvature of the line where the robot is then [1/m].
        step: Time of a stride; it does not matter.
        start: ``offset`` [m] and ``heading`` [rad] against the line; ``command_1``, ``command_2``, ...: the
            turns that were commanded one, two, ... strides before [rad].
    """
    del step
    begun = dict(start or {})
    robot = Robot(effects, base["stride"], base["camera_height"], columns=math.inf)
    offset, heading = begun.pop("offset", 0.0), begun.pop("heading", 0.0)
    given = [begun[name] for name in sorted(begun, reverse=True)]
    out = np.empty((len(commands), 3))
    for k, (command, near) in enumerate(commands):
        far = commands[min(k + 1, len(commands) - 1), 1]
        # The line bends as here for a stride, then as where the robot will be.
        line = Line(((9.0, near), (robot.length, near), (9.0, far)), heading=-9.0 * near)
        line = Line(line.pieces, -line.at(9.0)[0], line.heading)
        place = 1j * offset
        out[k] = robot.sight(line, place, heading, 9.0), offset, heading
        given.append(float(command))
        place += cmath.rect(robot.length, heading)
        bend = Line(((9.0 + robot.stride + 1.0, near),), line.start, line.heading)
        point, along = bend.at(bend.nearest(place, 9.0 + robot.length))
        offset = ((place - point) / along).imag
        heading = cmath.phase(cmath.rect(1.0, heading) / along) + robot.turn(given)
    return out
