"""Recordings of one bench that differ in length, step and episodes are learned from together."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from fieldagents.cli import app
from fieldmodels.recording.files import save_recording
from fieldmodels.registry import get_model
from fieldmodels.synthesis import synthesise

RIG = get_model("rig")
HIDDEN = {"parameters": {"mass": 2.4}, "coulomb_friction": {"force": 0.3}}


@pytest.fixture
def records(tmp_path):
    """Four logs: half a minute at 100 Hz, two episodes at 50 Hz, a short one at 200 Hz, a very short one."""
    rng = np.random.default_rng(8)
    kinds = {
        "long": (20.0, 0.01, 1),
        "episodes": (10.0, 0.02, 2),
        "fast": (12.0, 0.005, 1),
        "tiny": (0.15, 0.01, 1),
    }
    for name, (duration, step, episodes) in kinds.items():
        record = synthesise(
            RIG, HIDDEN, "mixed", duration=duration, step=step, episodes=episodes, amplitude=5, rng=rng
        )
        save_recording(record, tmp_path / f"{name}.csv")
    return tmp_path


@pytest.mark.nightly
def test_they_are_diagnosed_as_one_bench(records):
    asked = ["diagnose", *(str(records / f"{n}.csv") for n in ("long", "episodes")), "--model", "rig"]
    asked += ["--test", str(records / "fast.csv"), "--set", "mass=2.4", "--out", str(records)]
    result = CliRunner().invoke(app, asked)
    assert result.exit_code == 0, result.output
    found = json.loads((records / "diagnosis.json").read_text())
    assert [cause["effect"] for cause in found["causes"]] == ["coulomb_friction"]
    assert found["causes"][0]["parameters"]["force"]["value"] == pytest.approx(0.3, abs=0.02)
    assert found["parameters"]["mass"] == {"value": 2.4, "std": 0.0, "unit": "kg"}
    # 39 windows of half a second from the first, 19 from each episode of the second; 23 to test on.
    assert found["data"]["windows"] == {"train": 39 + 2 * 19, "test": 23}
    assert found["data"]["train"] == [str(records / f"{n}.csv") for n in ("long", "episodes")]


def test_the_one_that_cannot_be_used_is_named(records):
    asked = ["diagnose", *(str(records / f"{n}.csv") for n in ("long", "tiny")), "--model", "rig"]
    result = CliRunner().invoke(app, asked)
    assert result.exit_code == 2
    assert "tiny.csv: column 't': the longest record lasts 0.14 s, shorter than the 0.2 s" in result.stderr


@pytest.mark.parametrize(("train", "test"), [(("long", "again"), ()), (("long",), ("again",))])
def test_one_that_is_given_twice_is_refused(records, train, test):
    """Its noise would repeat, and look like something that is missing."""
    (records / "again.csv").write_bytes((records / "long.csv").read_bytes())
    asked = ["diagnose", *(str(records / f"{n}.csv") for n in train), "--model", "rig"]
    result = CliRunner().invoke(app, asked + [a for n in test for a in ("--test", str(records / f"{n}.csv"))])
    assert result.exit_code == 2
    use = "to test" if test else "to fit"
    words = " ".join(result.stderr.split())
    assert f"long.csv (to fit) and {records / 'again.csv'} ({use}) hold the same signals" in words
