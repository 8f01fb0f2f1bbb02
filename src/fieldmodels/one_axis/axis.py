"""What differs in name between a linear and a rotary axis."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Axis:
    """Names and units of an axis.

    Attributes:
        rotary: True for an angle under gravity, False for a position on a spring.
        force_name: Name of the generalised force.
        force_unit: Its unit.
        position_name: Name of the generalised position.
        position_unit: Its unit.
    """

    rotary: bool
    force_name: str
    force_unit: str
    position_name: str
    position_unit: str


LINEAR = Axis(False, "force", "N", "position", "m")
ROTARY = Axis(True, "torque", "N m", "angle", "rad")
