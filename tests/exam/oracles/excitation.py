"""The shaken vehicle by its momenta, written from docs/excitation.md and the effects' equations.

The linear and angular momentum of all there is, in the inertial frame, change as the ground and gravity
push. The arm is six point masses that have its moments of inertia, the payload a seventh; attitudes are
quaternions. Momenta are differentiated by the complex step, which is exact to rounding, so that no formula
for an acceleration is written down. Integration is adaptive. Nothing here is shared with the simulation that
it is compared with.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.interpolate import make_interp_spline

from exam.oracles import Values, filled
from fieldmodels.arrays import FloatArray, IntArray

NEUTRAL: Values = {
    "payload": {"mass": 0.0},
    "cubic_stiffness": {"force": 0.0, "torque": 0.0},
    "coulomb_friction": {"force": 0.0, "torque": 0.0},
    "stiffness_drift": {"rate": 0.0},
    "soil_compliance": {"share": 0.0},
    "actuator_lag": {"time_constant": 0.0},
    "accelerometer_bias": {"x": 0.0, "y": 0.0, "z": 0.0},
    "accelerometer_gain": {"gain": 1.0},
    "inclinometer_bias": {"pitch": 0.0, "roll": 0.0},
    "inclinometer_delay": {"delay": 0.0},
    "force_torque_gain": {"gain": 1.0},
}
GRAVITY = 9.81
ARM_MASS, REACH = 1.0, 0.245
ACROSS, ALONG = 0.02, 0.001
"""Inertia of the arm about its centre of mass, across and along it [kg m2]."""
FADE = np.repeat([0.002, 0.01], 3)
"""Speeds at which dry friction fades [m/s], [rad/s]."""
LEVI_CIVITA = np.zeros((3, 3, 3))
LEVI_CIVITA[[0, 1, 2], [1, 2, 0], [2, 0, 1]], LEVI_CIVITA[[1, 2, 0], [0, 1, 2], [2, 0, 1]] = 1.0, -1.0
UP = np.array([0.0, 0.0, 1.0])
TINY = 1e-30
"""The complex step."""

RELATIVE, ABSOLUTE = 2e-8, 2e-11
"""Tolerances of the integrator: some 2e-7 of a signal over a second."""

Complex = NDArray[np.complexfloating[Any, Any]]
Motion = Callable[[float], tuple[float, float, float]]


def hat(a: NDArray[Any]) -> NDArray[Any]:
    """Matrices that make of a vector its vector product with a, shape (..., 3, 3)."""
    return np.asarray(np.tensordot(a, -LEVI_CIVITA, 1))


def cross(a: NDArray[Any], b: NDArray[Any]) -> NDArray[Any]:
    """Vector product along the last axis."""
    return np.asarray((hat(a) @ b[..., None])[..., 0])


def summed_cross(a: NDArray[Any], b: NDArray[Any]) -> NDArray[Any]:
    """Sum of vector products over the axis before the last."""
    return np.asarray(np.tensordot(np.swapaxes(a, -1, -2) @ b, LEVI_CIVITA, 2))


def attitude(q: NDArray[Any]) -> NDArray[Any]:
    """Rotation matrices from the vehicle's frame to the inertial one, of its unit quaternions."""
    turn = hat(q[..., 1:])
    return np.asarray(np.eye(3) + 2.0 * (q[..., 0, None, None] * turn + turn @ turn))


def rotation_vector(q: FloatArray) -> FloatArray:
    """Axis times angle of a quaternion [rad]."""
    sine = np.sqrt(q[1:] @ q[1:])
    return q[1:] * (2.0 * np.arctan2(sine, q[0]) / sine if sine > 1e-12 else 2.0)


