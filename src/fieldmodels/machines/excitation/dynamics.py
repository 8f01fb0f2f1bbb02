"""The truth: eqs (1)-(3) as a nonlinear rigid body on its suspension, by the implicit trapezoidal rule.

All vectors are components in frame II, which turns with the vehicle. The vehicle stands level at rest with
its arm at f(0); d(.) is the difference from there. Unknown of a step are the accelerations alone: the
suspension's forces enter implicitly (damping over inertia is 0.3 to 0.8 ms in Table I, far below the sampling
interval), the rest by fixed-point iteration. At each sample the accelerations are then those of eqs (1)-(3)
exactly, so that A x = F holds to rounding whatever the step.

A vehicle is a vector: the 22 unknowns, then the effects below at zero. Effects that are off change no bit.
"""

from __future__ import annotations

import math

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled, inlined
from fieldmodels.machines.excitation.parameters import CG, DAMPING, INERTIA, MASS, MODES, STIFFNESS, UNKNOWNS
from fieldmodels.machines.excitation.regression import (
    ANGLE,
    FORCE,
    POSITION,
    RATE,
    SIGNALS,
    TORQUE,
    TURNING,
    VELOCITY,
    gravity_change,
)

PAYLOAD = UNKNOWNS
"""Mass at the arm's tip [kg], twice as far from the joint as the arm's centre of mass."""
CUBIC_FORCE, CUBIC_TORQUE = UNKNOWNS + 1, UNKNOWNS + 2
"""Hardening: springs k x (1 + c x^2) [1/m2], [1/rad2]."""
COULOMB_FORCE, COULOMB_TORQUE = UNKNOWNS + 3, UNKNOWNS + 4
"""Dry friction beside each spring [N], [N m]."""
DRIFT = UNKNOWNS + 5
"""Relative change of all stiffness per time [1/s]."""
SOIL = UNKNOWNS + 6
"""Compliance of the soil under each spring, as a share of that spring's own [1]."""
VEHICLE = UNKNOWNS + 7
"""Length of a vehicle's vector."""

CREEP_FORCE, CREEP_TORQUE = 0.002, 0.01
"""Speeds below which dry friction fades smoothly [m/s], [rad/s] (assumed)."""

SOIL_FORCE = TURNING + 3
STATE = SOIL_FORCE + 6
"""State of one mode: its first 18 signals, then the soil's forces and torques (zero on firm ground)."""

ARM_MASS, REACH, ACROSS, ALONG, GRAVITY = range(5)
ITERATIONS = 2
"""Fixed-point iterations a step: a third changes the error by less than its sixth digit."""
SUBSTEPS = 4
"""Steps within a sampling interval of 5 ms."""


@inlined
def pose(mode: int, angle: float) -> tuple[float, float, float, float, float, float]:
    """Axis of rotation and direction of the arm, as unit vectors in frame II.

    The arm lies along y for rotations about x and z. For rotations about y it stands along z: about its own
    axis it would hardly shake anything (0.01 N m).
    """
    s, c = math.sin(angle), math.cos(angle)
    if mode == 0:
        return 1.0, 0.0, 0.0, 0.0, c, s
    if mode == 1:
        return 0.0, 1.0, 0.0, s, 0.0, c
    return 0.0, 0.0, 1.0, -s, c, 0.0


@inlined
def cross(ax: float, ay: float, az: float, bx: float, by: float, bz: float) -> tuple[float, float, float]:
    """Vector product."""
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@inlined
def turning_excess(
    x: float, y: float, z: float, wx: float, wy: float, wz: float
) -> tuple[float, float, float]:
    """Rate of the rotation vector less w: theta x w / 2 + theta x (theta x w) / 12 + ..."""
    square = x * x + y * y + z * z
    if square < 1e-4:
        share = 1.0 / 12.0 + square / 720.0
    else:
        angle = math.sqrt(square)
        share = (1.0 - 0.5 * angle / math.tan(0.5 * angle)) / square
    px, py, pz = cross(x, y, z, wx, wy, wz)
    qx, qy, qz = cross(x, y, z, px, py, pz)
    return 0.5 * px + share * qx, 0.5 * py + share * qy, 0.5 * pz + share * qz


