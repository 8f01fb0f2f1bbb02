"""All modes of vehicles without effects side by side, as numbers of vectors, equal to the bit.

A quantity is a row of an array, a mode of a vehicle a column. Loops over columns hold no call and no branch,
so that the compiler makes vector instructions of them; several vectors fill the time that one waits.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import allocation_free, allocation_free_inlined
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
    turning_series,
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
    SMALL,
    TURNING,
    VELOCITY,
    turned_gravity,
    turned_series,
    turned_shares,
)
from fieldmodels.machines.excitation.suspension import Resistance
from fieldmodels.machines.excitation.vectors import ZERO, Vector

BESIDE = 5
"""Vehicles that go side by side where there are as many."""
NOW, BEGUN, GUESS, BASE = 0, 12, 24, 36
A, B, H, N, G = 48, 51, 54, 57, 60
AXIS, ALONG, REST, CENTRE, SPEED, MOVED = 63, 66, 69, 72, 75, 78
TURNED, SINE, COSINE, F1, F2 = 81, 82, 83, 84, 85
TOTAL, INERTIA, JOINT, DAMPING, TWISTING, STIFFNESS, SPRUNG, ROWS = 86, 87, 93, 96, 99, 102, 105, 108
"""Rows: places, accelerations and what is known of them, the arm, shares of series, the vehicle."""


@lru_cache
def room_for(vehicles: int) -> np.dtype[Any]:
    """Room for so many vehicles, in whole vectors of four numbers.

    Of an array in a record the compiler knows the shape, which the loops over columns need.
    """
    return np.dtype([("rows", np.float64, (ROWS, (MODES * vehicles + 3) // 4 * 4))])


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
def read_swing(s: FloatArray, lane: int) -> Swing:
    """The arm of a lane."""
    return Swing(
        read(s, AXIS, lane), read(s, ALONG, lane), read(s, CENTRE, lane), read(s, SPEED, lane),
        read(s, MOVED, lane), s[F1, lane], s[F2, lane],
    )  # fmt: skip


@allocation_free_inlined
def read_response(s: FloatArray, lane: int) -> Response:
    """Accelerations of a lane, and what they share with the arm's force and moment."""
    return Response(read(s, A, lane), read(s, B, lane), read(s, H, lane), read(s, N, lane), read(s, G, lane))


@allocation_free_inlined
def system_in(s: FloatArray, arm: System, lane: int) -> System:
    """Vehicle and arm of a lane."""
    inertia = read(s, INERTIA, lane) + read(s, INERTIA + 3, lane)
    return System(
        s[TOTAL, lane], arm.mass, arm.reach, arm.across, arm.slim, arm.gravity, inertia, read(s, JOINT, lane),
        read(s, REST, lane),
    )  # fmt: skip


@allocation_free_inlined
def plain_suspension(
    s: FloatArray, lane: int, damping: int, stiffness: int, x: Vector, v: Vector, c1: float, c2: float
) -> tuple[Vector, Vector]:
    """``suspension.suspension`` of three axes without effects, whose numbers are in rows from these on."""
    d, k = read(s, damping, lane), read(s, stiffness, lane)
    return (
        (d[0] * v[0] + k[0] * x[0], d[1] * v[1] + k[1] * x[1], d[2] * v[2] + k[2] * x[2]),
        (d[0] * c1 + k[0] * c2, d[1] * c1 + k[1] * c2, d[2] * c1 + k[2] * c2),
    )


@allocation_free_inlined
def square_of(s: FloatArray, row: int, lane: int) -> float:
    """Square of a vector in three rows."""
    x, y, z = read(s, row, lane)
    return x * x + y * y + z * z


@allocation_free_inlined
def share_turning(s: FloatArray, row: int) -> None:
    """``dynamics.turning_share`` of the rotation vectors in three rows."""
    large = 0
    for m in range(s.shape[1]):
        square = square_of(s, row, m)
        s[TURNED, m] = turning_series(square)
        large += 0 if square < SMALL else 1
    if large > 0:
        for m in range(s.shape[1]):
            s[TURNED, m] = turning_share(square_of(s, row, m))


@allocation_free_inlined
def share_gravity(s: FloatArray, row: int) -> None:
    """``regression.turned_shares`` of the rotation vectors in three rows."""
    large = 0
    for m in range(s.shape[1]):
        square = square_of(s, row, m)
        s[SINE, m], s[COSINE, m] = turned_series(square)
        large += 0 if square < SMALL else 1
    if large > 0:
        for m in range(s.shape[1]):
            s[SINE, m], s[COSINE, m] = turned_shares(square_of(s, row, m))


@allocation_free_inlined
def vehicle_in(lane: int, count: int) -> int:
    """The vehicle of a lane: of those that are left over, the last."""
    return lane // MODES if lane < MODES * count else count - 1


@allocation_free_inlined
def swing_arms(s: FloatArray, arm: System, motions: FloatArray, k: int) -> None:
    """Put the arms of all modes to where they are at substep ``k``; see ``dynamics.pose``."""
    sine = cosine = 0.0
    for m in range(s.shape[1]):
        mode, moved = m % MODES, motions[vehicle_in(m, len(motions)), k]
        if mode == 0:
            sine, cosine = math.sin(moved[0]), math.cos(moved[0])
        s[F1, m], s[F2, m] = moved[1], moved[2]
        s[ALONG, m] = 0.0 if mode == 0 else (sine if mode == 1 else -sine)
        s[ALONG + 1, m] = 0.0 if mode == 1 else cosine
        s[ALONG + 2, m] = sine if mode == 0 else (cosine if mode == 1 else 0.0)
    for m in range(s.shape[1]):
        system = system_in(s, arm, m)
        swing = swing_along(system, read(s, AXIS, m), read(s, ALONG, m), s[F1, m], s[F2, m])
        write(s, CENTRE, m, swing.centre)
        write(s, SPEED, m, swing.speed)
        write(s, MOVED, m, swing.acceleration)


