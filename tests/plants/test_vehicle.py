"""The shaken vehicle against the exam's plant, by fine steps: model, pushes and environment."""

from __future__ import annotations

import json
from functools import cache
from itertools import pairwise
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from numpy.polynomial import Polynomial
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

import fieldgym  # noqa: F401
from exam.benches import get_bench
from exam.plants import vehicle
from fieldmodels.machines.excitation.model import ExcitationModel
from fieldmodels.recording import Recording

Array = NDArray[np.float64]
Effects = dict[str, dict[str, float]]

VALUES: Effects = {
    "payload": {"mass": 0.713},
    "cubic_stiffness": {"force": 371.0, "torque": -3.7},
    "coulomb_friction": {"force": 1.73, "torque": 0.53},
    "stiffness_drift": {"rate": -0.0371},
    "soil_compliance": {"share": 0.731},
    "actuator_lag": {"time_constant": 0.0371},
    "accelerometer_bias": {"x": -1.3, "y": 0.73, "z": -0.0173},
    "accelerometer_gain": {"gain": 0.613},
    "inclinometer_bias": {"pitch": -0.137, "roll": 0.0371},
    "inclinometer_delay": {"delay": 0.0071},
    "force_torque_gain": {"gain": 1.73},
}
TOGETHER: list[Effects] = [
    {e: VALUES[e] for e in ("payload", "force_torque_gain", "accelerometer_bias", "accelerometer_gain")},
    {e: VALUES[e] for e in ("soil_compliance", "cubic_stiffness", "stiffness_drift")},
    {e: VALUES[e] for e in ("actuator_lag", "inclinometer_bias", "inclinometer_delay")},
]
REALITIES: list[Effects] = [*({e: VALUES[e]} for e in get_bench("excitation").effects), *TOGETHER]
ODD = {"inertia_xz": 0.013, "inertia_xy": -0.0071, "cg_x": 0.037, "damping_yaw": 3.7, "stiffness_x": 1137.0}
"""A body in which no value is zero or twice the same."""
STEP, FINE = 0.0025, 10
"""Time between samples of the commands [s], and steps of the kernel between them."""
PREDICTED = 6e-4
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


def plant(effects: Effects, body: str = "soft", **more: Any) -> vehicle.Vehicle:
    """The plant of the odd body in a reality."""
    base = {p.name: p.nominal for p in ExcitationModel(body).parameters} | ODD
    shaped = [np.array([[base[f"{kind}_{a}"]] for a in vehicle.AXES]) for kind in ("damping", "stiffness")]
    made = vehicle.Vehicle(*shaped, body=base, **more)
    vehicle.install(made, effects)
    return made


def command() -> Array:
    """Angle of an arm that starts from rest, 2.5 ms apart, shape (130,)."""
    return 0.31 + 0.15 * (1.0 - np.cos(9.0 * np.arange(130) * STEP)) ** 2


def given(axis: int, body: str = "soft") -> tuple[ExcitationModel, Any]:
    """The model, and a window of it by fine steps."""
    model = ExcitationModel(body)
    fine = model.between(np.column_stack([command(), np.full(130, axis + 1.0)]), FINE)
    signals = {"arm_angle": fine[:, 0], "arm_axis": fine[:, 1]}
    signals |= {signal.name: np.zeros(len(fine)) for signal in model.outputs}
    return model, model.windows(Recording(BEGAN + STEP / FINE * np.arange(len(fine)), signals), 120 * STEP)


def shown(made: vehicle.Vehicle, modes: Array, error: Array | float = 0.0) -> Array:
    """What the plant shows with its arm about some axes, side by side, shape (121, 11, modes)."""
    spline = make_interp_spline(np.arange(130.0), command(), k=5)
    fine = spline(np.arange(121 * vehicle.FINE + 1) / vehicle.FINE)[:, None] + np.zeros(len(modes)) + error
    made.finer = 5
    return vehicle.simulate(made, modes, fine, np.zeros((121, 11, 1)), STEP)


@cache
def both(effects: str, axis: int, body: str = "soft") -> tuple[Array, Array]:
    """What the model predicts, and the plant shows, shape (121, 11)."""
    on = json.loads(effects)
    model, windows = given(axis, body)
    predicted = model.simulate(model.vector(ODD, on), windows)[0, 0][::FINE]
    return predicted, _shown(effects, body)[..., axis]


