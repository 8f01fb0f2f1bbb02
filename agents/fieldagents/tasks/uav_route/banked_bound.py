"""A length below which no route of banked turns is undetected, by Lagrangian relaxation of the angle.

About one radar a route is a chain of straight legs in polar coordinates. What may be flown depends on the
radius and on the angle between course and radial alone, so that the bearing enters only by its sum: all legs
together must gain the angle between start and goal. Charged with lambda a radian instead, this condition
leaves a shortest path over radii, and for every lambda its length plus lambda times the angle is a lower
bound; the largest counts.

On a leg that passes the radar at the distance p, length less lambda times angle is a difference of G(r) =
sqrt(r^2 - p^2) - lambda acos(p / r) at its two ends: the sum over a leg separates, and a sweep over all legs
is a running minimum over radii for each p.

A turn shows the aircraft banked, on its new course. What the bank may show decides from which radius on it
may be made. Within 39 degrees of the nose a bank hides what level flight shows beyond 30: a leg may be flown
there for as long as its bank lasts, which depends on the course before it; these courses are taken together
in classes, each with the longest bank that its turns can have. After a course towards the radar such a leg
gains nothing (both legs together are less steep than a level one may be, ``_hidden_after_inwards``).
Everything else is relaxed: how long a bank lasts elsewhere, whether it fits the turn, all other radars. Turns
below the model's epsilon, a milliradian, are not banked and not covered.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fieldagents.tasks.uav_route.limits import NOSE, banked_limits, limits_of, steepest
from fieldagents.tasks.uav_route.polish import bank_length
from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled
from fieldmodels.machines.uav_route.parameters import Layout, LegRules, World

GRID = 1.0
"""Between radii [km]; turns are allowed as much too near, legs may be as much too short."""
PASSING = 1.0
"""Between the distances in which legs pass the radar [km]."""
LEGS = 60
"""Largest number of legs: the environment's ``max_legs``."""
LEVEL_IN, LEVEL_OUT, BANK_IN, BANK_OUT = 1, 2, 4, 8
OUTWARDS = (0.0, 0.1, 0.2, 0.3, 0.4, 0.7, 0.95, 1.0)
"""Classes of courses away from the radar before a turn, by how far from it they pass at least [circles]."""
PAST, INWARDS, CLASSES = 7, 8, 9
"""The last of them, which may pass the radar; courses towards it; number of classes."""


@dataclass(frozen=True)
class _Legs:
    """Legs about a radar: where they may be flown, by distance from the radar (rows) and radius (columns).

    Attributes:
        radius: Radii [km], shape (n,).
        course: Class of the rows' courses away from the radar, shape (m,).
        first: Column at which each row begins, shape (m,).
        root: Distance to the place next to the radar [km], shape (m, n).
        angle: Bearing relative to that place [rad], shape (m, n).
        allowed: Bits, shape (m, n): level towards the radar, level away from it, and the same two in a bank.
        bank: Longest leg that only a bank hides, less what its own slope takes off, by the class of the
            course before it [km], shape (classes, n).
        per_radian: Length of a bank by its turn [km/rad].
    """

    radius: FloatArray
    course: NDArray[np.int64]
    first: NDArray[np.int64]
    root: FloatArray
    angle: FloatArray
    allowed: NDArray[np.uint8]
    bank: FloatArray
    per_radian: float


def banked_bound(layout: Layout, world: World, least_leg: float = LegRules.least_leg) -> float:
    """Length below which no undetected route of banked turns reaches the goal [km].

    Args:
        layout: Start, goal and radars; each radar is taken by itself, and the largest bound holds.
        world: The continuous model.
        least_leg: Shortest leg that may be flown [km]; shorter ones would let a bank hide more.
    """
    start, goal = np.array(layout.start), np.array(layout.goal)
    straight = float(np.hypot(*(goal - start)))
    sites = np.array(layout.radars).reshape(-1, 2)
    return max([straight, *(_about(start - site, goal - site, world, least_leg) for site in sites)])


