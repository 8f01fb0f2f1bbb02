"""The vehicle: eqs (1)-(3) as a nonlinear rigid body on its suspension, by the implicit trapezoidal rule.

All vectors are components in frame II, which turns with the vehicle. The vehicle stands level at rest with
its arm at f(0); d(.) is the difference from there. Unknown of a step are the accelerations alone: the
suspension's forces enter implicitly (damping over inertia is 0.3 to 0.8 ms in Table I, far below the sampling
interval), the rest by fixed-point iteration. At each sample the accelerations are then those of eqs (1)-(3)
exactly, so that A x = F holds to rounding whatever the step.

A vehicle is a record ``q`` of dtype ``ROW``. Effects that are off change no bit.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import allocation_free_inlined, compiled, inlined
from fieldmodels.machines.excitation.declaration import as_vehicles
from fieldmodels.machines.excitation.parameters import MODES
from fieldmodels.machines.excitation.regression import (
    ACCELERATION,
    ANGLE,
    FORCE,
    POSITION,
    RATE,
    SIGNALS,
    SMALL,
    TORQUE,
    TURNING,
    VELOCITY,
    gravity_change,
)
from fieldmodels.machines.excitation.suspension import (
    Resistance,
    Soil,
    load_soil,
    pass_on,
    resting_soil,
    suspension,
)
from fieldmodels.machines.excitation.vectors import ZERO, Vector, cross, dot, minus, plus, solve3, vector_at

SOIL_FORCE = TURNING + 3
STATE = SOIL_FORCE + 6
"""State of one mode: its first 18 signals, then the soil's forces and torques (zero on firm ground)."""

ARM_MASS, REACH, ACROSS, ALONG, GRAVITY = range(5)
ITERATIONS = 2
"""Fixed-point iterations a step: a third changes the error by less than its sixth digit."""
SUBSTEPS = 4
"""Steps within a sampling interval of 5 ms."""


class System(NamedTuple):
    """Vehicle and loaded arm: what does not change while they move."""

    total: float  # mass of both [kg]
    mass: float  # of the arm with its payload [kg]
    reach: float  # joint to the centre of that mass [m]
    across: float  # the arm's inertia across its axis [kg m2]
    slim: float  # that along it, less the one across
    gravity: float
    inertia: Any  # of the vehicle, an array: x, y, z, xz, yz, xy
    joint: Vector  # from the vehicle's centre of gravity to the arm's joint [m]
    rest: Vector  # direction of the arm at rest


class Swing(NamedTuple):
    """The arm at an instant, as it moves within frame II."""

    axis: Vector
    along: Vector  # direction of the arm
    centre: Vector  # from the vehicle's centre of gravity to the arm's centre of mass [m]
    speed: Vector  # of that centre within the frame [m/s]
    acceleration: Vector  # the same [m/s2]
    rate: float  # f' [rad/s]
    turning: float  # f'' [rad/s2]


class Place(NamedTuple):
    """Where the vehicle is and how it moves: position, velocity, rotation vector, angular velocity."""

    r: Vector
    v: Vector
    o: Vector
    w: Vector


class Response(NamedTuple):
    """Accelerations of the vehicle, and what they share with the arm's force and moment."""

    a: Vector  # dr''
    b: Vector  # w'
    arm: Vector  # acceleration of the arm's centre of mass without that of the vehicle
    spin: Vector  # rate of the arm's angular momentum without that of the vehicle
    gravity: Vector  # change of the free fall in frame II


@inlined
def pose(mode: int, angle: float) -> tuple[Vector, Vector]:
    """Axis of rotation and direction of the arm, as unit vectors in frame II.

    The arm lies along y for rotations about x and z. For rotations about y it stands along z: about its own
    axis it would hardly shake anything (0.01 N m).
    """
    s, c = math.sin(angle), math.cos(angle)
    if mode == 0:
        return (1.0, 0.0, 0.0), (0.0, c, s)
    if mode == 1:
        return (0.0, 1.0, 0.0), (s, 0.0, c)
    return (0.0, 0.0, 1.0), (-s, c, 0.0)


