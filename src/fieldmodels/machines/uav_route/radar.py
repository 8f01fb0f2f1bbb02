"""What a radar's scan sees of an aircraft that flies with one attitude, and how likely it detects it."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from fieldmodels.compiled import inlined
from fieldmodels.machines.uav_route.aircraft import Attitude
from fieldmodels.machines.uav_route.detection import EXACT, probability
from fieldmodels.machines.uav_route.parameters import LOG
from fieldmodels.machines.uav_route.signature import NOSE, angles_of_table, aspect, body_axes, signature


class View(NamedTuple):
    """An aircraft as a radar sees it."""

    slant_range: float  # [km]
    azimuth: float  # of the radar in the aircraft's body axes [rad]
    elevation: float  # the same [rad]
    signature: float
    probability: float  # of detection by a scan; 0 beyond the radar's reach


@inlined
def view(to_north: float, to_east: float, attitude: Attitude, plant: Any, c: Any) -> View:
    """What a radar sees of an aircraft.

    Args:
        to_north: From the aircraft to where the radar is believed to be [km].
        to_east: The same [km].
        attitude: Heading and bank of the aircraft.
        plant: What aircraft and radar truly are.
        c: The world.
    """
    north, east = to_north + plant.radar_position.north, to_east + plant.radar_position.east
    slant, azimuth, elevation = aspect(
        north, east, c.altitude, attitude.cosine, attitude.sine, attitude.bank_cosine, attitude.bank_sine
    )
    seen = shown(azimuth, elevation, plant)
    return View(slant, azimuth, elevation, seen, within_reach(seen, slant, plant, c))


@inlined
def shown(azimuth: float, elevation: float, plant: Any) -> float:
    """Signature that an aircraft truly shows; angles as in ``View``."""
    narrowed = abs(azimuth) / plant.nose_cone_width.factor
    # between the cones Table 4.1 does not depend on the azimuth
    entered = narrowed if narrowed <= NOSE else max(abs(azimuth), NOSE)
    return float(plant.signature_scale.factor * signature(entered, elevation))


@inlined
def within_reach(seen: float, slant: float, plant: Any, c: Any) -> float:
    """Probability with which a signature is detected at a slant range [km]."""
    if slant > c.reach:
        return 0.0
    return probability(seen, slant / plant.radar_range_scale.factor, c.interpolation == LOG)


@inlined
def chance(to_north: float, to_east: float, attitude: Attitude, plant: Any, c: Any) -> float:
    """Probability with which a radar's scan detects an aircraft, as in ``view``; arguments as there."""
    north, east = to_north + plant.radar_position.north, to_east + plant.radar_position.east
    if north * north + east * east + c.altitude * c.altitude > c.reach * c.reach:
        return 0.0
    nose, right, belly = body_axes(
        north, east, c.altitude, attitude.cosine, attitude.sine, attitude.bank_cosine, attitude.bank_sine
    )
    if plant.nose_cone_width.factor == 1.0:
        azimuth, elevation = angles_of_table(nose, right, belly)
    else:
        azimuth = math.atan2(right, nose)
        elevation = math.atan2(-belly, math.sqrt(nose * nose + right * right))
    slant = math.sqrt(nose * nose + right * right + belly * belly)
    return within_reach(shown(azimuth, elevation, plant), slant, plant, c)


@inlined
def certain(likely: float, c: Any) -> bool:
    """Whether a probability of detection exceeds the threshold above which detection is certain."""
    return bool(likely > c.threshold + EXACT)
