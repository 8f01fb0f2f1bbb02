"""Shortest paths of bounded curvature between two poses (Dubins 1957), compiled and batched.

A shortest path is one of six words of turns to the left (L) and right (R) on the smallest circle and
straights (S). In units of the radius, seen from the start's pose, three words are solved in closed form
from the distance of their outer circles' centres; mirrored, they give the other three.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled, inlined
from fieldmodels.machines.pose_reaching.unicycle import arc
from fieldmodels.model import ModelError

WORDS = ("LSL", "RSR", "LSR", "RSL", "LRL", "RLR")
_TURNS = np.array([[{"L": 1.0, "S": 0.0, "R": -1.0}[letter] for letter in word] for word in WORDS])
_FULL = 2.0 * math.pi
_TINY = 1e-10  # rad and radii: rounding must not make a full circle of a turn that is zero


@inlined
def positive_turn(angle: float) -> float:
    """The same angle in [0, 2 pi); a hair's breadth below a full turn counts as none."""
    result = angle - _FULL * math.floor(angle / _FULL)
    return 0.0 if result > _FULL - _TINY else result


@inlined
def solve_left(kind: int, x: float, y: float, turn: float) -> tuple[float, float, float, float]:
    """Solve LSL (kind 0), LSR (1) or LRL (2) to the pose (x, y, turn) from (0, 0, 0), in radii.

    Returns:
        Length (infinite if there is no such path) and the three segments' lengths.
    """
    if kind == 1:
        # From the centre of the first circle, left, to that of the last, right.
        u, w = x + math.sin(turn), y - 1.0 - math.cos(turn)
        squared = u * u + w * w - 4.0
        if squared < -_TINY:
            return math.inf, 0.0, 0.0, 0.0
        straight = math.sqrt(max(squared, 0.0))
        heading = math.atan2(w, u) + math.atan2(2.0, straight)
        first, last = positive_turn(heading), positive_turn(heading - turn)
        return first + straight + last, first, straight, last
    u, w = x - math.sin(turn), y - 1.0 + math.cos(turn)
    apart = math.hypot(u, w)
    if kind == 0:
        if apart < _TINY:  # both poses on one circle
            first = positive_turn(turn)
            return first, first, 0.0, 0.0
        heading = math.atan2(w, u)
        first, last = positive_turn(heading), positive_turn(turn - heading)
        return first + apart + last, first, apart, last
    if apart > 4.0:
        return math.inf, 0.0, 0.0, 0.0
    middle = _FULL - 2.0 * math.asin(0.25 * apart)
    heading = math.atan2(w, u) + 0.5 * middle
    first, last = positive_turn(heading), positive_turn(turn - heading + middle)
    return first + middle + last, first, middle, last


