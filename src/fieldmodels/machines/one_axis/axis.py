"""What differs in name between a linear and a rotary axis."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Axis:
    """Names and units of an axis.

    Attributes:
        rotary: True for an angle under gravity, False for a position on a spring.
        damped: True if viscous friction is part of the nominal axis, not an effect.
        force_name: Name of the generalised force.
        force_unit: Its unit.
        position_name: Name of the generalised position.
        position_unit: Its unit.
    """

    rotary: bool
    damped: bool
    force_name: str
    force_unit: str
    position_name: str
    position_unit: str


LINEAR = Axis(False, True, "force", "N", "position", "m")
ROTARY = Axis(True, False, "torque", "N m", "angle", "rad")
