"""All modes of a vehicle without effects side by side, as numbers of a vector, equal to the bit.

A quantity is a row of an array, a mode a column. Loops over columns hold no call and no branch, so that the
compiler makes vector instructions of them.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import allocation_free, allocation_free_inlined, inlined
from fieldmodels.estimation.parameter_filter import clear
from fieldmodels.machines.excitation.dynamics import (
    ACROSS,
    ARM_MASS,
    GRAVITY,
    ITERATIONS,
    REACH,
    Place,
    Response,
    Swing,
    System,
    accelerations,
    guess_after,
    half_step,
    moved_by,
    swing_along,
    turning_share,
    without_accelerations,
    write_force,
    write_motion,
)
from fieldmodels.machines.excitation.dynamics import ALONG as ALONG_ITSELF
from fieldmodels.machines.excitation.parameters import MODES
from fieldmodels.machines.excitation.regression import (
    ACCELERATION,
    ANGLE,
    POSITION,
    RATE,
    TURNING,
    VELOCITY,
    turned_gravity,
    turned_shares,
)
from fieldmodels.machines.excitation.suspension import Resistance
from fieldmodels.machines.excitation.vectors import ZERO, Vector, vector_at

LANES = 4
"""Columns, one of which is idle: numbers of a vector."""
NOW, BEGUN, GUESS, BASE = 0, 12, 24, 36
A, B, H, N, G = 48, 51, 54, 57, 60
AXIS, ALONG, REST, CENTRE, SPEED, MOVED = 63, 66, 69, 72, 75, 78
TURNED, SINE, COSINE, ROWS = 81, 82, 83, 84
"""Rows: places, accelerations and what is known of them, the arm, shares of series."""
ROOM = np.dtype([("rows", np.float64, (ROWS, LANES))])
"""Room for them. Of an array in a record the compiler knows the shape, which the loops over columns need."""


@allocation_free_inlined
def read(s: FloatArray, row: int, lane: int) -> Vector:
    """Three rows of a lane."""
    return s[row, lane], s[row + 1, lane], s[row + 2, lane]


@allocation_free_inlined
def write(s: FloatArray, row: int, lane: int, v: Vector) -> None:
    """Set three rows of a lane."""
    s[row, lane], s[row + 1, lane], s[row + 2, lane] = v


@allocation_free_inlined
def read_place(s: FloatArray, row: int, lane: int) -> Place:
    """A place in twelve rows."""
    return Place(read(s, row, lane), read(s, row + 3, lane), read(s, row + 6, lane), read(s, row + 9, lane))


@allocation_free_inlined
def write_place(s: FloatArray, row: int, lane: int, place: Place) -> None:
    """Set twelve rows of a lane."""
    write(s, row, lane, place.r)
    write(s, row + 3, lane, place.v)
    write(s, row + 6, lane, place.o)
    write(s, row + 9, lane, place.w)


@allocation_free_inlined
def read_swing(s: FloatArray, lane: int, rate: float, turning: float) -> Swing:
    """The arm of a lane."""
    return Swing(
        read(s, AXIS, lane), read(s, ALONG, lane), read(s, CENTRE, lane), read(s, SPEED, lane),
        read(s, MOVED, lane), rate, turning,
    )  # fmt: skip


@allocation_free_inlined
def read_response(s: FloatArray, lane: int) -> Response:
    """Accelerations of a lane, and what they share with the arm's force and moment."""
    return Response(read(s, A, lane), read(s, B, lane), read(s, H, lane), read(s, N, lane), read(s, G, lane))


@allocation_free_inlined
def system_in(s: FloatArray, own: System, lane: int) -> System:
    """Vehicle and arm of a lane."""
    return System(
        own.total, own.mass, own.reach, own.across, own.slim, own.gravity, own.inertia, own.joint,
        read(s, REST, lane),
    )  # fmt: skip


@inlined
def plain_suspension(
    damping: Vector, stiffness: Vector, x: Vector, v: Vector, c1: float, c2: float
) -> tuple[Vector, Vector]:
    """``suspension.suspension`` of three axes without effects."""
    return (
        (
            damping[0] * v[0] + stiffness[0] * x[0],
            damping[1] * v[1] + stiffness[1] * x[1],
            damping[2] * v[2] + stiffness[2] * x[2],
        ),
        (
            damping[0] * c1 + stiffness[0] * c2,
            damping[1] * c1 + stiffness[1] * c2,
            damping[2] * c1 + stiffness[2] * c2,
        ),
    )


@allocation_free_inlined
def square_of(s: FloatArray, row: int, lane: int) -> float:
    """Square of a vector in three rows."""
    x, y, z = read(s, row, lane)
    return x * x + y * y + z * z


@allocation_free_inlined
def swing_arm(s: FloatArray, system: System, angle: float, rate: float, turning: float) -> None:
    """Put the arms of all modes to an angle; see ``dynamics.pose``."""
    sine, cosine = math.sin(angle), math.cos(angle)
    s[ALONG + 1, 0], s[ALONG + 2, 0] = cosine, sine
    s[ALONG, 1], s[ALONG + 2, 1] = sine, cosine
    s[ALONG, 2], s[ALONG + 1, 2] = -sine, cosine
    for m in range(LANES):
        swing = swing_along(system, read(s, AXIS, m), read(s, ALONG, m), rate, turning)
        write(s, CENTRE, m, swing.centre)
        write(s, SPEED, m, swing.speed)
        write(s, MOVED, m, swing.acceleration)


