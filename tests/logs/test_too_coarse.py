"""Rows so far apart that each shows a settled response: no time constant is told, a static map is."""

import subprocess
import sys
import warnings

import numpy as np
import pytest
from typer.testing import CliRunner

from fieldagents.cli import app
from fieldgym.bench import as_env
from fieldmodels.diagnosis import diagnose
from fieldmodels.diagnosis.answer import _by_certainty, how_sure
from fieldmodels.diagnosis.pilot import identifiable
from fieldmodels.diagnosis.result import Cause, Estimate, Share
from fieldmodels.effects import actuator, curve, friction, sensor
from fieldmodels.export import write_model
from fieldmodels.machine import Machine, number
from fieldmodels.model import Signal
from fieldmodels.recording import RecordingError
from fieldmodels.recording.files import load_recording
from fieldmodels.recording.proposals import propose
from fieldmodels.recording.reading import read_table
from fieldmodels.registry import get_model

MAP = get_model("map")
COLUMNS = {"command": "Servo (µs)", "response": "Motor Optical Speed (RPM)"}


class Stand(Machine):
    """A propeller's stand as one would write it down who does not know how far apart its rows are."""

    inputs = (Signal("command", "us"),)
    states = outputs = (Signal("speed", "rad/s", noise=0.1),)
    gain = number("rad/s/us", 0.02, 0.0, 1.0)
    time_constant = number("s", 0.1, 0.01, 10.0)
    effects = (
        actuator("command") + friction("speed") + sensor("speed") + curve("force", "speed", over="command")
    )

    def derivative(self, state, input, p):
        return (p.gain * (1500.0 - input.command) - state.speed) / p.time_constant


def written(path, command, response, noise=0.3, seed=2):
    rng = np.random.default_rng(seed)
    time = 5.5187 * np.arange(len(command)) + 0.04 * rng.random(len(command))
    rows = np.column_stack([time, command, response + noise * rng.standard_normal(len(command))])
    header = "Time (s),Servo (µs),Motor Optical Speed (RPM)"
    np.savetxt(path, rows, delimiter=",", header=header, comments="", fmt="%.4f", encoding="utf-8")
    return path


def loaded(path, model, columns):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return load_recording(path, model, columns)


@pytest.fixture(scope="module")
def ramp(tmp_path_factory):
    """Up and down in small steps: a curve that ends at nothing."""
    command = np.concatenate([np.linspace(1000, 1500, 350), np.linspace(1500, 1000, 350)])
    speed = np.abs(52 * np.tanh((1500 - command) / 130) * (np.abs(command - 1500) > 60))
    return written(tmp_path_factory.mktemp("ramp") / "stand.csv", command, speed)


@pytest.fixture(scope="module")
def steps(tmp_path_factory):
    """A dead zone of 34 us about 1500 us, and limits of 50 rpm."""
    rng = np.random.default_rng(1)
    command = 1500 + np.repeat(rng.uniform(-400, 400, 200), 3)
    beyond = command - 1500 - np.clip(command - 1500, -34, 34)
    return written(tmp_path_factory.mktemp("steps") / "stand.csv", command, np.clip(0.2 * beyond, -50, 50))


def test_too_coarse_for_a_time_constant_is_said_before_the_work(ramp):
    columns = {"command": "Servo (µs)", "speed": "Motor Optical Speed (RPM):rpm"}
    told = identifiable(Stand(), [loaded(ramp, Stand(), columns)], {})
    assert told[0].startswith("rows are 5.52 s apart: no time constant below about 11 s can be told, nor one")
    assert "--machine map" in told[0]
    assert told[1].startswith("as a static map of 'speed': ")
    assert "lower limit (limit −0.0" in told[1]
    assert "curvature" in told[1]
    assert told[2] == "can be told: gain"


def test_what_is_resolved_is_not_said_to_be_too_coarse(tmp_path):
    time = 0.05 * np.arange(1000)
    command = 1500 + 100 * np.repeat(np.random.default_rng(0).uniform(-1, 1, 50), 20)
    speed = np.zeros(1000)
    for k in range(1, 1000):
        speed[k] = speed[k - 1] + (1 - np.exp(-0.05 / 0.3)) * (0.02 * (1500 - command[k - 1]) - speed[k - 1])
    rows = np.column_stack([time, command, speed + 0.01 * np.random.default_rng(1).standard_normal(1000)])
    path = tmp_path / "log.csv"
    np.savetxt(path, rows, delimiter=",", header="t,command,speed", comments="", fmt="%.5f")
    told = identifiable(Stand(), [loaded(path, Stand(), {})], {})
    assert not any("apart: no time constant" in line for line in told)
    assert any("time_constant" in line for line in told)