@inlined
def solve(word: int, x: float, y: float, turn: float) -> tuple[float, float, float, float]:
    """Solve any word, by its index in ``WORDS``, as ``solve_left`` does; every other one by the mirror."""
    side = 1.0 - 2.0 * (word % 2)
    return solve_left(word // 2, x, side * y, side * turn)


@inlined
def seen_from(
    x: float, y: float, heading: float, goal_x: float, goal_y: float, goal_heading: float
) -> tuple[float, float, float]:
    """A goal's place ahead and to the left [m], and its heading [rad], as a robot at a pose sees them."""
    c, s = math.cos(heading), math.sin(heading)
    return (
        c * (goal_x - x) + s * (goal_y - y),
        c * (goal_y - y) - s * (goal_x - x),
        goal_heading - heading,
    )


@inlined
def shortest(
    x: float, y: float, heading: float, goal_x: float, goal_y: float, goal_heading: float, radius: float
) -> tuple[float, int, float, float, float]:
    """The shortest path between two poses.

    Returns:
        Length [m], index of its word in ``WORDS``, and the lengths of its three segments [m].
    """
    ahead, aside, turn = seen_from(x, y, heading, goal_x, goal_y, goal_heading)
    best, word, first, middle, last = math.inf, 0, 0.0, 0.0, 0.0
    for candidate in range(6):
        length, a, b, d = solve(candidate, ahead / radius, aside / radius, turn)
        if length < best:
            best, word, first, middle, last = length, candidate, a, b, d
    return best * radius, word, first * radius, middle * radius, last * radius


@compiled
def _words(start: FloatArray, goal: FloatArray, radius: float) -> FloatArray:
    words = np.empty((6, 4))
    ahead, aside, turn = seen_from(start[0], start[1], start[2], goal[0], goal[1], goal[2])
    for k in range(6):
        length, first, middle, last = solve(k, ahead / radius, aside / radius, turn)
        words[k, 0] = length * radius
        words[k, 1] = first * radius
        words[k, 2] = middle * radius
        words[k, 3] = last * radius
    return words


@compiled
def _along(
    start: FloatArray, turns: FloatArray, segments: FloatArray, radius: float, distances: FloatArray
) -> FloatArray:
    poses = np.empty((len(distances), 3))
    for i in range(len(distances)):
        x, y, heading = start[0], start[1], start[2]
        left = distances[i]
        for k in range(3):
            part = min(left, segments[k])
            turn = turns[k] * part / radius
            x, y, _, _ = arc(x, y, math.cos(heading), math.sin(heading), part, turn)
            heading += turn
            left -= part
        poses[i, 0] = x
        poses[i, 1] = y
        poses[i, 2] = heading
    return poses


@dataclass(frozen=True)
class DubinsPath:
    """A shortest path.

    Attributes:
        start: Pose at its start: x [m], y [m], heading [rad], shape (3,).
        word: One of ``WORDS``.
        segments: Lengths of its segments [m], shape (3,).
        radius: Radius of its turns [m].
    """

    start: FloatArray
    word: str
    segments: FloatArray
    radius: float

    @property
    def length(self) -> float:
        """Length of the whole path [m]."""
        return float(self.segments.sum())

    def at(self, distances: ArrayLike) -> FloatArray:
        """Poses at distances from the start [m]; the heading is continuous, not wrapped.

        Args:
            distances: Distances, shape (n,); beyond the path's ends the poses there.

        Returns:
            Poses, shape (n, 3).
        """
        wanted = np.clip(np.asarray(distances, dtype=np.float64).ravel(), 0.0, self.length)
        return _along(self.start, _TURNS[WORDS.index(self.word)], self.segments, self.radius, wanted)

    def sampled(self, spacing: float) -> FloatArray:
        """Poses from start to end, both included, evenly and at most ``spacing`` [m] apart, shape (n, 3)."""
        return self.at(np.linspace(0.0, self.length, max(2, math.ceil(self.length / spacing) + 1)))


def dubins_path(start: ArrayLike, goal: ArrayLike, radius: float, word: str | None = None) -> DubinsPath:
    """The shortest path between two poses.

    Args:
        start: x [m], y [m], heading [rad], shape (3,).
        goal: The same.
        radius: Smallest turning radius [m].
        word: The path by this one of ``WORDS`` instead of the shortest.

    Raises:
        ModelError: If the radius is not positive, a pose does not have three finite numbers, the word is
            unknown, or without a path between these poses.
    """
    begin = _pose(start)
    words = _words(begin, _pose(goal), _positive(radius))
    if word is not None and word not in WORDS:
        raise ModelError(f"no Dubins word {word!r} (known: {', '.join(WORDS)})")
    chosen = int(np.argmin(words[:, 0])) if word is None else WORDS.index(word)
    if not math.isfinite(words[chosen, 0]):
        raise ModelError(f"no path of the word {word!r} between these poses; the shortest always exists")
    return DubinsPath(begin, WORDS[chosen], words[chosen, 1:], float(radius))


def _pose(values: ArrayLike) -> FloatArray:
    pose = np.array(values, dtype=np.float64)
    if pose.shape != (3,) or not np.isfinite(pose).all():
        raise ModelError(f"a pose is x [m], y [m] and heading [rad], not {values!r:.80}")
    return pose


def _positive(radius: float) -> float:
    if not 0.0 < radius < math.inf:
        raise ModelError(f"a turning radius must be a positive number of metres, not {radius!r}")
    return float(radius)
