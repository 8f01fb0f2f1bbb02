"""What an aircraft and the radars that watch it truly are: one row of numbers, as all kernels take it."""

from __future__ import annotations

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import inlined
from fieldmodels.machines.uav_route.detection import probability
from fieldmodels.machines.uav_route.parameters import Constants
from fieldmodels.machines.uav_route.signature import NOSE, aspect, signature

PARAMETERS = 13
(
    SPEED,  # [km/s]
    WIND_NORTH,  # whereto it blows [km/s]
    WIND_EAST,
    TURN_LOSS,  # share of the airspeed that is lost in turns
    BANK,  # factor of the bank
    BIAS_NORTH,  # of the measured position [km]
    BIAS_EAST,
    SIGNATURE,  # factor of Table 4.1
    CONE,  # factor of the nose cone's width
    RANGE,  # factor of Table 4.2's ranges
    SITE_NORTH,  # how far the radars are from where they are believed to be [km]
    SITE_EAST,
    INTERVAL,  # factor of the time between looks
) = range(PARAMETERS)


def nominal_plant(speed: float) -> FloatArray:
    """The row of an aircraft as it is believed to be, shape (13,); speed in [km/s]."""
    row = np.zeros(PARAMETERS)
    row[SPEED] = speed
    row[[BANK, SIGNATURE, CONE, RANGE, INTERVAL]] = 1.0
    return row


@inlined
def chance(
    to_north: float,
    to_east: float,
    cosine: float,
    sine: float,
    bank_cosine: float,
    bank_sine: float,
    plant: FloatArray,
    c: Constants,
) -> float:
    """Probability with which a radar's look detects an aircraft of a plant; 0 beyond the radar's reach.

    Args:
        to_north: From the aircraft to where the radar is believed to be [km].
        to_east: The same [km].
        cosine: Cosine of the heading.
        sine: Sine of the heading.
        bank_cosine: Cosine of the bank.
        bank_sine: Sine of the bank, of the opposite sign in the printed axes.
        plant: What the aircraft and the radars truly are.
        c: The world.
    """
    north, east = to_north + plant[SITE_NORTH], to_east + plant[SITE_EAST]
    if north * north + east * east + c.altitude * c.altitude > c.reach * c.reach:
        return 0.0
    slant, azimuth, elevation = aspect(north, east, c.altitude, cosine, sine, bank_cosine, bank_sine)
    azimuth = abs(azimuth)
    narrowed = azimuth / plant[CONE]
    # between the cones Table 4.1 does not depend on the azimuth
    azimuth = narrowed if narrowed <= NOSE else max(azimuth, NOSE)
    return probability(plant[SIGNATURE] * signature(azimuth, elevation), slant / plant[RANGE], c.log)
