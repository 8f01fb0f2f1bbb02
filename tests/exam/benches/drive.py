"""The wheeled robot, commanded by its motion or by its wheels' speeds."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from exam.benches.base import Bench, Conditions, Hidden, Log, noisy
from exam.plants import drive_faults, lookalikes
from exam.plants.commands import held, path
from exam.plants.drive import Control, Drive, Pose, simulate
from exam.plants.drive_faults import Scale
from exam.plants.noise import NOISES, noise
from exam.plants.ruler import Ruler, Windows
from fieldmodels.arrays import FloatArray
from fieldmodels.recording import Recording

DURATION, STEP = 120.0, 0.05
SPEED, RATE = 1.0, 4.0
"""Largest commands [m/s, rad/s]."""
NOISE = (0.003, 0.003, 0.01, 0.1, 0.1)
HORIZON = 2.0
WHEELS = ("left_wheel", "right_wheel")
POOR = ("straight", "circle", "rest")
DECADES = (0.05, 1e-1, 1e1, 1e2)
TYPICAL: Mapping[str, Callable[[float, int, float], dict[str, float]]] = {
    "actuator_gain": lambda k, s, _a: {"gain": math.exp(0.01 * k * s)},
    "turn_gain": lambda k, s, _a: {"gain": math.exp(0.01 * k * s)},
    "actuator_lag": lambda k, _s, _a: {"time_constant": 0.005 * k},
    "actuator_rate_limit": lambda k, _s, _a: {"rate": 50.0 / k},
    "actuator_delay": lambda k, _s, _a: {"delay": 0.005 * k},
    "actuator_saturation": lambda k, _s, _a: {"limit": 1.3 / (1.0 + 0.05 * k)},
    "actuator_dead_zone": lambda k, _s, _a: {"width": 0.005 * k},
    "unequal_wheels": lambda k, s, _a: {"difference": 0.5 * math.tanh(0.01 * k * s)},
    "yaw_slip": lambda k, _s, _a: {"share": 1.0 - math.exp(-0.01 * k)},
    "sideways_slip": lambda k, _s, _a: {"coefficient": 0.005 * k},
    "slope": lambda k, _s, a: {"x": 0.005 * k * math.cos(a), "y": 0.005 * k * math.sin(a)},
    "sensor_delay": lambda k, _s, _a: {"delay": 0.005 * k},
    "heading_bias": lambda k, s, _a: {"angle": 0.01 * k * s},
    "parameter_step": lambda k, s, _a: {"time": 0.45 * DURATION, "factor": math.exp(0.01 * k * s)},
}
"""Values of every effect's parameters: (size, sign, angle)."""


