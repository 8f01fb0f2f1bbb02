"""Benches that log the command and the measured force: drive and axis are diagnosed one after the other."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from fieldagents.cli import app
from fieldmodels.diagnosis import diagnose
from fieldmodels.machines.one_axis.model import between
from fieldmodels.recording import Recording
from fieldmodels.recording.files import save_recording
from fieldmodels.registry import get_model
from fieldmodels.synthesis import excitation, synthesise

STEP, FINE = 0.01, 10


def logged(name, drive, reality, seed, duration=30.0, amplitude=5.0):
    """Command, measured force and motion; ``drive`` turns a command held in ticks into the force of each."""
    model = get_model(name)
    rng = np.random.default_rng(seed)
    commanded = amplitude * excitation("mixed", duration, STEP, rng)
    force = drive(np.repeat(commanded, FINE), STEP / FINE)
    truth = synthesise(model, reality, force, step=STEP / FINE, refine=1, rng=rng, noise=False)
    command, (position, velocity) = model.inputs[0].name, (s.name for s in model.outputs)
    signals = {
        command: commanded,
        f"{command}_measured": force[::FINE] + 2e-3 * amplitude * rng.standard_normal(len(commanded)),
        position: truth[position][::FINE] + model.outputs[0].noise * rng.standard_normal(len(commanded)),
        velocity: truth[velocity][::FINE] + model.outputs[1].noise * rng.standard_normal(len(commanded)),
    }
    return Recording(np.arange(len(commanded)) * STEP, signals, source=f"{name} {seed}")


def slow(command, tick, time_constant=0.03):
    force = np.empty_like(command)
    now = command[0]
    for i, u in enumerate(command):
        force[i] = now
        now = u + (now - u) * np.exp(-tick / time_constant)
    return force


DRIVES = {
    "actuator_lag": (slow, "time_constant", 0.03, 0.006),
    "actuator_gain": (lambda u, _: 0.8 * u, "gain", 0.8, 0.005),
    "actuator_saturation": (lambda u, _: np.clip(u, -2.5, 2.5), "limit", 2.5, 0.03),
    "actuator_dead_zone": (lambda u, _: np.sign(u) * np.maximum(np.abs(u) - 0.4, 0), "width", 0.4, 0.02),
}


@pytest.mark.parametrize(
    "effect",
    [
        "actuator_lag",
        *(pytest.param(name, marks=pytest.mark.nightly) for name in DRIVES if name != "actuator_lag"),
    ],
)
def test_a_fault_of_the_drive_and_one_of_the_axis_are_told_apart(effect):
    drive, parameter, value, tolerance = DRIVES[effect]
    hidden = {"coulomb_friction": {"force": 0.3}}
    found = diagnose(get_model("rig"), [logged("rig", drive, hidden, 1)], [logged("rig", drive, hidden, 2)])
    assert [cause.effect for cause in found.causes] == ["coulomb_friction", effect]
    axis, motor = found.causes
    assert axis.signal in ("position", "velocity")
    assert motor.signal == "force_measured"
    assert axis.parameters["force"].value == pytest.approx(0.3, abs=0.02)
    assert motor.parameters[parameter].value == pytest.approx(value, abs=tolerance)
    assert found.parameters["mass"].value == pytest.approx(2.0, rel=0.01)
    assert set(found.gain) == {"position", "velocity", "force_measured"}


def test_nothing_is_named_where_the_drive_does_as_it_is_told():
    records = [logged("pendulum", lambda u, _: u, {}, seed, amplitude=0.5) for seed in (3, 4)]
    found = diagnose(get_model("pendulum"), records[:1], records[1:])
    assert found.verdict == "consistent"


@pytest.mark.nightly
def test_a_gain_of_the_drive_is_told_from_a_wrong_mass_only_if_its_force_is_measured(tmp_path):
    for seed in (1, 2):
        record = logged("rig", lambda u, _: 0.8 * u, {}, seed)
        save_recording(record, tmp_path / f"{seed}.csv")
    asked = ["diagnose", str(tmp_path / "1.csv"), "--test", str(tmp_path / "2.csv"), "--model", "rig"]
    result = CliRunner().invoke(app, [*asked, "--out", str(tmp_path)])
    assert result.exit_code == 0, result.output
    found = json.loads((tmp_path / "diagnosis.json").read_text())
    assert [cause["effect"] for cause in found["causes"]] == ["actuator_gain"]
    assert found["parameters"]["mass"]["value"] == pytest.approx(2.0, rel=0.01)
    for name in ("1.csv", "2.csv"):
        text = (tmp_path / name).read_text().replace("force_measured", "another")
        (tmp_path / name).write_text(text)
    assert CliRunner().invoke(app, [*asked, "--out", str(tmp_path)]).exit_code == 0
    found = json.loads((tmp_path / "diagnosis.json").read_text())
    assert found["verdict"] == "consistent"
    assert found["parameters"]["mass"]["value"] == pytest.approx(2.0 / 0.8, rel=0.01)


@pytest.mark.parametrize(
    "effects",
    [
        {"actuator_lag": {"time_constant": 0.04}},
        {"actuator_delay": {"delay": 0.03}},
        {"actuator_rate_limit": {"rate": 80.0}},
        {"actuator_gain": {"gain": 0.7}, "actuator_dead_zone": {"width": 0.5}},
    ],
)
def test_the_drive_alone_gives_the_impulse_that_the_whole_gives(effects):
    rig = get_model("rig")
    record = logged("rig", lambda u, _: u, {}, 1, duration=3.0)
    _, stage = rig.stages([record])
    vector = rig.vector({"damping": 0.0, "stiffness": 0.0}, effects)[None]
    force = stage.model.simulate(vector, stage.model.windows(record, 1.0))[0, 1, :, 0]
    window = rig.windows(record, 1.0).select(np.array([1]))
    velocity = rig.simulate(vector, window.with_states(np.zeros((1, 2))))[0, 0, :, 1]
    command = record["force"][window.starts[0] :][: len(force)]
    held = between(command, force, np.full(len(force), len(force) - 1))
    impulse = np.r_[0.0, np.cumsum(held[:-1])] * STEP / 2.0
    assert np.abs(velocity - impulse).max() < 0.02 * np.abs(impulse).max()
