"""The shaken vehicle against an oracle that balances momenta; it shares no code with the kernels."""

from __future__ import annotations

import json
from functools import cache
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

import fieldgym  # noqa: F401
from exam.oracles import excitation as oracle
from fieldmodels.machines.excitation.model import ExcitationModel
from fieldmodels.recording import Recording

Array = NDArray[np.float64]
Effects = dict[str, dict[str, float]]

SHAKEN: dict[str, tuple[dict[str, float], ...]] = {
    "payload": ({"mass": 0.0137}, {"mass": 0.713}),
    "cubic_stiffness": ({"force": -37.0, "torque": 0.73}, {"force": 371.0, "torque": -3.7}),
    "coulomb_friction": ({"force": 0.137, "torque": 0.0371}, {"force": 1.73, "torque": 0.53}),
    "stiffness_drift": ({"rate": 0.0037}, {"rate": -0.0371}),
    "soil_compliance": ({"share": 0.0731}, {"share": 0.731}),
    "actuator_lag": tuple({"time_constant": lag} for lag in (0.0073, 0.0731, 0.00073, 0.0371)),
    "accelerometer_bias": ({"x": 0.0137, "y": -0.171, "z": 0.371}, {"x": -1.3, "y": 0.73, "z": -0.0173}),
    "accelerometer_gain": ({"gain": 1.0173}, {"gain": 0.613}),
    "inclinometer_bias": ({"pitch": 0.0017, "roll": -0.0173}, {"pitch": -0.137, "roll": 0.0371}),
    "inclinometer_delay": ({"delay": 0.0017}, {"delay": 0.0731}, {"delay": 0.0071}),
    "force_torque_gain": ({"gain": 0.983}, {"gain": 1.73}),
}
CASES = {"excitation": SHAKEN}
PAIRS: list[Effects] = [
    {a: SHAKEN[a][1], b: SHAKEN[b][1]}
    for a, b in (
        ("payload", "force_torque_gain"),
        ("cubic_stiffness", "stiffness_drift"),
        ("soil_compliance", "cubic_stiffness"),
        ("soil_compliance", "stiffness_drift"),
        ("accelerometer_bias", "accelerometer_gain"),
        ("inclinometer_bias", "inclinometer_delay"),
        ("inclinometer_bias", "accelerometer_gain"),
        ("actuator_lag", "inclinometer_delay"),
    )
]
PAIRS.append({effect: cases[0] for effect, cases in SHAKEN.items()})  # and all of them at once
REALITIES: list[Effects] = [*({e: own} for e, cases in SHAKEN.items() for own in cases[-1:]), *PAIRS]

ODD = {"inertia_xz": 0.013, "inertia_xy": -0.0071, "cg_x": 0.037, "damping_yaw": 3.7, "stiffness_x": 1137.0}
"""A body in which no value is zero or twice the same."""
STEP, FINE = 0.0025, 10
"""Time between samples of the commands [s], and steps of the kernel between them."""
PREDICTED = 3e-4
"""Largest error of an effect's change as a share of it. The trapezoidal rule errs by (0.25 ms w)^2 / 12 of
what moves at w: 5e-3 of the transients of soil and friction (1000 1/s), less than a tenth of a change."""
TOLD = 2e-3
"""The same in the environment, by steps of 1.25 ms, where body and arm move at 40 1/s or less."""
NOMINAL = 1e-4
"""Largest error without effects as a share of a kind of signal; the dampers of Table I relax at 2000 1/s."""
KINDS = [3, 5, 8]
"""Where an output is of another kind: accelerations, tilts, forces, torques."""
BEGAN = 0.713
"""Time of a recording's first sample [s]."""


def name_of(effects: Effects) -> str:
    """Name of a test's case."""
    if len(effects) > 2:
        return "all"
    return "+".join(f"{e}:{','.join(f'{v:g}' for v in values.values())}" for e, values in effects.items())


