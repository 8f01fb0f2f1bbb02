"""Simulating a plan in the continuous model: what it is worth, whatever model it was made in."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled, inlined
from fieldmodels.machines.uav_route.aircraft import Attitude, heading_of, leg_of, turn_into
from fieldmodels.machines.uav_route.declaration import nominal_plant
from fieldmodels.machines.uav_route.lock_loss import timers_after
from fieldmodels.machines.uav_route.parameters import NEXT_LEG, TWO_QUADRANT, World, kernel_world
from fieldmodels.machines.uav_route.radar import certain, view
from fieldmodels.model import ModelError

STEP = 0.1
"""Time between samples of a simulated plan [s]: 25 m."""

SAMPLE = np.dtype(
    [
        ("time", np.float64),  # its middle [s]
        ("interval", np.float64),  # its length [s]
        ("position", np.float64, (2,)),
        ("heading", np.float64),
        ("bank", np.float64),
    ]
)
"""What a sample holds of the aircraft."""

RADAR_SAMPLE = np.dtype(
    [
        ("slant_range", np.float64),
        ("azimuth", np.float64),
        ("elevation", np.float64),
        ("signature", np.float64),
        ("probability", np.float64),
        ("detected", np.int8),
        ("hit", np.int8),  # whether its missile hits in this sample
        ("timers", np.float64, (3,)),
    ]
)
"""What a sample holds of each radar."""


@dataclass(frozen=True)
class PlanVerification:
    """What the continuous model says of a plan.

    Attributes:
        path_length: Length of the path [km].
        duration: Time of the flight [s].
        time_over: Time for which the probability of detection by any radar exceeds the threshold [s].
        longest_detection: Longest time without a break in which one radar's does [s].
        largest_probability: Largest probability of detection by any radar.
        lock_losses: How often an engaged radar lost its lock.
        damaged_at: When the first missile hits [s]; infinity if none does. The flight goes on.
        step: Time between the samples [s]; times over the threshold are known to about one step an edge.
    """

    path_length: float
    duration: float
    time_over: float
    longest_detection: float
    largest_probability: float
    lock_losses: int
    damaged_at: float
    step: float

    @property
    def undetected(self) -> bool:
        """Whether no radar's probability of detection ever exceeds the threshold."""
        return self.time_over == 0.0

    @property
    def survived(self) -> bool:
        """Whether no missile hits."""
        return math.isinf(self.damaged_at)


@dataclass(frozen=True)
class PlanSimulation:
    """A plan as simulated: its verification, and its trace at the middle of every sample.

    Attributes:
        verification: What it is worth.
        time: Middle of each sample [s], shape (samples,).
        interval: Length of each sample [s], shape (samples,).
        position: North and east [km], shape (samples, 2).
        heading: Heading [rad], shape (samples,).
        bank: Bank [rad], shape (samples,).
        slant_range: Slant range of each radar [km], shape (samples, radars).
        azimuth: Azimuth of each radar [rad], shape (samples, radars).
        elevation: Elevation of each radar [rad], shape (samples, radars).
        signature: Signature that each radar sees, shape (samples, radars).
        probability: Probability of detection by each radar, shape (samples, radars).
        detected: Whether it exceeds the threshold, shape (samples, radars).
        timers: Lock-loss, engage and launch timers at each sample's end, shape (samples, radars, 3).
    """

    verification: PlanVerification
    time: FloatArray
    interval: FloatArray
    position: FloatArray
    heading: FloatArray
    bank: FloatArray
    slant_range: FloatArray
    azimuth: FloatArray
    elevation: FloatArray
    signature: FloatArray
    probability: FloatArray
    detected: NDArray[np.bool_]
    timers: FloatArray