def _about(start: FloatArray, goal: FloatArray, world: World, least_leg: float) -> float:
    """The same for one radar at the origin: the largest value over charges, by golden section."""
    ends = float(np.hypot(*start)), float(np.hypot(*goal))
    cosine = float(start @ goal) / max(ends[0] * ends[1], 1e-12)
    angle = math.acos(min(1.0, max(-1.0, cosine)))
    if angle < 1e-9 or limits_of(world).side <= 0.0:
        return 0.0
    legs = _legs(*ends, world, least_leg)
    at = np.searchsorted(legs.radius, ends)

    def value(charge: float) -> float:
        cost = _cheapest(
            charge, int(at[0]), int(at[1]), legs.course, legs.first, legs.root, legs.angle, legs.allowed,
            legs.bank, legs.per_radian, max(least_leg - GRID, 0.0),
        )  # fmt: skip
        return cost + charge * angle

    low, high = 0.0, float(legs.radius[-1])
    share = 0.5 * (math.sqrt(5.0) - 1.0)
    inner, outer = high - share * (high - low), low + share * (high - low)
    left, right = value(inner), value(outer)
    best = max(value(0.0), left, right)
    while high - low > 1.0:
        if left >= right:
            high, outer, right = outer, inner, left
            inner = high - share * (high - low)
            left = value(inner)
        else:
            low, inner, left = inner, outer, right
            outer = low + share * (high - low)
            right = value(outer)
        best = max(best, left, right)
    return best


def _legs(start: float, goal: float, world: World, least_leg: float) -> _Legs:
    """All legs between radii from the nearer end, or the circle, outwards [km]."""
    circle = limits_of(world).side
    far = max(limits_of(world).banked_side, start, goal) + GRID
    radius = np.unique([*np.arange(min(start, goal, circle), far, GRID), start, goal, circle, far])
    passing = np.unique([*np.arange(0.0, circle, PASSING), *np.arange(circle, far, PASSING)])
    sine = passing[:, None] / radius
    reached = sine <= 1.0
    slope = np.arcsin(np.minimum(sine, 1.0))
    azimuths, least = banked_limits(world, kinder=True)
    outside = radius >= circle - 1e-9
    bits = np.zeros(sine.shape, np.uint8)
    for nose, level, banked in ((True, LEVEL_IN, BANK_IN), (False, LEVEL_OUT, BANK_OUT)):
        at, limit = steepest(world, nose)
        steep = limit[np.minimum(np.searchsorted(at, radius + GRID), len(limit) - 1)]
        course = slope if nose else math.pi - slope
        bits |= np.where(outside | (slope <= steep), level, 0).astype(np.uint8)
        bits |= np.where(radius + GRID >= np.interp(course, azimuths, least), banked, 0).astype(np.uint8)
    hidden = azimuths[(least <= circle + GRID) & (azimuths < 0.5 * math.pi)].max(initial=NOSE)
    bank = np.empty((CLASSES, len(radius)))
    for c, passed in enumerate(OUTWARDS):
        slopes = np.arcsin(np.minimum(passed * circle / radius, 1.0))
        bank[c] = [bank_length(world, math.pi - a) for a in slopes]
    bank[INWARDS] = _hidden_after_inwards(hidden, world, least_leg)
    return _Legs(
        radius=radius,
        course=np.searchsorted(np.array(OUTWARDS) * circle, passing + 1e-9, side="right") - 1,
        first=np.argmax(reached, axis=1),
        root=np.sqrt(np.maximum(radius**2 - passing[:, None] ** 2, 0.0)),
        angle=np.arccos(np.minimum(sine, 1.0)),
        allowed=np.where(reached, bits, 0).astype(np.uint8),
        bank=bank,
        per_radian=bank_length(world, 1.0),
    )


def _hidden_after_inwards(steepest_hidden: float, world: World, least_leg: float) -> float:
    """Longest leg that only a bank hides after one towards the radar [km]; 0 if it could as well be level.

    The steeper the course before it, the shorter the bank. Where the two legs together lead less steeply than
    a level leg may, that level leg is shorter.
    """
    before = np.linspace(0.0, steepest_hidden, 400)
    length = bank_length(world, 1.0) * (steepest_hidden - before)
    across = least_leg * np.sin(before) + length * math.sin(steepest_hidden)
    along = least_leg * np.cos(before) + length * math.cos(steepest_hidden)
    needless = (np.arctan2(across, along) <= NOSE) | (length < least_leg)
    return 0.0 if needless.all() else bank_length(world, steepest_hidden)