@cache
def _shown(effects: str, body: str) -> Array:
    return shown(plant(json.loads(effects), body, began=BEGAN), np.arange(3.0))


def check_change(own: Array, theirs: Array, own_off: Array, theirs_off: Array, share: float) -> None:
    """The change that effects make is the same, by each column's largest, and there is one."""
    change = np.abs(theirs - theirs_off).max(axis=0)
    size = np.abs(theirs_off).max(axis=0)
    assert (change > 1e-3 * size).any()
    error = np.abs((own - own_off) - (theirs - theirs_off)).max(axis=0)
    np.testing.assert_array_less(error, share * change + 1e-6 * size + 1e-12)


@pytest.mark.every("body", ["soft", "table1"])
def test_nominal_prediction(body: str) -> None:
    """Without effects every sensor shows what the plant says."""
    for axis in range(3):
        own, theirs = both("{}", axis, body)
        kinds = np.split(np.abs(own - theirs), KINDS, axis=1), np.split(np.abs(theirs), KINDS, axis=1)
        for error, size in zip(*kinds, strict=True):
            assert error.max() < NOMINAL * size.max()


@pytest.mark.every("effects", REALITIES)
def test_prediction(effects: Effects) -> None:
    """Effects change a prediction as their equations say, one or more at a time."""
    for axis in range(3):
        check_change(*both(json.dumps(effects), axis), *both("{}", axis), PREDICTED)


def test_a_lag_shorter_than_a_sample() -> None:
    """What it follows within a step counts."""
    short = json.dumps({"actuator_lag": {"time_constant": 0.00073}})
    check_change(*both(short, 2), *both("{}", 2), PREDICTED)


PUSHED = np.array([3.1, -4.3, 5.7, 0.71, -0.53, 0.37, 0.0371, 0.0573])
"""Largest forces [N], torques [N m], and errors of the arm's angle and of its way from rest [rad]."""


def wave(time: Array, column: int) -> Array:
    """What acts in a direction; neither it nor its rate begins at zero."""
    return np.asarray(PUSHED[column] * np.sin(11.0 * time + 0.7))


def test_a_push_is_that_of_newton_and_euler() -> None:
    """A force, a torque or an error of the arm acts in its direction; all of them side by side."""
    columns = np.arange(8)
    made, count = plant({}, began=BEGAN), 121 * vehicle.FINE + 1
    made.loads.append(
        lambda t, _x, _v: np.diag([-wave(np.array(t - BEGAN), k) * (k < 6) for k in columns])[:6]
    )
    error = np.zeros((count, 8))
    for k in (6, 7):
        error[:, k] = wave(STEP / vehicle.FINE * np.arange(count), k)
    error[:, 7] -= error[0, 7]
    pushed = shown(made, columns % 3, error)
    for k in columns:
        model, windows = given(k % 3)
        along = np.multiply.outer(wave(windows.recording.time - BEGAN, k), model.pushes[k].weights)
        own = model.simulate(model.vector(ODD, {}), windows.with_disturbance(along))[0, 0][::FINE]
        still = both("{}", k % 3)
        # The first sample shows the rest before anything acts.
        check_change(*(part[1:] for part in (own, pushed[..., k], *still)), PREDICTED)