def simulate_plan(
    waypoints: ArrayLike,
    radars: ArrayLike,
    world: World | None = None,
    *,
    durations: ArrayLike | None = None,
    heading: float | None = None,
    step: float = STEP,
) -> PlanSimulation:
    """Simulate a plan from waypoint to waypoint in the continuous model, detection above the threshold.

    Several aircraft are uncoupled in the source: simulate each one by itself.

    Args:
        waypoints: North and east of start, waypoints and goal [km], shape (n, 2). A leg of no length is
            left out, unless it takes time: then the aircraft hovers with the heading that it has.
        radars: North and east of each radar [km], shape (radars, 2); may be empty.
        world: Aircraft, detection, lock loss, and how the equations are read.
        durations: Time of each leg [s], shape (n - 1,), for plans whose speed varies; None flies at the
            aircraft's speed.
        heading: Heading before the first leg [rad]; None is the first leg's, so that it begins without a
            turn.
        step: Longest time between samples [s].

    Raises:
        ModelError: If an array has the wrong shape or a number is not possible.
    """
    world = world or World()
    points = _places(waypoints, "waypoints")
    sites = _places(radars, "radars")
    if len(points) < 2:
        raise ModelError("a plan needs at least a start and a goal")
    if not (step > 0 and math.isfinite(step)):
        raise ModelError(f"the step must be positive [s], not {step}")
    legs = np.diff(points, axis=0)
    lengths = np.hypot(legs[:, 0], legs[:, 1])
    times = lengths / world.aircraft.speed
    if durations is not None:
        times = np.array(durations, dtype=np.float64)
        if times.shape != lengths.shape or not np.isfinite(times).all() or (times < 0).any():
            raise ModelError(f"durations are the {len(lengths)} times of the legs [s], not {durations!r:.80}")
        if (lengths[times == 0] > 0).any():
            raise ModelError("a leg takes no time")
    flown = times > 0
    starts, legs, times, lengths = points[:-1][flown], legs[flown], times[flown], lengths[flown]
    c = kernel_world(world)
    room = int(np.sum(np.ceil(times / step)) + 2 * len(times))
    trace, seen = np.zeros(room, SAMPLE), np.zeros((room, len(sites)), RADAR_SAMPLE)
    before = math.nan if heading is None else float(heading)
    plant = nominal_plant(world.aircraft.speed).reshape(1)
    count, largest, losses = _fly(starts, legs, times, sites, before, step, plant, c, trace, seen)
    trace, seen = trace[:count], seen[:count]
    detected, interval = seen["detected"] > 0, trace["interval"]
    ends = np.cumsum(interval)
    hits = np.flatnonzero(seen["hit"].any(axis=1))
    verification = PlanVerification(
        path_length=float(lengths.sum()),
        duration=float(times.sum()),
        time_over=float(interval[detected.any(axis=1)].sum()),
        longest_detection=max((_longest(column, interval) for column in detected.T), default=0.0),
        largest_probability=float(largest),
        lock_losses=int(losses),
        damaged_at=float(ends[hits[0]]) if len(hits) else math.inf,
        step=float(step),
    )
    own = {name: trace[name] for name in SAMPLE.names or ()}
    radar = {name: seen[name] for name in (RADAR_SAMPLE.names or ()) if name not in ("detected", "hit")}
    return PlanSimulation(verification=verification, detected=detected, **own, **radar)


def _places(values: ArrayLike, what: str) -> FloatArray:
    """Places on the map, checked, shape (n, 2)."""
    try:
        places = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise ModelError(f"{what} are pairs of north and east [km], not {values!r:.80}") from None
    places = places.reshape(0, 2) if places.size == 0 else places
    if places.ndim != 2 or places.shape[1] != 2 or not np.isfinite(places).all():
        raise ModelError(f"{what} are finite pairs of north and east [km], not {values!r:.80}")
    return np.ascontiguousarray(places)


def _longest(detected: NDArray[np.bool_], interval: FloatArray) -> float:
    """Longest time without a break [s]."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], detected.astype(np.int8), [0]])))
    ends = np.concatenate([[0.0], np.cumsum(interval)])
    return float(np.max(ends[edges[1::2]] - ends[edges[::2]], initial=0.0))


@inlined
def scan(
    north: float, east: float, attitude: Attitude, sites: FloatArray, plant: Any, c: Any, out: Any
) -> float:
    """What each radar sees of an aircraft at a place [km]; the largest probability of detection."""
    largest = 0.0
    for r in range(len(sites)):
        one = view(sites[r, 0] - north, sites[r, 1] - east, attitude, plant, c)
        out[r].slant_range, out[r].azimuth, out[r].elevation = one.slant_range, one.azimuth, one.elevation
        out[r].signature, out[r].probability = one.signature, one.probability
        largest = max(largest, one.probability)
    return largest


@inlined
def run_timers(count: int, interval: float, c: Any, seen: Any) -> int:
    """Let the radars' timers run through sample ``count`` [s]; returns the number of lock losses."""
    losses = 0
    for r in range(seen.shape[1]):
        one = seen[count, r]
        detected = certain(one.probability, c)
        lose, engage, launch = 0.0, 0.0, 0.0
        if count > 0:
            before = seen[count - 1, r].timers
            lose, engage, launch = before[0], before[1], before[2]
        lose, engage, launch, lost, hit = timers_after(lose, engage, launch, detected, interval, c)
        one.timers[0], one.timers[1], one.timers[2] = lose, engage, launch
        one.detected = 1 if detected else 0
        one.hit = 1 if hit else 0
        losses += 1 if lost else 0
    return losses


