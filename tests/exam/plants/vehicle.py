"""A vehicle on its suspension, shaken by its arm: Newton and Euler in the vehicle's frame.

Unknown are the acceleration of its centre of gravity and the angular one; arm and payload hang on its joint
with a prescribed angle. Attitude is a rotation vector. Written from docs/excitation.md and the
effects' equations, for many runs side by side: vectors have the shape (3, runs).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.signal import lfilter

from exam.plants.faults import Fault
from fieldmodels.arrays import FloatArray

Rng = np.random.Generator
Values = Mapping[str, float]
Load = Callable[[float, FloatArray, FloatArray], FloatArray]
"""(time, deflections (6, runs), their rates) to what the suspension resists with beside its own."""
GRAVITY, ARM, REACH, ACROSS, ALONG = 9.81, 1.0, 0.245, 0.02, 0.001
BODY: Mapping[str, float] = {
    "mass": 3.0, "inertia_x": 0.15, "inertia_y": 0.10, "inertia_z": 0.20, "inertia_xz": 0.0,
    "inertia_yz": 0.03, "inertia_xy": 0.0, "cg_x": 0.01, "cg_y": 0.3, "cg_z": 0.1,
}  # fmt: skip
"""What scales and drawings say (Table I)."""
AXES = ("x", "y", "z", "pitch", "roll", "yaw")
DAMPING, STIFFNESS = (20.0, 20.0, 30.0, 2.0, 2.0, 3.0), (1000.0, 1000.0, 1500.0, 60.0, 50.0, 80.0)
"""Of the soft suspension along and about x, y, z."""
FADE = np.repeat([0.002, 0.01], 3)[:, None]
NOISE = (*[0.02] * 3, *[0.002] * 2, *[0.05] * 3, *[0.1] * 3)
"""Of accelerometer [m/s2], inclinometer [rad], force [N] and torque [N m]."""
FINE = 40
"""Points in a sample at which the arm's command is evaluated."""


@dataclass
class Vehicle:
    """Vehicles side by side with what is wrong with them, the same in all.

    Attributes:
        damping: Shape (6, runs).
        stiffness: The same.
        payload: At the arm's tip [kg].
        hardening: Cubic share of the stiffness, shape (6, 1).
        dry: Dry friction, the same.
        drift: Of the stiffness [1/s].
        soil: Share of the suspension's stiffness that the soil takes.
        lag: Of the arm [s].
        delay: Of the inclinometer [s].
        loads: Further resistance of the suspension.
        arm: What becomes of the arm's angle.
        sensors: What becomes of what is shown, (samples, 11, runs) by times (samples,).
        body: What scales and drawings say.
        began: Time at which a run begins, by which the stiffness drifts [s].
        moving: Whether the arm already moves then, as far behind its command as a steady motion leaves it.
        finer: By what the steps are shorter.
        path: What the last runs did: deflection, its rate, angular acceleration and velocity, and rotation
            vector in the vehicle's frame, (samples, 15, runs).
    """

    damping: FloatArray
    stiffness: FloatArray
    payload: float = 0.0
    hardening: FloatArray = field(default_factory=lambda: np.zeros((6, 1)))
    dry: FloatArray = field(default_factory=lambda: np.zeros((6, 1)))
    drift: float = 0.0
    soil: float = 0.0
    lag: float = 0.0
    delay: float = 0.0
    loads: list[Load] = field(default_factory=list)
    arm: list[Callable[[FloatArray], FloatArray]] = field(default_factory=list)
    sensors: list[Callable[[FloatArray, FloatArray], FloatArray]] = field(default_factory=list)
    body: Mapping[str, float] = field(default_factory=lambda: BODY)
    began: float = 0.0
    moving: bool = False
    finer: int = 1
    path: FloatArray = field(default_factory=lambda: np.zeros((0, 15, 1)))

    @property
    def steps(self) -> int:
        """Steps of the integration in a sample."""
        return self.finer * (2 if self.dry.any() or self.soil or self.delay else 1)

    def resistance(self, time: float, x: FloatArray, v: FloatArray) -> FloatArray:
        """What the suspension resists with."""
        stiff = self.stiffness * (1.0 + self.drift * time)
        total = self.damping * v + stiff * (x + self.hardening * x**3) + self.dry * v / np.hypot(v, FADE)
        for load in self.loads:
            total = total + load(time, x, v)
        return np.asarray(total)


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Vector products, components first."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def turned(angle: FloatArray, vector: FloatArray) -> FloatArray:
    """Vectors of the inertial frame in that of a vehicle with a rotation vector (Rodrigues)."""
    size = np.sqrt((angle * angle).sum(axis=0)) + 1e-30
    axis = angle / size
    along = (axis * vector).sum(axis=0) * axis
    return np.asarray(along + np.cos(size) * (vector - along) - np.sin(size) * cross(axis, vector))


