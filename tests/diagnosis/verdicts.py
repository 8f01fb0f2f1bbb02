"""Diagnoses of every shape, made without diagnosing, for tests of what is said of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fieldmodels.diagnosis.outcome import Diagnosis
from fieldmodels.diagnosis.result import Cause, Estimate, Evidence, MissingCurve, Share, SignalGain, Visible
from fieldmodels.registry import get_model

RIG = get_model("rig")
CURVE = np.column_stack([np.linspace(-1.0, 1.0, 8), np.linspace(-2.0, 2.0, 8), np.full(8, 0.1)])


def gain(before: float = 0.01, after: float = 0.002) -> SignalGain:
    share = Share(100.0 * (1.0 - after / before), (70.0, 85.0))
    return SignalGain("m", before, after, share, 0.2, 0.001, after, share)


def cause(effect: str, *alternatives: str, chance: float = 1e-9) -> Cause:
    return Cause(
        effect, "Something happens.", "actuator", {"delay": Estimate(0.05, 5e-5, "s")}, "position",
        Share(80.0, (70.0, 85.0)), alternatives=alternatives, p_value=1e-4, chance=chance, nats=50.0,
    )  # fmt: skip


def curve(place: str, target: str, over: str, formula: str = "", certain: bool = True) -> MissingCurve:
    return MissingCurve(place, target, over, "m/s", "N", CURVE, 1e-5, 30.0, formula, certain)


def verdict(
    causes: Sequence[Cause] = (), curves: Sequence[MissingCurve] = (), kind: str = "", **changes: object
) -> Diagnosis:
    """A diagnosis of a rig with these causes and curves."""
    ambiguous = any(c.alternatives for c in causes)
    found = "ambiguous" if ambiguous else "named" if causes else "unknown" if curves else "consistent"
    plain = Diagnosis(
        model="rig", machine=RIG, verdict=kind or found, causes=tuple(causes), mistaken="", misfit=(),
        gain={"position": gain()}, curves=tuple(curves), possible=(), seen=(), curve_effects={},
        not_runnable=(), next_measurement=None,
        parameters={p.name: Estimate(p.nominal, 0.01, p.unit) for p in RIG.parameters}, undetermined=(),
        vector=RIG.nominal, not_testable={}, trained_on=("a.csv",), tested_on=("b.csv",), windows=(90, 30),
        seconds=3.0, evidence=Evidence(),
    )  # fmt: skip
    return replace(plain, **changes)


LIKELY = cause("coulomb_friction", chance=1e-4)
VELOCITY = curve("parameter", "damping", "velocity")
SHAPES = {
    "one": verdict([cause("actuator_delay")]),
    "one of a sensor": verdict([cause("sensor_gain")]),
    "two": verdict([cause("actuator_delay"), cause("coulomb_friction")]),
    "two, less certain": verdict([cause("actuator_delay"), LIKELY]),
    "three": verdict(
        [cause("actuator_delay"), cause("elastic_stop"), cause("coulomb_friction", chance=0.01)]
    ),
    "a tie": verdict([cause("coulomb_friction", "stribeck_friction")]),
    "a tie of three": verdict([cause("actuator_delay", "actuator_lag", "sensor_delay")]),
    "a tie with a curve": verdict([cause("sensor_gain", "curve of position, in the sensor of position")]),
    "a tie with a force's curve": verdict([cause("coulomb_friction", "curve of velocity")]),
    "a tie with a value's curve": verdict(
        [cause("actuator_delay", "curve of size of rate of velocity, in actuator_delay.delay")]
    ),
    "a tie with chance": verdict([cause("actuator_delay", "random changes of actuator delay")]),
    "a tie and a name": verdict([cause("coulomb_friction", "stribeck_friction"), cause("constant_force")]),
    "two ties": verdict(
        [cause("coulomb_friction", "stribeck_friction"), LIKELY, cause("actuator_lag", "sensor_lag")]
    ),
    "a name and a curve": verdict([cause("actuator_delay")], [VELOCITY]),
    "a tie and a curve": verdict([cause("coulomb_friction", "stribeck_friction")], [VELOCITY]),
    "a name and an uncertain curve": verdict([cause("gyro_bias")], [replace(VELOCITY, certain=False)]),
    "a curve": verdict([], [VELOCITY], curve_effects={"x": {}}),
    "two curves": verdict(
        [],
        [curve("force", "", "velocity", "sign"), curve("force", "", "position", "ends")],
        curve_effects={"x": {}},
    ),
    "a force's curve": verdict([], [curve("force", "", "velocity", "sign")]),
    "a sensor's curve": verdict([], [curve("sensor", "position", "position", "repeats every 0.1 m")]),
    "a wheel's curve": verdict([], [curve("force", "share of left_wheel", "way of left_wheel", "square")]),
    "a constant": verdict([], [curve("sensor", "position", "time", "constant")]),
    "an uncertain curve": verdict([], [replace(VELOCITY, certain=False)]),
    "an unconfirmed curve": verdict([], [replace(VELOCITY, confirmed=False)]),
    "a name and an unconfirmed curve": verdict(
        [cause("actuator_delay")], [replace(VELOCITY, confirmed=False)], possible=(cause("gyro_bias"),)
    ),
    "a curve and an unconfirmed one": verdict(
        [],
        [VELOCITY, replace(curve("force", "", "position", "ends"), confirmed=False)],
        curve_effects={"x": {}},
    ),
    "nothing": verdict(
        seen=(
            Visible("force", "", "velocity", 0.031, "N", {"position": 1e-4}),
            Visible("sensor", "position", "position", 2e-4, "m", {"position": 2e-4}),
            Visible("parameter", "damping", "velocity", 0.2, "N s/m", {"position": 1e-4}),
        ),
        gain={"position": replace(gain(), unseen=9e-4), "velocity": replace(gain(), unit="m/s", unseen=0.03)},
    ),
    "nothing but noise": verdict(
        above_noise={"position": 2.9, "velocity": 2.0}, gain={"position": replace(gain(), unseen=0.008)}
    ),
    "a sensor that wanders": verdict(wandering={"position": 0.002}),
    "lost samples": verdict(lost=("the position sensor repeats its last value in 3 % of the samples",)),
    "doubted": verdict(
        [cause("actuator_delay")], undetermined=("mass", "damping"), possible=(cause("gyro_bias"),),
        bounded=("the mass at the largest value allowed, 2.00 kg",), above_noise={"position": 3.0},
    ),
    "two possible": verdict(possible=(cause("unequal_wheels"), cause("radar_position"))),
    "quantised": verdict([replace(cause("sensor_quantisation"), chance=float("nan"))]),
    "a sign": verdict(
        kind="unknown", mistaken="the sign of force seems to be reversed (declare it as force=-force)"
    ),
    "two columns": verdict(
        kind="unknown", mistaken="left and right seem to be swapped (declare left=right and right=left)"
    ),
    "unrelated": verdict(kind="unrelated"),
    "out of time": verdict(
        [cause("actuator_delay")],
        stopped="Stopped after 5 s of a budget of 4 s; not tried: the next measurement.",
    ),
}  # fmt: skip