@allocation_free
def advance_modes(
    q: Any,
    arm: FloatArray,
    motion: FloatArray,
    rest: float,
    step: float,
    substeps: int,
    state: FloatArray,
    signals: FloatArray,
    room: Any,
) -> None:
    """``dynamics.advance_mode`` of all modes of a vehicle without effects.

    State and signals have shapes (3, 24) and (3, samples, 24); ``room``, of dtype ``ROOM``, is overwritten.
    """
    h = step / substeps
    half, full = 0.5 * h, 0.5 * h * (0.5 * h)
    s = room.rows
    clear(s)
    mass, reach, across = arm[ARM_MASS], arm[REACH], arm[ACROSS]
    inertia, joint = vector_at(q.inertia, 0) + vector_at(q.inertia, 3), vector_at(q.cg, 0)
    own = System(
        q.mass + mass, mass, reach, across, arm[ALONG_ITSELF] - across, arm[GRAVITY], inertia, joint, ZERO
    )
    damping, twisting = vector_at(q.damping, 0), vector_at(q.damping, 3)
    stiffness, turned = vector_at(q.stiffness, 0), vector_at(q.stiffness, 3)
    for m in range(MODES):
        s[AXIS + m, m] = 1.0
    swing_arm(s, own, rest, 0.0, 0.0)
    for m in range(MODES):
        write(s, REST, m, read(s, ALONG, m))
        for i in range(3):
            s[NOW + i, m], s[NOW + 3 + i, m] = state[m, POSITION + i], state[m, VELOCITY + i]
            s[NOW + 6 + i, m], s[NOW + 9 + i, m] = state[m, ANGLE + i], state[m, RATE + i]
            s[A + i, m], s[B + i, m] = state[m, ACCELERATION + i], state[m, TURNING + i]
    for k in range(len(motion)):
        rate, turning = motion[k, 1], motion[k, 2]
        swing_arm(s, own, motion[k, 0], rate, turning)
        final = k % substeps == 0
        if k > 0:
            for m in range(MODES):
                s[TURNED, m] = turning_share(square_of(s, NOW + 6, m))
            for m in range(LANES):
                a, b = read(s, A, m), read(s, B, m)
                begun = half_step(read_place(s, NOW, m), a, b, half, s[TURNED, m])
                write_place(s, BEGUN, m, begun)
                write_place(s, GUESS, m, guess_after(begun, a, b, half))
        else:
            for m in range(LANES):
                write_place(s, GUESS, m, read_place(s, NOW, m))
        for iteration in range(0 if k > 0 else ITERATIONS, ITERATIONS + 1 if final else ITERATIONS):
            exact = iteration == ITERATIONS
            c1, c2 = (0.0, 0.0) if exact else (half, full)
            for m in range(MODES):
                square = square_of(s, GUESS + 6, m)
                s[TURNED, m] = turning_share(square)
                s[SINE, m], s[COSINE, m] = turned_shares(square)
            if exact:
                for m in range(LANES):
                    write_place(s, BASE, m, read_place(s, GUESS, m))
            else:
                for m in range(LANES):
                    base = without_accelerations(
                        read_place(s, BEGUN, m), read_place(s, GUESS, m), half, s[TURNED, m]
                    )
                    write_place(s, BASE, m, base)
            for m in range(LANES):
                base, o, w = read_place(s, BASE, m), read(s, GUESS + 6, m), read(s, GUESS + 9, m)
                g = turned_gravity(o[0], o[1], o[2], s[SINE, m], s[COSINE, m], own.gravity)
                force, force_factor = plain_suspension(damping, stiffness, base.r, base.v, c1, c2)
                torque, torque_factor = plain_suspension(twisting, turned, base.o, base.w, c1, c2)
                resisting = Resistance(force, torque, force_factor, torque_factor)
                system = system_in(s, own, m)
                found = accelerations(system, read_swing(s, m, rate, turning), g, w, resisting)
                write(s, A, m, found.a)
                write(s, B, m, found.b)
                write(s, H, m, found.arm)
                write(s, N, m, found.spin)
                write(s, G, m, found.gravity)
            if not exact:
                for m in range(LANES):
                    a, b, base = read(s, A, m), read(s, B, m), read_place(s, BASE, m)
                    write_place(s, GUESS, m, moved_by(base, a, b, c1, c2))
        for m in range(LANES):
            write_place(s, NOW, m, read_place(s, GUESS, m))
        if final and k > 0:
            for m in range(MODES):
                out, response = signals[m, k // substeps - 1], read_response(s, m)
                write_motion(read_place(s, NOW, m), response.a, response.b, out)
                system = system_in(s, own, m)
                write_force(system, read_swing(s, m, rate, turning), response, out)
    for m in range(MODES):
        write_motion(read_place(s, NOW, m), read(s, A, m), read(s, B, m), state[m])