@inlined
def turning_series(square: float) -> float:
    """``turning_share`` where it is small."""
    fourth = square * square
    share = 1.0 / 30240.0 + square * (1.0 / 1209600.0) + fourth * (1.0 / 47900160.0)
    return 1.0 / 12.0 + square * (1.0 / 720.0) + fourth * share


@inlined
def turning_share(square: float) -> float:
    """What o x (o x w) counts in ``turning_excess``, by the square of o [rad2]."""
    if square < SMALL:
        return turning_series(square)
    angle = math.sqrt(square)
    return (1.0 - 0.5 * angle / math.tan(0.5 * angle)) / square


@inlined
def turning_excess(o: Vector, w: Vector, share: float) -> Vector:
    """Rate of the rotation vector o less w: o x w / 2 + o x (o x w) / 12 + ..."""
    p = cross(o, w)
    q = cross(o, p)
    return 0.5 * p[0] + share * q[0], 0.5 * p[1] + share * q[1], 0.5 * p[2] + share * q[2]


@inlined
def system_of(q: Any, arm: FloatArray, mode: int, rest: float) -> System:
    """Vehicle and arm as one system, the payload a point mass at the arm's tip; see ``advance_mode``."""
    mass, reach, across = arm[ARM_MASS], arm[REACH], arm[ACROSS]
    if q.payload.mass > 0.0:
        mass = arm[ARM_MASS] + q.payload.mass
        tip = 2.0 * arm[REACH]
        reach = (arm[ARM_MASS] * arm[REACH] + q.payload.mass * tip) / mass
        across = (
            arm[ACROSS]
            + arm[ARM_MASS] * (reach - arm[REACH]) * (reach - arm[REACH])
            + q.payload.mass * (tip - reach) * (tip - reach)
        )
    _, along = pose(mode, rest)
    joint = (q.cg[0], q.cg[1], q.cg[2])
    slim = arm[ALONG] - across
    return System(q.mass + mass, mass, reach, across, slim, arm[GRAVITY], q.inertia, joint, along)


@inlined
def swing_along(system: System, axis: Vector, u: Vector, f1: float, f2: float) -> Swing:
    """The arm along u at f', f''."""
    reach, t = system.reach, cross(axis, u)
    speed = (reach * t[0] * f1, reach * t[1] * f1, reach * t[2] * f1)
    acceleration = (
        reach * (t[0] * f2 - u[0] * f1 * f1),
        reach * (t[1] * f2 - u[1] * f1 * f1),
        reach * (t[2] * f2 - u[2] * f1 * f1),
    )
    return Swing(axis, u, plus(system.joint, reach, u), speed, acceleration, f1, f2)


@inlined
def spin_rate(system: System, swing: Swing, w: Vector) -> Vector:
    """Rate of the arm's angular momentum, without what the vehicle's w' adds to it."""
    across, u, f1, f2 = system.across, swing.along, swing.rate, swing.turning
    z = plus(w, f1, swing.axis)
    d = cross(w, swing.axis)
    n = (
        f2 * swing.axis[0] + f1 * d[0],
        f2 * swing.axis[1] + f1 * d[1],
        f2 * swing.axis[2] + f1 * d[2],
    )
    tip1, tip2 = system.slim * dot(u, n), system.slim * dot(u, z)
    d = cross(z, u)
    return (
        across * n[0] + tip1 * u[0] + tip2 * d[0],
        across * n[1] + tip1 * u[1] + tip2 * d[1],
        across * n[2] + tip1 * u[2] + tip2 * d[2],
    )


@inlined
def gyroscopic(inertia: Any, w: Vector) -> Vector:
    """W x I w."""
    return cross(
        w,
        (
            inertia[0] * w[0] + inertia[5] * w[1] + inertia[3] * w[2],
            inertia[5] * w[0] + inertia[1] * w[1] + inertia[4] * w[2],
            inertia[3] * w[0] + inertia[4] * w[1] + inertia[2] * w[2],
        ),
    )


