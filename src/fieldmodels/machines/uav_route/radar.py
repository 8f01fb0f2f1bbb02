"""What a radar's scan sees of an aircraft that flies with one attitude, and how likely it detects it."""

from __future__ import annotations

from typing import Any, NamedTuple

from fieldmodels.compiled import inlined
from fieldmodels.machines.uav_route.aircraft import Attitude
from fieldmodels.machines.uav_route.detection import EXACT, probability
from fieldmodels.machines.uav_route.parameters import LOG
from fieldmodels.machines.uav_route.signature import NOSE, aspect, signature


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
    narrowed = abs(azimuth) / plant.nose_cone_width.factor
    # between the cones Table 4.1 does not depend on the azimuth
    entered = narrowed if narrowed <= NOSE else max(abs(azimuth), NOSE)
    seen = plant.signature_scale.factor * signature(entered, elevation)
    likely = (
        probability(seen, slant / plant.radar_range_scale.factor, c.interpolation == LOG)
        if slant <= c.reach
        else 0.0
    )
    return View(slant, azimuth, elevation, seen, likely)


@inlined
def chance(to_north: float, to_east: float, attitude: Attitude, plant: Any, c: Any) -> float:
    """Probability with which a radar's scan detects an aircraft; arguments as of ``view``."""
    north, east = to_north + plant.radar_position.north, to_east + plant.radar_position.east
    if north * north + east * east + c.altitude * c.altitude > c.reach * c.reach:
        return 0.0
    return view(to_north, to_east, attitude, plant, c).probability


@inlined
def certain(likely: float, c: Any) -> bool:
    """Whether a probability of detection exceeds the threshold above which detection is certain."""
    return bool(likely > c.threshold + EXACT)
