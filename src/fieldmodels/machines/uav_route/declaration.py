"""The numbers of an aircraft and the radars that watch it: each is declared here and nowhere else."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fieldmodels.declared import as_rows, neutral, row_type
from fieldmodels.machines.uav_route.parameters import Aircraft
from fieldmodels.model import Effect, Parameter

KM = 1000.0
"""Metres: parameter vectors are in SI units, kernels in [km] and [km/s], since Table 4.2 is."""


def base_parameters(aircraft: Aircraft) -> tuple[Parameter, ...]:
    """The numbers that a nominal flight depends on, for an aircraft."""
    return (
        Parameter("speed", "m/s", KM * aircraft.speed, 50.0, 1000.0, 2.0),
        Parameter("radar_north", "m", 0.0, -1e7, 1e7, 2000.0, refitted=False),
        Parameter("radar_east", "m", 0.0, -1e7, 1e7, 2000.0, refitted=False),
    )


WIDTHS = tuple(width / 100 for width in range(60, 161, 2) if width != 100)
"""Tried widths of the nose cone: half a degree apart, as fine as its edge."""

EFFECTS = (
    Effect(
        "wind",
        "A steady wind blows: the aircraft crabs along its leg, faster or slower over ground.",
        "environment",
        (
            Parameter("north", "m/s", 0.0, -80.0, 80.0, 2.0),
            Parameter("east", "m/s", 0.0, -80.0, 80.0, 2.0),
        ),
        "ground speed = wind along + sqrt(speed^2 - wind across^2)",
    ),
    Effect(
        "turn_speed_loss",
        "The aircraft loses speed while it is banked in a turn.",
        "force",
        (Parameter("share", "1", 0.0, 0.0, 0.5, 0.02, starts=(0.1,)),),
        "speed * (1 - share) during T_turn, and in T_turn",
    ),
    Effect(
        "weaker_bank",
        "The aircraft banks less in turns than it should, so that it takes longer to turn.",
        "actuator",
        (Parameter("factor", "1", 1.0, 0.2, 1.5, 0.02, starts=(0.8,)),),
        "bank = factor * 45 deg, in T_turn too",
    ),
    Effect(
        "sensor_bias",
        "The measured position is shifted by a constant.",
        "sensor",
        (
            Parameter("north", "m", 0.0, -5000.0, 5000.0, 50.0),
            Parameter("east", "m", 0.0, -5000.0, 5000.0, 50.0),
        ),
        "measured = position + bias",
    ),
    Effect(
        "signature_scale",
        "The aircraft shows more or less of itself than the table of signatures says.",
        "environment",
        (Parameter("factor", "1", 1.0, 0.05, 20.0, 0.05),),
        "signature = factor * Table 4.1, before it enters Table 4.2",
    ),
    Effect(
        "nose_cone_width",
        "The cone about the nose in which the aircraft is hard to see is wider or narrower than believed.",
        "environment",
        (Parameter("factor", "1", 1.0, 0.5, 2.0, 0.02, starts=WIDTHS),),
        "azimuth / factor enters Table 4.1 up to 31 deg",
    ),
    Effect(
        "radar_range_scale",
        "The radar sees farther or less far than the table of ranges says.",
        "environment",
        (Parameter("factor", "1", 1.0, 0.3, 3.0, 0.02),),
        "range = factor * Table 4.2",
    ),
    Effect(
        "radar_position",
        "The radar does not stand where it is believed to.",
        "environment",
        (
            Parameter("north", "m", 0.0, -100e3, 100e3, 2000.0),
            Parameter("east", "m", 0.0, -100e3, 100e3, 2000.0),
        ),
        "site = believed site + error",
    ),
    Effect(
        "scan_interval",
        "The radar scans more or less often than believed.",
        "environment",
        (Parameter("factor", "1", 1.0, 0.4, 4.0, 0.01),),
        "time between scans = factor * scan interval",
    ),
)
"""What may be missing from the nominal flight."""

BASE = base_parameters(Aircraft())
PLANT = row_type(BASE, EFFECTS)
"""Type of a plant: what aircraft and radars truly are, as kernels read it, in [km] and [km/s]."""
_UNITS = np.array(
    [KM if p.unit in ("m", "m/s") else 1.0 for p in (*BASE, *(p for e in EFFECTS for p in e.parameters))]
)


def as_plants(vectors: ArrayLike) -> NDArray[Any]:
    """Parameter vectors of ``UavRoute``, shape (..., numbers), as plants, shape (...)."""
    return as_rows(np.asarray(vectors, dtype=np.float64) / _UNITS, PLANT)


def nominal_plant(speed: float) -> NDArray[Any]:
    """The plant of an aircraft as it is believed to be, shape (); speed in [km/s]."""
    plant = as_plants(neutral(BASE, EFFECTS))
    plant["speed"] = speed
    return plant
