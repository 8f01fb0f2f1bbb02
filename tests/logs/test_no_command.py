"""Logs without a command: what swings out, rings down or coasts down, and machines that have no input."""

import csv
import json
import subprocess
import sys
import warnings

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from typer.testing import CliRunner

from fieldagents.cli import app
from fieldagents.logs import Logs, listed
from fieldgym.bench import as_env
from fieldmodels.diagnosis import diagnose
from fieldmodels.recording import RecordingError, RecordingWarning
from fieldmodels.recording.bench import Bench, Channel
from fieldmodels.recording.files import load_recording
from fieldmodels.recording.proposals import propose
from fieldmodels.recording.reading import read_table
from fieldmodels.registry import get_model

PENDULUM, RIG = get_model("pendulum"), get_model("rig")
STEP, FINE = 0.01, 2e-4


def swung_out(duration=30.0, friction=0.08, seed=0):
    """A pendulum of 4 rad/s with dry friction [rad/s^2] that is let go at 1 rad; times and noisy angles."""
    angle, rate, rows = 1.0, 0.0, []
    for k in range(round(duration / FINE)):
        if k % round(STEP / FINE) == 0:
            rows.append((k * FINE, angle))
        half = rate + 0.5 * FINE * (-16.0 * np.sin(angle) - friction * np.sign(rate))
        angle += FINE * half
        rate = half + 0.5 * FINE * (-16.0 * np.sin(angle) - friction * np.sign(half))
    time, angle = np.array(rows).T
    return time, angle + 1e-3 * np.random.default_rng(seed).standard_normal(len(time))


def written(path, **columns):
    rows = np.column_stack([*columns.values()])
    np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="", fmt="%.6f")
    return path


@pytest.fixture(scope="module")
def swing():
    return dict(zip(("time", "angle_rad"), swung_out(), strict=True))


def test_no_command_is_proposed_where_nothing_looks_like_one(tmp_path, swing):
    path = written(tmp_path / "log.csv", **swing)
    proposal = propose(read_table(path), PENDULUM)
    assert not proposal.sure
    assert "torque = none" in listed(proposal)
    assert proposal.missing == ()
    with pytest.raises(RecordingError, match=r"(?s)torque = none.*which is not sure: take it by --accept"):
        Logs(PENDULUM).read(str(path))
    with pytest.warns(RecordingWarning, match="no command: 'torque' is zero throughout"):
        recording = Logs(PENDULUM, accept=True).read(str(path))
    assert not recording["torque"].any()
    assert Bench.load(tmp_path / "bench.yaml").columns["torque"] == Channel("")
    with pytest.warns(RecordingWarning, match="zero throughout"):
        assert not Logs(PENDULUM).read(str(path))["torque"].any()  # by the bench file


@pytest.mark.parametrize("other", [np.sin, lambda t: np.full(len(t), 24.0)])
def test_nor_where_something_may_be_one(tmp_path, swing, other):
    path = written(tmp_path / "log.csv", **swing, duty=other(swing["time"]))
    assert "none" not in listed(propose(read_table(path), PENDULUM))
    driven = written(tmp_path / "driven.csv", time=swing["time"], angle_rad=np.sin(swing["time"]))
    assert propose(read_table(driven), PENDULUM).missing == ("torque",)
    with pytest.raises(RecordingError, match="or --input none if nothing was commanded"):
        Logs(PENDULUM).read(str(driven))
    still = written(tmp_path / "still.csv", **swing, duty=np.zeros(len(swing["time"])))
    assert "torque = none" in listed(propose(read_table(still), PENDULUM))


