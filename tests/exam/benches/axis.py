"""The benches of one axis: rig, pendulum, propeller arm, and a joint under position control."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import ClassVar
from zlib import crc32

import numpy as np

from exam.benches.base import Bench, Conditions, Hidden, Log, noisy
from exam.plants import axis_listed, axis_unlisted, lookalikes
from exam.plants.axis import Axis, Control, Joint, simulate
from exam.plants.axis_unlisted import Scale
from exam.plants.commands import COMMANDS, POOR, path
from exam.plants.noise import NOISES, noise
from exam.plants.ruler import Ruler, Windows
from fieldmodels.arrays import FloatArray
from fieldmodels.recording import Recording

DURATION, STEP = 30.0, 0.01
DECADES = (1e-6, 1e-3, 1e3, 1e6)
PACES = (0.1, 0.3, 3.0, 10.0, 100.0)
FACTORS = (0.0, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1, 1.0)


class AxisBench(Bench):
    """An axis that is driven and watched, its velocity mostly, too.

    Attributes:
        nominal: Base parameters about which a machine's are drawn.
        sizes: Typical sizes.
        noise: Standard deviations of the position's and the velocity's noise.
        gains: Of a controller: by position and by velocity.
        ahead: Share of the wanted position that the controller commands anyway.
        linear: Whether it moves along a line, so that it has a unit of length.
        dimensions: Of a base parameter in powers of inertia, length and time.
    """

    unlisted = MappingProxyType(
        {"develop": {**axis_unlisted.DEVELOP, **lookalikes.AXIS}, "report": axis_unlisted.REPORT}
    )
    needs_base = frozenset({"payload", "actuator_gain"})
    steady = (
        "coulomb_friction",
        "quadratic_drag",
        "backlash",
        "actuator_lag",
        "actuator_asymmetry",
        "sensor_gain",
    )
    needs = MappingProxyType(
        {"sensor_bias": ("velocity",), "sensor_gain": ("velocity",), "velocity_lag": ("velocity",)}
    )
    alike = frozenset(
        {
            frozenset({"actuator_lag", "actuator_delay"}),
            frozenset({"actuator_gain", "payload"}),
            frozenset({"actuator_gain", "parameter_step"}),
        }
    )
    nominal: ClassVar[Mapping[str, float]]
    sizes: ClassVar[Scale]
    noise: ClassVar[tuple[float, float]]
    horizon: float
    gains: ClassVar[tuple[float, float]]
    ahead: ClassVar[float] = 0.0
    linear: ClassVar[bool] = False
    force: ClassVar[str] = "torque"

    def base(self, seed: int) -> dict[str, float]:
        """See ``Bench.base``: within a quarter of the nominal ones."""
        rng = np.random.default_rng([seed, 1])
        return {name: value * math.exp(rng.uniform(-0.22, 0.22)) for name, value in self.nominal.items()}

    def plant(self, base: Mapping[str, float]) -> Axis:
        """The axis without faults."""
        raise NotImplementedError

    def acceleration(self, p: FloatArray, x: FloatArray, v: FloatArray, u: FloatArray) -> FloatArray:
        """That of the nominal machine, for parameters (b, p, 1) and motions (b, w)."""
        raise NotImplementedError

    def values(self, effect: str, size: float, sign: int, seed: int) -> dict[str, float]:
        """See ``Bench.values``."""
        angle = np.random.default_rng([seed, crc32(effect.encode())]).uniform(0.0, 2.0 * math.pi)
        return TYPICAL[effect](self, size, sign, float(angle))

    def log(self, hidden: Sequence[Hidden], conditions: Conditions, seed: int, record: int) -> Log:
        """See ``Bench.log``."""
        base, step = self.base(seed), STEP * conditions.sampling
        n = round((conditions.duration or DURATION * conditions.sampling) / step)
        given = round(conditions.cut / step) or n
        rng = np.random.default_rng([seed, 2 + record])
        control, largest = self.control(conditions, base, n, step, rng)
        errors = noise(conditions.noise, conditions.factor * np.array(self.noise), n, rng)
        plant = self.plant(base)
        sizes = Scale(self.sizes.x, self.sizes.v, self.sizes.f, self.sizes.u, n * step, step)
        axis_listed.install(plant, self.hide(hidden, plant, sizes, seed, record), largest, self.linear)
        if conditions.noise == "quantised":
            plant.quantum = max(plant.quantum, 2.0 * self.noise[0] * conditions.factor)
        rows = simulate(plant, control, errors, step)[:given]
        return Log(step, rows[:, :1], self.shown(rows[:, 1:], conditions))

    def control(
        self, conditions: Conditions, base: Mapping[str, float], n: int, step: float, rng: np.random.Generator
    ) -> tuple[Control, float]:
        """What commands the axis, and the largest command that is expected."""
        time = np.arange(float(n)) * step
        limit = self.sizes.u
        if conditions.closed:
            way = 1.5 * self.sizes.x * path(time, rng)
            wanted: list[float] = way.tolist()
            rates: list[float] = np.gradient(way, step).tolist()
            by_position, by_velocity = self.gains

            def follow(i: int, shown: float, speed: float) -> float:
                force = by_position * (wanted[i] - shown) + by_velocity * (rates[i] - speed)
                return min(max(force + self.ahead * wanted[i], -limit), limit)

            return follow, limit
        commands = self.commands(conditions.commands, base, time, rng)
        given: list[float] = commands.tolist()
        return lambda i, _shown, _speed: given[i], float(np.abs(commands).max())

    def commands(
        self, kind: str, base: Mapping[str, float], time: FloatArray, rng: np.random.Generator
    ) -> FloatArray:
        """Commands at the samples."""
        del base
        return self.sizes.u * COMMANDS[kind or "mixed"](time, rng)

    def errors(self, train: Log, test: Log, conditions: Conditions, seed: int, known: bool) -> FloatArray:
        """See ``Bench.errors``."""
        del conditions
        ruler = Ruler(
            lambda p, s, u, _t: self._predict(p, s, u, train.step),
            np.array(self.noise), np.array([self.sizes.x, self.sizes.v]), np.full(2, np.inf),
        )  # fmt: skip
        base = np.array(list(self.base(seed).values()))
        return ruler.errors(self._windows(train), self._windows(test), base, not known)

    def _windows(self, log: Log) -> Windows:
        length = max(round(self.horizon / log.step), 10)
        count = (len(log.inputs) - 1) // length
        rows = np.arange(count)[:, None] * length + np.arange(length + 1)
        place = log.outputs[:, 0]
        speed = log.outputs[:, 1] if np.isfinite(log.outputs[0, 1]) else np.gradient(place, log.step)
        begin = rows[:, 0]
        return Windows(
            log.inputs[rows],
            log.outputs[rows],
            np.column_stack([place, speed])[begin],
            begin.astype(float) * log.step,
        )

    def _predict(self, p: FloatArray, states: FloatArray, inputs: FloatArray, step: float) -> FloatArray:
        """Windows of the nominal machine, two steps of Runge and Kutta a sample."""
        p = p.T[:, :, None]
        x, v, h = states[:, :, 0], states[:, :, 1], 0.5 * step
        out = np.empty((*x.shape, inputs.shape[1], 2))
        with np.errstate(over="ignore", invalid="ignore"):
            for k in range(inputs.shape[1]):
                out[:, :, k, 0], out[:, :, k, 1] = x, v
                u = inputs[None, :, k, 0]
                for _ in range(2):
                    a1 = self.acceleration(p, x, v, u)
                    v2 = v + 0.5 * h * a1
                    a2 = self.acceleration(p, x + 0.5 * h * v, v2, u)
                    v3 = v + 0.5 * h * a2
                    a3 = self.acceleration(p, x + 0.5 * h * v2, v3, u)
                    v4 = v + h * a3
                    a4 = self.acceleration(p, x + h * v3, v4, u)
                    x, v = x + h / 6.0 * (v + 2.0 * (v2 + v3) + v4), v + h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)
        return out

    def recording(self, log: Log, conditions: Conditions, seed: int) -> Recording:
        """See ``Bench.recording``: time by the pace, forces and motions by their units."""
        force = conditions.inertia * conditions.length * conditions.pace**2
        columns = {
            self.model.inputs[0].name: log.inputs[:, 0] * force,
            self.model.outputs[0].name: log.outputs[:, 0] * conditions.length,
            self.model.outputs[1].name: log.outputs[:, 1] * conditions.length * conditions.pace,
        }
        return self.recorded(columns, log.step / conditions.pace, conditions, seed)

    def scaled(self, values: Mapping[str, float], effect: str, conditions: Conditions) -> dict[str, float]:
        """See ``Bench.scaled``: by the powers of inertia, length and time in a parameter's unit."""
        result = {}
        for name, value in values.items():
            m, x, t = POWERS.get(f"{effect}.{name}", POWERS.get(name, (0, 0, 0)))
            result[name] = value * conditions.inertia**m * conditions.length**x * conditions.pace**-t
        return result

    def nothing(self) -> Iterator[Conditions]:
        """See ``Bench.nothing``."""
        for closed in (False, True):
            for factor in FACTORS:
                yield Conditions(factor=factor, closed=closed)
            for kind in NOISES:
                for factor in (1.0, 0.03):
                    yield Conditions(noise=kind, factor=factor, closed=closed)
            yield Conditions(noise="float32", factor=0.0, closed=closed)
            for pace in PACES:
                yield Conditions(pace=pace, closed=closed)
        for commands in POOR:
            for factor in (1.0, 1e-3):
                yield Conditions(commands=commands, factor=factor)
        for sampling in (0.5, 2.0, 5.0):
            yield Conditions(sampling=sampling)
        for decade in DECADES:
            yield Conditions(inertia=decade)
            if self.linear:
                yield Conditions(length=decade)
                yield Conditions(
                    length=decade, inertia=1.0 / decade, pace=float(10.0 ** (math.log10(decade) / 3))
                )
        yield Conditions(without=("velocity",))
        yield Conditions(without=("velocity",), factor=0.0)

    def usual(self, rng: np.random.Generator, hidden: tuple[str, ...]) -> Conditions:
        """See ``Bench.usual``: a quarter without velocity, a fifth in a closed loop, a sixth scaled."""
        conditions = Conditions(commands=str(rng.choice(["", "", "steps", "waves", "sweep"])))
        if rng.uniform() < 0.25 and "velocity" not in self.needed(hidden):
            conditions = replace(conditions, without=("velocity",))
        # How play is crossed depends on the largest command, which no controller promises.
        if rng.uniform() < 0.2 and "backlash" not in hidden:
            conditions = replace(conditions, closed=True, commands="")
        if rng.uniform() < 1.0 / 6.0:
            pace, inertia = 10.0 ** rng.uniform(-1.0, 2.0), 10.0 ** rng.uniform(-6.0, 3.0)
            length = 10.0 ** rng.uniform(-3.0, 1.0) if self.linear else 1.0
            conditions = replace(conditions, pace=float(pace), inertia=float(inertia), length=float(length))
        return replace(conditions, noise=noisy(rng).noise)