def axis_of(effects: Effects) -> int:
    """The arm's axis on which effects are tried: all axes in turn."""
    return len(name_of(effects)) % 3


def commands(axis: int) -> Array:
    """Angle and axis of an arm that starts from rest, 2.5 ms apart, shape (130, 2)."""
    time = np.arange(130) * STEP
    angle = 0.31 + 0.15 * (1.0 - np.cos(9.0 * time)) ** 2
    return np.column_stack([angle, np.full(len(time), axis + 1.0)])


def predicted(effects: Effects, axis: int, vehicle: str = "soft") -> Array:
    """What the model predicts, by fine steps, at the samples, shape (121, 11)."""
    model = ExcitationModel(vehicle)
    given = model.between(commands(axis), FINE)
    signals = {"arm_angle": given[:, 0], "arm_axis": given[:, 1]}
    signals |= {signal.name: np.zeros(len(given)) for signal in model.outputs}
    windows = model.windows(Recording(BEGAN + STEP / FINE * np.arange(len(given)), signals), 120 * STEP)
    return model.simulate(model.vector(ODD, effects), windows)[0, 0][::FINE]


def expected(effects: Effects, axis: int, vehicle: str = "soft") -> Array:
    """What the oracle says of it."""
    model = ExcitationModel(vehicle)
    base = {p.name: p.nominal for p in model.parameters} | ODD
    return oracle.simulate(base, effects, commands(axis), STEP, {"time": BEGAN})[:121]


@cache
def without(axis: int, vehicle: str = "soft") -> tuple[Array, Array]:
    """Both without an effect."""
    return predicted({}, axis, vehicle), expected({}, axis, vehicle)


def check_change(own: Array, oracles: Array, own_off: Array, oracles_off: Array, share: float) -> None:
    """The change that effects make is the same, by each column's largest, and there is one."""
    change = np.abs(oracles - oracles_off).max(axis=0)
    size = np.abs(oracles_off).max(axis=0)
    assert (change > 1e-3 * size).any()
    error = np.abs((own - own_off) - (oracles - oracles_off)).max(axis=0)
    np.testing.assert_array_less(error, share * change + 1e-7 * size + 1e-12)


@pytest.mark.parametrize(("axis", "vehicle"), [(0, "soft"), (1, "soft"), (2, "soft"), (2, "table1")])
def test_nominal_prediction(axis: int, vehicle: str) -> None:
    """Without effects every sensor shows what the oracle says."""
    own, oracles = without(axis, vehicle)
    kinds = np.split(np.abs(own - oracles), KINDS, axis=1), np.split(np.abs(oracles), KINDS, axis=1)
    for error, shown in zip(*kinds, strict=True):
        assert error.max() < NOMINAL * shown.max()


@pytest.mark.matrix(
    keep=(
        "payload-1",
        "cubic_stiffness-0",
        "cubic_stiffness-1",
        "coulomb_friction-0",
        "coulomb_friction-1",
        "stiffness_drift-0",
        "stiffness_drift-1",
        "soil_compliance-1",
        "actuator_lag-2",
        "accelerometer_bias-1",
        "accelerometer_gain-1",
        "inclinometer_bias-0",
        "force_torque_gain-1",
    )
)
def test_prediction(effect: str, values: dict[str, float]) -> None:
    """One effect changes a prediction as its equation says."""
    axis = axis_of({effect: values})
    own_off, oracles_off = without(axis)
    own, oracles = predicted({effect: values}, axis), expected({effect: values}, axis)
    check_change(own, oracles, own_off, oracles_off, PREDICTED)


@pytest.mark.parametrize("effects", PAIRS, ids=map(name_of, PAIRS))
def test_prediction_of_pairs(effects: Effects) -> None:
    """Two effects act on each other as their equations say."""
    axis = axis_of(effects)
    own_off, oracles_off = without(axis)
    check_change(predicted(effects, axis), expected(effects, axis), own_off, oracles_off, PREDICTED)