def test_without_a_command_all_is_in_proportion_to_the_inertia(tmp_path, swing):
    """0.08 rad/s^2 of dry friction on a pendulum of 16/s^2, whatever it weighs."""
    path = written(tmp_path / "log.csv", t=swing["time"], angle=swing["angle_rad"])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        recording = load_recording(path, PENDULUM, commanded=False)
    found = diagnose(PENDULUM, [recording])
    assert found.causes[0].effect == "coulomb_friction"
    inertia = PENDULUM.nominal[PENDULUM.index("inertia")]
    torque = found.causes[0].parameters["torque"]
    assert torque.value == pytest.approx(0.08 * inertia, abs=4 * torque.std)
    assert found.parameters["gravity_moment"].value == pytest.approx(16.0 * inertia, rel=0.01)
    assert (
        "nothing is commanded: torque = 0 throughout; all else is in proportion to the inertia"
        in found.notes[0]
    )
    assert found.not_testable["actuator_gain"] == "nothing is commanded"
    assert not found.undetermined


def test_a_ring_down_by_the_command_line(tmp_path):
    time = STEP / 2 * np.arange(4000)
    rate, decay = np.sqrt(40.0 - 0.25**2), np.exp(-0.25 * time)
    noise = np.random.default_rng(0).standard_normal(len(time))
    position = 0.05 * decay * (np.cos(rate * time) + 0.25 / rate * np.sin(rate * time)) + 1e-5 * noise
    path = written(tmp_path / "ring.csv", t=time, position=position)
    out = tmp_path / "out"
    done = CliRunner().invoke(app, [
        "diagnose", str(path), "--model", "rig", "--input", "none", "--set", "mass=3.0",
        "--out", str(out), "--json",
    ])  # fmt: skip
    assert done.exit_code == 0, done.output
    found = json.loads((out / "diagnosis.json").read_text())
    assert found["verdict"] == "consistent"
    assert found["parameters"]["stiffness"]["value"] == pytest.approx(3.0 * 40.0, rel=0.01)
    assert found["parameters"]["damping"]["value"] == pytest.approx(3.0 * 0.5, rel=0.02)


SWING = """
import math
from fieldmodels.effects import force, sensor
from fieldmodels.machine import Force, Machine, number
from fieldmodels.model import Signal


class Swing(Machine):
    inputs = ()
    states = (Signal("theta", "rad"), Signal("rate", "rad/s"))
    outputs = (Signal("theta", "rad", noise=1e-3),)
    frequency2 = number("1/s^2", 10.0, 1.0, 500.0)
    forces = (Force("rate", "theta", unit="rad/s^2"),)
    effects = force("rate", ("coulomb_friction", "quadratic_drag")) + sensor("theta", ("delay",))

    def derivative(self, state, input, p):
        return state.rate, -p.frequency2 * math.sin(state.theta)
"""


def test_a_machine_without_inputs_is_diagnosed_exported_and_flown(tmp_path, swing):
    model = tmp_path / "swing.py"
    model.write_text(SWING)
    path = written(tmp_path / "log.csv", t=swing["time"], theta=swing["angle_rad"])
    out, runner = tmp_path / "out", CliRunner()
    done = runner.invoke(app, ["diagnose", str(path), "--model", str(model), "--out", str(out)])
    assert done.exit_code == 0, done.output
    assert "Coulomb friction" in done.output
    assert (out / "report.html").exists()
    extended, exported = str(out / "extended.yaml"), out / "exported.py"
    refused = runner.invoke(app, ["export", extended, str(exported)])
    assert refused.exit_code == 2
    assert "give its file, too: --machine FILE.py" in refused.output
    assert runner.invoke(app, ["export", extended, str(exported), "--model", str(model)]).exit_code == 0
    command = [sys.executable, "-I", str(exported), str(path), str(tmp_path / "simulated.csv")]
    subprocess.run(command, check=True, cwd=tmp_path)
    simulated = np.array([row[1] for row in csv.reader((tmp_path / "simulated.csv").open())][1:], dtype=float)
    assert np.abs(simulated - swing["angle_rad"])[:1000].max() < 0.05
    env = as_env(str(model), reality=extended)
    env.reset(seed=0)
    assert np.isfinite(env.step(env.action_space.sample())[0]).all()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        check_env(as_env(str(model)), skip_render_check=True)