Typical = Callable[[AxisBench, float, int, float], dict[str, float]]


def _friction(share: float) -> Typical:
    return lambda b, k, _sign, _angle: {b.force: share * k * b.sizes.f}


def _waves(b: AxisBench, k: float, angle: float) -> dict[str, float]:
    size = 0.1 * k * b.sizes.f
    return {"sine": size * math.sin(angle), "cosine": size * math.cos(angle)}


TYPICAL: Mapping[str, Typical] = {
    "viscous_friction": lambda b, k, _s, _a: {"coefficient": 0.05 * k * b.sizes.f / b.sizes.v},
    "coulomb_friction": _friction(0.1),
    "stribeck_friction": lambda b, k, _s, _a: {b.force: 0.2 * k * b.sizes.f, "velocity": 0.12 * b.sizes.v},
    "hysteresis": lambda b, k, _s, _a: {b.force: 0.2 * k * b.sizes.f, "distance": 0.12 * b.sizes.x},
    "cogging": lambda b, k, _s, a: {**_waves(b, k, a), "period": 1.6 * b.sizes.x},
    "quadratic_drag": lambda b, k, _s, _a: {"coefficient": 0.1 * k * b.sizes.f / b.sizes.v**2},
    "asymmetric_damping": lambda b, k, s, _a: {"coefficient": 0.05 * k * s * b.sizes.f / b.sizes.v},
    "cubic_stiffness": lambda b, k, _s, _a: {"coefficient": 0.1 * k * b.sizes.f / b.sizes.x**3},
    "backlash": lambda b, k, _s, _a: {"gap": 0.05 * k * b.sizes.x},
    "payload": lambda b, k, _s, _a: (
        {"mass": 0.1 * k * b.nominal["mass"]}
        if b.linear
        else {"mass": 0.1 * k * b.nominal["inertia"] / 0.09, "length": 0.3}
    ),
    "constant_force": lambda b, k, s, _a: {b.force: 0.05 * k * s * b.sizes.f},
    "periodic_force": lambda b, k, _s, a: {**_waves(b, k, a), "frequency": 1.3},
    "actuator_gain": lambda _b, k, s, _a: {"gain": math.exp(0.05 * k * s)},
    "actuator_asymmetry": lambda _b, k, s, _a: {"difference": 1.9 * math.tanh(0.05 * k * s)},
    "actuator_lag": lambda _b, k, _s, _a: {"time_constant": 0.005 * k},
    "actuator_rate_limit": lambda b, k, _s, _a: {"rate": 50.0 * b.sizes.u / k},
    "actuator_delay": lambda _b, k, _s, _a: {"delay": 0.005 * k},
    "actuator_saturation": lambda b, k, _s, _a: {"limit": b.sizes.u / (1.0 + 0.1 * k)},
    "actuator_dead_zone": lambda b, k, _s, _a: {"width": 0.02 * k * b.sizes.u},
    "sensor_bias": lambda b, k, s, _a: {"bias": 0.02 * k * s * (b.sizes.v if b.linear else b.sizes.x)},
    "sensor_drift": lambda b, k, s, _a: {"rate": 0.1 * k * s * b.sizes.x / (DURATION)},
    "sensor_gain": lambda _b, k, s, _a: {"gain": math.exp(0.02 * k * s)},
    "sensor_delay": lambda _b, k, _s, _a: {"delay": 0.003 * k},
    "velocity_lag": lambda _b, k, _s, _a: {"time_constant": 0.005 * k},
    "sensor_quantisation": lambda b, k, _s, _a: {"step": 3.0 * k * b.noise[0]},
    "parameter_step": lambda _b, k, s, _a: {
        "time": round(0.45 * DURATION / STEP) * STEP,
        "factor": math.exp(0.05 * k * s),
    },
    "thrust_curve": lambda _b, k, s, _a: {"exponent": math.exp(0.05 * k * s)},
    "gravity": lambda b, k, _s, a: _waves(b, k, a),
    "dead_band": lambda b, k, _s, _a: {"width": 0.05 * k * b.sizes.f},
    "torque_limit": lambda b, k, _s, _a: {"limit": 3.0 * b.sizes.f / k},
}
"""Values of every effect's parameters: (bench, size, sign, angle)."""
FORCE = (1, 1, -2)
POWERS: Mapping[str, tuple[int, int, int]] = {
    "force": FORCE,
    "torque": FORCE,
    "sine": FORCE,
    "cosine": FORCE,
    "limit": FORCE,
    "width": FORCE,
    "stribeck_friction.velocity": (0, 1, -1),
    "distance": (0, 1, 0),
    "period": (0, 1, 0),
    "gap": (0, 1, 0),
    "step": (0, 1, 0),
    "viscous_friction.coefficient": (1, 0, -1),
    "asymmetric_damping.coefficient": (1, 0, -1),
    "quadratic_drag.coefficient": (1, -1, 0),
    "cubic_stiffness.coefficient": (1, -2, -2),
    "payload.mass": (1, 0, 0),
    "frequency": (0, 0, -1),
    "time_constant": (0, 0, 1),
    "delay": (0, 0, 1),
    "time": (0, 0, 1),
    "actuator_rate_limit.rate": (1, 1, -3),
    "sensor_drift.rate": (0, 1, -1),
    "bias": (0, 1, 0),
    "mass": (1, 0, 0),
    "inertia": (1, 0, 0),
    "damping": (1, 0, -1),
    "stiffness": (1, 0, -2),
    "gravity_moment": (1, 0, -2),
}
"""Powers of inertia, length and time in parameters; none where they are numbers."""
OF_ONE = ("viscous_friction", "asymmetric_damping", "thrust_curve", "gravity", "dead_band", "torque_limit")
STOCK = tuple(name for name in TYPICAL if name not in OF_ONE)