def test_a_push_runs_straight_between_samples() -> None:
    """Samples of 10 ms, integrated by steps of 2.5 ms, are samples of 2.5 ms along lines."""
    model = ExcitationModel("soft")
    coarse, fine = 0.01 * np.arange(81), 0.0025 * np.arange(321)
    for column in range(6):
        pushes, simulated = wave(coarse, column), []
        for time in (coarse, fine):
            still = {"arm_angle": np.full(len(time), 0.3), "arm_axis": np.ones(len(time))}
            signals = still | {signal.name: np.zeros(len(time)) for signal in model.outputs}
            along = np.multiply.outer(np.interp(time, coarse, pushes), model.pushes[column].weights)
            windows = model.windows(Recording(time, signals), 0.8).with_disturbance(along)
            simulated.append(model.simulate(model.nominal, windows)[0, 0][:: len(time) // 80])
        assert np.abs(simulated[0]).max() > 0.01
        np.testing.assert_allclose(simulated[0], simulated[1], rtol=0.0, atol=1e-9)


COARSE = {"inclinometer_delay": 0.01, "coulomb_friction": 0.01}
"""The same of a late inclinometer, which between samples follows a cubic whose slopes are w, the rotation
vector's own but for theta x w / 2, and of friction that fades within a step."""
TURNING = slice(9, 12)
"""Features w'."""
ACTIONS = np.array([[-0.3, 0.1, 0.2], [0.1, 0.3, -0.1]], dtype=np.float32)
DECISION = 0.4


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


def blended(commands: Array, time: Array) -> Array:
    """The arm's angle a0 + a sin(phi), phi' = w.

    Args:
        commands: Amplitude [rad], frequency [rad/s] and offset [rad] at the ends of the decisions, the first
            in force before them at phase 0, shape (decisions + 1, 3). Each passes to the next along
            10 s^3 - 15 s^4 + 6 s^5.
        time: When [s].
    """
    phase, angle = 0.0, np.zeros(len(time))
    for number, (before, after) in enumerate(pairwise(commands)):
        passing = Polynomial([0.0, 0.0, 0.0, 10.0, -15.0, 6.0])(Polynomial([0.0, 1.0 / DECISION]))
        a, w, a0 = (p + (n - p) * passing for p, n in zip(before, after, strict=True))
        phi, since = w.integ() + phase, time - number * DECISION
        angle = np.where(since >= 0.0, a0(since) + a(since) * np.sin(phi(since)), angle)
        phase = phi(DECISION)
    return angle


@cache
def told(reality: str) -> Array:
    """The plant's features of it, those of eq (4), shape (3, 160, 30).

    Specific force (gravity's change less acceleration), dr', dr, w', products and squares of w, w, the
    rotation vector, dF, dN. dr' and dr are integrals of the accelerometer that are zeroed at rest, and so
    without its bias; what the inclinometer shows late, its derivatives show late.
    """
    effects, step = json.loads(reality), 0.001
    made = plant(effects, moving=True)
    time = step * np.arange(801.0)
    angle = blended(quiet(reality)[1], step / vehicle.FINE * np.arange(801 * vehicle.FINE + 1))
    fine = np.repeat(angle[:, None], 3, axis=1)
    readings = vehicle.simulate(made, np.arange(3.0), fine, np.zeros((801, 11, 1)), step)
    late = make_interp_spline(time, made.path, k=3)(np.maximum(time - made.delay, 0.0))
    turning, w, tilt = late[:, 6:9], late[:, 9:12], late[:, 12:15].copy()
    tilt[:, :2] = readings[:, 3:5]
    products = w[:, [1, 0, 0]] * w[:, [2, 2, 1]]
    moved = effects.get("accelerometer_gain", {}).get("gain", 1.0) * made.path[:, [3, 4, 5, 0, 1, 2]]
    parts = [-readings[:, :3], moved, turning, products, w**2, w, tilt, readings[:, 5:]]
    return np.concatenate(parts, axis=1)[5::5].transpose(2, 0, 1)


@pytest.mark.every("effects", REALITIES)
def test_environment(effects: Effects) -> None:
    """The environment's sensors show in this reality what the plant says."""
    own, own_off = (quiet(json.dumps(on))[0].copy() for on in (effects, {}))
    theirs, theirs_off = (told(json.dumps(on)).copy() for on in (effects, {}))
    if "inclinometer_delay" in effects:
        # w' jumps as the arm begins to move, and no cubic leads through the sample after.
        seen = 0.005 * np.arange(1.0, 161.0) - effects["inclinometer_delay"]["delay"]
        for values in (own, own_off, theirs, theirs_off):
            values[:, seen < 0.005, TURNING] = 0.0
            values[:, (seen >= 0.0) & (seen < 0.005)] = 0.0
    share = max(COARSE.get(effect, TOLD) for effect in effects)
    for axis in range(3):
        size = np.abs(theirs_off[axis]).max(axis=0)
        np.testing.assert_array_less(
            np.abs(own_off[axis] - theirs_off[axis]).max(axis=0), TOLD * size + 1e-12
        )
        check_change(own[axis], theirs[axis], own_off[axis], theirs_off[axis], share)