@inlined
def loads(
    system: System, swing: Swing, g: Vector, w: Vector, resisting: Resistance
) -> tuple[Vector, Vector, Response]:
    """Force, and moment about the vehicle's centre of gravity, without what the accelerations add to them.

    The third is the response as far as it is known before the accelerations are.
    """
    m2, gravity, p = system.mass, system.gravity, swing.centre
    h = plus(cross(w, plus(cross(w, p), 2.0, swing.speed)), 1.0, swing.acceleration)
    n = spin_rate(system, swing, w)
    force = (
        system.total * g[0] - resisting.force[0] - m2 * h[0],
        system.total * g[1] - resisting.force[1] - m2 * h[1],
        system.total * g[2] - resisting.force[2] - m2 * h[2],
    )
    gyro = gyroscopic(system.inertia, w)
    # The arm's inertia force and the change of its weight, at its centre of mass.
    m = cross(p, (m2 * (g[0] - h[0]), m2 * (g[1] - h[1]), m2 * (g[2] - gravity - h[2])))
    # What the arm's weight does to the moments at rest: r x F and the joint's own moment.
    rest_x = -(system.joint[1] + system.reach * system.rest[1]) * gravity * m2
    rest_y = (system.joint[0] + system.reach * system.rest[0]) * gravity * m2
    torque = (
        -gyro[0] - resisting.torque[0] + m[0] - rest_x - n[0],
        -gyro[1] - resisting.torque[1] + m[1] - rest_y - n[1],
        -gyro[2] - resisting.torque[2] + m[2] - n[2],
    )
    return force, torque, Response(ZERO, ZERO, h, n, g)


@inlined
def accelerations(system: System, swing: Swing, g: Vector, w: Vector, resisting: Resistance) -> Response:
    """Accelerations of eqs (1)-(3), the dr'' eliminated from the moments; g is gravity's change."""
    force, torque, known = loads(system, swing, g, w, resisting)
    m2, u, p = system.mass, swing.along, swing.centre
    i, k, across, slim = system.inertia, resisting.torque_factor, system.across, system.slim
    # Reciprocals: a division takes as long as five products.
    d0, d1 = (
        1.0 / (system.total + resisting.force_factor[0]),
        1.0 / (system.total + resisting.force_factor[1]),
    )
    d2 = 1.0 / (system.total + resisting.force_factor[2])
    a = (force[0] * d0, force[1] * d1, force[2] * d2)
    w0, w1, w2 = m2 - m2 * m2 * d0, m2 - m2 * m2 * d1, m2 - m2 * m2 * d2
    diagonal = (
        i[0] + across + slim * u[0] * u[0] + k[0] + p[2] * p[2] * w1 + p[1] * p[1] * w2,
        i[1] + across + slim * u[1] * u[1] + k[1] + p[2] * p[2] * w0 + p[0] * p[0] * w2,
        i[2] + across + slim * u[2] * u[2] + k[2] + p[1] * p[1] * w0 + p[0] * p[0] * w1,
    )
    b = solve3(
        diagonal,
        i[5] + slim * u[0] * u[1] - p[0] * p[1] * w2,
        i[3] + slim * u[0] * u[2] - p[0] * p[2] * w1,
        i[4] + slim * u[1] * u[2] - p[1] * p[2] * w0,
        plus(torque, -m2, cross(p, a)),
    )
    d = cross(p, b)
    a = (a[0] + m2 * d[0] * d0, a[1] + m2 * d[1] * d1, a[2] + m2 * d[2] * d2)
    return Response(a, b, known.arm, known.spin, known.gravity)


@inlined
def half_step(now: Place, a: Vector, b: Vector, half: float, share: float) -> Place:
    """Half of a step with the slopes at its beginning."""
    return Place(
        plus(now.r, half, minus(now.v, cross(now.w, now.r))),
        plus(now.v, half, minus(a, cross(now.w, now.v))),
        plus(now.o, half, plus(now.w, 1.0, turning_excess(now.o, now.w, share))),
        plus(now.w, half, b),
    )


@inlined
def guess_after(begun: Place, a: Vector, b: Vector, half: float) -> Place:
    """First guess of a step's end: unchanged accelerations."""
    v, w = plus(begun.v, half, a), plus(begun.w, half, b)
    return Place(plus(begun.r, half, v), v, plus(begun.o, half, w), w)