@compiled
def _cheapest(
    charge: float, start: int, goal: int, course: NDArray[np.int64], first: NDArray[np.int64],
    root: FloatArray, angle: FloatArray, allowed: NDArray[np.uint8], bank: FloatArray, per_radian: float,
    least: float,
) -> float:  # fmt: skip
    """Least length less charge times angle from start to goal, without a turn at the start.

    The costs to go are for a turn at each radius, by the class of the course before it; a sweep adds a leg.
    """
    n = root.shape[1]
    cost = np.full((CLASSES, n), math.inf)
    cost[:, goal] = 0.0
    inwards, outwards = np.zeros(n), np.zeros(n)
    shown = np.zeros(len(root), np.int64)  # last column of a row at which only a bank hides, plus one
    for i in range(len(root)):
        for j in range(first[i], n):
            if allowed[i, j] & (BANK_IN | LEVEL_IN) == BANK_IN:
                shown[i] = j + 1
    begun = math.inf
    for _ in range(LEGS):
        before = cost.copy()
        for i in range(len(root)):
            _level(i, charge, goal, course[i], first[i], root, angle, allowed, least, cost, inwards, outwards)
            begun = min(begun, inwards[start], outwards[start])
            for j in range(first[i], n):
                bits = allowed[i, j]
                turned = min(
                    inwards[j] if bits & BANK_IN else math.inf, outwards[j] if bits & BANK_OUT else math.inf
                )
                for c in range(CLASSES):
                    cost[c, j] = min(cost[c, j], turned)
                if shown[i] and bits & BANK_IN and root[i, j] - root[i, shown[i] - 1] <= bank[0, j]:
                    _hidden(i, j, charge, first[i], root, angle, allowed, bank, per_radian, cost)
        if (cost == before).all():
            break
    return begun


@compiled
def _level(
    i: int, charge: float, goal: int, after: int, first: int, root: FloatArray, angle: FloatArray,
    allowed: NDArray[np.uint8], least: float, cost: FloatArray, inwards: FloatArray, outwards: FloatArray,
) -> None:  # fmt: skip
    """The best that level legs of one distance from the radar make of each radius they begin at."""
    n = root.shape[1]
    inwards[:first], outwards[:first] = math.inf, math.inf
    best, past, k = math.inf, math.inf, n - 1
    for j in range(n - 1, first - 1, -1):
        g = root[i, j] - charge * angle[i, j]
        past = min(past, cost[after, j] + g)
        if j == goal:
            best = min(best, g)  # the last leg may be short
        while k >= first and root[i, k] - root[i, j] >= least:
            best = min(best, cost[after, k] + root[i, k] - charge * angle[i, k])
            k -= 1
        outwards[j] = best - g if allowed[i, j] & (LEVEL_OUT | BANK_OUT) else math.inf
    past = past if after == PAST else math.inf
    best = math.inf
    for j in range(first, n):
        g = root[i, j] - charge * angle[i, j]
        if allowed[i, j] & LEVEL_IN:
            best = min(best, cost[INWARDS, j] - g)
            inwards[j] = g + min(best, past)
        else:
            best = inwards[j] = math.inf


@compiled
def _hidden(
    i: int, j: int, charge: float, first: int, root: FloatArray, angle: FloatArray,
    allowed: NDArray[np.uint8], bank: FloatArray, per_radian: float, cost: FloatArray,
) -> None:  # fmt: skip
    """Legs towards the radar that only their bank hides, from column j on."""
    own = per_radian * (0.5 * math.pi - angle[i, j])  # the new course is this far from the radial
    k, shown, longest = j, False, bank[0, j] - own
    g = root[i, j] - charge * angle[i, j]
    while k >= first and allowed[i, k] & (LEVEL_IN | BANK_IN) and root[i, j] - root[i, k] <= longest + GRID:
        shown = shown or not allowed[i, k] & LEVEL_IN
        if shown and k < j:
            total = g - root[i, k] + charge * angle[i, k] + cost[INWARDS, k]
            for c in range(CLASSES):
                if bank[c, j] > 0.0 and root[i, j] - root[i, k] <= bank[c, j] - own + GRID:
                    cost[c, j] = min(cost[c, j], total)
        k -= 1
