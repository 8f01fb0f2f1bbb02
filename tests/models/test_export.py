"""An exported file, run where nothing of this project can be imported, gives what the simulation gives."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from fieldmodels.diagnosis.use import Simulation
from fieldmodels.drivers.named import with_named
from fieldmodels.export import write_model
from fieldmodels.machine import held_inputs
from fieldmodels.model import ModelError
from fieldmodels.model_files import load_model_file
from fieldmodels.recording import Recording
from fieldmodels.registry import get_model

ALONE = """
import importlib.abc, json, sys

class OnlyNumPy(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name.partition(".")[0] in ("fieldmodels", "fieldgym", "fieldagents", "numba", "scipy", "pandas"):
            raise ImportError(name)

sys.meta_path.insert(0, OnlyNumPy())
import model
given = json.load(sys.stdin)
print(json.dumps({k: v.tolist() for k, v in model.simulate(**given).items()}))
"""
KNOTS = {f"value_{k + 1}": 0.4 * np.sin(2.0 * v) for k, v in enumerate(np.linspace(-1, 1, 17))}
REALITIES = {
    "rig": {
        "coulomb_friction": {"force": 0.4},
        "actuator_delay": {"delay": 0.013},
        "actuator_lag": {"time_constant": 0.04},
        "sensor_bias": {"bias": 0.002},
        "cubic_stiffness": {"coefficient": 50.0},
    },
    "pendulum": {
        "viscous_friction": {"coefficient": 0.03},
        "hysteresis": {"torque": 0.2, "distance": 0.05},
        "actuator_saturation": {"limit": 0.9},
        "sensor_delay": {"delay": 0.004},
        "force_on_velocity_over_velocity": {"low": -4.0, "high": 4.0, **KNOTS},
    },
    "propeller_arm": {},
    "servo": {},
}


def _log(model, seed: int = 3, n: int = 300, step: float = 0.01) -> Recording:
    """Commands that jump and swing, with outputs that only say where the machine starts."""
    rng = np.random.default_rng(seed)
    time = step * np.arange(n)
    signals = {s.name: np.repeat(rng.normal(0, 1.5, n // 20), 20) + np.sin(9 * time) for s in model.inputs}
    signals |= {s.name: np.full(n, 0.05 * (k + 1)) for k, s in enumerate(model.outputs)}
    return Recording(time, signals, {}, source="made here")


@pytest.mark.every(
    ("name", "hold"),
    [("rig", "held"), ("pendulum", "interpolated"), ("propeller_arm", "held"), ("servo", "held")],
)
def test_it_gives_what_the_simulation_gives(tmp_path: Path, name: str, hold: str):
    reality = REALITIES[name]
    model = held_inputs(with_named(get_model(name), reality), hold)
    vector = model.vector({}, reality)
    write_model(model, vector, tmp_path / "model.py")
    log = _log(model)
    start = model.initial_states(log, np.array([0]))[0]
    given = {
        "step": log.step,
        "inputs": {s.name: log[s.name].tolist() for s in model.inputs},
        "start": {s.name: value for s, value in zip(model.states, start.tolist(), strict=True)},
    }
    run = subprocess.run(
        [sys.executable, "-c", ALONE], input=json.dumps(given), cwd=tmp_path, env={"PYTHONPATH": ""},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    alone = json.loads(run.stdout)
    here = Simulation(model, vector).free_run(log)
    for output in model.outputs:
        assert np.ptp(here[output.name]) > 0
        np.testing.assert_allclose(alone[output.name], here[output.name], rtol=1e-9, atol=1e-9)


OWN = """
import math

from fieldmodels.effects.actuators import actuator
from fieldmodels.effects.sensors import sensor
from fieldmodels.machine import Machine, number
from fieldmodels.model import Signal

SLOPE = 0.3


def drag(speed):
    return SLOPE * math.tanh(speed)


class Fan(Machine):
    inputs = (Signal("voltage", "V"),)
    states = outputs = (Signal("speed", "rad/s", noise=0.2),)
    gain = number("rad/s/V", 10.0, 0.0, 1e3)
    time_constant = number("s", 0.1, 0.01, 10.0)
    effects = actuator("voltage") + sensor("speed")

    def derivative(self, state, input, p):
        return (p.gain * input.voltage - state.speed) / p.time_constant - drag(state.speed)
"""


def test_a_machine_of_ones_own_with_its_helpers(tmp_path: Path):
    (tmp_path / "fan.py").write_text(OWN)
    model = load_model_file(str(tmp_path / "fan.py"))
    write_model(model, model.nominal, tmp_path / "model.py")
    log = _log(model)
    np.savetxt(
        tmp_path / "log.csv", np.column_stack([log.time, log["voltage"], log["speed"]]), delimiter=",",
        header="t,voltage,speed", comments="", fmt="%.17g",
    )  # fmt: skip
    subprocess.run([sys.executable, "model.py", "log.csv", "out.csv"], cwd=tmp_path, check=True)
    out = np.genfromtxt(tmp_path / "out.csv", delimiter=",", names=True)
    # An outsider: Euler's method at a hundredth of the step.
    speed, expected = log["speed"][0], []
    for voltage in log["voltage"]:
        expected.append(speed)
        for _ in range(100):
            speed += 1e-4 * ((10 * voltage - speed) / 0.1 - 0.3 * np.tanh(speed))
    np.testing.assert_allclose(out["speed"], expected, atol=0.03)
    for text, said in (
        ("time,voltage\n0,1\n1,1\n", "no column t; its columns are time, voltage"),
        ("Prüfstand,1\n", "no table of comma-separated values in UTF-8: "),
    ):
        (tmp_path / "other.csv").write_bytes(text.encode("latin-1"))
        command = [sys.executable, "model.py", "other.csv", "out.csv"]
        told = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert told.returncode == 1
        assert told.stderr.startswith(f"other.csv: {said}")


AXIS = """
import numpy as np

from fieldmodels.effects import actuator, force, sensor
from fieldmodels.machine import Force, Machine, number
from fieldmodels.model import Signal

SPEEDS, FORCES = np.array([-1.0, 0.0, 2.0]), (-3.0, 0.0, 4.0)


def drag(slope):
    return np.interp(slope, SPEEDS, FORCES)


class Axis(Machine):
    inputs = (Signal("force", "N"),)
    states = (Signal("position", "m"), Signal("speed", "m/s"))
    outputs = (Signal("position", "m", noise=1e-4),)
    mass = number("kg", 2.0, 0.1, 100.0)
    forces = (Force("speed", "position", unit="N", inertia="mass"),)
    effects = actuator("force") + force("speed", ("coulomb_friction",)) + sensor("position", ("bias",))

    def derivative(self, state, input, p):
        slope = state.speed
        return state.speed, (np.clip(input.force, -5, 5) - drag(slope)) / p.mass
"""


def test_an_axis_whose_position_alone_is_measured(tmp_path: Path):
    """Its speed comes from a slope, by a function whose name is that of a variable beside it."""
    (tmp_path / "axis.py").write_text(AXIS)
    model = load_model_file(str(tmp_path / "axis.py"))
    vector = model.vector({}, {"coulomb_friction": {"force": 0.5}})
    write_model(model, vector, tmp_path / "model.py")
    log = _log(model)
    given = {
        "step": log.step,
        "inputs": {"force": log["force"].tolist()},
        "start": {"position": 0.0, "speed": 0.0},
    }
    run = subprocess.run(
        [sys.executable, "-c", ALONE], input=json.dumps(given), cwd=tmp_path, env={"PYTHONPATH": ""},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    position, speed, expected = 0.0, 0.0, []  # an outsider: Euler's method at a hundredth of the step
    for push in log["force"]:
        expected.append(position)
        for _ in range(100):
            pull = min(max(push, -5.0), 5.0) - (3.0 * speed if speed < 0.0 else min(2.0 * speed, 4.0))
            free = speed + 0.01 * log.step * pull / 2.0
            speed = np.sign(free) * max(abs(free) - 0.01 * log.step * 0.5 / 2.0, 0.0)
            position += 0.01 * log.step * speed
    assert np.ptp(expected) > 0.01
    np.testing.assert_allclose(json.loads(run.stdout)["position"], expected, atol=2e-3 * np.ptp(expected))


def test_what_cannot_be_exported_says_why(tmp_path: Path):
    model = get_model("heel_strike")
    with pytest.raises(ModelError, match="kernels of its own"):
        write_model(model, model.nominal, tmp_path / "model.py")
