"""The shaken vehicle, with accelerometer, inclinometer and the force/torque sensor of its arm."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache
from types import MappingProxyType

import numpy as np
from scipy.interpolate import make_interp_spline

from exam.benches.base import Bench, Conditions, Hidden, Log
from exam.plants import vehicle
from exam.plants.noise import NOISES, noise
from fieldmodels.arrays import FloatArray
from fieldmodels.recording import Recording

RUN, STEP = 4.0, 0.01
"""Length of a run [s], sampling interval [s]."""
SAMPLES = round(RUN / STEP)
USUAL = 3
"""Runs in a record: one about each axis."""
FORCES = tuple(f"{kind}_{axis}" for kind in ("force", "torque") for axis in ("x", "y", "z"))
NUDGE = 1e-3
"""Of parameters, in their logarithm, for differences."""
SUSPENSION = tuple(f"{kind}_{axis}" for kind in ("damping", "stiffness") for axis in vehicle.AXES)
TYPICAL: Mapping[str, Callable[[float, int, float], dict[str, float]]] = {
    "payload": lambda k, _s, _a: {"mass": 0.002 * k},
    "cubic_stiffness": lambda k, _s, _a: {
        "force": 900.0 * math.tanh(0.02 * k), "torque": 90.0 * math.tanh(0.02 * k),
    },
    "coulomb_friction": lambda k, _s, _a: {"force": 0.02 * k, "torque": 0.01 * k},
    "stiffness_drift": lambda k, s, _a: {"rate": 0.05 * s * math.tanh(0.05 * k)},
    "soil_compliance": lambda k, _s, _a: {"share": 2.0 * math.tanh(0.003 * k)},
    "actuator_lag": lambda k, _s, _a: {"time_constant": 0.2 * math.tanh(0.003 * k)},
    "accelerometer_bias": lambda k, s, a: {
        "x": 0.005 * k * math.cos(a), "y": 0.005 * k * math.sin(a), "z": 0.002 * k * s,
    },
    "accelerometer_gain": lambda k, s, _a: {"gain": math.exp(0.01 * k * s)},
    "inclinometer_bias": lambda k, _s, a: {"pitch": 5e-4 * k * math.cos(a), "roll": 5e-4 * k * math.sin(a)},
    "inclinometer_delay": lambda k, _s, _a: {"delay": 0.2 * math.tanh(0.003 * k)},
    "force_torque_gain": lambda k, s, _a: {"gain": math.exp(0.002 * k * s)},
}  # fmt: skip
"""Values of every effect's parameters: (size, sign, angle)."""


