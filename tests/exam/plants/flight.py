"""An aircraft that is sent from waypoint to waypoint, the tracker that follows it, and a radar that scans it.

Places are north + i east [m], so that a positive phase turns to the right. Written from
docs/uav_route.md and the effects' equations; flown in short pieces, scans at their own times.
"""

from __future__ import annotations

import cmath
import math
from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from exam.plants.faults import Fault
from fieldmodels.arrays import FloatArray

Rng = np.random.Generator
Values = Mapping[str, float]
GRAVITY, ALTITUDE, BANK, LEAST_TURN = 9.80665, 10e3, math.radians(45.0), 1e-3
INTERVAL, REACH = 5.0, 656.6e3
"""Between scans [s]; slant range beyond which there are none [m]."""
NOISE = (20.0, 20.0, 0.02, 0.1)
"""Standard deviations of north and east [m], of the bank [rad] and of the time between scans [s]."""
PIECES = 8
"""Pieces of a sample, beside those that scans and the ends of banks make."""
RING = (250e3, 450e3)
"""Distances from the radar within which waypoints lie [m]."""
EDGES = tuple(math.radians(a) for a in (0.0, 30.0, 31.0, 159.0, 160.0, 180.0))
SIDE = (0.0, 0.0, 1.0, 1.0, 0.0, 0.0)
"""Table 4.1: how far a signature is from that of the cones to that between them, by azimuth."""
UP = tuple(math.radians(a) for a in (0.0, 20.0, 45.0, 90.0))
CONE, BETWEEN = (5e-5, 5e-4, 5e-3, 1.0), (0.5, 0.5, 1.0, 1.0)
"""Table 4.1: both, by elevation."""
SIZES = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0)
CHANCES = (0.99, 0.5, 0.1, 0.01)
RANGES = (
    (12.0, 21.4, 38.0, 67.6, 120.2, 213.7, 380.0),
    (15.2, 27.1, 48.1, 85.6, 152.2, 270.6, 481.2),
    (17.6, 31.2, 55.6, 98.8, 175.7, 312.5, 555.6),
    (20.8, 36.9, 65.7, 116.8, 207.6, 369.2, 656.6),
)
"""Table 4.2: slant range [km] by signature, for every chance."""


@dataclass
class Flight:
    """An aircraft and its radar, which stands at zero, with what is wrong with them.

    Attributes:
        speed: Airspeed [m/s].
        loss: Share of it that is lost in turns.
        bank: In turns [rad].
        wind: Whereto it blows [m/s].
        bias: Of the tracker [m].
        signature: Factor.
        cone: Factor of the nose cone's width.
        range: Factor.
        site: Where the radar truly stands [m].
        interval: Between scans [s].
        drifts: Further velocities over ground [m/s] by time, place, course, and signed bank.
        throttles: Factors of the airspeed by time and place.
        tracker: What becomes of a place that it shows, by place and time.
        gauge: What becomes of the bank that is shown, by bank and time.
        scans: What becomes of the chance of a detection, by chance, time and bearing from the radar.
        reaches: Factors of the radar's range by time and bearing.
        left: Factor of the bank in turns to the left.
    """

    speed: float
    loss: float = 0.0
    bank: float = BANK
    wind: complex = 0.0
    bias: complex = 0.0
    signature: float = 1.0
    cone: float = 1.0
    range: float = 1.0
    site: complex = 0.0
    interval: float = INTERVAL
    drifts: list[Callable[[float, complex, complex, float], complex]] = field(default_factory=list)
    throttles: list[Callable[[float, complex], float]] = field(default_factory=list)
    tracker: list[Callable[[complex, float], complex]] = field(default_factory=list)
    gauge: list[Callable[[float, float], float]] = field(default_factory=list)
    scans: list[Callable[[float, float, float], float]] = field(default_factory=list)
    reaches: list[Callable[[float, float], float]] = field(default_factory=list)
    left: float = 1.0

    def velocity(self, time: float, place: complex, course: complex, bank: float) -> tuple[complex, complex]:
        """Velocity over ground, and through the air, while a course is held."""
        speed = self.speed * (1.0 - self.loss if bank else 1.0)
        for throttle in self.throttles:
            speed *= throttle(time, place)
        wind = self.wind / course
        over = course * (wind.real + math.sqrt(speed * speed - wind.imag**2))
        air = over - self.wind
        for drift in self.drifts:
            over += drift(time, place, course, bank)
        return over, air

    def chance(self, time: float, place: complex, air: complex, bank: float) -> float:
        """Probability that a scan detects the aircraft."""
        to = (self.site - place) / (air / abs(air))
        bearing = cmath.phase(place - self.site)
        wing = complex(to.imag, ALTITUDE) * cmath.rect(1.0, -bank)
        azimuth, flat = abs(math.atan2(wing.real, to.real)), math.hypot(to.real, wing.real)
        elevation = abs(math.atan2(wing.imag, flat))
        slant = math.hypot(flat, wing.imag)
        edges = (0.0, EDGES[1] * self.cone, EDGES[2] * self.cone, *EDGES[3:])
        side, up = between(azimuth, edges, SIDE), elevation
        shown = (1.0 - side) * between(up, UP, CONE) + side * between(up, UP, BETWEEN)
        scale = 1e3 * self.range
        for reach in self.reaches:
            scale *= reach(time, bearing)
        ranges = [scale * between(self.signature * shown, SIZES, column) for column in RANGES]
        result = between(slant, ranges, CHANCES) if slant <= REACH else 0.0
        for change in self.scans:
            result = change(result, time, bearing)
        return result


