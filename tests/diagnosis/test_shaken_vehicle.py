"""What the shaken vehicle's list does not hold: forces beside its suspension, and errors of its arm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

import fieldgym  # noqa: F401
from exam.plants import vehicle
from fieldmodels.contract import ModelWarning
from fieldmodels.diagnosis import diagnose
from fieldmodels.diagnosis.curves import Curves
from fieldmodels.diagnosis.fit import fit
from fieldmodels.diagnosis.options import DEFAULT
from fieldmodels.diagnosis.outcome import Diagnosis
from fieldmodels.diagnosis.problem import build
from fieldmodels.machines.excitation.model import ExcitationModel, joined_runs
from fieldmodels.machines.excitation.recording import record_experiment
from fieldmodels.recording import Recording
from fieldmodels.synthesis import synthesise
from fieldmodels.yaml import save_yaml

STEP, SAMPLES = 0.01, 400
MODEL = ExcitationModel("soft")
Fault = Callable[[vehicle.Vehicle], None]


def log(seed: int, fault: Fault | None = None) -> Recording:
    """Three runs of 4 s, about x, y and z, by the exam's plant, with the usual noise."""
    rng = np.random.default_rng([711, seed])
    plant = vehicle.Vehicle(*(np.tile(np.array(v)[:, None], 3) for v in (vehicle.DAMPING, vehicle.STIFFNESS)))
    if fault:
        fault(plant)
    coarse = np.column_stack([vehicle.shaking(4.0, STEP, rng)[:SAMPLES] for _ in range(3)])
    fine = np.arange(SAMPLES * vehicle.FINE + 1) / vehicle.FINE
    commands = make_interp_spline(np.arange(float(SAMPLES)), coarse, k=5)(fine)
    noise = rng.standard_normal((SAMPLES, 11, 3)) * np.array(vehicle.NOISE)[:, None]
    shown = vehicle.simulate(plant, np.arange(3.0), commands, noise, STEP)
    names = [signal.name for signal in MODEL.outputs]
    return joined_runs(
        [
            Recording(
                np.arange(SAMPLES) * STEP,
                {
                    "arm_angle": coarse[:, k],
                    "arm_axis": np.full(SAMPLES, k + 1.0),
                    **dict(zip(names, shown[:, :, k].T, strict=True)),
                },
                known=dict(vehicle.BODY),
            )
            for k in range(3)
        ],
        f"seed {seed}",
    )


@cache
def nominal() -> tuple[Curves, np.ndarray]:
    """Curves beside the vehicle as it is, and its features."""
    problem = build(MODEL, [log(1)], 0.4)
    vector = MODEL.nominal
    fitted = fit(
        problem, vector, np.zeros(0, dtype=np.int64), np.diag(1 / problem.output_scale), iterations=0
    )
    return Curves(problem, fitted, DEFAULT), problem.features - fitted.raw


def told(curves: Curves, target: str, over: str) -> Curves:
    return next(
        c for c in curves.all if (c.place, c.target, c.over) == ("force", target, over) and not c.formula
    )


@pytest.mark.parametrize("column", range(6))
def test_a_force_is_felt_in_the_windows_after_it(column: int):
    """A slow wave of force over all windows, put together from segments, is that of one simulation."""
    curves, before = nominal()
    push, part, size = MODEL.pushes[column], curves.problem.parts[0], 1e-3

    def wave(time: np.ndarray) -> np.ndarray:
        return np.sin(7.0 * time)

    time = curves.signals["time"][1]
    place = told(curves, push.name, "time")
    found = curves.response(replace(place, values=wave(time)[:, :, None]))[:, :, 0]
    acting = np.multiply.outer(size * wave(part.windows.recording.time), push.weights)
    after = curves.problem.response(curves.fitted.parameters, curves.fitted.states, [acting])
    expected = (after - before) / size @ curves.fitted.whitener.T
    assert np.linalg.norm(found - expected) < 0.12 * np.linalg.norm(expected)
    own = place.values.shape[1]
    alone = curves.answers(place).columns[:, :, :own] @ wave(time)[:, :, None]
    assert np.linalg.norm(alone[:, :, 0] - expected) > 0.3 * np.linalg.norm(expected)