class _Runs:
    """The equations of motion, for arms that turn about the axes of ``modes``."""

    def __init__(self, vehicle: Vehicle, modes: FloatArray, rest: FloatArray) -> None:
        count, self.vehicle = len(modes), vehicle
        self.pin = np.eye(3)[:, modes.astype(int)]
        rods = np.eye(3)[:, [2 if mode == 1 else 1 for mode in modes.astype(int)]]
        self.rod, self.side = rods, cross(self.pin, rods)
        self.up = np.repeat([[0.0], [0.0], [1.0]], count, axis=1)
        i = vehicle.body
        self.joint = np.repeat([[i[f"cg_{a}"]] for a in "xyz"], count, axis=1)
        self.inertia = np.array([
            [i["inertia_x"], i["inertia_xy"], i["inertia_xz"]],
            [i["inertia_xy"], i["inertia_y"], i["inertia_yz"]],
            [i["inertia_xz"], i["inertia_yz"], i["inertia_z"]],
        ])  # fmt: skip
        self.carried = ARM + vehicle.payload
        self.moment = GRAVITY * (ARM + 2.0 * vehicle.payload) * cross(self.along(rest) * REACH, self.up)
        self.at_rest = self.moment + GRAVITY * self.carried * cross(self.joint, self.up)

    def along(self, angle: FloatArray) -> FloatArray:
        """Direction of the arm."""
        return np.asarray(np.cos(angle) * self.rod + np.sin(angle) * self.side)

    def accelerations(
        self, resisted: FloatArray, tilt: FloatArray, w: FloatArray, arm: tuple[FloatArray, ...]
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Acceleration and angular acceleration; force and torque on the arm's base less those at rest."""
        angle, rate, faster = arm
        rod = self.along(angle)
        gravity = GRAVITY * turned(tilt, self.up)
        mass, swing = self.vehicle.body["mass"], rate * self.pin
        total, first, moment = mass, np.zeros_like(w), np.zeros_like(w)
        pushes, block = mass * gravity, np.repeat(self.inertia[:, :, None], w.shape[1], axis=2)
        parts = []
        for part, lever in ((ARM, REACH * rod), (self.vehicle.payload, 2.0 * REACH * rod)):
            if not part:
                continue
            place, moving = self.joint + lever, cross(swing, lever)
            own = cross(w, cross(w, place)) + 2.0 * cross(w, moving)
            own = own + faster * cross(self.pin, lever) + cross(swing, moving) + gravity
            total, first, pushes = total + part, first + part * place, pushes + part * own
            moment = moment + part * cross(place, own)
            block = block + part * (
                (place * place).sum(axis=0) * np.eye(3)[:, :, None] - place[:, None] * place[None]
            )
            parts.append((part, lever, place, own))
        # The rod's own inertia, in the vehicle's frame.
        spread = ACROSS * np.eye(3)[:, :, None] - (ACROSS - ALONG) * rod[:, None] * rod[None]
        turning = w + swing
        spin = faster * self.pin + cross(w, swing)

        def rod_moment(angular: FloatArray) -> FloatArray:
            momentum = np.einsum("ijr,jr->ir", spread, turning)
            return np.asarray(np.einsum("ijr,jr->ir", spread, angular) + cross(turning, momentum))

        ground = (mass + self.carried) * GRAVITY * self.up - resisted[:3]
        torque = self.at_rest - resisted[3:] - cross(w, self.inertia @ w) - moment - rod_moment(spin)
        force = ground - pushes
        # total a + D x first = force;  first x a + (block + spread) D = torque
        system = block + spread + (
            first[:, None] * first[None] - (first * first).sum(axis=0) * np.eye(3)[:, :, None]
        ) / total  # fmt: skip
        right = torque - cross(first, force) / total
        angular = np.linalg.solve(system.transpose(2, 0, 1), right.T[:, :, None])[:, :, 0].T
        linear = (force - cross(angular, first)) / total
        pull, twist = np.zeros_like(w), rod_moment(spin + angular)
        for part, lever, place, own in parts:
            one = part * (linear + cross(angular, place) + own)
            pull, twist = pull + one, twist + cross(lever, one)
        return linear, angular, pull - GRAVITY * self.carried * self.up, twist - self.moment


def simulate(
    vehicle: Vehicle, modes: FloatArray, commands: FloatArray, noise: FloatArray, step: float
) -> FloatArray:
    """Shake vehicles from rest.

    Args:
        vehicle: The vehicles, all with the same faults.
        modes: 0, 1, 2: about which axis each arm turns, shape (runs,).
        commands: Angle of each arm [rad], ``FINE`` of them a sample, from rest, shape (n FINE + 1, runs).
        noise: Of the sensors, shape (n, 11, runs).
        step: Sampling interval [s].

    Returns:
        Acceleration, tilt, force and torque as shown, shape (n, 11, runs).
    """
    angle, rate, faster = arm_motion(vehicle, commands, step / FINE)
    steps = vehicle.steps
    runs, h = _Runs(vehicle, modes, commands[0] if vehicle.moving else angle[0]), step / steps
    stride = FINE // (2 * steps)
    count, size = len(noise), len(modes)
    zero = np.zeros((3, size))
    x, tilt, v, w = zero, zero, zero, zero
    soft, resisted, load = vehicle.soil > 0.0, np.zeros((6, size)), np.zeros((6, size))
    shown, tilts = np.zeros((count, 11, size)), np.zeros((count * steps + 1, 3, size))
    vehicle.path = np.zeros((count, 15, size))

    def slopes(time: float, arm: int, span: float, *state: FloatArray) -> tuple[FloatArray, ...]:
        at, turn, moves, spins = state
        aim = vehicle.resistance(time, np.vstack([turned(turn, at), turn]),
                                 np.vstack([turned(turn, moves), spins]))  # fmt: skip
        force = _yielded(vehicle, time, resisted, load, aim, span) if soft else aim
        motion = angle[arm], rate[arm], faster[arm]
        linear, angular, pull, twist = runs.accelerations(force, turn, spins, motion)
        return moves, _rotation_rate(turn, spins), turned(-turn, linear), angular, linear, pull, twist, aim

    for k in range(count * steps):
        now, row, state = vehicle.began + k * h, 2 * k * stride, (x, tilt, v, w)
        a = slopes(now, row, 0.0, *state)
        if k % steps == 0:
            gravity = GRAVITY * (turned(tilt, runs.up) - runs.up)
            shown[k // steps] = np.vstack([a[4] + gravity, tilt[:2], a[5], a[6]])
            vehicle.path[k // steps] = np.vstack([turned(tilt, x), turned(tilt, v), a[3], w, tilt])
        tilts[k] = tilt
        b = slopes(now + h / 2, row + stride, h / 2, *(s + h / 2 * d for s, d in zip(state, a, strict=False)))
        c = slopes(now + h / 2, row + stride, h / 2, *(s + h / 2 * d for s, d in zip(state, b, strict=False)))
        d = slopes(now + h, row + 2 * stride, h, *(s + h * e for s, e in zip(state, c, strict=False)))
        x, tilt, v, w = (
            s + h / 6.0 * (e + 2.0 * (f + g) + i)
            for s, e, f, g, i in zip(state, a, b, c, d, strict=False)
        )  # fmt: skip
        if soft:
            aim = vehicle.resistance(now + h, np.vstack([turned(tilt, x), tilt]),
                                     np.vstack([turned(tilt, v), w]))  # fmt: skip
            resisted, load = _yielded(vehicle, now + h, resisted, load, aim, h), aim
    tilts[-1] = tilt
    times = np.arange(count) * step
    if vehicle.delay:
        place: FloatArray = np.maximum(times - vehicle.delay, 0.0) / h
        low = np.minimum(place.astype(int), count * steps - 1)
        share = (place - low)[:, None, None]
        shown[:, 3:5] = (1.0 - share) * tilts[low, :2] + share * tilts[low + 1, :2]
    for sensor in vehicle.sensors:
        shown = sensor(shown, times.astype(np.float64))
    return np.asarray(shown + noise)


def _yielded(
    vehicle: Vehicle, time: float, before: FloatArray, load: FloatArray, aim: FloatArray, span: float
) -> FloatArray:
    """What soft soil passes on after a time in which the load goes from one value to another, linearly."""
    if span == 0.0:
        return before
    share = vehicle.soil
    lag = share / (1.0 + share) * vehicle.damping / (vehicle.stiffness * (1.0 + vehicle.drift * time))
    fade = np.exp(-span / lag)
    first, last = load / (1.0 + share), aim / (1.0 + share)
    return np.asarray(
        fade * before + (1.0 - fade) * first + (last - first) * (1.0 - (1.0 - fade) * lag / span)
    )


def _rotation_rate(angle: FloatArray, w: FloatArray) -> FloatArray:
    """Rate of a rotation vector at an angular velocity in the vehicle's frame."""
    square = (angle * angle).sum(axis=0)
    size = np.sqrt(square) + 1e-12
    rest = np.where(size > 1e-3, (1.0 - 0.5 * size / np.tan(0.5 * size)) / size**2, 1.0 / 12.0)
    once = cross(angle, w)
    return np.asarray(w + 0.5 * once + rest * cross(angle, once))


def arm_motion(vehicle: Vehicle, commands: FloatArray, step: float) -> tuple[FloatArray, ...]:
    """Angle, rate and acceleration of arms that are commanded so [rad], shape (points, runs) each."""
    angle = commands
    for change in vehicle.arm:
        angle = change(angle)
    rate = np.gradient(angle, step, axis=0, edge_order=2)
    parts = angle, rate, np.gradient(rate, step, axis=0, edge_order=2)
    if not vehicle.lag:
        return parts
    # Rates of what lags are lagging rates, as all begins at rest; commands are straight between two points.
    fade = math.exp(-step / vehicle.lag)
    late = vehicle.lag / step * (1.0 - fade)
    driven = [(1.0 - fade) * one[:-1] + (1.0 - late) * np.diff(one, axis=0) for one in parts]
    begin = [one[:1] for one in parts]
    if vehicle.moving:
        begin[1] = begin[1] - vehicle.lag * begin[2]
        begin[0] = begin[0] - vehicle.lag * begin[1]
    return tuple(
        np.vstack([one, lfilter([1.0], [1.0, -fade], to, axis=0, zi=fade * one)[0]])
        for one, to in zip(begin, driven, strict=True)
    )


def shaking(duration: float, step: float, rng: Rng) -> FloatArray:
    """An arm's angle [rad] from rest: five sines that set in within a second, shape (points,)."""
    time = np.arange(round(duration / step) + 1) * step
    pulses = np.geomspace(1.0, 11.0, 5) * rng.uniform(0.9, 1.1, 5)
    phases, sizes = rng.uniform(0.0, 2.0 * math.pi, 5), rng.uniform(0.5, 1.0, 5) / pulses
    sizes *= 20.0 / (sizes * pulses**2).sum()  # never faster than 25 rad/s2, nearly
    begun = np.minimum(time, 1.0)
    rise = begun**3 * (10.0 - 15.0 * begun + 6.0 * begun**2)
    waves = np.sin(np.outer(time, pulses) + phases) @ np.minimum(sizes, 0.6)
    return np.asarray(rng.uniform(-0.7, 0.7) + rise * waves)


def install(vehicle: Vehicle, effects: Mapping[str, Values]) -> None:
    """Let listed effects act, in the documented order: gains before biases."""
    for name in LISTED:
        if name not in effects:
            continue
        values = effects[name]
        if name in ("cubic_stiffness", "coulomb_friction"):
            both = np.repeat([values["force"], values["torque"]], 3)[:, None]
            setattr(vehicle, {"cubic_stiffness": "hardening", "coulomb_friction": "dry"}[name], both)
        elif name in NUMBERS:
            setattr(vehicle, NUMBERS[name], next(iter(values.values())))
        else:
            gain, bias = values.get("gain", 1.0), [v for key, v in values.items() if key != "gain"] or [0.0]
            vehicle.sensors.append(_scale(SHOWN[name], gain, np.array(bias)[:, None]))


def _scale(rows: slice, gain: float, bias: FloatArray) -> Callable[[FloatArray, FloatArray], FloatArray]:
    def change(shown: FloatArray, _times: FloatArray) -> FloatArray:
        result = shown.copy()
        result[:, rows] = gain * result[:, rows] + bias
        return result

    return change


NUMBERS = {
    "payload": "payload", "stiffness_drift": "drift", "soil_compliance": "soil", "actuator_lag": "lag",
    "inclinometer_delay": "delay",
}  # fmt: skip
SHOWN = {
    "accelerometer_gain": slice(0, 3), "accelerometer_bias": slice(0, 3), "inclinometer_bias": slice(3, 5),
    "force_torque_gain": slice(5, 11),
}  # fmt: skip
LISTED = ("cubic_stiffness", "coulomb_friction", *NUMBERS, *SHOWN)
VehicleFault = Fault[Vehicle, float]
"""The scale of a run is its duration [s]."""


def _suspension(over: str) -> tuple[str, ...]:
    """Curves of the suspension along and about every axis over something of its own deflection."""
    along = [f"force suspension along {a} over {over.format(f'deflection {a}')}" for a in AXES[:3]]
    return (*along, *(f"force suspension in {a} over {over.format(a)}" for a in AXES[3:]))


OF_HEIGHT = ("force suspension along z over deflection z",)
OF_ARM = ("force arm's angle|arm's way from rest over arm angle",)


def _only(row: int, values: Any) -> FloatArray:
    result = np.zeros((6, np.shape(values)[-1]))
    result[row] = values
    return result


def _one_way_spring(vehicle: Vehicle, k: float, _s: float, _rng: Rng) -> None:
    vehicle.loads.append(lambda _t, x, _v: _only(2, 50.0 * k * np.minimum(x[2], 0.0)))


def _arm_cubic(vehicle: Vehicle, k: float, _s: float, _rng: Rng) -> None:
    vehicle.arm.append(lambda f: f + 0.005 * k * f**3)


def _tilted_accelerometer(vehicle: Vehicle, k: float, _s: float, _rng: Rng) -> None:
    def tilt(shown: FloatArray, _times: FloatArray) -> FloatArray:
        result = shown.copy()
        result[:, 0] += 0.01 * k * shown[:, 2]
        return result

    vehicle.sensors.append(tilt)


def _swinging_spring(vehicle: Vehicle, k: float, s: float, rng: Rng) -> None:
    phase, stiff = rng.uniform(0.0, 2.0 * math.pi), 0.02 * k * vehicle.stiffness
    vehicle.loads.append(lambda t, x, _v: stiff * x * math.sin(6.0 * math.pi * t / s + phase))


def _bent_force_sensor(vehicle: Vehicle, k: float, _s: float, _rng: Rng) -> None:
    def bend(shown: FloatArray, _times: FloatArray) -> FloatArray:
        result = shown.copy()
        result[:, 5:8] += 1e-3 * k * shown[:, 5:8] ** 3 / 10.0
        return result

    vehicle.sensors.append(bend)


def _hot_dampers(vehicle: Vehicle, k: float, s: float, _rng: Rng) -> None:
    vehicle.loads.append(lambda t, _x, v: -(1.0 - math.exp(-0.05 * k)) * vehicle.damping * v * t / s)


def _bump_stop(vehicle: Vehicle, k: float, _s: float, _rng: Rng) -> None:
    vehicle.loads.append(lambda _t, x, _v: _only(2, 500.0 * k * np.maximum(np.abs(x[2]) - 0.002, 0.0)
                                                 * np.sign(x[2])))  # fmt: skip


def _arm_scale(vehicle: Vehicle, k: float, _s: float, _rng: Rng) -> None:
    vehicle.arm.append(lambda f: f[:1] + (1.0 + 0.01 * k) * (f - f[:1]))


def _drifting_tilt(vehicle: Vehicle, k: float, s: float, _rng: Rng) -> None:
    def drift(shown: FloatArray, times: FloatArray) -> FloatArray:
        result = shown.copy()
        result[:, 3] += 0.001 * k * (times / s)[:, None]
        return result

    vehicle.sensors.append(drift)


def _deaf_torque(vehicle: Vehicle, k: float, _s: float, _rng: Rng) -> None:
    def band(shown: FloatArray, _times: FloatArray) -> FloatArray:
        result, width = shown.copy(), 0.02 * k
        result[:, 8:11] = np.sign(shown[:, 8:11]) * np.maximum(np.abs(shown[:, 8:11]) - width, 0.0)
        return result

    vehicle.sensors.append(band)


DEVELOP: Mapping[str, VehicleFault] = {
    "hot_dampers": Fault(
        "The damping fades.",
        _hot_dampers,
        shows=(*_suspension("rate of {}*time"), *(f"parameter damping {a} over time" for a in AXES)),
    ),
    "bump_stop": Fault("A rubber stop ends the suspension's travel.", _bump_stop, shows=OF_HEIGHT),
    "arm_scale": Fault("The arm turns too far.", _arm_scale, ("arm_angle_gain",), shows=OF_ARM),
    "drifting_tilt": Fault(
        "The inclinometer drifts.", _drifting_tilt, ("drift",), shows=("sensor pitch over time",)
    ),
    "deaf_torque": Fault(
        "The torque sensor does not feel small torques.",
        _deaf_torque,
        shows=tuple(f"sensor torque {a} over torque {a}" for a in "xyz"),
    ),
    "one_way_spring": Fault(
        "The suspension is stiffer when it is pressed.", _one_way_spring, shows=OF_HEIGHT
    ),
    "arm_cubic": Fault("The arm's angle is off by a cubic.", _arm_cubic, ("arm_angle_bend",), shows=OF_ARM),
    "tilted_accelerometer": Fault(
        "Its axis x feels axis z.",
        _tilted_accelerometer,
        shows=("sensor acceleration x over acceleration z",),
    ),
    "swinging_spring": Fault(
        "The stiffness swings slowly.",
        _swinging_spring,
        shows=(*_suspension("{}*time"), *(f"parameter stiffness {a} over time" for a in AXES)),
    ),
    "bent_force_sensor": Fault(
        "The force sensor is bent by a cubic.",
        _bent_force_sensor,
        ("bend",),
        shows=tuple(f"sensor force {a} over force {a}" for a in "xyz"),
    ),
}
"""To develop a diagnosis on."""


def _square_damping(vehicle: Vehicle, k: float, _s: float, _rng: Rng) -> None:
    vehicle.loads.append(lambda _t, _x, v: k * vehicle.damping * v * np.abs(v))


def _coupled_springs(vehicle: Vehicle, k: float, _s: float, _rng: Rng) -> None:
    vehicle.loads.append(lambda _t, x, _v: _only(0, 2.0 * k * x[4]) + _only(4, 2.0 * k * x[0]))


def _arm_ripple(vehicle: Vehicle, k: float, _s: float, rng: Rng) -> None:
    phase = rng.uniform(0.0, 2.0 * math.pi)
    vehicle.arm.append(lambda f: f + 0.001 * k * (np.sin(8.0 * f + phase) - np.sin(8.0 * f[:1] + phase)))


def _slow_accelerometer(vehicle: Vehicle, k: float, _s: float, _rng: Rng) -> None:
    share = math.exp(-4.0 / k)

    def lag(shown: FloatArray, _times: FloatArray) -> FloatArray:
        result = shown.copy()
        result[:, :3] = lfilter([1.0 - share], [1.0, -share], shown[:, :3], axis=0)
        return result

    vehicle.sensors.append(lag)


def _force_crosstalk(vehicle: Vehicle, k: float, _s: float, _rng: Rng) -> None:
    def cross_talk(shown: FloatArray, _times: FloatArray) -> FloatArray:
        result = shown.copy()
        result[:, 5] += 0.02 * k * shown[:, 9]
        return result

    vehicle.sensors.append(cross_talk)


REPORT: Mapping[str, VehicleFault] = {
    "square_damping": Fault(
        "Damping grows with the square of the speed.", _square_damping, shows=_suspension("rate of {}")
    ),
    "coupled_springs": Fault(
        "Roll pushes sideways.",
        _coupled_springs,
        shows=("force suspension along x over roll", "force suspension in roll over deflection x"),
    ),
    "arm_ripple": Fault("The arm's gear errs with its angle by a wave.", _arm_ripple, shows=OF_ARM),
    "slow_accelerometer": Fault(
        "The accelerometer lags.",
        _slow_accelerometer,
        ("lag", "delay"),
        shows=tuple(
            f"sensor acceleration {a} over {word} of acceleration {a}"
            for a in "xyz"
            for word in ("past", "rate")
        ),
    ),
    "felt_torque": Fault(
        "The force sensor's x feels torque about y.",
        _force_crosstalk,
        shows=("sensor force x over torque y",),
    ),
}
"""To report on: no kind of the other set."""