@inlined
def solve3(
    a: float, b: float, c: float, d: float, e: float, f: float, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """Solve [[a d e] [d b f] [e f c]] u = (x, y, z), positive definite, by Cholesky's L D L'."""
    l1, l2 = d / a, e / a
    b1 = b - l1 * d
    f1 = f - l1 * e
    l3 = f1 / b1
    c1 = c - l2 * e - l3 * f1
    y1 = y - l1 * x
    z1 = z - l2 * x - l3 * y1
    uz = z1 / c1
    uy = y1 / b1 - l3 * uz
    ux = x / a - l1 * uy - l2 * uz
    return ux, uy, uz


@inlined
def load_arm(arm: FloatArray, payload: float, loaded: FloatArray) -> None:
    """The arm with a point mass at its tip, as one rigid body."""
    loaded[:] = arm
    if payload > 0.0:
        mass = arm[ARM_MASS] + payload
        tip = 2.0 * arm[REACH]
        centre = (arm[ARM_MASS] * arm[REACH] + payload * tip) / mass
        loaded[ARM_MASS], loaded[REACH] = mass, centre
        loaded[ACROSS] = (
            arm[ACROSS]
            + arm[ARM_MASS] * (centre - arm[REACH]) * (centre - arm[REACH])
            + payload * (tip - centre) * (tip - centre)
        )


@inlined
def dry_friction(size: float, speed: float, creep: float) -> float:
    """Dry friction at a speed."""
    return size * speed / math.sqrt(speed * speed + creep * creep)


@inlined
def resistance(vehicle: FloatArray, axis: int, x: float, v: float, scale: float) -> float:
    """What the suspension of one axis (0 to 5) resists with: damper, spring, dry friction."""
    hardening = vehicle[CUBIC_FORCE] if axis < 3 else vehicle[CUBIC_TORQUE]
    size = vehicle[COULOMB_FORCE] if axis < 3 else vehicle[COULOMB_TORQUE]
    creep = CREEP_FORCE if axis < 3 else CREEP_TORQUE
    spring = scale * vehicle[STIFFNESS + axis] * x * (1.0 + hardening * x * x)
    total: float = vehicle[DAMPING + axis] * v + spring + dry_friction(size, v, creep)
    return total


@inlined
def implicit_resistance(
    vehicle: FloatArray,
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
    stiffness = scale * vehicle[STIFFNESS + axis]
    damping = vehicle[DAMPING + axis]
    known = damping * v0 + stiffness * x0
    hardening = vehicle[CUBIC_FORCE] if axis < 3 else vehicle[CUBIC_TORQUE]
    if hardening != 0.0:
        known += stiffness * hardening * x * x * x
    size = vehicle[COULOMB_FORCE] if axis < 3 else vehicle[COULOMB_TORQUE]
    if size != 0.0:
        creep = CREEP_FORCE if axis < 3 else CREEP_TORQUE
        root = math.sqrt(v * v + creep * creep)
        slope = size * creep * creep / (root * root * root)
        known += size * v / root + slope * (v0 - v)
        damping += slope
    return known, damping * c1 + stiffness * c2


@inlined
def advance_mode(
    vehicle: FloatArray,
    arm: FloatArray,
    mode: int,
    motion: FloatArray,
    rest: float,
    step: float,
    substeps: int,
    time: float,
    state: FloatArray,
    signals: FloatArray,
) -> None:
    """Advance the vehicle under one mode of the arm, in place.

    Args:
        vehicle: The 22 unknowns and the effects, shape (29,).
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
    """
    h = step / substeps
    load = np.empty(5)
    load_arm(arm, vehicle[PAYLOAD], load)
    m2, reach, across, along, gravity = load[0], load[1], load[2], load[3], load[4]
    total = vehicle[MASS] + m2
    ixx, iyy, izz = vehicle[INERTIA], vehicle[INERTIA + 1], vehicle[INERTIA + 2]
    ixz, iyz, ixy = vehicle[INERTIA + 3], vehicle[INERTIA + 4], vehicle[INERTIA + 5]
    cx, cy, cz = vehicle[CG], vehicle[CG + 1], vehicle[CG + 2]
    drift, soil = vehicle[DRIFT], vehicle[SOIL]
    soft = soil != 0.0
    _, _, _, u0x, u0y, _ = pose(mode, rest)
    # What the arm's weight does to the moments at rest: r x F and the joint's own moment.
    rest_x = -(cy + reach * u0y) * gravity * m2
    rest_y = (cx + reach * u0x) * gravity * m2

    # Per axis: lag of the force on soft ground, as exact for a load that grows linearly over a step.
    now = state[:18].copy()
    new = np.empty(18)
    push = np.zeros(6)  # known part of the suspension's resistance
    kept = np.ones(6)  # E of the soil's lag
    early = np.zeros(6)  # weight of the old load
    late = np.zeros(6)  # weight of the new load
    load_old = np.zeros(6)
    shown = np.zeros(6)
    for i in range(6):
        shown[i] = state[SOIL_FORCE + i]

    for k in range(len(motion)):
        f, f1, f2 = motion[k, 0], motion[k, 1], motion[k, 2]
        scale = 1.0 + drift * (time + (k - 1) * h)
        next_scale = 1.0 + drift * (time + k * h)
        if soft and k > 0:
            for i in range(6):
                x = POSITION + i if i < 3 else ANGLE + i - 3
                v = VELOCITY + i if i < 3 else RATE + i - 3
                load_old[i] = resistance(vehicle, i, now[x], now[v], scale)
                stiffness = max(next_scale * vehicle[STIFFNESS + i], 1e-9)
                lag = soil / (1.0 + soil) * vehicle[DAMPING + i] / stiffness
                ratio = lag / h
                kept[i] = math.exp(-1.0 / ratio) if ratio > 1e-9 else 0.0
                late[i] = (1.0 - (1.0 - kept[i]) * ratio) / (1.0 + soil)
                early[i] = ((1.0 - kept[i]) * ratio - kept[i]) / (1.0 + soil)
        ex, ey, ez, ux, uy, uz = pose(mode, f)
        tx, ty, tz = cross(ex, ey, ez, ux, uy, uz)
        px, py, pz = cx + reach * ux, cy + reach * uy, cz + reach * uz
        # Speed and acceleration of the arm's centre of mass within frame II.
        qx, qy, qz = reach * tx * f1, reach * ty * f1, reach * tz * f1
        sx = reach * (tx * f2 - ux * f1 * f1)
        sy = reach * (ty * f2 - uy * f1 * f1)
        sz = reach * (tz * f2 - uz * f1 * f1)

        # Slopes at the beginning.
        rx, ry, rz = now[0], now[1], now[2]
        vx, vy, vz = now[3], now[4], now[5]
        ax, ay, az = now[6], now[7], now[8]
        ox, oy, oz = now[9], now[10], now[11]
        wx, wy, wz = now[12], now[13], now[14]
        bx, by, bz = now[15], now[16], now[17]
        half = 0.5 * h
        dx, dy, dz = cross(wx, wy, wz, rx, ry, rz)
        r0x, r0y, r0z = rx + half * (vx - dx), ry + half * (vy - dy), rz + half * (vz - dz)
        dx, dy, dz = cross(wx, wy, wz, vx, vy, vz)
        v0x, v0y, v0z = vx + half * (ax - dx), vy + half * (ay - dy), vz + half * (az - dz)
        dx, dy, dz = turning_excess(ox, oy, oz, wx, wy, wz)
        o0x, o0y, o0z = ox + half * (wx + dx), oy + half * (wy + dy), oz + half * (wz + dz)
        w0x, w0y, w0z = wx + half * bx, wy + half * by, wz + half * bz
        if k > 0:
            # First guess: unchanged accelerations.
            wx, wy, wz = w0x + half * bx, w0y + half * by, w0z + half * bz
            vx, vy, vz = v0x + half * ax, v0y + half * ay, v0z + half * az
            rx, ry, rz = r0x + half * vx, r0y + half * vy, r0z + half * vz
            ox, oy, oz = o0x + half * wx, o0y + half * wy, o0z + half * wz

        final = k % substeps == 0
        # The state at the beginning needs no step, but accelerations that fit the arm's motion there.
        for iteration in range(0 if k > 0 else ITERATIONS, ITERATIONS + 1 if final else ITERATIONS):
            exact = iteration == ITERATIONS  # accelerations of the state as it stands: no implicit part
            c1 = 0.0 if exact else half
            c2 = 0.0 if exact else half * half
            if not exact:
                dx, dy, dz = cross(wx, wy, wz, vx, vy, vz)
                new[3], new[4], new[5] = v0x - half * dx, v0y - half * dy, v0z - half * dz
                dx, dy, dz = cross(wx, wy, wz, rx, ry, rz)
                new[0] = r0x + half * (new[3] - dx)
                new[1] = r0y + half * (new[4] - dy)
                new[2] = r0z + half * (new[5] - dz)
                new[12], new[13], new[14] = w0x, w0y, w0z
                dx, dy, dz = turning_excess(ox, oy, oz, wx, wy, wz)
                new[9] = o0x + half * (w0x + dx)
                new[10] = o0y + half * (w0y + dy)
                new[11] = o0z + half * (w0z + dz)
            else:
                new[0], new[1], new[2] = rx, ry, rz
                new[3], new[4], new[5] = vx, vy, vz
                new[9], new[10], new[11] = ox, oy, oz
                new[12], new[13], new[14] = wx, wy, wz
            # Suspension: resistance = push + (damping c1 + stiffness c2) acceleration.
            gx, gy, gz = gravity_change(ox, oy, oz, gravity)
            push[0], i0 = implicit_resistance(vehicle, 0, new[0], new[3], rx, vx, next_scale, c1, c2)
            push[1], i1 = implicit_resistance(vehicle, 1, new[1], new[4], ry, vy, next_scale, c1, c2)
            push[2], i2 = implicit_resistance(vehicle, 2, new[2], new[5], rz, vz, next_scale, c1, c2)
            push[3], i3 = implicit_resistance(vehicle, 3, new[9], new[12], ox, wx, next_scale, c1, c2)
            push[4], i4 = implicit_resistance(vehicle, 4, new[10], new[13], oy, wy, next_scale, c1, c2)
            push[5], i5 = implicit_resistance(vehicle, 5, new[11], new[14], oz, wz, next_scale, c1, c2)
            if soft:
                for i in range(6):
                    push[i] = kept[i] * shown[i] + early[i] * load_old[i] + late[i] * push[i]
                i0, i1, i2 = late[0] * i0, late[1] * i1, late[2] * i2
                i3, i4, i5 = late[3] * i3, late[4] * i4, late[5] * i5

            # Arm: acceleration of its centre of mass without that of the vehicle.
            lx, ly, lz = cross(wx, wy, wz, px, py, pz)
            hx, hy, hz = cross(wx, wy, wz, lx + 2.0 * qx, ly + 2.0 * qy, lz + 2.0 * qz)
            hx, hy, hz = hx + sx, hy + sy, hz + sz
            # Its angular velocity, and the rate of its angular momentum without that of the vehicle.
            zx, zy, zz = wx + f1 * ex, wy + f1 * ey, wz + f1 * ez
            dx, dy, dz = cross(wx, wy, wz, ex, ey, ez)
            nx, ny, nz = f2 * ex + f1 * dx, f2 * ey + f1 * dy, f2 * ez + f1 * dz
            slim = along - across
            tip1 = slim * (ux * nx + uy * ny + uz * nz)
            tip2 = slim * (ux * zx + uy * zy + uz * zz)
            dx, dy, dz = cross(zx, zy, zz, ux, uy, uz)
            nx = across * nx + tip1 * ux + tip2 * dx
            ny = across * ny + tip1 * uy + tip2 * dy
            nz = across * nz + tip1 * uz + tip2 * dz

            # Forces, then moments about the vehicle's centre of gravity.
            fx = total * gx - push[0] - m2 * hx
            fy = total * gy - push[1] - m2 * hy
            fz = total * gz - push[2] - m2 * hz
            kx = ixx * wx + ixy * wy + ixz * wz
            ky = ixy * wx + iyy * wy + iyz * wz
            kz = ixz * wx + iyz * wy + izz * wz
            dx, dy, dz = cross(wx, wy, wz, kx, ky, kz)
            # The arm's inertia force and the change of its weight, at its centre of mass.
            jx, jy, jz = m2 * (gx - hx), m2 * (gy - hy), m2 * (gz - gravity - hz)
            mx, my, mz = cross(px, py, pz, jx, jy, jz)
            torque_x = -dx - push[3] + mx - rest_x - nx
            torque_y = -dy - push[4] + my - rest_y - ny
            torque_z = -dz - push[5] + mz - nz

            d0, d1, d2 = total + i0, total + i1, total + i2
            ax, ay, az = fx / d0, fy / d1, fz / d2
            dx, dy, dz = cross(px, py, pz, ax, ay, az)
            w0, w1, w2 = m2 - m2 * m2 / d0, m2 - m2 * m2 / d1, m2 - m2 * m2 / d2
            bx, by, bz = solve3(
                ixx + across + slim * ux * ux + i3 + pz * pz * w1 + py * py * w2,
                iyy + across + slim * uy * uy + i4 + pz * pz * w0 + px * px * w2,
                izz + across + slim * uz * uz + i5 + py * py * w0 + px * px * w1,
                ixy + slim * ux * uy - px * py * w2,
                ixz + slim * ux * uz - px * pz * w1,
                iyz + slim * uy * uz - py * pz * w0,
                torque_x - m2 * dx,
                torque_y - m2 * dy,
                torque_z - m2 * dz,
            )
            dx, dy, dz = cross(px, py, pz, bx, by, bz)
            ax, ay, az = ax + m2 * dx / d0, ay + m2 * dy / d1, az + m2 * dz / d2
            if not exact:
                vx, vy, vz = new[3] + half * ax, new[4] + half * ay, new[5] + half * az
                rx = new[0] + half * half * ax
                ry = new[1] + half * half * ay
                rz = new[2] + half * half * az
                wx, wy, wz = new[12] + half * bx, new[13] + half * by, new[14] + half * bz
                ox = new[9] + half * half * bx
                oy = new[10] + half * half * by
                oz = new[11] + half * half * bz
        if soft and k > 0:
            # The force that the soil passes on at the end of the step, now that the load is known.
            loads = (rx, ry, rz, ox, oy, oz)
            rates = (vx, vy, vz, wx, wy, wz)
            for i in range(6):
                load_new = resistance(vehicle, i, loads[i], rates[i], next_scale)
                shown[i] = kept[i] * shown[i] + early[i] * load_old[i] + late[i] * load_new
        now[0], now[1], now[2], now[3], now[4], now[5] = rx, ry, rz, vx, vy, vz
        now[6], now[7], now[8], now[9], now[10], now[11] = ax, ay, az, ox, oy, oz
        now[12], now[13], now[14], now[15], now[16], now[17] = wx, wy, wz, bx, by, bz
        if final and k > 0:
            out = signals[k // substeps - 1]
            out[:18] = now
            # Eq (1): force and moment of the base on the arm, less those at rest.
            dx, dy, dz = cross(bx, by, bz, px, py, pz)
            fx = m2 * (ax + dx + hx - gx)
            fy = m2 * (ay + dy + hy - gy)
            fz = m2 * (az + dz + hz - gz)
            tip1 = slim * (ux * bx + uy * by + uz * bz)
            mx, my, mz = cross(reach * ux, reach * uy, reach * uz, fx, fy, fz + m2 * gravity)
            out[FORCE], out[FORCE + 1], out[FORCE + 2] = fx, fy, fz
            out[TORQUE] = across * bx + tip1 * ux + nx + mx - reach * u0y * m2 * gravity
            out[TORQUE + 1] = across * by + tip1 * uy + ny + my + reach * u0x * m2 * gravity
            out[TORQUE + 2] = across * bz + tip1 * uz + nz + mz
    state[:18] = now
    for i in range(6):
        state[SOIL_FORCE + i] = shown[i]


@compiled
def _simulate(
    vehicles: FloatArray,
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
        vehicles: The 22 unknowns, or with effects 29 numbers, shape (batch, 22 or 29).
        motion: f, f', f'' at every substep, begin and end included, shape (samples * substeps + 1, 3);
            the same in each mode.
        arm: ``Arm.row()``, shape (5,).
        step: Sampling interval [s].
        substeps: Integration steps within it.

    Returns:
        Signals at the end of each sampling interval, shape (batch, 3, samples, 24).
    """
    vehicles = np.atleast_2d(np.asarray(vehicles, dtype=np.float64))
    full = np.zeros((len(vehicles), VEHICLE))
    full[:, : vehicles.shape[1]] = vehicles
    samples = (len(motion) - 1) // substeps
    result = np.empty((len(full), MODES, samples, SIGNALS))
    _simulate(full, arm, np.ascontiguousarray(motion)[None], step, substeps, result)
    return result