@pytest.mark.parametrize(("target", "from_rest"), [("arm's angle", False), ("arm's way from rest", True)])
def test_an_error_of_the_arm_s_angle_is_another_command(target: str, from_rest: bool):
    curves, before = nominal()
    size, recording = 1e-4, curves.problem.parts[0].windows.recording
    angle = recording["arm_angle"]
    place = told(curves, target, "arm_angle")
    knots = np.linspace(angle.min(), angle.max(), 65)
    found = curves.response(replace(place, knots=knots, shapes=np.sin(3.0 * knots)[:, None]))[:, :, 0]
    error = np.sin(3.0 * angle)
    if from_rest:
        error -= np.repeat(error[recording.bounds[:, 0]], np.diff(recording.bounds)[:, 0])
    part = curves.problem.parts[0]
    other = replace(
        part.windows, recording=MODEL.with_commands(recording, {"arm_angle": angle + size * error})
    )
    after = part.compressed(MODEL.simulate(curves.fitted.parameters[None], other))[0]
    expected = (after - before) / size @ curves.fitted.whitener.T
    assert np.linalg.norm(found - expected) < 0.03 * np.linalg.norm(expected)


def rope(plant: vehicle.Vehicle) -> None:
    """Holds the vehicle back on one side, from where it is stretched."""
    plant.loads.append(lambda _t, x, _v: vehicle._only(0, 600.0 * np.maximum(x[0], 0.0)))


def crank(plant: vehicle.Vehicle) -> None:
    """The arm goes by a crank, further on one side."""
    plant.arm.append(lambda f: f + 0.01 * f * f)


HIDDEN: dict[str, tuple[Fault, str, str]] = {
    "rope": (rope, "suspension along x", "deflection_x"),
    "crank": (crank, "arm's angle", "arm_angle"),
}
"""A fault, the direction in which it acts, and what it depends on."""


def again(seen: Recording, reality: Path | dict[str, Any]) -> Recording:
    """The runs of a log in a reality, without noise."""
    runs = []
    for a, b in seen.bounds:
        given = {name: seen[name][a:b] for name in ("arm_angle", "arm_axis")}
        rng = np.random.default_rng(0)
        runs.append(synthesise(MODEL, reality, given, step=STEP, rng=rng, noise=False, refine=4))
    return joined_runs(runs, "again")


@cache
def found(kind: str) -> Diagnosis:
    return diagnose(MODEL, [log(2, HIDDEN[kind][0])], [log(3, HIDDEN[kind][0])])


@pytest.mark.nightly
@pytest.mark.parametrize("kind", list(HIDDEN))
def test_what_is_not_listed_is_found_as_a_curve_where_it_acts(kind: str):
    result, (_, target, over) = found(kind), HIDDEN[kind]
    assert result.verdict == "unknown", result.summary()
    assert (result.curves[0].target, result.curves[0].over) == (target, over), result.summary()
    suffers = max(result.gain.values(), key=lambda g: g.rmse_before - g.rmse_with_curves)
    assert suffers.rmse_with_curves < 0.9 * suffers.rmse_before
    assert not result.not_runnable


@pytest.mark.nightly
@pytest.mark.parametrize("kind", list(HIDDEN))
def test_its_extended_simulation_runs(kind: str, tmp_path: Path):
    """Recorded as a whole it errs less; the environment has the arm's error, and says what it leaves out."""
    result, seen = found(kind), log(4, HIDDEN[kind][0])
    path = tmp_path / "extended.yaml"
    save_yaml(result.extended(), path)
    base = {"parameters": {n: e.value for n, e in result.parameters.items()}}
    errors = []
    for reality in (path, base):
        run = again(seen, reality)
        errors.append([np.sqrt(np.mean((run[s.name] - seen[s.name]) ** 2)) for s in MODEL.outputs])
    after, before = np.array(errors)
    assert (after < 1.02 * before).all()
    assert (after < 0.95 * before).any()
    if kind == "rope":
        with pytest.warns(ModelWarning, match="is stepped without force_on_suspension along x"):
            env = gym.make("fieldgym/Excitation-v0", reality=path, settings={"preset": "soft"})
    else:
        env = gym.make("fieldgym/Excitation-v0", reality=path, settings={"preset": "soft"})
    env.reset(seed=1)
    assert np.isfinite(env.step(env.action_space.sample())[1])


@pytest.mark.filterwarnings("error")
def test_a_recording_has_a_curve_that_no_environment_can_step():
    spring = {"at_1": -1.0, "at_2": 0.0, "at_3": 1.0, "value_1": 900.0, "value_2": 0.0, "value_3": 0.0}
    reality = {"force_on_suspension along z_over_deflection_z": spring}
    seen, plain = (
        record_experiment(np.random.default_rng(1), r, duration=0.8, noise=False) for r in (reality, {})
    )
    pressed = np.abs(seen["acceleration_z"] - plain["acceleration_z"])
    assert pressed.max() > 0.05 * np.abs(plain["acceleration_z"]).max()
    np.testing.assert_array_equal(seen["arm_angle"], plain["arm_angle"])