@inlined
def first_direction(legs: FloatArray, before: float) -> tuple[float, float]:
    """Direction before the first leg: of a heading [rad], or (NaN) of the first leg with a length."""
    if not math.isnan(before):
        return math.cos(before), math.sin(before)
    for i in range(len(legs)):
        if legs[i, 0] != 0.0 or legs[i, 1] != 0.0:
            return legs[i, 0], legs[i, 1]
    return 1.0, 0.0


@inlined
def turn_and_heading(
    i: int, starts: FloatArray, legs: FloatArray, old_north: float, old_east: float, c: Any
) -> tuple[float, float]:
    """Turn [rad] and heading [rad] of leg ``i``, (4.1) and (4.2); as printed, those of the next leg."""
    north, east = legs[i, 0], legs[i, 1]
    heading = heading_of(north, east, c.arctangent == TWO_QUADRANT)
    if c.heading != NEXT_LEG:
        to_north, to_east = starts[i, 0] + north, starts[i, 1] + east
        return turn_into(old_north, old_east, north, east, to_north, to_east, c), heading
    if i + 1 < len(legs) and (legs[i + 1, 0] != 0.0 or legs[i + 1, 1] != 0.0):
        to_north, to_east = starts[i + 1, 0] + legs[i + 1, 0], starts[i + 1, 1] + legs[i + 1, 1]
        turn = turn_into(north, east, legs[i + 1, 0], legs[i + 1, 1], to_north, to_east, c)
        return turn, heading_of(legs[i + 1, 0], legs[i + 1, 1], c.arctangent == TWO_QUADRANT)
    return 0.0, heading


@compiled
def _fly(
    starts: FloatArray,
    legs: FloatArray,
    times: FloatArray,
    sites: FloatArray,
    before: float,
    step: float,
    plants: NDArray[Any],
    c: Any,
    trace: NDArray[Any],
    seen: NDArray[Any],
) -> tuple[int, float, int]:
    """Fill the trace of the aircraft, and what each radar sees and counts.

    Returns:
        Number of samples, largest probability of detection (corners included), number of lock losses.
    """
    count, losses, largest, begun = 0, 0, 0.0, 0.0
    plant = plants[0]
    at_corner = np.zeros_like(seen[0])
    old_north, old_east = first_direction(legs, before)
    heading = heading_of(old_north, old_east, c.arctangent == TWO_QUADRANT)
    for i in range(len(legs)):
        duration = times[i]
        length = math.sqrt(legs[i, 0] * legs[i, 0] + legs[i, 1] * legs[i, 1])
        course, turn = heading, 0.0
        if length > 0.0:
            course = heading_of(legs[i, 0], legs[i, 1], c.arctangent == TWO_QUADRANT)
            turn, heading = turn_and_heading(i, starts, legs, old_north, old_east, c)
            old_north, old_east = legs[i, 0], legs[i, 1]
        plant.speed = length / duration
        leg = leg_of(math.cos(course), math.sin(course), turn, plant, c)
        banked = min(leg.banked, duration)
        for level in range(2):
            first, last = (banked, duration) if level == 1 else (0.0, banked)
            if last <= first:
                continue
            bank, phase = (0.0, leg.level) if level == 1 else (leg.bank, leg.turning)
            tilt = phase.attitude
            attitude = Attitude(math.cos(heading), math.sin(heading), tilt.bank_cosine, tilt.bank_sine)
            pieces = max(1, math.ceil((last - first) / step - 1e-9))
            interval = (last - first) / pieces
            for edge in (first, last):
                x, y = starts[i, 0] + edge * phase.north, starts[i, 1] + edge * phase.east
                largest = max(largest, scan(x, y, attitude, sites, plant, c, at_corner))
            for k in range(pieces):
                middle = first + (k + 0.5) * interval
                x, y = starts[i, 0] + middle * phase.north, starts[i, 1] + middle * phase.east
                one = trace[count]
                one.time, one.interval, one.heading, one.bank = begun + middle, interval, heading, bank
                one.position[0], one.position[1] = x, y
                largest = max(largest, scan(x, y, attitude, sites, plant, c, seen[count]))
                losses += run_timers(count, interval, c, seen)
                count += 1
        begun += duration
    return count, largest, losses
