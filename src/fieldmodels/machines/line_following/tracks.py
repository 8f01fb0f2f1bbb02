"""Lines on the floor: straight, S, oval, figure of eight, winding ones, or a user's own polyline."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import inlined
from fieldmodels.model import ModelError
from fieldmodels.names import did_you_mean

SPACING = 0.05
"""Distance between a track's points [m]: on a circle of 9 m the chord errs by 0.035 mm."""
RADIUS = 9.0
"""Turn radius of the track at Robots on Tour [m] (section 3.6)."""
SEARCH = 1.5
"""How far along the line the nearest point may be from where it is expected [m], so that a robot at a
crossing stays on its own branch."""


@dataclass(frozen=True)
class Track:
    """A line as evenly spaced points.

    Attributes:
        name: Its name.
        table: Points and unit tangents, shape (points, 4): x, y [m], tangent x, y.
        spacing: Arc length between points [m].
        closed: Whether the last point is followed by the first one.
    """

    name: str
    table: FloatArray
    spacing: float
    closed: bool

    @property
    def length(self) -> float:
        """Length of the line [m]."""
        return self.spacing * (len(self.table) - (0 if self.closed else 1))

    @property
    def points(self) -> FloatArray:
        """Points, shape (points, 2) [m]."""
        return self.table[:, :2]

    def at(self, arc: float) -> tuple[float, float, float]:
        """Position [m] and heading [rad] at an arc length [m]."""
        x, y, tx, ty = point_at(self.table, self.spacing, self.closed, arc)
        return x, y, math.atan2(ty, tx)

    @cached_property
    def bends(self) -> FloatArray:
        """Curvature between each point and the next [1/m], left positive."""
        headings = np.unwrap(np.arctan2(self.table[:, 3], self.table[:, 2]))
        if self.closed:
            turns = round((headings[-1] - headings[0]) / 2 / np.pi)
            headings = np.append(headings, headings[0] + 2 * np.pi * turns)
        return np.asarray(np.diff(headings) / self.spacing)

    def curvature(self, arc: ArrayLike) -> FloatArray:
        """Curvature at arc lengths [1/m], left positive; 0 beyond the ends of an open line."""
        arcs = np.asarray(arc, dtype=np.float64)
        bends = [bend_at(self.bends, self.spacing, self.closed, one) for one in arcs.ravel()]
        return np.array(bends).reshape(arcs.shape)


@inlined
def bend_at(bends: FloatArray, spacing: float, closed: bool, arc: float) -> float:
    """Curvature at an arc length [1/m], left positive; 0 beyond the ends of an open line."""
    i = math.floor(arc / spacing)
    if closed:
        i = i % len(bends)
    elif i < 0 or i >= len(bends):
        return 0.0
    return float(bends[i])


@inlined
def point_at(
    table: FloatArray, spacing: float, closed: bool, arc: float
) -> tuple[float, float, float, float]:
    """Point and unit tangent at an arc length; an open line goes on straight beyond its ends."""
    count = len(table)
    position = arc / spacing
    i = math.floor(position)
    if closed:
        part = position - i
        i = i % count
        j = i + 1 if i + 1 < count else 0
    else:
        i = min(max(i, 0), count - 2)
        part = position - i
        if part < 0.0 or part > 1.0:
            end = 0 if part < 0.0 else count - 1
            beyond = arc - end * spacing
            tx, ty = table[end, 2], table[end, 3]
            return table[end, 0] + beyond * tx, table[end, 1] + beyond * ty, tx, ty
        j = i + 1
    rest = 1.0 - part
    return (
        rest * table[i, 0] + part * table[j, 0],
        rest * table[i, 1] + part * table[j, 1],
        rest * table[i, 2] + part * table[j, 2],
        rest * table[i, 3] + part * table[j, 3],
    )


@inlined
def nearest(
    table: FloatArray, spacing: float, closed: bool, x: float, y: float, expected: float
) -> tuple[float, float, float, float]:
    """Arc length of the nearest point, sideways offset (left of the line positive) and tangent there."""
    arc = expected
    px, py, tx, ty = point_at(table, spacing, closed, arc)
    for _ in range(4):
        arc += (x - px) * tx + (y - py) * ty
        arc = min(max(arc, expected - SEARCH), expected + SEARCH)
        px, py, tx, ty = point_at(table, spacing, closed, arc)
    return arc, (y - py) * tx - (x - px) * ty, tx, ty


def from_points(points: ArrayLike, name: str = "own", spacing: float = SPACING) -> Track:
    """A smooth line through points: a cubic spline over the chord length, evenly sampled.

    Args:
        points: Corner points, shape (points, 2) [m]; a line whose last point is its first one is closed.
        name: Its name.
        spacing: Arc length between the samples [m], at most.

    Raises:
        ModelError: If there are too few points, or some are no numbers, or two neighbours coincide.
    """
    given = np.asarray(points, dtype=np.float64)
    if given.ndim != 2 or given.shape[1] != 2 or len(given) < 2:
        raise ModelError(f"track {name!r}: at least two points (x, y) are needed, not shape {given.shape}")
    if not np.isfinite(given).all():
        raise ModelError(
            f"track {name!r}: point {int(np.argmin(np.isfinite(given).all(axis=1)))} is no number"
        )
    chords = np.hypot(*np.diff(given, axis=0).T)
    if (chords < 1e-6).any():
        at = int(np.argmin(chords))
        raise ModelError(f"track {name!r}: points {at} and {at + 1} coincide; remove one")
    closed = bool(len(given) > 3 and np.allclose(given[0], given[-1], atol=1e-9))
    knots = np.concatenate(([0.0], np.cumsum(chords)))
    if len(given) == 2:
        curve = CubicSpline(knots, given, bc_type="natural")
    else:
        curve = CubicSpline(knots, given, bc_type="periodic" if closed else "natural")
    fine = np.linspace(0.0, knots[-1], max(2, math.ceil(knots[-1] / spacing * 20)) + 1)
    along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(curve(fine), axis=0).T))))
    pieces = max(2, math.ceil(along[-1] / spacing))
    arcs = np.linspace(0.0, along[-1], pieces + 1)[: pieces if closed else None]
    chord = np.interp(arcs, along, fine)
    tangents = curve(chord, 1)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    return Track(name, np.ascontiguousarray(np.hstack([curve(chord), tangents])), along[-1] / pieces, closed)


