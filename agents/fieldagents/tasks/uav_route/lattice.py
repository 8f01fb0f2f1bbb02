"""Shortest path over a lattice of waypoints, legs flown in the continuous model with the timers of lock loss.

A label is a way to a node: its length, its last heading, and each radar's lock-loss and engage timers. Labels
grow by straight legs of any length to any node, in the order of length so far plus the straight line to the
goal (A*). A leg's bank follows from the heading before it. A label is dropped if another at its node is no
longer and has gentler timers; headings are not compared, so that the answer is close to the lattice's best
path, not proven to be it. Afterwards the lattice is made finer about the path.
"""

from __future__ import annotations

import heapq
import math
import time
from dataclasses import replace
from typing import Any

import numpy as np

from fieldagents.tasks.uav_route.plan import Plan, Search, make_plan
from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled
from fieldmodels.machines.uav_route.aircraft import banked_time, turn_into
from fieldmodels.machines.uav_route.detection import probability
from fieldmodels.machines.uav_route.lock_loss import launched, timers_after
from fieldmodels.machines.uav_route.parameters import INSTANT_KILL, LOG, Layout, World, kernel_world
from fieldmodels.machines.uav_route.signature import aspect, signature
from fieldmodels.model import ModelError

STEP = 2.0
"""Longest time between two scans of a leg [s]; it counts as detected between them if it is at either."""
LABELS = 400_000
"""Largest number of labels."""
ALIKE = 5.0
"""Timers that differ by no more are taken as equal when labels are compared [s]."""


def lattice_plan(
    layout: Layout,
    world: World | None = None,
    *,
    spacing: float = 5.0,
    detour: float = 1.25,
    refinements: int = 3,
    lock_loss: bool = False,
    least_leg: float = 0.0,
    heading: float | None = None,
) -> Plan:
    """Plan over a lattice, without a solver.

    Args:
        layout: Start, goal and radars.
        world: The continuous model.
        spacing: Between nodes [km].
        detour: The lattice fills the ellipse of paths this many times as long as the straight line.
        refinements: How often it is made three times as fine about the path.
        lock_loss: True allows detections as long as no radar launches its missile; False allows none.
        least_leg: Shortest leg [km], but for one that ends at the goal.
        heading: Heading before the first leg [rad]; None begins without a turn.

    Raises:
        ModelError: If a number is not possible, or the lattice is larger than 20 000 nodes.
    """
    world = world or World()
    if not spacing > 0 or not detour > 1 or refinements < 0:
        raise ModelError("spacing > 0 [km], detour > 1, refinements >= 0")
    begun = time.perf_counter()
    start, goal = np.array(layout.start), np.array(layout.goal)
    sites = np.array(layout.radars, dtype=np.float64).reshape(-1, 2)
    c = kernel_world(world if lock_loss else replace(world, lock_loss=INSTANT_KILL))
    name = "lattice-lock-loss" if lock_loss else "lattice"
    before = math.nan if heading is None else heading
    nodes = _ellipse(start, goal, spacing, detour)
    path, count = _shortest(nodes, sites, c, before, least_leg)
    if not len(path):
        reason = "no path over this lattice: a finer spacing, or a larger detour"
        if count >= LABELS:
            reason = f"stopped after {LABELS} labels: a coarser spacing, or a smaller detour"
        search = Search("no plan", reason, "lattice", work=count, seconds=time.perf_counter() - begun)
        return make_plan(name, layout, world, search, heading=heading)
    for _ in range(refinements):
        spacing /= 3.0
        path, more = _shortest(_about(path, spacing), sites, c, before, least_leg)
        count += more
    search = Search(
        "feasible",
        "shortest path found over the lattice and its refinements",
        "lattice",
        objective=float(np.hypot(*np.diff(path, axis=0).T).sum()),
        work=count,
        seconds=time.perf_counter() - begun,
    )
    return make_plan(name, layout, world, search, path, heading=heading)