def between(x: float, xs: Sequence[float], ys: Sequence[float]) -> float:
    """Value between the entries of a table, and of its ends beyond them."""
    if x <= xs[0] or x >= xs[-1]:
        return ys[0] if x <= xs[0] else ys[-1]
    k = bisect_right(xs, x)
    return ys[k - 1] + (x - xs[k - 1]) / (xs[k] - xs[k - 1]) * (ys[k] - ys[k - 1])


def simulate(flight: Flight, noise: FloatArray, step: float, way: Rng, luck: Rng) -> FloatArray:
    """Fly from one waypoint to the next.

    Args:
        flight: The aircraft and its radar.
        noise: Of north, east, bank, and the time between scans, shape (n, 4).
        step: Sampling interval [s].
        way: Draws the waypoints.
        luck: Draws the detections.

    Returns:
        Waypoint, place and mean bank as shown, whether a scan since the sample before detected, and its time
        since the scan before (NaN without a scan), shape (n, 7).
    """
    rows = np.full((len(noise), 7), np.nan)
    draws, jitter = luck.random(len(noise) * 8), noise[:, 3].tolist()
    place, aim, course = complex(0.0, -0.5 * sum(RING)), 0j, 0j
    left, side, mean, seen, gap = 0.0, 0.0, 0.0, math.nan, math.nan
    due, scanned, number, h = 0.0, -flight.interval, 0, step / PIECES
    for i, errors in enumerate(noise):
        now = i * step
        if i == 0 or abs(aim - place) <= 1.5 * flight.speed * step:
            aim = _waypoint(place, course, way)
            new = (aim - place) / abs(aim - place)
            turn = cmath.phase(new / course) if i else 0.0
            course = new
            bank = flight.bank * (flight.left if turn < 0.0 else 1.0)
            slow = flight.speed * (1.0 - flight.loss)
            left = abs(turn) * slow / (GRAVITY * math.tan(bank)) if abs(turn) >= LEAST_TURN else 0.0
            side = math.copysign(bank, turn)
        shown, banked = place + flight.bias, mean
        for sensor in flight.tracker:
            shown = sensor(shown, now)
        for gauge in flight.gauge:
            banked = gauge(banked, now)
        rows[i] = (
            aim.real, aim.imag, shown.real + errors[0], shown.imag + errors[1], banked + errors[2], seen, gap
        )  # fmt: skip
        mean, seen, gap, time = 0.0, math.nan, math.nan, now
        for end in [now + h * (j + 1) for j in range(PIECES)]:
            while time < end - 1e-9:
                if due <= time + 1e-9:
                    _, air = flight.velocity(time, place, course, side if left > 0.0 else 0.0)
                    chance = flight.chance(time, place, air, side if left > 0.0 else 0.0)
                    seen, gap, scanned = float(draws[number % len(draws)] < chance), due - scanned, due
                    due += max(flight.interval + jitter[number % len(jitter)], step)
                    number += 1
                until = min(end, due, time + left if left > 1e-9 else math.inf)
                bank = side if left > 1e-9 else 0.0
                over, _ = flight.velocity(time, place, course, bank)
                place += (until - time) * over
                mean += (until - time) * bank / step
                left -= until - time
                time = until
    return rows


def _waypoint(place: complex, course: complex, way: Rng) -> complex:
    """A waypoint within the ring about the radar that takes no reversal."""
    while True:
        aim = place + cmath.rect(way.uniform(6e3, 20e3), way.uniform(-math.pi, math.pi))
        if RING[0] <= abs(aim) <= RING[1] and (
            not course or abs(cmath.phase((aim - place) / course)) < math.radians(170.0)
        ):
            return aim