class DriveBench(Bench):
    """Two minutes at 20 Hz by random commands, mostly with measured wheels.

    Attributes:
        by_wheels: Whether wheels' speeds are commanded, instead of speed and turn rate.
    """

    effects = tuple(drive_faults.LISTED)
    alike = frozenset({frozenset({"actuator_lag", "actuator_delay"}), frozenset({"turn_gain", "yaw_slip"})})
    steady = ("yaw_slip", "sideways_slip", "actuator_dead_zone", "actuator_lag", "unequal_wheels")
    usual_length = 4.0
    typical = TYPICAL
    unlisted = MappingProxyType(
        {"develop": {**drive_faults.DEVELOP, **lookalikes.DRIVE}, "report": drive_faults.REPORT}
    )
    horizon = HORIZON
    by_wheels: ClassVar[bool] = False

    def base(self, seed: int) -> dict[str, float]:
        """See ``Bench.base``."""
        rng = np.random.default_rng([seed, 1])
        return {
            "wheel_radius": 0.03 * math.exp(rng.uniform(-0.2, 0.2)),
            "track": 0.15 * math.exp(rng.uniform(-0.2, 0.2)),
        }

    def log(self, hidden: Sequence[Hidden], conditions: Conditions, seed: int, record: int) -> Log:
        """See ``Bench.log``."""
        base, step = self.base(seed), STEP * conditions.sampling
        n = round((conditions.duration or DURATION * conditions.sampling) / step)
        given = round(conditions.cut / step) or n
        rng = np.random.default_rng([seed, 2 + record])
        control = self.control(conditions, n, step, rng)
        errors = noise(conditions.noise, conditions.factor * np.array(NOISE), n, rng)
        plant = Drive(base["wheel_radius"], base["track"])
        scale = Scale(SPEED, RATE, SPEED + 0.5 * RATE * base["track"], n * step, step)
        drive_faults.install(plant, self.hide(hidden, plant, scale, seed, record))
        rows = simulate(plant, control, errors, step)[:given]
        if conditions.noise == "quantised":
            quanta = 2.0 * np.array(NOISE) * conditions.factor
            rows[:, 2:] = quanta * np.round(rows[:, 2:] / quanta)
        return Log(step, rows[:, :2], self.shown(rows[:, 2:], conditions))

    def control(self, conditions: Conditions, n: int, step: float, rng: np.random.Generator) -> Control:
        """What commands the drive; it rests in the first half second."""
        time = np.arange(float(n)) * step
        forward = 0.5 * SPEED * (1.0 + held(time, 0.2, 1.2, rng))
        turning = RATE * held(time, 0.2, 1.2, rng)
        # Some commands turn on the spot, for what shows at small speeds only.
        forward[held(time, 0.3, 1.2, rng) > 0.6] = 0.0
        if conditions.commands == "straight":
            turning[:] = 0.0
        elif conditions.commands == "circle":
            forward[:], turning[:] = 0.6 * SPEED, 0.3 * RATE
        elif conditions.commands == "rest":
            forward[:], turning[:] = 0.0, 0.0
        forward[time < 0.5] = turning[time < 0.5] = 0.0
        if conditions.closed:
            wanted = 3.0 * path(time, rng)

            def steer(i: int, shown: Pose) -> tuple[float, float]:
                rate = 2.0 * (float(wanted[i]) - shown[2]) if time[i] >= 0.5 else 0.0
                return float(forward[i]), min(max(rate, -RATE), RATE)

            return steer
        return lambda i, _shown: (float(forward[i]), float(turning[i]))

    def errors(self, train: Log, test: Log, conditions: Conditions, seed: int, known: bool) -> FloatArray:
        """See ``Bench.errors``: the wheels' from the commands; the pose's from the wheels, if measured."""
        del train, known
        base, step = self.base(seed), test.step
        half = 0.5 * base["track"] * test.inputs[:, 1]
        rims = np.column_stack([test.inputs[:, 0] - half, test.inputs[:, 0] + half])
        result = np.full(5, np.nan)
        if WHEELS[0] not in conditions.without:
            off = test.outputs[1:, 3:] - rims[:-1] / base["wheel_radius"]
            result[3:] = np.sqrt(np.mean(off**2, axis=0))
            rims = np.concatenate([test.outputs[1:, 3:] * base["wheel_radius"], rims[-1:]])
        length = round(self.horizon / STEP)
        count = (len(rims) - 1) // length
        rows = np.arange(count)[:, None] * length + np.arange(length + 1)
        pose = test.outputs[:, :3]
        windows = Windows(rims[rows], pose[rows], pose[rows[:, 0]], rows[:, 0].astype(float) * step)
        ruler = Ruler(
            lambda _p, s, u, _t: _poses(s, u, float(base["track"]), step),
            np.array(NOISE[:3]), np.array([0.1, 0.1, 0.1]), np.full(3, np.inf),
        )  # fmt: skip
        result[:3] = ruler.errors(windows, windows, np.ones(1), False)
        return result

    def recording(self, log: Log, conditions: Conditions, seed: int) -> Recording:
        """See ``Bench.recording``; headings are wrapped."""
        base, length, pace = self.base(seed), conditions.length, conditions.pace
        speed, rate = log.inputs.T
        if self.by_wheels:
            half = 0.5 * base["track"] * rate
            inputs = [rim / base["wheel_radius"] * pace for rim in (speed - half, speed + half)]
        else:
            inputs = [speed * length * pace, rate * pace]
        x, y, heading, left, right = log.outputs.T
        heading = np.pi - np.mod(np.pi - heading, 2.0 * np.pi)
        outputs = [x * length, y * length, heading, left * pace, right * pace]
        signals = (*self.model.inputs, *self.model.outputs)
        columns = {s.name: v for s, v in zip(signals, [*inputs, *outputs], strict=True)}
        known = {name: value * length for name, value in base.items()}
        return self.recorded(columns, log.step / pace, conditions, seed, known=known)

    def scaled(self, values: Mapping[str, float], effect: str, conditions: Conditions) -> dict[str, float]:
        """See ``Bench.scaled``."""
        powers = {
            "actuator_lag.time_constant": (0, 1), "actuator_delay.delay": (0, 1),
            "sensor_delay.delay": (0, 1), "parameter_step.time": (0, 1), "actuator_saturation.limit": (1, -1),
            "actuator_dead_zone.width": (1, -1), "actuator_rate_limit.rate": (1, -2),
            "sideways_slip.coefficient": (0, 1),
        }  # fmt: skip
        result = {}
        for name, value in values.items():
            x, t = powers.get(f"{effect}.{name}", (0, 0))
            result[name] = value * conditions.length**x * conditions.pace**-t
        return result

    def nothing(self) -> Iterator[Conditions]:
        """See ``Bench.nothing``."""
        for closed in (False, True):
            for factor in (0.0, 1e-6, 1e-4, 1e-2, 0.1, 1.0):
                yield Conditions(factor=factor, closed=closed)
            for kind in NOISES:
                yield Conditions(noise=kind, closed=closed)
            yield Conditions(noise="float32", factor=0.0, closed=closed)
            yield Conditions(without=WHEELS, closed=closed)
        for commands in POOR:
            yield Conditions(commands=commands)
        for decade in DECADES:
            yield Conditions(length=decade)
        for pace in (0.1, 10.0):
            yield Conditions(pace=pace)
        yield Conditions(sampling=2.0)

    def usual(self, rng: np.random.Generator, hidden: tuple[str, ...]) -> Conditions:
        """See ``Bench.usual``: a quarter without wheels, a fifth in a closed loop, a sixth scaled."""
        conditions = Conditions()
        if rng.uniform() < 0.25 and not {"turn_gain", "yaw_slip"} & set(hidden):
            conditions = replace(conditions, without=WHEELS)
        if rng.uniform() < 0.2:
            conditions = replace(conditions, closed=True)
        if rng.uniform() < 1.0 / 6.0:
            length, pace = 10.0 ** rng.uniform(-1.0, 1.5), 10.0 ** rng.uniform(-1.0, 1.0)
            conditions = replace(conditions, length=float(length), pace=float(pace))
        return replace(conditions, noise=noisy(rng).noise)


def _poses(states: FloatArray, rims: FloatArray, track: float, step: float) -> FloatArray:
    """Poses of windows along arcs, from states (b, w, 3) by rims' speeds (w, n, 2)."""
    forward, turned = rims.mean(axis=2) * step, (rims[:, :, 1] - rims[:, :, 0]) / track * step
    share = np.sinc(0.5 * turned / np.pi)
    begun = np.concatenate([np.zeros((len(rims), 1)), np.cumsum(turned, axis=1)[:, :-1]], axis=1)
    heading = states[:, :, 2, None] + begun
    way = forward * share * np.exp(1j * (heading + 0.5 * turned))
    place = states[:, :, 0, None] + 1j * states[:, :, 1, None] + np.cumsum(way, axis=2) - way
    return np.stack([place.real, place.imag, heading], axis=3)


class PoseReaching(DriveBench):
    """Commanded by speed and turn rate."""

    name = "pose_reaching"


class DifferentialDrive(DriveBench):
    """Commanded by its wheels' speeds."""

    name = "differential_drive"
    by_wheels = True


BENCHES: Mapping[str, DriveBench] = {bench.name: bench for bench in (PoseReaching(), DifferentialDrive())}