@inlined
def without_accelerations(begun: Place, guess: Place, half: float, share: float) -> Place:
    """The other half with the slopes at a guess of the step's end, but for what the accelerations add."""
    v = plus(begun.v, -half, cross(guess.w, guess.v))
    r = plus(begun.r, half, minus(v, cross(guess.w, guess.r)))
    o = plus(begun.o, half, plus(begun.w, 1.0, turning_excess(guess.o, guess.w, share)))
    return Place(r, v, o, begun.w)


@inlined
def moved_by(base: Place, a: Vector, b: Vector, c1: float, c2: float) -> Place:
    """A step's end: the base with what the accelerations add."""
    return Place(plus(base.r, c2, a), plus(base.v, c1, a), plus(base.o, c2, b), plus(base.w, c1, b))


@allocation_free_inlined
def write_motion(place: Place, a: Vector, b: Vector, out: FloatArray) -> None:
    """The first 18 signals."""
    for i in range(3):
        out[POSITION + i], out[VELOCITY + i], out[ACCELERATION + i] = place.r[i], place.v[i], a[i]
        out[ANGLE + i], out[RATE + i], out[TURNING + i] = place.o[i], place.w[i], b[i]


@allocation_free_inlined
def write_force(system: System, swing: Swing, response: Response, out: FloatArray) -> None:
    """Eq (1): force and moment of the base on the arm, less those at rest."""
    a, b, h, n, g = response.a, response.b, response.arm, response.spin, response.gravity
    m2, reach, across, gravity, u = system.mass, system.reach, system.across, system.gravity, swing.along
    d = cross(b, swing.centre)
    fx = m2 * (a[0] + d[0] + h[0] - g[0])
    fy = m2 * (a[1] + d[1] + h[1] - g[1])
    fz = m2 * (a[2] + d[2] + h[2] - g[2])
    tip = system.slim * dot(u, b)
    m = cross((reach * u[0], reach * u[1], reach * u[2]), (fx, fy, fz + m2 * gravity))
    out[FORCE], out[FORCE + 1], out[FORCE + 2] = fx, fy, fz
    out[TORQUE] = across * b[0] + tip * u[0] + n[0] + m[0] - reach * system.rest[1] * m2 * gravity
    out[TORQUE + 1] = across * b[1] + tip * u[1] + n[1] + m[1] + reach * system.rest[0] * m2 * gravity
    out[TORQUE + 2] = across * b[2] + tip * u[2] + n[2] + m[2]


@inlined
def push_at(pushes: FloatArray, k: int, substeps: int, first: int) -> Vector:
    """Three components of a push at substep ``k``, along a line between samples."""
    n, part = k // substeps, k % substeps
    here = vector_at(pushes[n], first)
    if part == 0:
        return here
    return plus(here, part / substeps, minus(vector_at(pushes[n + 1], first), here))