def install(flight: Flight, effects: Mapping[str, Values]) -> None:
    """Let listed effects act."""
    for name, values in effects.items():
        if name in PLACES:
            setattr(flight, PLACES[name], complex(values["north"], values["east"]))
        else:
            attribute, key, usual = FACTORS[name]
            setattr(flight, attribute, usual * values[key])


PLACES = {"wind": "wind", "sensor_bias": "bias", "radar_position": "site"}
FACTORS: Mapping[str, tuple[str, str, float]] = {
    "turn_speed_loss": ("loss", "share", 1.0),
    "weaker_bank": ("bank", "factor", BANK),
    "signature_scale": ("signature", "factor", 1.0),
    "nose_cone_width": ("cone", "factor", 1.0),
    "radar_range_scale": ("range", "factor", 1.0),
    "scan_interval": ("interval", "factor", INTERVAL),
}
LISTED = (*PLACES, *FACTORS)
FlightFault = Fault[Flight, float]
"""The scale of a flight is its duration [s]."""
WIND = "wind to the north|wind to the east"
WIND_OVER_TIME, TRACKER_OVER_TIME = (f"force {WIND} over time",), ("sensor north|east over time",)
SECTOR = ("odds detected over north|east", "odds detected over north*east")
BENT_GAUGE = ("sensor bank over bank",)


def _wind_shear(flight: Flight, k: float, _s: float, rng: Rng) -> None:
    blow = cmath.rect(k, rng.uniform(0.0, 2.0 * math.pi))
    flight.drifts.append(lambda _t, place, _c, _b: blow * math.sin(place.real / 60e3))


def _engine_fades(flight: Flight, k: float, s: float, _rng: Rng) -> None:
    flight.throttles.append(lambda t, _p: 1.0 - 0.2 * math.tanh(0.02 * k) * (t / s) ** 2)


def _slow_gauge(flight: Flight, k: float, _s: float, _rng: Rng) -> None:
    held, share = [0.0], math.exp(-2.0 / k)

    def lag(bank: float, _t: float) -> float:
        held[0] = bank + share * (held[0] - bank)
        return held[0]

    flight.gauge.append(lag)


def _map_scale(flight: Flight, k: float, _s: float, _rng: Rng) -> None:
    flight.tracker.append(lambda p, _t: complex(p.real * (1.0 + 5e-4 * k), p.imag))


def _clutter(flight: Flight, k: float, _s: float, _rng: Rng) -> None:
    share = 1.0 - math.exp(-0.05 * k)
    flight.scans.append(lambda p, _t, _b: p + share * (1.0 - p))


def _rain(flight: Flight, k: float, _s: float, rng: Rng) -> None:
    middle, depth = rng.uniform(-math.pi, math.pi), 0.08 * k
    flight.reaches.append(lambda _t, b: math.exp(-depth * max(math.cos(b - middle), 0.0)))


def _gauge_offset(flight: Flight, k: float, _s: float, _rng: Rng) -> None:
    flight.gauge.append(lambda bank, _t: bank + 0.001 * k)


def _drifting_tracker(flight: Flight, k: float, s: float, _rng: Rng) -> None:
    flight.tracker.append(lambda place, t: place + (2.0 + 1.0j) * k * t / s)


def _tidal_wind(flight: Flight, k: float, s: float, rng: Rng) -> None:
    blow, phase = cmath.rect(k, rng.uniform(0.0, 2.0 * math.pi)), rng.uniform(0.0, 2.0 * math.pi)
    flight.drifts.append(lambda t, _p, _c, _b: blow * math.sin(6.0 * math.pi * t / s + phase))


def _gauge_scale(flight: Flight, k: float, _s: float, _rng: Rng) -> None:
    flight.gauge.append(lambda bank, _t: bank * (1.0 + 0.01 * k))


def _map_lens(flight: Flight, k: float, _s: float, _rng: Rng) -> None:
    flight.tracker.append(lambda p, _t: p * (1.0 + 2e-4 * k * (abs(p) / RING[1]) ** 2))


def _thin_air(flight: Flight, k: float, _s: float, _rng: Rng) -> None:
    flight.throttles.append(lambda _t, p: 1.0 + 0.2 * math.tanh(0.01 * k) * p.imag / RING[1])


def _blind_sector(flight: Flight, k: float, _s: float, rng: Rng) -> None:
    middle, share = rng.uniform(-math.pi, math.pi), 1.0 - math.exp(-0.05 * k)
    flight.scans.append(lambda p, _t, b: p * (1.0 - share * (math.cos(b - middle) > 0.5)))


def _pilot_slips(flight: Flight, k: float, _s: float, _rng: Rng) -> None:
    flight.drifts.append(lambda _t, _p, c, _b: 0.5 * k * c * 1j)