def _ellipse(start: FloatArray, goal: FloatArray, spacing: float, detour: float) -> FloatArray:
    """Start, goal, and the lattice in the ellipse about them, shape (nodes, 2)."""
    straight = float(np.hypot(*(goal - start)))
    reach = 0.5 * detour * straight
    middle = 0.5 * (start + goal)
    n = int(reach / spacing)
    if (2 * n + 1) ** 2 > 40_000:
        raise ModelError(f"a lattice of {(2 * n + 1) ** 2} nodes is too large: a spacing above {spacing} km")
    ticks = spacing * np.arange(-n, n + 1)
    grid = middle + np.stack(np.meshgrid(ticks, ticks, indexing="ij"), axis=-1).reshape(-1, 2)
    inside = np.hypot(*(grid - start).T) + np.hypot(*(grid - goal).T) <= detour * straight
    return np.concatenate([start[None], goal[None], grid[inside]])


def _about(path: FloatArray, spacing: float) -> FloatArray:
    """Start, goal, the path's waypoints, and a finer lattice about each of them."""
    ticks = spacing * np.arange(-4, 5)
    near = np.stack(np.meshgrid(ticks, ticks, indexing="ij"), axis=-1).reshape(-1, 2)
    clouds = [p + near for p in path[1:-1]]
    return np.concatenate([path[:1], path[-1:], path[1:-1], *clouds])


def _shortest(
    nodes: FloatArray, sites: FloatArray, c: Any, before: float, least_leg: float
) -> tuple[FloatArray, int]:
    """The path found from the first node to the second, shape (n, 2), and the number of labels."""
    chain, count = _search(nodes, sites, c, before, least_leg)
    return nodes[chain[::-1]], count


@compiled
def _detected(
    north: float, east: float, cosine: float, sine: float, bank: float, site: FloatArray, c: Any
) -> bool:
    slant, azimuth, elevation = aspect(
        site[0] - north, site[1] - east, c.altitude, cosine, sine, math.cos(bank), math.sin(bank)
    )
    likely = probability(signature(azimuth, elevation), slant, c.interpolation == LOG)
    return bool(slant <= c.reach and likely > c.threshold)


@compiled
def _survives(
    a: FloatArray,
    b: FloatArray,
    old_cosine: float,
    old_sine: float,
    sites: FloatArray,
    c: Any,
    timers: FloatArray,
) -> bool:
    """Fly a leg, let the timers run, and say whether no radar launches."""
    north, east = b[0] - a[0], b[1] - a[1]
    length = math.sqrt(north * north + east * east)
    cosine, sine, duration = north / length, east / length, length / c.speed
    turn = turn_into(old_cosine, old_sine, cosine, sine, b[0], b[1], c)
    banked = banked_time(turn, c.speed, c.bank, duration, c)
    for r in range(len(sites)):
        lose, engage, launch = timers[r, 0], timers[r, 1], 0.0
        for level in range(2):
            first, last = (banked, duration) if level == 1 else (0.0, banked)
            if last <= first:
                continue
            bank = 0.0 if level == 1 else math.copysign(c.bank, turn)
            pieces = max(1, math.ceil((last - first) / STEP))
            interval = (last - first) / pieces
            way = first * c.speed
            seen = _detected(a[0] + way * cosine, a[1] + way * sine, cosine, sine, bank, sites[r], c)
            for k in range(pieces):
                way = (first + (k + 1) * interval) * c.speed
                then = _detected(a[0] + way * cosine, a[1] + way * sine, cosine, sine, bank, sites[r], c)
                lose, engage, launch, _, _ = timers_after(lose, engage, launch, seen or then, interval, c)
                if launched(engage, c):
                    return False
                seen = then
        timers[r, 0], timers[r, 1] = lose, engage
    return True


@compiled
def _no_worse(a: FloatArray, b: FloatArray) -> bool:
    """Whether timers a are as gentle as b, or nearly so."""
    for r in range(len(a)):
        if a[r, 1] > b[r, 1] + ALIKE or (a[r, 1] > 0.0 and a[r, 0] < b[r, 0] - ALIKE):
            return False
    return True


