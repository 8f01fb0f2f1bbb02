"""Public recordings of real machines, diagnosed by the command line; figures are of runs that are not fitted.

The Warthog has a file of its own (test_warthog.py).
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from fieldagents.cli import app
from fieldmodels.model import FloatArray, Model
from fieldmodels.propeller_arm import PropellerArm
from fieldmodels.recording import Recording, Windows


def diagnosed(folder: Path, collection: str, out: Path, model: str, train: list[str], test: str = "") -> dict:
    """What the command line finds."""
    if not (folder / collection).is_dir():
        pytest.skip(f"no real data: FIELDGYM_DATA holds no {collection}")
    asked = [f"{collection}/{name}" for name in train]
    asked += ["--test", f"{collection}/{test}"] if test else []
    result = CliRunner().invoke(app, ["diagnose", *asked, "--model", model, "--out", str(out)])
    assert result.exit_code == 0, result.output
    return json.loads((out / "diagnosis.json").read_text())


def vector(model: Model, found: dict, upto: int | None = None, measured: bool = True) -> FloatArray:
    """The extended simulation, or with only its first causes."""
    del measured
    base = {name: entry["value"] for name, entry in found["parameters"].items()}
    effects = {
        cause["effect"]: {name: entry["value"] for name, entry in cause["parameters"].items()}
        for cause in found["causes"][:upto]
    }
    return model.vector(base, effects)


def test_coulomb_friction_of_the_dfki_pendulum(public_data, tmp_path):
    """Seen before from measured starts: 0.0646 to 0.0432 rad; here windows start where they fit best."""
    found = diagnosed(
        public_data, "dfki_simple_pendulum", tmp_path, "pendulum", ["ddp"], "direct_collocation"
    )
    assert found["causes"][0]["effect"] == "coulomb_friction"
    # The bench's own identification: 0.184 N m beside a viscous 0.047 N m s/rad.
    assert 0.1 < found["causes"][0]["parameters"]["torque"]["value"] < 0.2
    gain = found["gain"]["angle"]
    assert gain["rmse_before"] == pytest.approx(0.0106, rel=0.1)
    assert gain["rmse_after"] < 0.0045
    assert gain["ci95"][0] > 38


def test_a_bang_bang_swing_up_stays_unknown(public_data, tmp_path):
    found = diagnosed(public_data, "dfki_simple_pendulum", tmp_path, "pendulum", ["energy_shaping"])
    assert found["verdict"] == "unknown"
    assert found["causes"] == []


def test_a_pendulum_that_was_moved_by_hand_is_not_explained_by_its_bench(public_data, tmp_path):
    found = diagnosed(public_data, "dfki_simple_pendulum", tmp_path, "pendulum", ["gravity_compensation"])
    assert found["verdict"] == "unknown" or found["unknown"] is not None


def between(recording: Recording, begin: float, end: float) -> Recording:
    kept = (recording.time >= begin) & (recording.time < end)
    signals = {name: values[kept] for name, values in recording.signals.items()}
    return replace(recording, time=recording.time[kept], signals=signals, episode=recording.episode[kept])


def window_error(model: PropellerArm, recording: Recording, parameters: FloatArray) -> float:
    """Root mean square error of half a second predicted from measured starts [deg]."""
    windows = model.windows(recording, 0.5)
    error = model.simulate(parameters, windows)[0] - windows.measured(tuple(o.name for o in model.outputs))
    return float(np.rad2deg(np.sqrt(np.mean(error[:, :, 0] ** 2))))


def free_run_error(model: PropellerArm, recording: Recording, parameters: FloatArray) -> float:
    """Root mean square error of a whole run from its first measured state [deg]."""
    n = len(recording)
    start = np.array([0])
    windows = Windows(
        recording,
        start,
        np.array([n]),
        model.initial_states(recording, start),
        np.ones((1, n, 2), dtype=bool),
    )
    error = model.simulate(parameters, windows)[0, 0, :, 0] - recording["angle"]
    return float(np.rad2deg(np.sqrt(np.mean(error**2))))


@pytest.mark.slow
def test_the_thrust_of_a_quarter_drone_grows_with_the_square_and_comes_late(public_data, tmp_path):
    """Learned on the multisine and the steps, measured on a swept sine that had no say."""
    found = diagnosed(
        public_data, "quarter_drone", tmp_path, "propeller_arm", ["multisine", "steps"], "swept_sine"
    )
    first, second = found["causes"][:2]
    assert first["effect"] == "thrust_curve"
    assert first["parameters"]["exponent"]["value"] == pytest.approx(2.0, abs=0.2)
    late = {"actuator_delay", "actuator_lag", "sensor_delay"}
    assert {second["effect"], *second["alternatives"]} <= late
    assert found["gain"]["angle"]["ci95"][0] > 25