DEVELOP: Mapping[str, FlightFault] = {
    "tidal_wind": Fault("The wind swings slowly.", _tidal_wind, shows=WIND_OVER_TIME),
    "gauge_scale": Fault("The bank is shown too large.", _gauge_scale, ("bank_gain",), shows=BENT_GAUGE),
    "map_lens": Fault(
        "The tracker's map is stretched towards its rim.",
        _map_lens,
        shows=("sensor north over north", "sensor east over east", "sensor north|east over north*east"),
    ),
    "thin_air": Fault(
        "It is faster in the east.",
        _thin_air,
        shows=("force speed along the course over east", "parameter speed over east"),
    ),
    "blind_sector": Fault("The radar sees less in a sector.", _blind_sector, shows=SECTOR),
    "pilot_slips": Fault(
        "It always flies a little to the right of its nose.",
        _pilot_slips,
        shows=("force speed to the right",),
    ),
    "wind_shear": Fault(
        "The wind is another one farther north.", _wind_shear, shows=(f"force {WIND} over north",)
    ),
    "engine_fades": Fault(
        "The engine gives less and less.",
        _engine_fades,
        shows=("force speed along the course over time", "parameter speed over time"),
    ),
    "slow_gauge": Fault(
        "The bank is shown with a lag.",
        _slow_gauge,
        ("bank_lag", "bank_delay"),
        shows=("sensor bank over past of bank", "sensor bank over rate of bank"),
    ),
    "map_scale": Fault(
        "The tracker's map is too large in one direction.",
        _map_scale,
        ("north_gain",),
        shows=("sensor north over north",),
    ),
    "clutter": Fault(
        "The radar takes clutter for aircraft.", _clutter, shows=("odds detected over detected",)
    ),
    "rain": Fault("The radar sees less far into the rain.", _rain, shows=SECTOR),
    "gauge_offset": Fault(
        "The bank is shown too large by a constant.", _gauge_offset, ("bank_bias",), shows=("sensor bank",)
    ),
    "drifting_tracker": Fault("The tracker's zero drifts.", _drifting_tracker, shows=TRACKER_OVER_TIME),
}
"""To develop a diagnosis on."""


def _rotated_grid(flight: Flight, k: float, _s: float, _rng: Rng) -> None:
    turn = cmath.rect(1.0, 2e-4 * k)
    flight.tracker.append(lambda p, _t: p * turn)


def _gust_front(flight: Flight, k: float, s: float, rng: Rng) -> None:
    blow, when = cmath.rect(k, rng.uniform(0.0, 2.0 * math.pi)), rng.uniform(0.3, 0.6) * s
    flight.drifts.append(lambda t, _p, _c, _b: blow if t > when else 0.0)


def _skid(flight: Flight, k: float, _s: float, _rng: Rng) -> None:
    flight.drifts.append(lambda _t, _p, c, b: -2.0 * k * c * 1j * math.copysign(1.0, b) if b else 0.0)


def _stale_tracker(flight: Flight, k: float, _s: float, _rng: Rng) -> None:
    past: list[complex] = []
    share = math.tanh(0.03 * k)

    def held(place: complex, _t: float) -> complex:
        past[:] = [*past[-1:], place]
        return (1.0 - share) * place + share * past[0]

    flight.tracker.append(held)


def _aging_radar(flight: Flight, k: float, s: float, _rng: Rng) -> None:
    flight.reaches.append(lambda t, _b: math.exp(-0.05 * k * t / s))


def _one_sided_bank(flight: Flight, k: float, _s: float, _rng: Rng) -> None:
    flight.left = 1.0 - 0.7 * math.tanh(0.05 * k)


REPORT: Mapping[str, FlightFault] = {
    "rotated_grid": Fault(
        "The tracker's grid is turned.",
        _rotated_grid,
        shows=("sensor north over east", "sensor east over north"),
    ),
    "gust_front": Fault("The wind turns at some time.", _gust_front, shows=WIND_OVER_TIME),
    "skid": Fault(
        "The aircraft skids outwards in turns.", _skid, shows=("force speed to the right over bank",)
    ),
    "stale_tracker": Fault(
        "The tracker shows part of the place before.",
        _stale_tracker,
        ("delay", "lag"),
        shows=("sensor north over rate of north|past of north", "sensor east over rate of east|past of east"),
    ),
    "aging_radar": Fault("The radar's range falls.", _aging_radar, shows=("odds detected over time",)),
    "one_sided_bank": Fault("It banks less to the left.", _one_sided_bank, shows=BENT_GAUGE),
}
"""To report on: no kind of the other set."""
