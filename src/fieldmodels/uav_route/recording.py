"""Measured flights: what an aircraft's log and a tracker would hold."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from fieldmodels.model import ModelError
from fieldmodels.reality import read_reality
from fieldmodels.recording import Recording
from fieldmodels.uav_route.model import UavRoute
from fieldmodels.units import STANDARD_GRAVITY

BOX = 150e3
"""Half of the width of the area over which a recorded flight wanders [m]."""
SHORTEST, LONGEST = 8e3, 30e3
"""Lengths of its legs [m]."""
SUBSTEPS = 200
"""Pieces of a sample in which the flight is integrated."""


def record_flight(
    reality: Any = None,
    duration: float = 6000.0,
    *,
    step: float = 2.0,
    bank: bool = True,
    noise: float = 1.0,
    added: Callable[[complex], float] | None = None,
    rng: np.random.Generator,
) -> Recording:
    """Let an aircraft fly from one random waypoint to the next, and log it.

    The flight is integrated here in small pieces with complex positions (north + i east), apart from the
    kernels that predict it. The autopilot turns to the next waypoint at the last sample before it would
    pass the present one.

    Args:
        reality: What the aircraft truly is: effects of the model, see ``read_reality``.
        duration: Length of the record [s].
        step: Time between samples [s].
        bank: Whether the bank is logged.
        noise: Multiple of the sensors' nominal noise.
        added: A fault of one's own: speed along the course [m/s] that is added at a place [m].
        rng: Source of the waypoints and of the noise.

    Raises:
        ModelError: If duration or step is not positive.
    """
    if not (step > 0 and duration >= 10 * step):
        raise ModelError(f"a record needs at least 10 samples, not {duration:g} s in steps of {step:g} s")
    model = UavRoute()
    speed, wind_north, wind_east, loss, factor, bias_north, bias_east = (
        float(value) for value in read_reality(reality, model).vector(model)
    )
    wind, angle = complex(wind_north, wind_east), factor * model.world.aircraft.bank
    place, target = 0j, 0j
    course, turn_left = 1 + 0j, 0.0
    count, piece = round(duration / step), step / SUBSTEPS
    columns = np.zeros((count, 5))
    mean_bank = 0.0
    for i in range(count):
        if i == 0 or abs(target - place) <= 1.5 * speed * step:
            target = _next_target(place, rng)
            new = (target - place) / abs(target - place)
            angle_turned = cmath.phase(new / course) if i > 0 else 0.0
            course = new
            slow = speed * (1.0 - loss)
            turn_left = abs(angle_turned) * slow / (STANDARD_GRAVITY * math.tan(angle))
            side = math.copysign(angle, angle_turned)
        columns[i] = target.real, target.imag, place.real, place.imag, mean_bank
        banked, extra = 0.0, added(place) if added else 0.0
        for _ in range(SUBSTEPS):
            turning = min(max(turn_left, 0.0), piece)
            place += turning * _over_ground(course, slow, wind)
            place += (piece - turning) * _over_ground(course, speed, wind)
            place += piece * extra * course
            turn_left -= turning
            banked += turning
        mean_bank = side * banked / step
    deviations = noise * np.array([output.noise for output in model.outputs])
    measured = columns[:, 2:] + deviations * rng.standard_normal((count, 3))
    signals = {
        "to_north": columns[:, 0],
        "to_east": columns[:, 1],
        "north": measured[:, 0] + bias_north,
        "east": measured[:, 1] + bias_east,
    }
    if bank:
        signals["bank"] = measured[:, 2]
    units = {signal.name: signal.unit for signal in (*model.inputs, *model.outputs)}
    return Recording(
        time=step * np.arange(count, dtype=np.float64),
        signals=signals,
        units={name: units[name] for name in signals},
        source="simulation of uav_route",
    )


def _over_ground(course: complex, speed: float, wind: complex) -> complex:
    """Velocity over ground that holds a course: the nose is turned until the wind only helps or hinders."""
    aside = (wind / course).imag
    return course * ((wind / course).real + math.sqrt(speed * speed - aside * aside))


def _next_target(place: complex, rng: np.random.Generator) -> complex:
    """A waypoint within the box."""
    while True:
        target = place + cmath.rect(rng.uniform(SHORTEST, LONGEST), rng.uniform(-math.pi, math.pi))
        if max(abs(target.real), abs(target.imag)) <= BOX:
            return target