@dataclass(frozen=True)
class Vehicle:
    """A vehicle with effects, and its arm that turns about one axis.

    Attributes:
        base: The 22 values by name, as ``ExcitationModel`` names them.
        effects: Values of the effects that are on.
        axis: 0, 1, 2: the arm turns about x, y, z.
        rest: Angle of the arm at which the vehicle stands level at rest [rad].
    """

    base: Mapping[str, float]
    effects: Values
    axis: int
    rest: float

    @cached_property
    def given(self) -> Values:
        """Values of every effect."""
        return filled(self.effects, NEUTRAL)

    @cached_property
    def suspension(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Damping, stiffness, hardening and dry friction along and about x, y, z."""
        hardening, dry = (
            np.repeat([self.given[name]["force"], self.given[name]["torque"]], 3)
            for name in ("cubic_stiffness", "coulomb_friction")
        )
        axes = ("x", "y", "z", "pitch", "roll", "yaw")
        damping, stiffness = (
            np.array([self.base[f"{name}_{axis}"] for axis in axes]) for name in ("damping", "stiffness")
        )
        return damping, stiffness, hardening, dry

    @cached_property
    def inertia(self) -> FloatArray:
        """Tensor of the vehicle [kg m2]."""
        own = {axes: self.base[f"inertia_{axes}"] for axes in ("x", "y", "z", "xy", "xz", "yz")}
        return np.array(
            [
                [own["x"], own["xy"], own["xz"]],
                [own["xy"], own["y"], own["yz"]],
                [own["xz"], own["yz"], own["z"]],
            ]
        )

    @cached_property
    def joint(self) -> FloatArray:
        """From the centre of gravity to the arm's joint [m]."""
        return np.array([self.base[f"cg_{axis}"] for axis in ("x", "y", "z")])

    @cached_property
    def masses(self) -> FloatArray:
        """The arm's point masses, and the payload [kg]."""
        return np.array([*np.full(6, ARM_MASS / 6.0), self.given["payload"]["mass"]])

    @cached_property
    def points(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Parts of the point masses' places that stay, and that go with cosine and sine of the angle [m]."""
        pin, rod = np.eye(3)[self.axis], np.eye(3)[2 if self.axis == 1 else 1]
        side = cross(pin, rod)
        long = np.sqrt(3.0 * (ACROSS - 0.5 * ALONG) / ARM_MASS)
        wide = np.sqrt(3.0 * 0.5 * ALONG / ARM_MASS)
        offsets = [long * rod, wide * pin, wide * side]
        placed = REACH * rod + np.array([*offsets, *(-x for x in offsets), REACH * rod])
        along = np.outer(placed @ pin, pin)
        return along, placed - along, cross(pin, placed)

    def momenta(
        self, q: Complex, r: Complex, v: Complex, w: Complex, angle: Complex, rate: Complex
    ) -> tuple[Complex, Complex, Complex, Complex]:
        """Momentum, and angular momentum about the origin, of all and of the arm with its payload.

        Args:
            q: Quaternion of the vehicle, shape (n, 4).
            r: Its centre of gravity [m], shape (n, 3).
            v: Its velocity [m/s].
            w: Its angular velocity in its own frame [rad/s].
            angle: Angle of the arm [rad], shape (n,).
            rate: Its rate [rad/s].
        """
        cosine, sine = np.cos(angle)[:, None, None], np.sin(angle)[:, None, None]
        fixed, even, odd = self.points
        place = self.joint + fixed + cosine * even + sine * odd
        swing = rate[:, None, None] * (cosine * odd - sine * even)
        pushes = self.masses[:, None] * (swing - place @ hat(w))
        turn = attitude(q)
        arm = self.masses.sum() * v + (turn @ pushes.sum(axis=1)[..., None])[..., 0]
        lever = (turn @ (self.masses @ place)[..., None])[..., 0]
        spin = (turn @ summed_cross(place, pushes)[..., None])[..., 0]
        arm_turning = cross(r, arm) + cross(lever, v) + spin
        own = self.base["mass"] * v
        turning = cross(r, own) + (turn @ (w @ self.inertia)[..., None])[..., 0]
        return own + arm, turning + arm_turning, arm, arm_turning

    def drifted(self, time: float) -> float:
        """What a drift makes of a stiffness at a time on the clock, as a factor."""
        return 1.0 + self.given["stiffness_drift"]["rate"] * time

    def resistance(self, time: float, x: FloatArray, v: FloatArray) -> FloatArray:
        """What the suspension resists with at deflections and their rates, along and about x, y, z."""
        damping, stiffness, hardening, dry = self.suspension
        spring = self.drifted(time) * stiffness * x * (1.0 + hardening * x**2)
        return np.asarray(damping * v + spring + dry * v / np.hypot(v, FADE))

    def places(self, angle: float) -> FloatArray:
        """Places of the point masses from the joint [m], shape (7, 3)."""
        fixed, even, odd = self.points
        return np.asarray(fixed + np.cos(angle) * even + np.sin(angle) * odd)

    @cached_property
    def carried(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """At rest: force on the arm's base, torque there, and about the centre of gravity."""
        force = GRAVITY * self.masses.sum() * UP
        torque = cross(self.masses @ self.places(self.rest), GRAVITY * UP)
        return force, torque, torque + cross(self.joint, force)

    def balance(
        self, time: float, state: FloatArray, motion: tuple[float, float, float]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Solve for all accelerations.

        Args:
            time: Time on the clock [s].
            state: Quaternion, place and velocity in the inertial frame, angular velocity in the vehicle's,
                and on soft soil the six forces and torques that it passes on; shape (13,) or (19,).
            motion: Angle of the arm [rad], its rate and its acceleration.

        Returns:
            Rate of the state; force and torque of the arm's base less those at rest, in the vehicle's frame.
        """
        q, r, v, w = state[:4] / np.sqrt(state[:4] @ state[:4]), state[4:7], state[7:10], state[10:13]
        angle, rate, acceleration = motion
        spin = 0.5 * np.concatenate([[-q[1:] @ w], q[0] * w + cross(q[1:], w)])
        # Row 0 goes along with time while v and w stay; rows 1 to 6 change one component of these.
        first, others = 1j * TINY * np.eye(7)[:, :1], 1j * TINY * np.eye(7)[:, 1:]
        slopes = [
            part.imag / TINY
            for part in self.momenta(
                q + first * spin,
                r + first * v,
                v + others[:, :3],
                w + others[:, 3:],
                angle + first[:, 0] * rate,
                rate + first[:, 0] * acceleration,
            )
        ]
        turn = attitude(q)
        load = self.resistance(
            time, np.concatenate([r @ turn, rotation_vector(q)]), np.concatenate([v @ turn, w])
        )
        resisted, yielding = load, state[13:]
        share = self.given["soil_compliance"]["share"]
        if share > 0.0:
            damping, stiffness, *_ = self.suspension
            lag = share / (1.0 + share) * damping / (stiffness * self.drifted(time))
            resisted = state[13:]
            yielding = (load / (1.0 + share) - resisted) / lag
        # The ground carries in the vehicle's frame what it carried at rest, and the suspension's change.
        weight, torque_at_rest, moment_at_rest = self.carried
        own = self.base["mass"] * GRAVITY * UP
        ground = turn @ (own + weight - resisted[:3])
        pull = cross(turn @ (self.masses @ (self.joint + self.places(angle))), -GRAVITY * UP)
        pull = pull + cross(r, -weight)
        force = ground - own - weight
        moment = cross(r, ground - own) + turn @ (moment_at_rest - resisted[3:]) + pull
        change = np.linalg.solve(
            np.vstack([slopes[0][1:].T, slopes[1][1:].T]),
            np.concatenate([force - slopes[0][0], moment - slopes[1][0]]),
        )
        push = slopes[2][0] + change @ slopes[2][1:] + weight
        twist = slopes[3][0] + change @ slopes[3][1:] - pull - cross(r + turn @ self.joint, push)
        return (
            np.concatenate([spin, v, change, yielding]),
            push @ turn - weight,
            twist @ turn - torque_at_rest,
        )


@dataclass(frozen=True)
class Run:
    """What a vehicle did, in its own frame, at given times.

    Attributes:
        time: Times [s], shape (n,).
        place: Displacement [m], shape (n, 3).
        velocity: Its rate [m/s].
        acceleration: Its second rate [m/s2].
        angle: Rotation vector [rad].
        rate: Angular velocity [rad/s].
        turning: Angular acceleration [rad/s2].
        force: Of the arm's base, less that at rest [N].
        torque: The same [N m].
        gravity: Change of gravity's components [m/s2].
    """

    time: FloatArray
    place: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    angle: FloatArray
    rate: FloatArray
    turning: FloatArray
    force: FloatArray
    torque: FloatArray
    gravity: FloatArray


def shake(
    vehicle: Vehicle, motion: Motion, times: FloatArray, stops: Sequence[float] = (), began: float = 0.0
) -> Run:
    """Shake a vehicle from rest.

    Args:
        vehicle: The vehicle.
        motion: Commanded angle of the arm and its two derivatives at a time since the beginning.
        times: When the run is looked at [s], rising from the beginning, which is 0.
        stops: Where a derivative of the command may jump [s].
        began: Time on the clock at the beginning [s], which a drift goes by.
    """
    edges = [0.0, *(t for t in sorted(stops) if 0.0 < t < times[-1]), float(times[-1])]
    arm = lagged(motion, vehicle.given["actuator_lag"]["time_constant"], edges)
    state = np.zeros(19 if vehicle.given["soil_compliance"]["share"] > 0.0 else 13)
    state[0] = 1.0
    states = [state]
    for first, last in pairwise(edges):
        wanted = times[(times > first) & (times <= last)]
        found = solve_ivp(
            lambda t, y: vehicle.balance(began + t, y, arm(t))[0],
            (first, last),
            state,
            method="DOP853",
            t_eval=np.union1d(wanted, [last]),
            rtol=RELATIVE,
            atol=ABSOLUTE,
        )
        state = found.y[:, -1]
        states += list(found.y.T[: len(wanted)])
    rows = []
    for time, y in zip(times, states, strict=True):
        change, force, torque = vehicle.balance(began + time, y, arm(time))
        q = y[:4] / np.sqrt(y[:4] @ y[:4])
        turn, down = attitude(q), -GRAVITY * UP
        inertial = (y[4:7] @ turn, y[7:10] @ turn, change[7:10] @ turn)
        rows.append(
            (*inertial, rotation_vector(q), y[10:13], change[10:13], force, torque, down @ turn - down)
        )
    return Run(times, *(np.array(column) for column in zip(*rows, strict=True)))


def lagged(motion: Motion, lag: float, edges: Sequence[float]) -> Motion:
    """What an arm makes of its commands: ``lag df/dt = command - f``.

    It begins in the motion that its first commands would have led to: at rest where they rest, else as far
    behind as a steady motion leaves it.
    """
    if lag == 0.0:
        return motion
    angle, rate, acceleration = motion(0.0)
    parts: list[Any] = []
    begun = angle - lag * (rate - lag * acceleration)
    for first, last in pairwise(edges):
        found = solve_ivp(
            lambda t, f: (motion(t)[0] - f) / lag,
            (first, last),
            [begun],
            method="DOP853",
            dense_output=True,
            rtol=1e-12,
            atol=1e-14,
        )
        parts.append(found.sol)
        begun = float(found.y[0, -1])

    def arm(time: float) -> tuple[float, float, float]:
        part = parts[max(int(np.searchsorted(edges, time)) - 1, 0)]
        angle, rate, _ = motion(time)
        own = float(part(time)[0])
        later = (angle - own) / lag
        return own, later, (rate - later) / lag

    return arm


def shown(given: Values, run: Run, now: IntArray, late: IntArray) -> FloatArray:
    """What the sensors show, shape (n, 11).

    Args:
        given: Values of every effect.
        run: The run.
        now: Which of its times are the samples, shape (n,).
        late: Which of them are those that the inclinometer shows.
    """
    specific = given["accelerometer_gain"]["gain"] * (run.acceleration - run.gravity)
    specific += [given["accelerometer_bias"][axis] for axis in ("x", "y", "z")]
    tilt = run.angle[late, :2] + [given["inclinometer_bias"][turn] for turn in ("pitch", "roll")]
    forces = given["force_torque_gain"]["gain"] * np.hstack([run.force, run.torque])
    return np.hstack([specific[now], tilt, forces[now]])


def features(given: Values, run: Run, now: IntArray, late: IntArray) -> FloatArray:
    """What the environment's filter makes of its sensors: the features of eq (4), shape (n, 30).

    Specific force (gravity's change less acceleration), dr', dr, w', products and squares of w, w, the
    rotation vector, dF, dN. dr' and dr are integrals of the accelerometer that are zeroed at rest, and so
    without its bias; what the inclinometer shows late, its derivatives show late.
    """
    readings = shown(given, run, now, late)
    gain = given["accelerometer_gain"]["gain"]
    w = run.rate[late]
    tilt = np.column_stack([readings[:, 3:5], run.angle[late, 2]])
    products = w[:, [1, 0, 0]] * w[:, [2, 2, 1]]
    moved = gain * np.hstack([run.velocity[now], run.place[now]])
    return np.hstack([-readings[:, :3], moved, run.turning[late], products, w**2, w, tilt, readings[:, 5:]])


def blended(commands: FloatArray, decision: float = 0.4) -> tuple[Motion, list[float]]:
    """The arm's motion f = a0 + a sin(phi), phi' = w, and when its higher derivatives jump.

    Args:
        commands: Amplitude [rad], frequency [rad/s] and offset [rad] at the ends of the decisions, the first
            in force before them at phase 0, shape (decisions + 1, 3). Each passes to the next along
            10 s^3 - 15 s^4 + 6 s^5.
        decision: Length of a decision [s].
    """
    phase, parts = 0.0, []
    for before, after in pairwise(commands):
        passing = Polynomial([0.0, 0.0, 0.0, 10.0, -15.0, 6.0])(Polynomial([0.0, 1.0 / decision]))
        a, w, a0 = (p + (n - p) * passing for p, n in zip(before, after, strict=True))
        phi = w.integ() + phase
        parts.append((a, phi, a0))
        phase = phi(decision)

    def motion(time: float) -> tuple[float, float, float]:
        number = min(int(time / decision), len(parts) - 1)
        (a, phi, a0), t = parts[number], time - number * decision
        sine, cosine = np.sin(phi(t)), np.cos(phi(t))
        w = phi.deriv()
        return (
            a0(t) + a(t) * sine,
            a0.deriv()(t) + a.deriv()(t) * sine + a(t) * w(t) * cosine,
            a0.deriv(2)(t)
            + (a.deriv(2)(t) - a(t) * w(t) ** 2) * sine
            + (2.0 * a.deriv()(t) * w(t) + a(t) * w.deriv()(t)) * cosine,
        )

    return motion, [decision * k for k in range(1, len(parts))]


def times_seen(vehicle: Vehicle, times: FloatArray) -> tuple[FloatArray, IntArray, IntArray]:
    """Times at which a run is needed, and which of them are the given ones and a delay before them.

    Before the beginning the vehicle is at rest, as at the beginning.
    """
    delayed = np.maximum(times - vehicle.given["inclinometer_delay"]["delay"], 0.0)
    every, inverse = np.unique(np.concatenate([times, delayed]), return_inverse=True)
    return every, inverse[: len(times)], inverse[len(times) :]


def simulate(
    base: Mapping[str, float],
    effects: Values,
    commands: FloatArray,
    step: float,
    start: Mapping[str, float] | None = None,
) -> FloatArray:
    """Work out what ``ExcitationModel`` describes; see ``Simulate``.

    Args:
        base: The 22 values.
        effects: Values of the effects that are on.
        commands: Angle of the arm [rad], smooth between the samples, and its axis (1, 2, 3).
        step: Sampling interval [s].
        start: ``time`` [s] of the first sample (default: 0), when the vehicle is at rest.
    """
    times = step * np.arange(float(len(commands)))
    spline = make_interp_spline(times, commands[:, 0], k=5)
    rate, acceleration = spline.derivative(), spline.derivative(2)
    vehicle = Vehicle(base, effects, int(commands[0, 1]) - 1, float(commands[0, 0]))

    def motion(time: float) -> tuple[float, float, float]:
        return float(spline(time)), float(rate(time)), float(acceleration(time))

    every, now, late = times_seen(vehicle, times)
    run = shake(vehicle, motion, every, began=(start or {}).get("time", 0.0))
    return shown(vehicle.given, run, now, late)