class Rig(AxisBench):
    """A mass of 2 kg on a spring, driven by up to 8 N."""

    name = "rig"
    effects = (*STOCK, "asymmetric_damping")
    nominal = MappingProxyType({"mass": 2.0, "damping": 4.0, "stiffness": 80.0})
    sizes = Scale(x=0.05, v=0.25, f=3.0, u=8.0, duration=DURATION, step=STEP)
    noise = (2e-4, 5e-3)
    horizon = 0.5
    gains = (160.0, 8.0)
    linear = True
    force = "force"

    def plant(self, base: Mapping[str, float]) -> Axis:
        """See ``AxisBench.plant``."""
        return Axis(base["mass"], base["damping"], base["stiffness"])

    def acceleration(self, p: FloatArray, x: FloatArray, v: FloatArray, u: FloatArray) -> FloatArray:
        """See ``AxisBench.acceleration``."""
        return np.asarray((u - p[1] * v - p[2] * x) / p[0])

    def scaled(self, values: Mapping[str, float], effect: str, conditions: Conditions) -> dict[str, float]:
        """See ``Bench.scaled``; the bias is the velocity's."""
        result = super().scaled(values, effect, conditions)
        return {n: v * conditions.pace if n == "bias" else v for n, v in result.items()}


class Pendulum(AxisBench):
    """A pendulum that is swung by up to 1.2 rad."""

    name = "pendulum"
    effects = ("viscous_friction", *STOCK)
    nominal = MappingProxyType({"inertia": 0.0626, "gravity_moment": 1.0})
    sizes = Scale(x=0.5, v=1.5, f=0.4, u=1.2, duration=DURATION, step=STEP)
    noise = (2e-3, 5e-2)
    horizon = 0.3
    gains = (2.0, 0.3)

    def plant(self, base: Mapping[str, float]) -> Axis:
        """See ``AxisBench.plant``."""
        return Axis(base["inertia"], gravity=base["gravity_moment"])

    def acceleration(self, p: FloatArray, x: FloatArray, v: FloatArray, u: FloatArray) -> FloatArray:
        """See ``AxisBench.acceleration``."""
        del v
        return np.asarray((u - p[1] * np.sin(x)) / p[0])

    def commands(
        self, kind: str, base: Mapping[str, float], time: FloatArray, rng: np.random.Generator
    ) -> FloatArray:
        """What swings the pendulum along a smooth path: without damping it wanders off under much else."""
        if kind in POOR:
            return np.asarray(0.15 * self.sizes.u * COMMANDS[kind](time, rng))
        wanted = 1.2 * path(time + 0.5 * (time[1] - time[0]), rng)
        needed = np.gradient(np.gradient(wanted, time), time)
        return np.asarray(base["inertia"] * needed + base["gravity_moment"] * np.sin(wanted))


