"""Flying a plan in the continuous model: what it is worth, whatever model it was made in."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled
from fieldmodels.machines.uav_route.aircraft import banked_time, heading_of, turn_into
from fieldmodels.machines.uav_route.detection import EXACT, probability
from fieldmodels.machines.uav_route.lock_loss import timers_after
from fieldmodels.machines.uav_route.parameters import Constants, World, make_constants
from fieldmodels.machines.uav_route.signature import aspect, signature
from fieldmodels.model import ModelError

STEP = 0.1
"""Time between samples of a re-flown plan [s]: 25 m."""

_COLUMNS = 10  # of a radar's trace: slant range ... damaged


@dataclass(frozen=True)
class Certificate:
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
class Reflight:
    """A plan as flown: its certificate, and its trace at the middle of every sample.

    Attributes:
        certificate: What it is worth.
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

    certificate: Certificate
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


def refly(
    waypoints: ArrayLike,
    radars: ArrayLike,
    world: World | None = None,
    *,
    durations: ArrayLike | None = None,
    heading: float | None = None,
    step: float = STEP,
) -> Reflight:
    """Fly a plan from waypoint to waypoint in the continuous model, detection above the threshold.

    Several aircraft are uncoupled in the source: fly each one by itself.

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
    c = make_constants(world)
    room = int(np.sum(np.ceil(times / step)) + 2 * len(times))
    own, seen = np.zeros((room, 6)), np.zeros((room, len(sites), _COLUMNS))
    before = math.nan if heading is None else float(heading)
    count, largest, losses = _fly(starts, legs, times, sites, before, step, c, own, seen)
    own, seen = own[:count], seen[:count]
    detected = seen[:, :, 5] > 0
    interval = own[:, 1]
    ends = np.cumsum(interval)
    hits = np.flatnonzero(seen[:, :, 9].any(axis=1))
    certificate = Certificate(
        path_length=float(lengths.sum()),
        duration=float(times.sum()),
        time_over=float(interval[detected.any(axis=1)].sum()),
        longest_detection=max((_longest(column, interval) for column in detected.T), default=0.0),
        largest_probability=float(largest),
        lock_losses=int(losses),
        damaged_at=float(ends[hits[0]]) if len(hits) else math.inf,
        step=float(step),
    )
    return Reflight(
        certificate=certificate,
        time=own[:, 0],
        interval=interval,
        position=own[:, 2:4],
        heading=own[:, 4],
        bank=own[:, 5],
        slant_range=seen[:, :, 0],
        azimuth=seen[:, :, 1],
        elevation=seen[:, :, 2],
        signature=seen[:, :, 3],
        probability=seen[:, :, 4],
        detected=detected,
        timers=seen[:, :, 6:9],
    )


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


@compiled
def _look(
    north: float, east: float, heading: float, bank: float, sites: FloatArray, c: Constants, out: FloatArray
) -> float:
    """Slant range, azimuth, elevation, signature and probability for each radar; the largest of these."""
    largest = 0.0
    for r in range(len(sites)):
        tilt = -bank if c.left_handed else bank
        out[r, 0], out[r, 1], out[r, 2] = aspect(
            sites[r, 0] - north,
            sites[r, 1] - east,
            c.altitude,
            math.cos(heading),
            math.sin(heading),
            math.cos(tilt),
            math.sin(tilt),
        )
        out[r, 3] = signature(out[r, 1], out[r, 2])
        out[r, 4] = probability(out[r, 3], out[r, 0], c.log) if out[r, 0] <= c.reach else 0.0
        largest = max(largest, out[r, 4])
    return largest


@compiled
def _fly(
    starts: FloatArray,
    legs: FloatArray,
    times: FloatArray,
    sites: FloatArray,
    before: float,
    step: float,
    c: Constants,
    own: FloatArray,
    seen: FloatArray,
) -> tuple[int, float, int]:
    """Fill the trace: time, interval, position, heading, bank; and what each radar sees and counts.

    Returns:
        Number of samples, largest probability of detection (corners included), number of lock losses.
    """
    count, losses, largest, begun = 0, 0, 0.0, 0.0
    at_corner = np.zeros((len(sites), 5))
    old_north, old_east = math.cos(before), math.sin(before)
    if math.isnan(before):
        for i in range(len(legs)):
            if legs[i, 0] != 0.0 or legs[i, 1] != 0.0:
                old_north, old_east = legs[i, 0], legs[i, 1]
                break
        else:
            old_north, old_east = 1.0, 0.0
    heading = heading_of(old_north, old_east, c.two_quadrant)
    for i in range(len(legs)):
        north, east, duration = legs[i, 0], legs[i, 1], times[i]
        length = math.sqrt(north * north + east * east)
        speed = length / duration
        course, turn = heading, 0.0
        if length > 0.0:
            course = heading_of(north, east, c.two_quadrant)
            heading = course
            if c.next_leg:
                if i + 1 < len(legs) and (legs[i + 1, 0] != 0.0 or legs[i + 1, 1] != 0.0):
                    to_north, to_east = starts[i + 1, 0] + legs[i + 1, 0], starts[i + 1, 1] + legs[i + 1, 1]
                    turn = turn_into(north, east, legs[i + 1, 0], legs[i + 1, 1], to_north, to_east, c)
                    heading = heading_of(legs[i + 1, 0], legs[i + 1, 1], c.two_quadrant)
            else:
                turn = turn_into(
                    old_north, old_east, north, east, starts[i, 0] + north, starts[i, 1] + east, c
                )
            old_north, old_east = north, east
        banked = banked_time(turn, speed, c.bank, duration, c)
        ahead_north, ahead_east = speed * math.cos(course), speed * math.sin(course)
        for level in range(2):
            first, last = (banked, duration) if level == 1 else (0.0, banked)
            if last <= first:
                continue
            bank = 0.0 if level == 1 else math.copysign(c.bank, turn)
            pieces = max(1, math.ceil((last - first) / step - 1e-9))
            interval = (last - first) / pieces
            for k in range(pieces + 1):
                edge = last if k == pieces else first
                if k == 0 or k == pieces:
                    x, y = starts[i, 0] + edge * ahead_north, starts[i, 1] + edge * ahead_east
                    largest = max(largest, _look(x, y, heading, bank, sites, c, at_corner))
                if k == pieces:
                    break
                middle = first + (k + 0.5) * interval
                x, y = starts[i, 0] + middle * ahead_north, starts[i, 1] + middle * ahead_east
                own[count, 0], own[count, 1] = begun + middle, interval
                own[count, 2], own[count, 3], own[count, 4], own[count, 5] = x, y, heading, bank
                largest = max(largest, _look(x, y, heading, bank, sites, c, seen[count]))
                for r in range(len(sites)):
                    one = seen[count, r]
                    detected = one[4] > c.threshold + EXACT
                    lose, engage, launch = 0.0, 0.0, 0.0
                    if count > 0:
                        lose, engage, launch = (
                            seen[count - 1, r, 6],
                            seen[count - 1, r, 7],
                            seen[count - 1, r, 8],
                        )
                    one[6], one[7], one[8], lost, hit = timers_after(
                        lose, engage, launch, detected, interval, c
                    )
                    one[5] = 1.0 if detected else 0.0
                    one[9] = 1.0 if hit else 0.0
                    losses += 1 if lost else 0
                count += 1
        begun += duration
    return count, largest, losses