def test_no_lag_without_a_size_is_certain(ramp):
    columns = {"command": "Servo (µs)", "speed": "Motor Optical Speed (RPM):rpm"}
    found = diagnose(Stand(), [loaded(ramp, Stand(), columns)])
    for cause in found.causes:
        assert cause.sized, cause
        assert "lag" not in cause.effect, cause
    certain = [s for s in how_sure(found).split(". ") if "may be missing" not in s and "Caution" not in s]
    assert "lag" not in " ".join(certain)


def test_a_cause_without_a_size_is_never_more_than_likely():
    def said(std):
        size = {"time_constant": Estimate(1474.0, std, "s")}
        lag = Cause("sensor_lag", "", "sensor", size, "speed", Share(50.0, (40.0, 60.0)), chance=1e-12)
        return list(_by_certainty([lag]))

    assert said(5266.0) == ["likely"]
    assert said(100.0) == ["practically certain"]


def test_a_static_map_has_its_dead_zone_and_its_limits(steps, tmp_path):
    recording = loaded(steps, MAP, COLUMNS)
    assert recording.units == {"command": "µs", "response": "RPM"}
    found = diagnose(MAP, [recording])
    assert {c.effect for c in found.causes} == {"dead_zone", "upper_limit", "lower_limit"}
    values = {f"{c.effect}.{name}": e for c in found.causes for name, e in c.parameters.items()}
    true = {
        "dead_zone.width": 34.0,
        "dead_zone.centre": 1500.0,
        "upper_limit.limit": 50.0,
        "lower_limit.limit": -50.0,
    }
    for name, value in true.items():
        assert values[name].value == pytest.approx(value, abs=4 * values[name].std), name
    assert values["dead_zone.width"].unit == "µs"
    assert values["upper_limit.limit"].unit == "RPM"
    assert found.above_noise == {}
    simulation = found.simulation
    write_model(simulation.model, simulation.vector, tmp_path / "exported.py")
    rows = np.column_stack([recording.time, recording["command"], recording["response"]])
    log = tmp_path / "log.csv"
    np.savetxt(log, rows, delimiter=",", header="t,command,response", comments="", fmt="%.9g")
    command = [sys.executable, "-I", str(tmp_path / "exported.py"), str(log), str(tmp_path / "out.csv")]
    subprocess.run(command, check=True)
    shown = np.genfromtxt(tmp_path / "out.csv", delimiter=",", names=True)["response"]
    assert np.std((shown - recording["response"])[1:]) < 0.35


@pytest.mark.nightly
def test_a_static_map_by_the_command_line_and_as_an_environment(ramp, tmp_path):
    out = tmp_path / "out"
    done = CliRunner().invoke(app, [
        "diagnose", str(ramp), "--model", "map", "--column", "command=Servo (µs)",
        "--column", "response=Motor Optical Speed (RPM)", "--out", str(out),
    ])  # fmt: skip
    assert done.exit_code == 0, done.output
    assert "lower limit" in done.output
    assert "curvature" in done.output
    assert "lag" not in done.output
    env = as_env("map", reality=str(out / "extended.yaml"))
    env.reset(seed=0)
    assert np.isfinite(env.step(env.action_space.sample())[0]).all()


def test_columns_in_any_unit_are_proposed_for_a_map(tmp_path):
    command = np.random.default_rng(0).uniform(1000, 2000, 200)
    rows = np.column_stack([5.5 * np.arange(200), command, 0.1 * (command - 1500) + np.sin(np.arange(200))])
    path = tmp_path / "log.csv"
    np.savetxt(path, rows, delimiter=",", header="time [s],pulse [us],angle [deg]", comments="", fmt="%.5f")
    found = propose(read_table(path), MAP)
    assert not found.sure  # a line is as good the other way round
    assert {str(c.channel) for c in found.columns} == {"time [s]:s", "pulse [us]:us", "angle [deg]:deg"}


def test_a_log_that_is_too_coarse_for_its_model_says_what_to_take(tmp_path):
    time = 5.5 * np.arange(60)
    rows = np.column_stack([time, np.sin(time), np.cos(time)])
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header="t,force,position", comments="", fmt="%.5f")
    with pytest.raises(RecordingError, match=r"one row every 5.5 s is too coarse .* or take --machine map"):
        load_recording(tmp_path / "log.csv", get_model("rig"))
