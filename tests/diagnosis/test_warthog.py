"""A real skid-steered vehicle, held against the ideal differential drive: slip in motion, lag in the wheels.

The Warthog of the DRIVE data (Norlab, Universite Laval): 360 windows of 2 s at 20 Hz. What is named is
chosen on even steps of commands, and its gain measured on odd ones.
"""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from typer.testing import CliRunner

from fieldagents.cli import app
from fieldmodels.arrays import FloatArray
from fieldmodels.machines.pose_reaching.model import PoseReaching
from fieldmodels.recording import Windows
from fieldmodels.recording.datasets import open_recording
from fieldmodels.registry import get_model

TRAIN, TEST = "drive_ugv/warthog_even_steps", "drive_ugv/warthog_odd_steps"


pytestmark = pytest.mark.nightly  # all stand on one diagnosis of minutes


@pytest.fixture(scope="module")
def found(public_data, tmp_path_factory) -> dict:
    """What the command line finds."""
    if not (public_data / "drive_ugv").is_dir():
        pytest.skip("no real data: FIELDGYM_DATA holds no drive_ugv")
    out = tmp_path_factory.mktemp("warthog")
    result = CliRunner().invoke(
        app, ["diagnose", TRAIN, "--model", "pose_reaching", "--test", TEST, "--out", str(out)]
    )
    assert result.exit_code == 0, result.output
    # What is printed names the causes and the gains.
    assert "yaw_slip" in result.output
    assert "actuator_lag" in result.output
    return json.loads((out / "diagnosis.json").read_text())


def test_yaw_slip_is_named_for_the_motion_and_lag_for_the_wheels(found):
    effects = [cause["effect"] for cause in found["causes"]]
    motion = [c for c in found["causes"] if c["gain"]["signal"] in ("x", "y", "heading")]
    wheels = [c for c in found["causes"] if c["gain"]["signal"] in ("left_wheel", "right_wheel")]
    assert len(motion) + len(wheels) == len(effects)
    assert motion[0]["effect"] == "yaw_slip"
    assert motion[1]["effect"] == "sideways_slip"
    assert wheels[0]["effect"] == "actuator_lag"
    for first in (motion[0], wheels[0]):
        # At most its own value may differ from place to place, as it does between kinds of ground.
        assert all(f"{first['effect'].replace('_', ' ')}." in other for other in first["alternatives"])
        assert first["gain"]["ci95"][0] > 50
    # Skidding, it turns by less than two thirds of what its wheels say.
    assert motion[0]["parameters"]["share"]["value"] == pytest.approx(0.38, abs=0.03)
    assert wheels[0]["parameters"]["time_constant"]["value"] == pytest.approx(1.2, abs=0.2)


def test_the_gains_are_stated_on_held_out_steps(found):
    assert found["data"]["windows"] == {"train": 180, "test": 180}
    gain = found["gain"]
    assert gain["heading"]["percent"] > 80
    assert gain["left_wheel"]["ci95"][0] > 60
    assert gain["right_wheel"]["ci95"][0] > 55
    for signal in ("x", "y"):
        assert gain[signal]["ci95"][0] > 15


def errors(model: PoseReaching, windows: Windows, effects: dict[str, dict[str, float]]) -> FloatArray:
    """Root mean square error of place [m] and heading [deg] after 2 s, and of the wheels [rad/s]."""
    vector = model.vector(dict(windows.recording.known), effects)
    error = windows.measured(tuple(o.name for o in model.outputs)) - model.simulate(vector, windows)[0]
    squares = np.sum(error[:, -1, :2] ** 2, axis=1), error[:, -1, 2] ** 2, error[:, :, 3:] ** 2
    return np.sqrt([s.mean() for s in squares]) * [1.0, 180 / math.pi, 1.0]


def test_errors_after_two_seconds_fall_as_reported(found):
    named = {c["effect"]: {k: v["value"] for k, v in c["parameters"].items()} for c in found["causes"]}
    model = PoseReaching()
    windows = model.windows(open_recording(TEST, model), 2.0)
    ideal = errors(model, windows, {})
    assert ideal == pytest.approx([1.75, 90.0, 5.40], rel=0.01)
    slipping = errors(model, windows, {"yaw_slip": named["yaw_slip"]})
    assert slipping == pytest.approx([1.12, 14.3, 5.40], rel=0.05)
    sideways = errors(model, windows, {k: named[k] for k in ("yaw_slip", "sideways_slip")})
    assert sideways[0] < 0.9 * slipping[0]
    lagging = errors(model, windows, {"actuator_lag": named["actuator_lag"]})
    assert lagging == pytest.approx([1.75, 90.0, 2.03], rel=0.05)


def test_the_front_that_takes_wheel_speeds_sees_the_same_vehicle(found):
    body, wheel = PoseReaching(), get_model("differential_drive")
    windows = [model.windows(open_recording(TEST, model), 2.0) for model in (body, wheel)]
    first, second = (
        model.simulate(model.vector(dict(w.recording.known)), w)
        for model, w in zip((body, wheel), windows, strict=True)
    )
    assert second == pytest.approx(first, abs=1e-9)
