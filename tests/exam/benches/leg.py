"""The walker's leg, watched by its gyro and by the geometry at its strikes."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from types import MappingProxyType

import numpy as np

from exam.benches.base import Bench, Conditions, Hidden, Log
from exam.plants import leg, lookalikes
from exam.plants.noise import NOISES, noise
from exam.plants.ruler import Ruler, Windows
from fieldmodels.arrays import FloatArray
from fieldmodels.machines.heel_strike.model import HeelStrikeModel
from fieldmodels.machines.heel_strike.parameters import Leg
from fieldmodels.model import Model
from fieldmodels.recording import Recording

DURATION, STEP = 120.0, 0.01
HORIZON = 80
"""Samples after a strike by which a fault is measured."""
AROUND = 3
"""Samples before and after a strike over which the gyro is averaged."""
DEVIATIONS = (leg.NOISE[0], 0.003, 0.005)
"""By which errors of gyro, closure and push-off are weighed."""
TYPICAL: Mapping[str, Callable[[float, int, float], dict[str, float]]] = {
    "viscous_friction": lambda k, _s, _a: {"rate": 0.05 * k},
    "coulomb_friction": lambda k, _s, _a: {"acceleration": 0.05 * k},
    "quadratic_drag": lambda k, _s, _a: {"coefficient": 0.05 * k},
    "constant_force": lambda k, s, _a: {"acceleration": 0.05 * k * s},
    "periodic_force": lambda k, _s, a: {
        "sine": 0.05 * k * math.sin(a), "cosine": 0.05 * k * math.cos(a), "frequency": 1.37,
    },
    "gyro_bias": lambda k, s, _a: {"rate": 0.001 * k * s},
    "gyro_drift": lambda k, s, _a: {"rate": 0.002 * k * s / DURATION},
    "gyro_gain": lambda k, s, _a: {"gain": math.exp(0.005 * k * s)},
    "gyro_delay": lambda k, _s, _a: {"delay": 0.02 * math.tanh(0.05 * k)},
    "gyro_quantisation": lambda k, _s, _a: {"step": 0.5 * math.tanh(0.02 * k)},
    "parameter_step": lambda k, s, _a: {"rate": 0.002 * k * s, "time": 0.5 * DURATION},
}  # fmt: skip
"""Values of every effect's parameters: (size, sign, angle)."""