PUSHED = np.array([3.1, -4.3, 5.7, 0.71, -0.53, 0.37, 0.0371, 0.0573])
"""Largest forces [N], torques [N m], and errors of the arm's angle and of its way from rest [rad]."""


def wave(time: Array, column: int) -> Array:
    """What acts in a direction; neither it nor its rate begins at zero."""
    return np.asarray(PUSHED[column] * np.sin(11.0 * time + 0.7))


class Pushed(oracle.Vehicle):
    """A vehicle on which one force or torque acts beside its suspension."""

    column: int

    def resistance(self, time: float, x: Array, v: Array) -> Array:
        """See ``oracle.Vehicle``."""
        result = super().resistance(time, x, v)
        if self.column < 6:
            result[self.column] -= wave(np.array(time - BEGAN), self.column)
        return result


def with_push(column: int | None, axis: int) -> tuple[Array, Array]:
    """What the model simulates with a push, and what the oracle says, shape (121, 15)."""
    model = ExcitationModel("soft")
    given = model.between(commands(axis), FINE)
    signals = {"arm_angle": given[:, 0], "arm_axis": given[:, 1]}
    signals |= {signal.name: np.zeros(len(given)) for signal in model.outputs}
    time = STEP / FINE * np.arange(len(given))
    windows = model.windows(Recording(BEGAN + time, signals), 120 * STEP)
    if column is not None:
        weights = model.pushes[column].weights
        windows = windows.with_disturbance(np.multiply.outer(wave(time, column), weights))
    own = model.simulate_all(model.vector(ODD, {}), windows)[0, 0][::FINE]
    times = STEP * np.arange(121.0)
    spline = make_interp_spline(STEP * np.arange(130.0), commands(axis)[:, 0], k=5)
    error, begin = (PUSHED[column], wave(np.zeros(1), column)[0]) if column in (6, 7) else (0.0, 0.0)

    def motion(t: float) -> tuple[float, float, float]:
        sine, cosine = error * np.sin(11.0 * t + 0.7), error * np.cos(11.0 * t + 0.7)
        rest = begin if column == 7 else 0.0
        return (
            float(spline(t)) + sine - rest,
            float(spline(t, 1)) + 11.0 * cosine,
            float(spline(t, 2)) - 121.0 * sine,
        )

    base = {p.name: p.nominal for p in model.parameters} | ODD
    vehicle = Pushed(base, {}, axis, motion(0.0)[0])
    object.__setattr__(vehicle, "column", 9 if column is None else column)
    run = oracle.shake(vehicle, motion, times, began=BEGAN)
    every = np.arange(121)
    said = oracle.shown(vehicle.given, run, every, every)
    return own, np.column_stack([said, run.place, run.angle[:, 2]])


@pytest.mark.parametrize("column", range(8))
def test_a_push_is_that_of_newton_and_euler(column: int) -> None:
    """A force, a torque or an error of the arm acts in its direction; deflection and yaw are those there."""
    axis = column % 3
    own_off, oracles_off = with_push(None, axis)
    own, oracles = with_push(column, axis)
    # The first sample shows the rest before anything acts.
    check_change(own[1:], oracles[1:], own_off[1:], oracles_off[1:], PREDICTED)


