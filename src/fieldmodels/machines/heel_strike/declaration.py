"""The numbers of the leg and of the gyro that watches it: each is declared here and nowhere else.

Left out of the effects, since data cannot distinguish them from these: a slope (a constant force at the small
angles of a walk), an off-centre mass (the same), a gravity error (the length).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fieldmodels.declared import any_on, as_rows, row_type
from fieldmodels.machines.heel_strike.parameters import Leg
from fieldmodels.model import Effect, Parameter, Where

ACCELERATION = "rad/s2"


def base_parameters(leg: Leg) -> tuple[Parameter, ...]:
    """The numbers that the nominal leg depends on."""
    return (Parameter("length", "m", leg.length, 0.2, 5.0, 0.02, source="section 2.4.1"),)


def leg_effects(duration: float = 300.0, frequencies: tuple[float, ...] = (1.0,)) -> tuple[Effect, ...]:
    """All effects that a diagnosis looks for.

    Args:
        duration: Length of the longest recording [s]; times and frequencies are resolved by it.
        frequencies: Where a periodic force may be sought [Hz].
    """
    return (*_force_effects(duration, frequencies), *_gyro_effects(duration))


def _force_effects(duration: float, frequencies: tuple[float, ...]) -> tuple[Effect, ...]:
    return (
        Effect(
            "viscous_friction",
            "The hinge is damped in proportion to its speed.",
            "force",
            (Parameter("rate", "1/s", 0.0, -0.5, 2.0, 0.05),),
            "-rate * omega",
        ),
        Effect(
            "coulomb_friction",
            "The hinge has dry friction.",
            "force",
            (Parameter("acceleration", ACCELERATION, 0.0, 0.0, 2.0, 0.05),),
            "-acceleration * omega / sqrt(omega^2 + (0.01 rad/s)^2)",
        ),
        Effect(
            "quadratic_drag",
            "The air resists with the square of the speed.",
            "force",
            (Parameter("coefficient", "1/rad", 0.0, 0.0, 2.0, 0.05),),
            "-coefficient * omega * |omega|",
        ),
        Effect(
            "constant_force",
            "A steady torque acts on the leg: a slope, an off-centre mass, or a steady wind.",
            "force",
            (Parameter("acceleration", ACCELERATION, 0.0, -2.0, 2.0, 0.05),),
            "+acceleration",
        ),
        Effect(
            "periodic_force",
            "A periodic torque acts on the leg, for example from an unbalanced motor.",
            "force",
            (
                Parameter("sine", ACCELERATION, 0.0, -5.0, 5.0, 0.1),
                Parameter("cosine", ACCELERATION, 0.0, -5.0, 5.0, 0.1),
                Parameter("frequency", "Hz", 1.0, 0.05, 20.0, 0.05 / duration, starts=frequencies),
            ),
            "sine * sin(2 pi * frequency * t) + cosine * cos(2 pi * frequency * t)",
        ),
    )


def _gyro_effects(duration: float) -> tuple[Effect, ...]:
    return (
        Effect(
            "gyro_bias",
            "The gyro measures a rate when nothing turns.",
            "sensor",
            (Parameter("rate", "rad/s", 0.0, -0.5, 0.5, 0.002),),
            "+rate on the gyro",
        ),
        Effect(
            "gyro_drift",
            "The gyro's bias grows steadily from zero at t = 0.",
            "sensor",
            (Parameter("rate", ACCELERATION, 0.0, -0.01, 0.01, 0.004 / duration),),
            "+rate * t on the gyro",
        ),
        Effect(
            "gyro_gain",
            "The gyro's scale is wrong.",
            "sensor",
            (Parameter("gain", "1", 1.0, 0.5, 2.0, 0.01),),
            "gain * omega + bias on the gyro, before noise and rounding",
        ),
        Effect(
            "gyro_delay",
            "The gyro's readings come late.",
            "sensor",
            (Parameter("delay", "s", 0.0, 0.0, 0.02, 0.002),),
            "omega(t - delay) on the gyro, linear between its samples",
        ),
        Effect(
            "gyro_quantisation",
            "The gyro measures multiples of a coarse step.",
            "sensor",
            (Parameter("step", "rad/s", 0.0, 0.0, 0.5, 0.01, smooth=False),),
            "step * round(gyro / step), after noise and the other faults",
        ),
        Effect(
            "parameter_step",
            "The gyro's bias jumps during the record.",
            "change",
            (
                Parameter("rate", "rad/s", 0.0, -0.5, 0.5, 0.004),
                Parameter("time", "s", 0.0, 0.0, 1e6, max(duration / 20, 1e-3), smooth=False),
            ),
            "+rate on the gyro from time on",
        ),
    )


BASE = base_parameters(Leg())
EFFECTS = leg_effects()
PLANT = row_type(BASE, EFFECTS)
"""Type of a plant: what leg and gyro truly are, as kernels read it."""


def as_plants(vectors: ArrayLike, where: Where | None = None) -> tuple[NDArray[Any], NDArray[np.bool_]]:
    """Parameter vectors of ``HeelStrikeModel`` as plants.

    Args:
        vectors: Shape (..., numbers).
        where: Which effects are asked for below; None for all.

    Returns:
        Plants of dtype ``PLANT``, and whether any such effect is on in each; both of shape (...).

    Raises:
        ModelError: If a vector has another length.
    """
    array = np.asarray(vectors, dtype=np.float64)
    return as_rows(array, PLANT), any_on(array, BASE, EFFECTS, where)
