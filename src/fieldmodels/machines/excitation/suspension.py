"""The suspension of six axes: spring, damper, dry friction, and the soil in series with them.

Axes 0 to 2 are displacements along x, y, z, axes 3 to 5 rotations about them. Effects are read from a
vehicle's record ``q``; those that are off change no bit.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import inlined
from fieldmodels.machines.excitation.vectors import Vector

CREEP_FORCE, CREEP_TORQUE = 0.002, 0.01
"""Speeds below which dry friction fades smoothly [m/s], [rad/s] (assumed)."""


class Resistance(NamedTuple):
    """The suspension's resistance: known parts, and factors of the accelerations."""

    force: Vector
    torque: Vector
    force_factor: Vector
    torque_factor: Vector


class Soil(NamedTuple):
    """Lag of each axis' force on soft ground, exact for a load that grows linearly in a step; shapes (6,)."""

    passed: FloatArray  # what the soil passes on
    load: FloatArray  # resistance at the step's beginning
    kept: FloatArray  # weight of what was passed on
    early: FloatArray  # weight of the load at the beginning
    late: FloatArray  # weight of the load at the end


@inlined
def dry_friction(size: float, speed: float, creep: float) -> float:
    """Dry friction at a speed."""
    return size * speed / math.sqrt(speed * speed + creep * creep)


@inlined
def resistance(q: Any, axis: int, x: float, v: float, scale: float) -> float:
    """What the suspension of one axis (0 to 5) resists with: damper, spring, dry friction."""
    hardening = q.cubic_stiffness.force if axis < 3 else q.cubic_stiffness.torque
    size = q.coulomb_friction.force if axis < 3 else q.coulomb_friction.torque
    creep = CREEP_FORCE if axis < 3 else CREEP_TORQUE
    spring = scale * q.stiffness[axis] * x * (1.0 + hardening * x * x)
    total: float = q.damping[axis] * v + spring + dry_friction(size, v, creep)
    return total


@inlined
def implicit_resistance(
    q: Any,
    axis: int,
    x0: float,
    v0: float,
    x: float,
    v: float,
    scale: float,
    c1: float,
    c2: float,
) -> tuple[float, float]:
    """Resistance at x0 + c2 a and v0 + c1 a as a known part and a factor of the acceleration a.

    Linearised about (x, v); with c1 = c2 = 0 the resistance itself.
    """
    stiffness = scale * q.stiffness[axis]
    damping = q.damping[axis]
    known = damping * v0 + stiffness * x0
    hardening = q.cubic_stiffness.force if axis < 3 else q.cubic_stiffness.torque
    if hardening != 0.0:
        known += stiffness * hardening * x * x * x
    size = q.coulomb_friction.force if axis < 3 else q.coulomb_friction.torque
    if size != 0.0:
        creep = CREEP_FORCE if axis < 3 else CREEP_TORQUE
        root = math.sqrt(v * v + creep * creep)
        slope = size * creep * creep / (root * root * root)
        known += size * v / root + slope * (v0 - v)
        damping += slope
    return known, damping * c1 + stiffness * c2


@inlined
def resting_soil(passed: FloatArray) -> Soil:
    """Soil that passes on these forces, shape (6,), until it is loaded."""
    return Soil(passed.copy(), np.zeros(6), np.ones(6), np.zeros(6), np.zeros(6))


@inlined
def load_soil(
    q: Any, r: Vector, v: Vector, o: Vector, w: Vector, scale: float, next_scale: float, h: float, soil: Soil
) -> None:
    """Load on the soil at a step's beginning, and the weights of its lag over the step.

    Args:
        q: The vehicle.
        r: Displacement.
        v: Velocity.
        o: Rotation vector.
        w: Angular velocity.
        scale: Stiffness over the nominal one at the step's beginning.
        next_scale: The same at its end.
        h: The step [s].
        soil: The soil; receives load and weights.
    """
    share = q.soil_compliance.share
    for i in range(6):
        x, rate = (r[i], v[i]) if i < 3 else (o[i - 3], w[i - 3])
        soil.load[i] = resistance(q, i, x, rate, scale)
        stiffness = max(next_scale * q.stiffness[i], 1e-9)
        lag = share / (1.0 + share) * q.damping[i] / stiffness
        ratio = lag / h
        kept = math.exp(-1.0 / ratio) if ratio > 1e-9 else 0.0
        soil.kept[i] = kept
        soil.late[i] = (1.0 - (1.0 - kept) * ratio) / (1.0 + share)
        soil.early[i] = ((1.0 - kept) * ratio - kept) / (1.0 + share)


@inlined
def pass_on(q: Any, r: Vector, v: Vector, o: Vector, w: Vector, scale: float, soil: Soil) -> None:
    """The force that the soil passes on at a step's end, now that the load is known; see ``load_soil``."""
    for i in range(6):
        x, rate = (r[i], v[i]) if i < 3 else (o[i - 3], w[i - 3])
        load = resistance(q, i, x, rate, scale)
        soil.passed[i] = soil.kept[i] * soil.passed[i] + soil.early[i] * soil.load[i] + soil.late[i] * load


@inlined
def through_soil(axis: int, known: float, factor: float, soft: bool, soil: Soil) -> tuple[float, float]:
    """What the ground passes on of a resistance: all of it, or on soft ground what its lag lets through."""
    if not soft:
        return known, factor
    passed = soil.kept[axis] * soil.passed[axis] + soil.early[axis] * soil.load[axis]
    return passed + soil.late[axis] * known, soil.late[axis] * factor


@inlined
def suspension(
    q: Any,
    first: int,
    x0: Vector,
    v0: Vector,
    x: Vector,
    v: Vector,
    scale: float,
    c1: float,
    c2: float,
    soft: bool,
    soil: Soil,
) -> tuple[Vector, Vector]:
    """Resistance of three axes from ``first`` on: known parts, and factors of the accelerations.

    Other arguments as of ``implicit_resistance``, and the soil below, if it is soft.
    """
    known0, factor0 = implicit_resistance(q, first, x0[0], v0[0], x[0], v[0], scale, c1, c2)
    known1, factor1 = implicit_resistance(q, first + 1, x0[1], v0[1], x[1], v[1], scale, c1, c2)
    known2, factor2 = implicit_resistance(q, first + 2, x0[2], v0[2], x[2], v[2], scale, c1, c2)
    known0, factor0 = through_soil(first, known0, factor0, soft, soil)
    known1, factor1 = through_soil(first + 1, known1, factor1, soft, soil)
    known2, factor2 = through_soil(first + 2, known2, factor2, soft, soil)
    return (known0, known1, known2), (factor0, factor1, factor2)