class HeelStrike(Bench):
    """Two minutes at 100 Hz under a random torque.

    Outputs are the gyro, the angle at the latest strike, and what the model derives: the closure (change of
    that angle less the gyro's sum) and the push-off (rate after a strike less the one that it aims at).
    """

    name = "heel_strike"
    effects = tuple(leg.LISTED)
    steady = ("viscous_friction", "constant_force", "gyro_gain", "gyro_bias")
    typical = TYPICAL
    unlisted = MappingProxyType({"develop": {**leg.DEVELOP, **lookalikes.LEG}, "report": leg.REPORT})
    usual_length = 1.5

    @cached_property
    def model(self) -> Model:
        """The leg, sampled at 100 Hz."""
        return HeelStrikeModel(Leg(step=STEP))

    def base(self, seed: int) -> dict[str, float]:
        """See ``Bench.base``."""
        return {"length": math.exp(np.random.default_rng([seed, 1]).uniform(-0.1, 0.1))}

    def log(self, hidden: Sequence[Hidden], conditions: Conditions, seed: int, record: int) -> Log:
        """See ``Bench.log``."""
        n = round((conditions.duration or DURATION) / STEP)
        given = round(conditions.cut / STEP) or n
        rng = np.random.default_rng([seed, 2 + record])
        held = round(leg.HOLD / STEP)
        torques = np.repeat(rng.uniform(-1.0, 1.0, n // held + 1), held)[:n] * leg.TORQUE
        errors = noise(conditions.noise, np.array(leg.NOISE), n, rng) * conditions.factor
        plant = leg.Leg(self.base(seed)["length"])
        leg.install(plant, self.hide(hidden, plant, n * STEP, seed, record))
        if conditions.noise == "quantised":
            plant.quantum = max(plant.quantum, 2.0 * leg.NOISE[0] * conditions.factor)
        quiet = conditions.commands == "calm"
        rows = leg.simulate(plant, 0.0 * torques if quiet else torques, errors, STEP)[:given]
        outputs = np.column_stack([rows[:, 1:], *_derived(*rows.T)])
        return Log(STEP, rows[:, :1], outputs)

    def errors(self, train: Log, test: Log, conditions: Conditions, seed: int, known: bool) -> FloatArray:
        """See ``Bench.errors``: of strides from strike on, starts near the measured ones."""
        del conditions
        ruler = Ruler(_swings, np.array(DEVIATIONS), np.array([0.003, 0.003]), np.ones(2))
        base = np.array(list(self.base(seed).values()))
        found = ruler.errors(_windows(train), _windows(test), base, not known)
        return np.array([found[0], np.nan, found[1], found[2]])

    def recording(self, log: Log, conditions: Conditions, seed: int) -> Recording:
        """See ``Bench.recording``."""
        columns = {"strike": log.inputs[:, 0], "gyro": log.outputs[:, 0], "strike_angle": log.outputs[:, 1]}
        return self.recorded(
            columns, STEP, conditions, seed, time=np.arange(1.0, len(log.inputs) + 1.0) * STEP
        )

    def nothing(self) -> Iterator[Conditions]:
        """See ``Bench.nothing``."""
        for factor in (0.0, 1e-4, 1e-2, 0.1, 1.0):
            yield Conditions(factor=factor)
        for kind in NOISES:
            yield Conditions(noise=kind)
        yield Conditions(commands="calm")
        yield Conditions(duration=60.0)


def _derived(strike: FloatArray, gyro: FloatArray, angle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Closure of the stride that ends, and push-off, at each strike; zero elsewhere."""
    struck = np.flatnonzero(strike > 0.5)
    closure, push = np.zeros(len(gyro)), np.zeros(len(gyro))
    turned = np.cumsum(gyro) * STEP
    closure[struck[1:]] = np.diff(angle[struck]) - np.diff(turned[struck])
    for n in struck[(struck >= AROUND) & (struck + AROUND < len(gyro))]:
        before = gyro[n - AROUND + 1 : n + 1].mean()
        after = gyro[n + 1 : n + AROUND + 1].mean()
        push[n] = after - (before + leg.PUSH_OFF * (math.copysign(leg.SPEED, before) - before))
    return closure, push


def _windows(log: Log) -> Windows:
    """The beginnings of strides; closure and push-off stand at their first sample."""
    struck = np.flatnonzero(log.inputs[:, 0] > 0.5)[1:]
    struck = struck[struck + HORIZON < len(log.inputs)]
    rows = struck[:, None] + np.arange(HORIZON)
    outputs = np.full((len(struck), HORIZON, 3), np.nan)
    outputs[:, :, 0] = log.outputs[rows, 0]
    outputs[:, 0, 1:] = log.outputs[struck, 2:]
    states = np.column_stack([log.outputs[struck, 1], log.outputs[struck, 0]])
    return Windows(np.zeros((len(struck), HORIZON, 1)), outputs, states, struck.astype(float) * STEP)


def _swings(p: FloatArray, states: FloatArray, inputs: FloatArray, times: FloatArray) -> FloatArray:
    """Strides of the nominal leg from angle and rate before the push-off (b, w, 2)."""
    del times
    stiffness = leg.GRAVITY / p[:, 0, None]
    theta, omega = states[:, :, 0], states[:, :, 1]
    out = np.zeros((*theta.shape, inputs.shape[1], 3))
    out[:, :, 0, 0] = omega
    omega = omega + leg.PUSH_OFF * (np.sign(omega) * leg.SPEED - omega)
    h = STEP
    for k in range(1, inputs.shape[1]):
        a1 = -stiffness * np.sin(theta)
        v2 = omega + 0.5 * h * a1
        a2 = -stiffness * np.sin(theta + 0.5 * h * omega)
        v3 = omega + 0.5 * h * a2
        a3 = -stiffness * np.sin(theta + 0.5 * h * v2)
        v4 = omega + h * a3
        a4 = -stiffness * np.sin(theta + h * v3)
        theta = theta + h / 6.0 * (omega + 2.0 * (v2 + v3) + v4)
        omega = omega + h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)
        out[:, :, k, 0] = omega
    return out


BENCHES: Mapping[str, HeelStrike] = {"heel_strike": HeelStrike()}