@compiled
def advance_mode(
    q: Any,
    arm: FloatArray,
    mode: int,
    motion: FloatArray,
    rest: float,
    step: float,
    substeps: int,
    time: float,
    state: FloatArray,
    signals: FloatArray,
    pushes: FloatArray | None = None,
) -> None:
    """Advance the vehicle under one mode of the arm, in place.

    Args:
        q: The vehicle and its effects, dtype ``ROW``.
        arm: ``Arm.row()``, shape (5,).
        mode: 0, 1, 2: the arm turns about x, y, z.
        motion: f [rad], f' [rad/s], f'' [rad/s2] at every substep, begin and end included, shape
            (samples * substeps + 1, 3).
        rest: f(0) [rad], the angle at which the vehicle stood at rest.
        step: Sampling interval [s].
        substeps: Integration steps within it.
        time: Time at the beginning [s] (for the drift).
        state: State at the beginning, shape (24,); receives that at the end. All zeros: at rest.
        signals: Receives the signals at the end of each sampling interval, shape (samples, 24).
        pushes: Force [N] and torque [N m] on the vehicle beside its suspension, in frame II, at every sample,
            the beginning included, shape (samples + 1, 6), or (0, 6) for none.
    """
    h = step / substeps
    half = 0.5 * h
    system = system_of(q, arm, mode, rest)
    drift, soft = q.stiffness_drift.rate, q.soil_compliance.share != 0.0
    soil: Soil = resting_soil(state[SOIL_FORCE:])
    now = Place(
        vector_at(state, POSITION),
        vector_at(state, VELOCITY),
        vector_at(state, ANGLE),
        vector_at(state, RATE),
    )
    a, b = vector_at(state, ACCELERATION), vector_at(state, TURNING)
    for k in range(len(motion)):
        scale, next_scale = 1.0 + drift * (time + (k - 1) * h), 1.0 + drift * (time + k * h)
        if soft and k > 0:
            load_soil(q, now.r, now.v, now.o, now.w, scale, next_scale, h, soil)
        axis, u = pose(mode, motion[k, 0])
        swing = swing_along(system, axis, u, motion[k, 1], motion[k, 2])
        begun = half_step(now, a, b, half, turning_share(dot(now.o, now.o)))
        # The state at the beginning needs no step, but accelerations that fit the arm's motion there.
        guess = guess_after(begun, a, b, half) if k > 0 else now
        response = Response(a, b, ZERO, ZERO, ZERO)
        final = k % substeps == 0
        for iteration in range(0 if k > 0 else ITERATIONS, ITERATIONS + 1 if final else ITERATIONS):
            exact = iteration == ITERATIONS  # accelerations of the state as it stands: no implicit part
            base = guess
            if not exact:
                base = without_accelerations(begun, guess, half, turning_share(dot(guess.o, guess.o)))
            c1, c2 = (0.0, 0.0) if exact else (half, half * half)
            force = suspension(q, 0, base.r, base.v, guess.r, guess.v, next_scale, c1, c2, soft, soil)
            torque = suspension(q, 3, base.o, base.w, guess.o, guess.w, next_scale, c1, c2, soft, soil)
            resisting = Resistance(force[0], torque[0], force[1], torque[1])
            if pushes is not None:  # noqa: SIM102 - compiled: without any, the rest is left out
                if len(pushes) > 0:
                    resisting = Resistance(
                        minus(force[0], push_at(pushes, k, substeps, 0)),
                        minus(torque[0], push_at(pushes, k, substeps, 3)),
                        force[1],
                        torque[1],
                    )
            g = gravity_change(guess.o[0], guess.o[1], guess.o[2], system.gravity)
            response = accelerations(system, swing, g, guess.w, resisting)
            a, b = response.a, response.b
            if not exact:
                guess = moved_by(base, a, b, c1, c2)
        now = guess
        if soft and k > 0:
            pass_on(q, now.r, now.v, now.o, now.w, next_scale, soil)
        if final and k > 0:
            out = signals[k // substeps - 1]
            write_motion(now, a, b, out)
            write_force(system, swing, response, out)
    write_motion(now, a, b, state)
    for i in range(len(soil.passed)):
        state[SOIL_FORCE + i] = soil.passed[i]


@compiled
def _simulate(
    vehicles: NDArray[Any],
    arm: FloatArray,
    motions: FloatArray,
    step: float,
    substeps: int,
    result: FloatArray,
) -> None:
    """Fill ``simulate``'s result."""
    state = np.zeros(STATE)
    for b in range(len(vehicles)):
        motion = motions[b % len(motions)]
        for mode in range(MODES):
            state[:] = 0.0
            advance_mode(
                vehicles[b], arm, mode, motion, motion[0, 0], step, substeps, 0.0, state, result[b, mode]
            )


def simulate(
    vehicles: FloatArray, motion: FloatArray, arm: FloatArray, step: float, substeps: int = SUBSTEPS
) -> FloatArray:
    """Shake vehicles from rest in all three modes.

    Args:
        vehicles: The 22 unknowns, or with effects the vectors of ``ExcitationModel``, shape (batch, numbers).
        motion: f, f', f'' at every substep, begin and end included, shape (samples * substeps + 1, 3);
            the same in each mode.
        arm: ``Arm.row()``, shape (5,).
        step: Sampling interval [s].
        substeps: Integration steps within it.

    Returns:
        Signals at the end of each sampling interval, shape (batch, 3, samples, 24).
    """
    rows = as_vehicles(np.atleast_2d(vehicles))
    samples = (len(motion) - 1) // substeps
    result = np.empty((len(rows), MODES, samples, SIGNALS))
    _simulate(rows, arm, np.ascontiguousarray(motion)[None], step, substeps, result)
    return result