@pytest.mark.parametrize("column", range(6))
def test_a_push_runs_straight_between_samples(column: int) -> None:
    """Samples of 10 ms, integrated by steps of 2.5 ms, are samples of 2.5 ms along lines."""
    model = ExcitationModel("soft")
    coarse, fine = 0.01 * np.arange(81), 0.0025 * np.arange(321)
    pushes, shown = wave(coarse, column), []
    for time in (coarse, fine):
        still = {"arm_angle": np.full(len(time), 0.3), "arm_axis": np.ones(len(time))}
        signals = still | {signal.name: np.zeros(len(time)) for signal in model.outputs}
        along = np.multiply.outer(np.interp(time, coarse, pushes), model.pushes[column].weights)
        windows = model.windows(Recording(time, signals), 0.8).with_disturbance(along)
        shown.append(model.simulate(model.nominal, windows)[0, 0][:: len(time) // 80])
    assert np.abs(shown[0]).max() > 0.01
    np.testing.assert_allclose(shown[0], shown[1], rtol=0.0, atol=1e-9)


LATE = 0.01
"""The same of a late inclinometer: between samples it follows a cubic whose slopes are w, the rotation
vector's own but for theta x w / 2."""
TURNING = slice(9, 12)
"""Features w'."""
ACTIONS = np.array([[-0.3, 0.1, 0.2], [0.1, 0.3, -0.1]], dtype=np.float32)


@cache
def quiet(reality: str) -> tuple[Array, Array]:
    """Features of the environment without noise, shape (3, 160, 30), and the arm's commands, shape (3, 3)."""
    settings = {"preset": "soft", "noise_fraction": 0.0}
    effects = json.loads(reality)
    env: Any = gym.make("fieldgym/Excitation-v0", settings=settings, reality=effects | {"parameters": ODD})
    _, info = env.reset(seed=0)
    filters = env.unwrapped._task.shakers._filters
    caught, update = [], filters.update

    def catch(features: Array, noise: Array) -> None:
        caught.append(features[0].copy())
        update(features, noise)

    filters.update = catch
    given = [info["arm.command"].copy()]
    for action in ACTIONS:
        info = env.step(action)[-1]
        given.append(info["arm.command"].copy())
    return np.concatenate(caught, axis=1), np.array(given)


@cache
def told(reality: str, axis: int) -> Array:
    """The oracle's features of it, shape (160, 30)."""
    base = {p.name: p.nominal for p in ExcitationModel().parameters} | ODD
    motion, stops = oracle.blended(quiet(reality)[1])
    vehicle = oracle.Vehicle(base, json.loads(reality), axis, motion(0.0)[0])
    every, now, late = oracle.times_seen(vehicle, 0.005 * np.arange(1.0, 161.0))
    run = oracle.shake(vehicle, motion, np.union1d([0.0], every), stops)
    first = int(every[0] > 0.0)
    return oracle.features(vehicle.given, run, now + first, late + first)


@pytest.mark.matrix(
    keep=(
        "stiffness_drift:-0.0371",
        "actuator_lag:0.0371",
        "accelerometer_gain:0.613",
        "inclinometer_bias:-0.137,0.0371",
        "inclinometer_delay:0.0071",
        "force_torque_gain:1.73",
        "payload:0.713+force_torque_gain:1.73",
        "cubic_stiffness:371,-3.7+stiffness_drift:-0.0371",
        "accelerometer_bias:-1.3,0.73,-0.0173+accelerometer_gain:0.613",
    )
)
@pytest.mark.parametrize("effects", REALITIES, ids=map(name_of, REALITIES))
def test_environment(effects: Effects) -> None:
    """The environment's sensors show in this reality what the oracle says."""
    axis = axis_of(effects)
    own, own_off = (quiet(json.dumps(on))[0][axis].copy() for on in (effects, {}))
    oracles, oracles_off = (told(json.dumps(on), axis).copy() for on in (effects, {}))
    if "inclinometer_delay" in effects:
        # w' jumps as the arm begins to move, and no cubic leads through the sample after.
        shown = 0.005 * np.arange(1.0, 161.0) - effects["inclinometer_delay"]["delay"]
        for values in (own, own_off, oracles, oracles_off):
            values[shown < 0.005, TURNING] = 0.0
            values[(shown >= 0.0) & (shown < 0.005)] = 0.0
    size = np.abs(oracles_off).max(axis=0)
    np.testing.assert_array_less(np.abs(own_off - oracles_off).max(axis=0), TOLD * size + 1e-12)
    share = LATE if "inclinometer_delay" in effects else TOLD
    check_change(own, oracles, own_off, oracles_off, share)
