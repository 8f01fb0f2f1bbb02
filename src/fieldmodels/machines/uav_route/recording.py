"""Measured flights: what an aircraft's log, a tracker and a radar would hold."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.drivers.named import apply_reality, stepped
from fieldmodels.drivers.stepped import Channels, Stepped
from fieldmodels.machines.uav_route import detection, signature
from fieldmodels.machines.uav_route.model import DETECTED, GAP, UavRoute
from fieldmodels.model import ModelError
from fieldmodels.recording import Recording
from fieldmodels.recording.units import STANDARD_GRAVITY

NEAREST, FARTHEST = 250e3, 450e3
"""Distances from the radar between which a recorded flight wanders [m]: side-on, it is seen for certain at
the one and hardly at the other."""
SHORTEST, LONGEST = 6e3, 20e3
"""Lengths of its legs [m]."""
SHARPEST = math.radians(170)
"""Sharpest turn that is commanded: beyond, the noise of a position decides to which side it goes [rad]."""
SUBSTEPS = 40
"""Pieces of a sample in which the flight is integrated."""
JITTER = 0.1
"""Standard deviation of the time between scans [s]."""

RECORDED = Channels(
    commands=("to_north", "to_east"),
    observed=("north", "east", "bank"),
    without="an aircraft is sent to a waypoint; its radar's scans are events",
)
"""Where stock effects can act on a recording, sample by sample."""

Detected = Callable[[complex, float], float]


def record_flight(
    reality: Any = None,
    duration: float = 6000.0,
    *,
    episodes: int = 1,
    step: float = 2.0,
    bank: bool = True,
    scans: bool = True,
    noise: float = 1.0,
    added: Callable[[complex], float] | None = None,
    faded: Detected | None = None,
    rng: np.random.Generator,
) -> Recording:
    """Let an aircraft fly from one random waypoint to the next under the scans of a radar, and log both.

    The flight is integrated here in small pieces with complex positions (north + i east), and detections are
    drawn from the tables as NumPy interpolates them, apart from the kernels that predict both. The autopilot
    turns to the next waypoint at the last sample before it would pass the present one.

    Args:
        reality: What aircraft and radar truly are: effects of the model, see ``read_reality``.
        duration: Length of an episode [s].
        episodes: Number of episodes; each begins in another direction from the radar.
        step: Time between samples [s].
        bank: Whether the bank is logged.
        scans: Whether the radar's scans are logged.
        noise: Multiple of the sensors' nominal noise.
        added: A fault of one's own: speed along the course [m/s] that is added at a place [m].
        faded: Another: factor of the radar's ranges for an aircraft at a place [m] at a time [s].
        rng: Source of the waypoints, of the noise and of the detections.

    Raises:
        ModelError: If an episode is too short, or a radar would scan twice in a step.
    """
    if not (step > 0 and episodes >= 1 and duration >= 10 * step):
        raise ModelError(f"an episode needs at least 10 samples, not {duration:g} s in steps of {step:g} s")
    model = UavRoute()
    around, truth = apply_reality(model, reality, RECORDED)
    stock = stepped(around, truth, RECORDED, 1, step)
    values = dict(zip(around.names, truth.vector(around).tolist(), strict=True))
    interval = model.world.detection.scan_interval * values["scan_interval.factor"]
    if scans and step > 0.9 * interval:
        raise ModelError(
            f"a scan every {interval:g} s would come twice in a step of {step:g} s; sample faster"
        )
    count = round(duration / step)
    luck = rng.spawn(1)[0]
    episodes_flown = [
        _fly(model, values, count, step, 2 * math.pi * e / episodes, added, faded, rng, luck, stock)
        for e in range(episodes)
    ]
    columns = np.concatenate(episodes_flown)
    deviations = noise * np.array([output.noise for output in model.outputs[:3]])
    measured = columns[:, 2:5] + deviations * rng.standard_normal((len(columns), 3))
    signals = {
        "to_north": columns[:, 0],
        "to_east": columns[:, 1],
        "north": measured[:, 0],
        "east": measured[:, 1],
    }
    if bank:
        signals["bank"] = measured[:, 2]
    if scans:
        signals |= {DETECTED: columns[:, 5], GAP: columns[:, 6]}
    units = {signal.name: signal.unit for signal in (*model.inputs, *model.outputs)}
    return Recording(
        time=step * np.tile(np.arange(count, dtype=np.float64), episodes),
        signals=signals,
        units={name: units[name] for name in signals},
        episode=np.repeat(np.arange(episodes), count),
        source="simulation of uav_route",
        known={name: values[name] for name in ("radar_north", "radar_east")},
    )


def _fly(
    model: UavRoute,
    values: dict[str, float],
    count: int,
    step: float,
    bearing: float,
    added: Callable[[complex], float] | None,
    faded: Detected | None,
    rng: np.random.Generator,
    luck: np.random.Generator,
    stock: Stepped | None,
) -> FloatArray:
    """One episode: waypoint, position and mean bank as shown, detected, scan gap, shape (samples, 7)."""
    aircraft, radar = model.world.aircraft, model.world.detection
    wind = complex(values["wind.north"], values["wind.east"])
    angle = values["weaker_bank.factor"] * aircraft.bank
    believed = complex(values["radar_north"], values["radar_east"])
    moved = complex(values["radar_position.north"], values["radar_position.east"])
    interval = radar.scan_interval * values["scan_interval.factor"]
    place = target = believed + cmath.rect(0.5 * (NEAREST + FARTHEST), bearing)
    aim, course, turn_left, side = target, 1 + 0j, 0.0, 0.0
    columns = np.zeros((count, 7))
    mean_bank, detected, gap = 0.0, 0.0, 0.0
    piece = step / SUBSTEPS
    scanned, due = -interval, 0.0
    shift = complex(values["sensor_bias.north"], values["sensor_bias.east"])
    if stock is not None:
        stock.begin([0])
    for i in range(count):
        if stock is not None and stock.moves:
            values = values | dict(zip(model.names, stock.change([0], step)[0].tolist(), strict=True))
        speed, slow = values["speed"], values["speed"] * (1.0 - values["turn_speed_loss.share"])
        site = complex(values["radar_north"], values["radar_east"]) + moved
        if i == 0 or abs(aim - place) <= 1.5 * speed * step:
            target = _next_target(place, believed, course if i > 0 else None, rng)
        given = target
        if stock is not None:
            given = complex(*stock.given(np.array([[target.real, target.imag]]))[0])
        if i == 0 or given != aim:
            aim = given
            new = (aim - place) / abs(aim - place)
            angle_turned = cmath.phase(new / course) if i > 0 else 0.0
            course = new
            turn_left = abs(angle_turned) * slow / (STANDARD_GRAVITY * math.tan(angle))
            side = math.copysign(angle, angle_turned)
        sensed = place + shift
        columns[i] = target.real, target.imag, sensed.real, sensed.imag, mean_bank, detected, gap
        if stock is not None:
            columns[i, 2:5] = stock.shown(columns[i : i + 1, 2:5])[0]
            stock.tick()
        banked, detected, gap = 0.0, 0.0, 0.0
        extra = added(place) if added else 0.0
        for j in range(SUBSTEPS):
            turning = min(max(turn_left, 0.0), piece)
            now = step * i + piece * j
            if now >= due:
                air = _over_ground(course, slow if turning > 0 else speed, wind) - wind
                share = _probability(
                    (site - place) / (air / abs(air)), side if turning > 0 else 0.0, model, values,
                    faded(place, now) if faded else 1.0,
                )  # fmt: skip
                detected = float(luck.random() < share)
                gap, scanned = due - scanned, due
                due += max(interval + JITTER * luck.standard_normal(), step)
            place += turning * _over_ground(course, slow, wind)
            place += (piece - turning) * _over_ground(course, speed, wind)
            place += piece * extra * course
            turn_left -= turning
            banked += turning
        mean_bank = side * banked / step
    return columns


def _over_ground(course: complex, speed: float, wind: complex) -> complex:
    """Velocity over ground that holds a course: the nose is turned until the wind only helps or hinders."""
    aside = (wind / course).imag
    return course * ((wind / course).real + math.sqrt(speed * speed - aside * aside))


def _probability(
    ahead: complex, bank: float, model: UavRoute, values: dict[str, float], factor: float
) -> float:
    """Tables 4.1 and 4.2 for a radar ahead + i to the right [m] of an aircraft that is not banked."""
    down = 1000.0 * model.world.aircraft.altitude
    wing = complex(ahead.imag, down) * cmath.rect(1.0, -bank)  # right + i down, turned into body axes
    azimuth = abs(math.atan2(wing.real, ahead.real))
    elevation = abs(math.atan2(-wing.imag, math.hypot(ahead.real, wing.real)))
    width = values["nose_cone_width.factor"]
    edges = signature.AZIMUTHS * [1.0, width, width, 1.0, 1.0, 1.0]
    rows = [np.interp(azimuth, edges, row) for row in signature.SIGNATURES]
    shown = values["signature_scale.factor"] * np.interp(elevation, signature.ELEVATIONS, rows)
    slant = math.hypot(abs(ahead), down) / 1000.0
    if slant > model.world.detection.reach:
        return 0.0
    ranges = [np.interp(shown, detection.SIGNATURES, column) for column in detection.RANGES.T]
    scale = factor * values["radar_range_scale.factor"]
    return float(np.interp(slant, scale * np.array(ranges), detection.PROBABILITIES))


def _next_target(place: complex, radar: complex, course: complex | None, rng: np.random.Generator) -> complex:
    """A waypoint within the ring about the radar that takes no reversal."""
    while True:
        target = place + cmath.rect(rng.uniform(SHORTEST, LONGEST), rng.uniform(-math.pi, math.pi))
        sharp = course is not None and abs(cmath.phase((target - place) / course)) > SHARPEST
        if NEAREST <= abs(target - radar) <= FARTHEST and not sharp:
            return target
