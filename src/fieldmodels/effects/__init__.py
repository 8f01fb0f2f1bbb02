"""Stock effects: what may be missing from any machine's simulation, each written once."""

from fieldmodels.effects.actuators import actuator
from fieldmodels.effects.changes import change
from fieldmodels.effects.curves import curve
from fieldmodels.effects.forces import force, friction
from fieldmodels.effects.sensors import sensor
from fieldmodels.effects.stock import Names, Sizes, Stock

__all__ = ["Names", "Sizes", "Stock", "actuator", "change", "curve", "force", "friction", "sensor"]