def from_pieces(pieces: Sequence[tuple[float, float]], name: str, closed: bool = False) -> Track:
    """A line of straight pieces and arcs.

    Args:
        pieces: Length [m] and curvature [1/m] (left positive) of each piece in turn; starts at the origin
            along x.
        name: Its name.
        closed: Whether the end is the start.
    """
    total = sum(length for length, _ in pieces)
    count = math.ceil(total / SPACING)
    spacing = total / count
    ends = np.cumsum([length for length, _ in pieces])
    rows = []
    for k in range(count if closed else count + 1):
        arc = k * spacing
        x = y = heading = begun = 0.0
        for (_, curvature), end in zip(pieces, ends, strict=True):
            part = min(arc, end) - begun
            half = 0.5 * curvature * part
            chord = part * (math.sin(half) / half if half else 1.0)
            x += chord * math.cos(heading + half)
            y += chord * math.sin(heading + half)
            heading += curvature * part
            begun = end
            if arc <= end:
                break
        rows.append((x, y, math.cos(heading), math.sin(heading)))
    return Track(name, np.array(rows), spacing, closed)


def straight(length: float = 100.0) -> Track:
    """A straight line along x."""
    return from_pieces([(length, 0.0)], "straight")


def s_curve(radius: float = RADIUS, turn: float = math.pi / 2, count: int = 6) -> Track:
    """Left and right turns in alternation, after 5 m of straight."""
    arcs = [(radius * turn, (1.0 if k % 2 == 0 else -1.0) / radius) for k in range(count)]
    return from_pieces([(5.0, 0.0), *arcs, (5.0, 0.0)], "s")


def oval(radius: float = RADIUS, side: float = 10.0) -> Track:
    """Two straights and two half circles; a walk of more than a lap goes over its own beginning."""
    half = (math.pi * radius, 1.0 / radius)
    return from_pieces([(side / 2, 0.0), half, (side, 0.0), half, (side / 2, 0.0)], "oval", closed=True)


def figure_eight(radius: float = RADIUS) -> Track:
    """A left and a right circle that touch at the start: the line meets itself."""
    turn = 2.0 * math.pi * radius
    return from_pieces([(turn, 1.0 / radius), (turn, -1.0 / radius)], "figure_eight", closed=True)


def winding(number: int) -> Track:
    """A hundred metres of straights and turns of random lengths and radii, another line for each number."""
    rng = np.random.default_rng(number)
    lengths = rng.uniform(2.0, 15.0, 50)
    bends = np.clip(rng.uniform(-1.5, 1.5, 50), -1.0, 1.0) / RADIUS  # a third of them turns of the S
    count = int(np.searchsorted(np.cumsum(lengths), 100.0)) + 1
    return from_pieces(list(zip(lengths[:count], bends[:count], strict=True)), f"{WINDING}{number}")


WINDING = "winding_"
"""Before the number of a winding line."""
TRACKS: dict[str, Callable[[], Track]] = {
    "straight": straight,
    "s": s_curve,
    "oval": oval,
    "figure_eight": figure_eight,
}
"""The tracks that have a name."""


def read_track(source: str | Path) -> Track:
    """A track by its name, such as ``s`` or ``winding_7``, or from a CSV file with columns ``x``, ``y`` [m].

    Raises:
        ModelError: If there is neither such a name nor such a file, or the file is no polyline.
    """
    if str(source) in TRACKS:
        return TRACKS[str(source)]()
    if str(source).startswith(WINDING) and (number := str(source).removeprefix(WINDING)).isdecimal():
        return winding(int(number))
    path = Path(source)
    if path.suffix.lower() != ".csv":
        raise ModelError(f"no track {str(source)!r}{did_you_mean(str(source), TRACKS)}, and no .csv file")
    if not path.is_file():
        raise ModelError(f"{path}: there is no such track file")
    try:
        table = np.atleast_1d(np.genfromtxt(path, delimiter=",", names=True, encoding="utf-8-sig"))
    except (ValueError, IndexError) as error:
        raise ModelError(f"{path}: not a CSV table ({error})") from None
    missing = [name for name in ("x", "y") if name not in (table.dtype.names or ())]
    if missing:
        raise ModelError(f"{path}: column {missing[0]!r} is missing; a track has columns x and y in metres")
    points = np.column_stack([table["x"], table["y"]])
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(bad):
        raise ModelError(f"{path}: line {bad[0] + 2} holds no pair of numbers")
    try:
        return from_points(points, path.stem)
    except ModelError as error:
        raise ModelError(f"{path}: {error}") from None
