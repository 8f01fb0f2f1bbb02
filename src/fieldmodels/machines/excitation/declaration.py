"""The numbers of vehicle, arm and sensors beside the 22 unknowns (``parameters``), each declared once.

Left out of the effects, since these data cannot distinguish it from others: slip of the wheels (beside the
soil's compliance, which lies in series with the same springs), a tilted rest (the force/torque sensor is
zeroed there).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.declared import as_rows, neutral, row_type
from fieldmodels.machines.excitation.parameters import UNKNOWNS, VEHICLE
from fieldmodels.model import Effect, Parameter

EFFECTS: tuple[Effect, ...] = (
    Effect(
        "payload",
        "The arm carries a mass at its tip.",
        "force",
        (Parameter("mass", "kg", 0.0, 0.0, 5.0, 0.02),),
        "point mass at twice the reach, there at rest too",
    ),
    Effect(
        "cubic_stiffness",
        "The suspension stiffens with its deflection.",
        "force",
        (
            Parameter("force", "1/m2", 0.0, -50.0, 1000.0, 2.0),
            Parameter("torque", "1/rad2", 0.0, -5.0, 100.0, 0.5),
        ),
        "-k x (1 + c x^2)",
    ),
    Effect(
        "coulomb_friction",
        "The suspension has dry friction.",
        "force",
        (
            Parameter("force", "N", 0.0, 0.0, 50.0, 0.1),
            Parameter("torque", "N m", 0.0, 0.0, 20.0, 0.05),
        ),
        "-force * v / sqrt(v^2 + (2 mm/s)^2), -torque * w / sqrt(w^2 + (10 mrad/s)^2)",
    ),
    Effect(
        "stiffness_drift",
        "The suspension's stiffness changes steadily, as when it warms up.",
        "change",
        (Parameter("rate", "1/s", 0.0, -0.05, 0.05, 0.001),),
        "k (1 + rate * t), of the spring's cubic part and of the soil too",
    ),
    Effect(
        "soil_compliance",
        "The soil under the wheels yields.",
        "environment",
        (Parameter("share", "1", 0.0, 0.0, 2.0, 0.02),),
        "a spring of k / share under each: share b / k dF/dt = resistance - (1 + share) F",
    ),
    Effect(
        "actuator_lag",
        "The arm follows its command with a lag.",
        "actuator",
        (Parameter("time_constant", "s", 0.0, 0.0, 0.2, 0.002),),
        "time_constant * df/dt = command - f, at first as far behind as its steady motion",
    ),
    Effect(
        "accelerometer_bias",
        "The accelerometer measures an acceleration when nothing moves.",
        "sensor",
        tuple(Parameter(axis, "m/s2", 0.0, -2.0, 2.0, 0.01) for axis in ("x", "y", "z")),
        "+(x, y, z) on the accelerometer",
    ),
    Effect(
        "accelerometer_gain",
        "The accelerometer's scale is wrong.",
        "sensor",
        (Parameter("gain", "1", 1.0, 0.3, 3.0, 0.01),),
        "gain * acceleration + bias",
    ),
    Effect(
        "inclinometer_bias",
        "The inclinometer measures a tilt when the vehicle stands level.",
        "sensor",
        (
            Parameter("pitch", "rad", 0.0, -0.3, 0.3, 0.001),
            Parameter("roll", "rad", 0.0, -0.3, 0.3, 0.001),
        ),
        "+(pitch, roll) on the inclinometer",
    ),
    Effect(
        "inclinometer_delay",
        "The inclinometer's readings come late.",
        "sensor",
        (Parameter("delay", "s", 0.0, 0.0, 0.2, 0.002),),
        "tilt(t - delay)",
    ),
    Effect(
        "force_torque_gain",
        "The scale of the force/torque sensor is wrong.",
        "sensor",
        (Parameter("gain", "1", 1.0, 0.3, 3.0, 0.01),),
        "gain * (force, torque)",
    ),
)
"""What may be missing from the nominal vehicle, arm and sensors."""

ROW = row_type(VEHICLE, EFFECTS, grouped=True)
"""Type of a vehicle's numbers as kernels read them: ``q.mass``, ``q.stiffness[axis]``, ``q.payload.mass``."""
NUMBERS = neutral(VEHICLE, EFFECTS)
"""Table I's vehicle with all effects off, as a vector of ``ExcitationModel``."""
NUMBERS.setflags(write=False)


def with_effects(vectors: ArrayLike) -> FloatArray:
    """Vectors of ``ExcitationModel``, shape (..., numbers), from such or from the 22 unknowns alone."""
    array = np.asarray(vectors, dtype=np.float64)
    if array.shape[-1:] == (UNKNOWNS,):
        rest = NUMBERS[UNKNOWNS:]
        array = np.concatenate([array, np.broadcast_to(rest, (*array.shape[:-1], len(rest)))], axis=-1)
    return array


def as_vehicles(vectors: ArrayLike) -> NDArray[Any]:
    """Vectors of ``ExcitationModel``, or the 22 unknowns with all effects off, as records of ``ROW``."""
    return as_rows(with_effects(vectors), ROW)