class PropellerArm(AxisBench):
    """An arm that a propeller lifts."""

    name = "propeller_arm"
    effects = (*(name for name in STOCK if name != "payload"), "thrust_curve")
    needs_base = frozenset({"actuator_gain"})
    alike = frozenset(pair for pair in AxisBench.alike if "payload" not in pair)
    nominal = MappingProxyType({"inertia": 0.01, "damping": 0.02, "gravity_moment": 0.4})
    sizes = Scale(x=0.5, v=1.5, f=0.15, u=0.3, duration=DURATION, step=STEP)
    noise = (2e-3, 5e-2)
    horizon = 0.5
    gains = (0.6, 0.06)

    def plant(self, base: Mapping[str, float]) -> Axis:
        """See ``AxisBench.plant``."""
        return Axis(base["inertia"], base["damping"], gravity=base["gravity_moment"])

    def acceleration(self, p: FloatArray, x: FloatArray, v: FloatArray, u: FloatArray) -> FloatArray:
        """See ``AxisBench.acceleration``."""
        return np.asarray((u - p[1] * v - p[2] * np.sin(x)) / p[0])


class Servo(AxisBench):
    """A joint under position control; torques are in units of the controller's proportional gain."""

    name = "servo"
    effects = (
        "coulomb_friction", "stribeck_friction", "hysteresis", "cogging", "quadratic_drag", "periodic_force",
        "gravity", "dead_band", "torque_limit", "actuator_gain", "actuator_lag", "actuator_rate_limit",
        "actuator_delay", "actuator_saturation", "sensor_drift", "sensor_delay", "sensor_quantisation",
    )  # fmt: skip
    steady = ("coulomb_friction", "hysteresis", "dead_band", "torque_limit", "actuator_lag", "actuator_gain")
    needs_base = frozenset()
    needs = MappingProxyType({})
    alike = frozenset(
        {frozenset({"actuator_lag", "actuator_delay"}), frozenset({"actuator_gain", "gravity"})}
    )
    nominal = MappingProxyType({"inertia": 2e-3, "damping": 0.06, "offset": 0.01})
    sizes = Scale(x=0.5, v=3.0, f=0.1, u=0.8, duration=DURATION, step=STEP)
    noise = (5e-4, 2e-2)
    horizon = 0.3
    gains = (0.3, 0.0)
    ahead = 0.7

    def plant(self, base: Mapping[str, float]) -> Axis:
        """See ``AxisBench.plant``."""
        return Joint(base["inertia"], derivative_gain=base["damping"], offset=base["offset"])

    def acceleration(self, p: FloatArray, x: FloatArray, v: FloatArray, u: FloatArray) -> FloatArray:
        """See ``AxisBench.acceleration``."""
        return np.asarray((u - x - p[1] * v + p[2]) / p[0])

    def recording(self, log: Log, conditions: Conditions, seed: int) -> Recording:
        """See ``Bench.recording``."""
        return super().recording(log, _as_angles(conditions), seed)

    def scaled(self, values: Mapping[str, float], effect: str, conditions: Conditions) -> dict[str, float]:
        """See ``Bench.scaled``."""
        return super().scaled(values, effect, _as_angles(conditions))

    def nothing(self) -> Iterator[Conditions]:
        """See ``Bench.nothing``: no unit of inertia, which only the pace has."""
        return (one for one in super().nothing() if one.inertia == 1.0)


def _as_angles(conditions: Conditions) -> Conditions:
    """The unit of inertia in which a moment is an angle at every pace."""
    return replace(conditions, inertia=conditions.pace**-2)


BENCHES: Mapping[str, AxisBench] = {
    bench.name: bench for bench in (Rig(), Pendulum(), PropellerArm(), Servo())
}