@allocation_free
def put_in(s: FloatArray, vehicles: NDArray[Any], states: FloatArray, arm: System, rest: float) -> None:
    """Let vehicles and their states be columns; those that are left over repeat the last vehicle."""
    sine, cosine = math.sin(rest), math.cos(rest)
    along = ((0.0, cosine, sine), (sine, 0.0, cosine), (-sine, cosine, 0.0))
    for m in range(s.shape[1]):
        b, mode = vehicle_in(m, len(vehicles)), m % MODES
        q, state = vehicles[b], states[b, mode]
        s[TOTAL, m] = q.mass + arm.mass
        for i in range(6):
            s[INERTIA + i, m] = q.inertia[i]
        for i in range(3):
            s[JOINT + i, m] = q.cg[i]
            s[DAMPING + i, m], s[TWISTING + i, m] = q.damping[i], q.damping[3 + i]
            s[STIFFNESS + i, m], s[SPRUNG + i, m] = q.stiffness[i], q.stiffness[3 + i]
            s[AXIS + i, m], s[REST + i, m] = 1.0 if i == mode else 0.0, along[mode][i]
            s[NOW + i, m], s[NOW + 3 + i, m] = state[POSITION + i], state[VELOCITY + i]
            s[NOW + 6 + i, m], s[NOW + 9 + i, m] = state[ANGLE + i], state[RATE + i]
            s[A + i, m], s[B + i, m] = state[ACCELERATION + i], state[TURNING + i]


@allocation_free
def advance_modes(
    vehicles: NDArray[Any],
    arm: FloatArray,
    motions: FloatArray,
    rest: float,
    step: float,
    substeps: int,
    states: FloatArray,
    signals: FloatArray,
    room: Any,
) -> None:
    """``dynamics.advance_mode`` of all modes of vehicles without effects, as many as there is room for.

    Motions, states and signals have shapes (vehicles, samples * substeps + 1, 3), (vehicles, 3, 24) and
    (vehicles, 3, samples, 24); ``room``, of a dtype of ``room_for``, is overwritten.
    """
    h = step / substeps
    half, full = 0.5 * h, 0.5 * h * (0.5 * h)
    s = room.rows
    lanes, used = s.shape[1], MODES * len(vehicles)
    mass, reach, across = arm[ARM_MASS], arm[REACH], arm[ACROSS]
    slim = arm[ALONG_ITSELF] - across
    loaded = System(0.0, mass, reach, across, slim, arm[GRAVITY], ZERO + ZERO, ZERO, ZERO)
    put_in(s, vehicles, states, loaded, rest)
    for k in range(motions.shape[1]):
        swing_arms(s, loaded, motions, k)
        final = k % substeps == 0
        if k > 0:
            share_turning(s, NOW + 6)
            for m in range(lanes):
                a, b = read(s, A, m), read(s, B, m)
                begun = half_step(read_place(s, NOW, m), a, b, half, s[TURNED, m])
                write_place(s, BEGUN, m, begun)
                write_place(s, GUESS, m, guess_after(begun, a, b, half))
        else:
            for m in range(lanes):
                write_place(s, GUESS, m, read_place(s, NOW, m))
        for iteration in range(0 if k > 0 else ITERATIONS, ITERATIONS + 1 if final else ITERATIONS):
            exact = iteration == ITERATIONS
            c1, c2 = (0.0, 0.0) if exact else (half, full)
            share_gravity(s, GUESS + 6)
            if exact:
                for m in range(lanes):
                    write_place(s, BASE, m, read_place(s, GUESS, m))
            else:
                share_turning(s, GUESS + 6)
                for m in range(lanes):
                    base = without_accelerations(
                        read_place(s, BEGUN, m), read_place(s, GUESS, m), half, s[TURNED, m]
                    )
                    write_place(s, BASE, m, base)
            for m in range(lanes):
                base, o, w = read_place(s, BASE, m), read(s, GUESS + 6, m), read(s, GUESS + 9, m)
                system = system_in(s, loaded, m)
                g = turned_gravity(o[0], o[1], o[2], s[SINE, m], s[COSINE, m], system.gravity)
                force, force_factor = plain_suspension(s, m, DAMPING, STIFFNESS, base.r, base.v, c1, c2)
                torque, torque_factor = plain_suspension(s, m, TWISTING, SPRUNG, base.o, base.w, c1, c2)
                resisting = Resistance(force, torque, force_factor, torque_factor)
                found = accelerations(system, read_swing(s, m), g, w, resisting)
                write(s, A, m, found.a)
                write(s, B, m, found.b)
                write(s, H, m, found.arm)
                write(s, N, m, found.spin)
                write(s, G, m, found.gravity)
            if not exact:
                for m in range(lanes):
                    a, b, base = read(s, A, m), read(s, B, m), read_place(s, BASE, m)
                    write_place(s, GUESS, m, moved_by(base, a, b, c1, c2))
        for m in range(lanes):
            write_place(s, NOW, m, read_place(s, GUESS, m))
        if final and k > 0:
            for m in range(used):
                out, response = signals[m // MODES, m % MODES, k // substeps - 1], read_response(s, m)
                write_motion(read_place(s, NOW, m), response.a, response.b, out)
                write_force(system_in(s, loaded, m), read_swing(s, m), response, out)
    for m in range(used):
        out = states[m // MODES, m % MODES]
        write_motion(read_place(s, NOW, m), read(s, A, m), read(s, B, m), out)
