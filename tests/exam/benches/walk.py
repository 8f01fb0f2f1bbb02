"""The walking robot on a straight line, followed by a tracker."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import MappingProxyType

import numpy as np

from exam.benches.base import Bench, Conditions, Hidden, Log
from exam.plants import lookalikes, walk
from exam.plants.noise import NOISES, noise
from exam.plants.ruler import Ruler, Windows
from exam.plants.walk import EXCITATION, NOISE, Walker
from fieldmodels.arrays import FloatArray
from fieldmodels.recording import Recording

STEP, STRIDES = 1.2, 1000
HORIZON = 7
"""Strides in the windows by which a fault is measured."""
TRACKER = ("offset", "heading")
TYPICAL: Mapping[str, Callable[[float, int, float], dict[str, float]]] = {
    "actuator_delay": lambda k, _s, _a: {"strides": 2.0 * math.tanh(0.05 * k)},
    "actuator_saturation": lambda k, _s, _a: {"turn": 0.15 / (1.0 + 0.1 * k)},
    "foot_slip": lambda k, _s, _a: {
        "turn": 0.7 * math.tanh(0.05 * k),
        "twist": 0.6 * math.tanh(0.03 * k),
        "step": 0.9 * math.tanh(0.01 * k),
    },
    "turn_gain": lambda k, s, _a: {"factor": math.exp(0.05 * k * s)},
    "steering_bias": lambda k, s, _a: {"turn": 0.5 * math.tanh(0.005 * k * s)},
    "camera_yaw": lambda k, s, _a: {"angle": 0.4 * math.tanh(0.02 * k * s)},
    "camera_pitch": lambda k, s, _a: {"angle": 0.3 * math.tanh(0.02 * k * s)},
    "sensor_gain": lambda k, s, _a: {"factor": math.exp(0.03 * k * s)},
    "sensor_quantisation": lambda k, _s, _a: {"step": 0.5 * math.tanh(0.05 * k)},
}
"""Values of every effect's parameters: (size, sign, angle)."""


class LineFollowing(Bench):
    """A thousand strides by the law with random turns added; each turns and slips a little by chance."""

    name = "line_following"
    effects = tuple(walk.LISTED)
    needs = MappingProxyType(dict.fromkeys(walk.LISTED, TRACKER))
    alike = frozenset({frozenset({"foot_slip", "turn_gain"}), frozenset({"foot_slip", "actuator_delay"})})
    steady = ("turn_gain", "steering_bias", "sensor_gain", "camera_yaw")
    usual_length = 15.0
    typical = TYPICAL
    unlisted = MappingProxyType({"develop": {**walk.DEVELOP, **lookalikes.WALK}, "report": walk.REPORT})

    def base(self, seed: int) -> dict[str, float]:
        """See ``Bench.base``: both are known to the diagnosis, as nominal."""
        del seed
        return {"stride": 0.7, "camera_height": 1.0}

    def log(self, hidden: Sequence[Hidden], conditions: Conditions, seed: int, record: int) -> Log:
        """See ``Bench.log``."""
        n = round((conditions.duration or STRIDES * STEP) / STEP)
        given = round(conditions.cut / STEP) or n
        rng = np.random.default_rng([seed, 2 + record])
        added = EXCITATION * np.diff(rng.standard_normal(n + 1)) / math.sqrt(2.0)
        if conditions.commands == "law":
            added *= 0.0
        deviations, shown = conditions.factor * np.array([*NOISE.values()]), len(self.model.outputs)
        # A turn that wanders from stride to stride would be a fault of the robot, not noise of a sensor.
        errors = np.hstack([
            noise(conditions.noise, deviations[:shown], n, rng),
            noise("white", deviations[shown:], n, rng),
        ])  # fmt: skip
        plant = Walker()
        walk.install(plant, self.hide(hidden, plant, n, seed, record))
        if conditions.noise == "quantised":
            plant.quantum = max(plant.quantum, 2.0 * NOISE["line"] * conditions.factor)
        rows = walk.simulate(plant, added, errors)[:given]
        return Log(STEP, rows[:, :1], self.shown(rows[:, 1:], conditions))

    def errors(self, train: Log, test: Log, conditions: Conditions, seed: int, known: bool) -> FloatArray:
        """See ``Bench.errors``; starts stay near the measured ones, or they would take up the chance."""
        del train, conditions, seed, known
        count = (len(test.inputs) - 1) // HORIZON
        rows = np.arange(count)[:, None] * HORIZON + np.arange(HORIZON)
        outputs = test.outputs[rows]
        windows = Windows(test.inputs[rows], outputs, outputs[:, 0, 1:], rows[:, 0].astype(float) * STEP)
        deviations = np.array([NOISE[name] for name in ("line", *TRACKER)])
        ruler = Ruler(_strides, deviations, np.array([0.01, 0.01]), np.ones(2))
        return ruler.errors(windows, windows, np.ones(1), False)

    def recording(self, log: Log, conditions: Conditions, seed: int) -> Recording:
        """See ``Bench.recording``."""
        columns = {"steering": log.inputs[:, 0], "curvature": np.zeros(len(log.inputs))}
        columns |= {s.name: log.outputs[:, j] for j, s in enumerate(self.model.outputs)}
        return self.recorded(columns, STEP, conditions, seed)

    def nothing(self) -> Iterator[Conditions]:
        """See ``Bench.nothing``."""
        for factor in (0.0, 1e-6, 1e-4, 1e-2, 0.1, 1.0):
            yield Conditions(factor=factor)
        for kind in NOISES:
            yield Conditions(noise=kind)
            yield Conditions(noise=kind, without=TRACKER)
        yield Conditions(noise="float32", factor=0.0)
        yield Conditions(commands="law")
        yield Conditions(duration=400.0 * STEP)


def _strides(parameters: FloatArray, states: FloatArray, inputs: FloatArray, times: FloatArray) -> FloatArray:
    """Windows of the nominal robot, from offset and heading (b, w, 2) by commands (w, n, 1)."""
    del parameters, times
    robot = Walker()
    offset, heading = states[:, :, 0], states[:, :, 1]
    out = np.empty((*offset.shape, inputs.shape[1], 3))
    for k in range(inputs.shape[1]):
        out[:, :, k, 0] = robot.look(offset, heading)
        out[:, :, k, 1], out[:, :, k, 2] = offset, heading
        offset, heading = offset + robot.stride * np.sin(heading), heading + inputs[None, :, k, 0]
    return out


BENCHES: Mapping[str, LineFollowing] = {"line_following": LineFollowing()}
