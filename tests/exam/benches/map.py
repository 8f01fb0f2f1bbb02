"""A test stand whose rows each show a settled response to a command."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import MappingProxyType

import numpy as np

from exam.benches.base import Bench, Conditions, Hidden, Log
from exam.plants import map as plants
from exam.plants.noise import NOISES, noise
from fieldmodels.arrays import FloatArray
from fieldmodels.recording import Recording

STEP, ROWS = 2.0, 1000
PLACES = np.arange(1, 8) / 8.0
KNOTS = [f"value_{k}" for k in range(1, 8)]
ARCH, WAVE = 4.0 * PLACES * (1.0 - PLACES), np.sin(2.0 * math.pi * PLACES)
TYPICAL: Mapping[str, Callable[[float, int, float], dict[str, float]]] = {
    "dead_zone": lambda k, s, _a: {"width": 0.5 * math.tanh(0.05 * k), "centre": 0.3 * s},
    "upper_limit": lambda k, _s, _a: {"limit": 1.3 / (1.0 + 0.1 * k)},
    "lower_limit": lambda k, _s, _a: {"limit": -0.9 / (1.0 + 0.1 * k)},
    "curvature": lambda k, s, a: {
        "low": -plants.RANGE, "high": plants.RANGE,
        **dict(zip(KNOTS, 0.03 * k * s * (math.cos(0.5 * a) * ARCH + math.sin(0.5 * a) * WAVE), strict=True)),
    },
    "actuator_play": lambda k, _s, _a: {"width": 0.8 * math.tanh(0.05 * k)},
    "sensor_drift": lambda k, s, _a: {"rate": 0.02 * k * s / (ROWS * STEP)},
    "sensor_quantisation": lambda k, _s, _a: {"step": 0.5 * math.tanh(0.02 * k)},
}  # fmt: skip
"""Values of every effect's parameters: (size, sign, angle)."""
CURVES = ("dead_zone", "upper_limit", "lower_limit", "curvature")


class Map(Bench):
    """A thousand commands between -1 and 1, 2 s apart, and what each leads to."""

    name = "map"
    effects = tuple(TYPICAL)
    alike = frozenset(frozenset({"curvature", other}) for other in CURVES[:3])
    steady = CURVES
    typical = TYPICAL
    unlisted = MappingProxyType({"develop": plants.DEVELOP, "report": plants.REPORT})
    usual_length = ROWS * STEP / 80.0

    def base(self, seed: int) -> dict[str, float]:
        """See ``Bench.base``."""
        gain, offset = np.random.default_rng([seed, 1]).uniform(-0.1, 0.1, 2)
        return {"gain": math.exp(gain), "offset": 0.2 + float(offset)}

    def log(self, hidden: Sequence[Hidden], conditions: Conditions, seed: int, record: int) -> Log:
        """See ``Bench.log``."""
        n = round((conditions.duration or ROWS * STEP) / STEP)
        given = round(conditions.cut / STEP) or n
        rng = np.random.default_rng([seed, 2 + record])
        commands = rng.uniform(-plants.RANGE, plants.RANGE, n)
        if conditions.commands == "stairs":  # up and down, five times
            commands = plants.RANGE * (1.0 - 4.0 * np.abs((5.0 * np.arange(n) / n) % 1.0 - 0.5))
        commands[:2] = -plants.RANGE, plants.RANGE  # the range is there to be seen
        errors = noise(conditions.noise, np.array([plants.NOISE]), n, rng)[:, 0] * conditions.factor
        base = self.base(seed)
        stand = plants.Stand(base["gain"], base["offset"])
        stand.listed = self.hide(hidden, stand, n * STEP, seed, record)
        if conditions.noise == "quantised":
            stand.quantum = 2.0 * plants.NOISE * conditions.factor
        shown = plants.respond(stand, commands, errors, STEP)
        return Log(STEP, commands[:given, None], shown[:given, None])

    def errors(self, train: Log, test: Log, conditions: Conditions, seed: int, known: bool) -> FloatArray:
        """See ``Bench.errors``: of a line."""
        del conditions
        base, told = self.base(seed), train.inputs[:, 0]
        fitted = np.polyfit(told, train.outputs[:, 0], 1)
        line = np.array([base["gain"], base["offset"]]) if known else fitted
        return np.array([np.sqrt(np.mean((test.outputs[:, 0] - np.polyval(line, test.inputs[:, 0])) ** 2))])

    def recording(self, log: Log, conditions: Conditions, seed: int) -> Recording:
        """See ``Bench.recording``."""
        columns = {"command": log.inputs[:, 0], "response": log.outputs[:, 0]}
        return self.recorded(columns, STEP, conditions, seed)

    def nothing(self) -> Iterator[Conditions]:
        """See ``Bench.nothing``."""
        for factor in (0.0, 1e-4, 1e-2, 0.1, 1.0):
            yield Conditions(factor=factor)
        for kind in NOISES:
            yield Conditions(noise=kind)
        yield Conditions(commands="stairs")
        yield Conditions(duration=200.0 * STEP)


BENCHES: Mapping[str, Map] = {"map": Map()}