class Excitation(Bench):
    """Runs of 4 s at 100 Hz, the arm about x, y, z in turn; mass, inertia and lever arms are known."""

    name = "excitation"
    effects = vehicle.LISTED
    steady = ("payload", "cubic_stiffness", "coulomb_friction", "accelerometer_gain", "force_torque_gain")
    needs = MappingProxyType({"force_torque_gain": FORCES})
    typical = TYPICAL
    unlisted = MappingProxyType({"develop": vehicle.DEVELOP, "report": vehicle.REPORT})
    usual_length = 0.4

    def base(self, seed: int) -> dict[str, float]:
        """See ``Bench.base``: the suspension is within a quarter of the soft one."""
        rng = np.random.default_rng([seed, 1])
        values = (*vehicle.DAMPING, *vehicle.STIFFNESS)
        drawn = {
            name: v * math.exp(rng.uniform(-0.22, 0.22)) for name, v in zip(SUSPENSION, values, strict=True)
        }
        return {**vehicle.BODY, **drawn}

    def log(self, hidden: Sequence[Hidden], conditions: Conditions, seed: int, record: int) -> Log:
        """See ``Bench.log``."""
        runs = round(conditions.duration / RUN) or USUAL
        plant = vehicle.Vehicle(*_suspension(self.base(seed), runs))
        vehicle.install(plant, self.hide(hidden, plant, RUN, seed, record))
        rng, sizes = np.random.default_rng([seed, 4 + record]), conditions.factor * np.array(vehicle.NOISE)
        errors = np.stack([noise(conditions.noise, sizes, SAMPLES, rng) for _ in range(runs)], axis=2)
        modes, commands = _commands(seed, record, runs)
        shown = vehicle.simulate(plant, modes, commands, errors, STEP)
        if conditions.noise == "quantised":
            quanta = 2.0 * np.maximum(sizes, 1e-15)[:, None]
            shown = quanta * np.round(shown / quanta)
        outputs = self.shown(shown.transpose(2, 0, 1).reshape(runs * SAMPLES, -1), conditions)
        given = round(conditions.cut / STEP) or len(outputs)
        angles = commands[: -1 : vehicle.FINE].T.ravel()
        inputs = np.column_stack([angles, np.repeat(modes + 1.0, SAMPLES)])
        return Log(STEP, inputs[:given], outputs[:given], record)

    def errors(self, train: Log, test: Log, conditions: Conditions, seed: int, known: bool) -> FloatArray:
        """See ``Bench.errors``: the suspension is fitted by the slopes at its true values."""
        del conditions
        weights = 1.0 / np.array(vehicle.NOISE)
        runs = len(train.inputs) // SAMPLES
        base = tuple(self.base(seed).items())
        change: FloatArray = np.zeros(len(SUSPENSION))
        if not known:
            nominal, slopes = _nominal(base, seed, train.record, runs)
            off = np.nan_to_num((train.outputs - nominal) * weights)
            seen = np.isfinite(train.outputs[:1, :, None]) * slopes * weights[:, None]
            found = np.linalg.lstsq(seen.reshape(-1, len(change)), off.ravel(), rcond=None)[0]
            change = np.asarray(found, dtype=np.float64)
        nominal, slopes = _nominal(base, seed, test.record, runs)
        return np.asarray(np.sqrt(np.mean((test.outputs - nominal - slopes @ change) ** 2, axis=0)))

    def recording(self, log: Log, conditions: Conditions, seed: int) -> Recording:
        """See ``Bench.recording``: every run is an episode."""
        names = [signal.name for signal in (*self.model.inputs, *self.model.outputs)]
        columns = np.column_stack([log.inputs, log.outputs]).T
        runs = len(log.inputs) // SAMPLES
        return self.recorded(
            dict(zip(names, columns, strict=True)),
            STEP,
            conditions,
            seed,
            time=np.tile(np.arange(float(SAMPLES)) * STEP, runs),
            episode=np.repeat(np.arange(runs), SAMPLES),
        )

    def nothing(self) -> Iterator[Conditions]:
        """See ``Bench.nothing``."""
        for factor in (0.0, 1e-4, 1e-2, 0.1, 1.0):
            yield Conditions(factor=factor)
        for kind in NOISES:
            yield Conditions(noise=kind)
        yield Conditions(without=FORCES)
        yield Conditions(duration=2.0 * USUAL * RUN)


def _suspension(base: Mapping[str, float], runs: int) -> tuple[FloatArray, FloatArray]:
    values = np.array([base[name] for name in SUSPENSION]).reshape(2, 6, 1)
    damping, stiffness = np.repeat(values, runs, axis=2)
    return damping, stiffness


@lru_cache(maxsize=8)
def _commands(seed: int, record: int, runs: int) -> tuple[FloatArray, FloatArray]:
    """Axes, and angles of the arm between the samples, where it moves smoothly (points, runs)."""
    rng = np.random.default_rng([seed, 2 + record])
    samples = np.column_stack([vehicle.shaking(RUN, STEP, rng) for _ in range(runs)])
    grid = np.arange(float(SAMPLES))
    fine = np.arange(SAMPLES * vehicle.FINE + 1) / vehicle.FINE
    modes = (np.arange(runs) % 3).astype(float)
    return modes, make_interp_spline(grid, samples[:SAMPLES], k=5)(fine)


@lru_cache(maxsize=8)
def _nominal(
    items: tuple[tuple[str, float], ...], seed: int, record: int, runs: int
) -> tuple[FloatArray, FloatArray]:
    """Outputs of the nominal vehicle (n, 11), and their slopes by the suspension's logarithms (n, 11, 12)."""
    modes, commands = _commands(seed, record, runs)
    count = 1 + len(SUSPENSION)
    both = np.concatenate(_suspension(dict(items), runs))
    nudged = both[:, None] * np.exp(NUDGE * np.eye(len(SUSPENSION), count, 1))[:, :, None]
    flat = nudged.reshape(12, -1)
    plant = vehicle.Vehicle(flat[:6], flat[6:])
    shown = vehicle.simulate(
        plant, np.tile(modes, count), np.tile(commands, count), np.zeros((SAMPLES, 11, 1)), STEP
    )
    outputs = shown.reshape(SAMPLES, 11, count, runs).transpose(2, 3, 0, 1).reshape(count, -1, 11)
    return outputs[0], np.asarray((outputs[1:] - outputs[0]).transpose(1, 2, 0) / NUDGE)


BENCHES: Mapping[str, Excitation] = {"excitation": Excitation()}