@compiled
def _search(
    nodes: FloatArray, sites: FloatArray, c: Any, before: float, least_leg: float
) -> tuple[np.ndarray[tuple[int], np.dtype[np.int64]], int]:
    """A* from node 0 to node 1: the path's nodes, from the goal back (none without one), and labels made."""
    n, m = len(nodes), len(sites)
    room = 4096
    node, parent, following = np.zeros(room, np.int64), np.zeros(room, np.int64), np.zeros(room, np.int64)
    cost, timers = np.zeros(room), np.zeros((room, m, 2))
    dropped = np.zeros(room, np.bool_)
    newest = np.full(n, -1)  # last label at each node; ``following`` leads to the one before it
    to_goal = np.sqrt((nodes[:, 0] - nodes[1, 0]) ** 2 + (nodes[:, 1] - nodes[1, 1]) ** 2)
    parent[0], following[0], newest[0] = -1, -1, 0
    timers[0, :, 0] = 0.0
    count, best = 1, math.inf
    queue = [(to_goal[0], 0)]
    trial, calm = np.zeros((m, 2)), np.zeros((m, 2))
    for r in range(m):
        calm[r, 0] = math.inf
    while len(queue) > 0:
        _, label = heapq.heappop(queue)
        if dropped[label]:
            continue
        here = node[label]
        if here == 1:
            return _path_back(label, node, parent), count
        for j in range(n):
            north, east = nodes[j, 0] - nodes[here, 0], nodes[j, 1] - nodes[here, 1]
            length = math.sqrt(north * north + east * east)
            total = cost[label] + length
            if length < 1e-9 or (length < least_leg and j != 1) or total + to_goal[j] >= best:
                continue
            if parent[label] >= 0:
                origin = nodes[node[parent[label]]]
                old_cosine, old_sine = nodes[here, 0] - origin[0], nodes[here, 1] - origin[1]
            else:
                old_cosine, old_sine = _first_course(before, north, east)
            if _beaten(newest[j], following, cost, timers, total, calm):
                continue
            trial[:] = timers[label]
            if not _survives(nodes[here], nodes[j], old_cosine, old_sine, sites, c, trial):
                continue
            if _beaten(newest[j], following, cost, timers, total, trial):
                continue
            _drop_beaten(newest[j], following, cost, timers, total, trial, dropped)
            if count >= LABELS:
                return np.zeros(0, np.int64), count
            if count == room:
                node, parent = np.concatenate((node, node)), np.concatenate((parent, parent))
                following, cost = np.concatenate((following, following)), np.concatenate((cost, cost))
                timers, dropped = np.concatenate((timers, timers)), np.concatenate((dropped, dropped))
                room *= 2
            node[count], parent[count], following[count], cost[count] = j, label, newest[j], total
            timers[count], dropped[count] = trial, False
            newest[j] = count
            if j == 1:
                best = total
            heapq.heappush(queue, (total + to_goal[j], count))
            count += 1
    return np.zeros(0, np.int64), count


@compiled
def _path_back(
    label: int,
    node: np.ndarray[tuple[int], np.dtype[np.int64]],
    parent: np.ndarray[tuple[int], np.dtype[np.int64]],
) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Nodes of a label's path, from its own back to the start."""
    chain = [node[label]]
    while parent[label] >= 0:
        label = parent[label]
        chain.append(node[label])
    return np.array(chain)


@compiled
def _first_course(before: float, north: float, east: float) -> tuple[float, float]:
    """Cosine and sine of the course before the first leg; with any, the leg's own."""
    return (north, east) if math.isnan(before) else (math.cos(before), math.sin(before))


@compiled
def _drop_beaten(
    other: int,
    following: np.ndarray[tuple[int], np.dtype[np.int64]],
    cost: FloatArray,
    timers: FloatArray,
    total: float,
    trial: FloatArray,
    dropped: np.ndarray[tuple[int], np.dtype[np.bool_]],
) -> None:
    """Mark the labels at the same node that are neither shorter nor better than a new one."""
    while other >= 0:
        if cost[other] >= total and _no_worse(trial, timers[other]):
            dropped[other] = True
        other = following[other]


@compiled
def _beaten(
    other: int,
    following: np.ndarray[tuple[int], np.dtype[np.int64]],
    cost: FloatArray,
    timers: FloatArray,
    total: float,
    trial: FloatArray,
) -> bool:
    """Whether a label at the same node is no longer and no worse."""
    while other >= 0:
        if cost[other] <= total + 1e-9 and _no_worse(timers[other], trial):
            return True
        other = following[other]
    return False
