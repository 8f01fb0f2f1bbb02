"""Structure may change, behaviour may not: every model, environment and agent as it was recorded."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

import fieldgym

HERE = Path(__file__).parent
_spec = importlib.util.spec_from_file_location("golden_record", HERE / "record.py")
record = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(record)

GOLDEN = np.load(record.FILE)


def check(found):
    found = dict(found)
    assert found
    wrong = {}
    for name, values in found.items():
        expected = GOLDEN[name]
        assert values.shape == expected.shape, name
        finite = np.abs(expected[np.isfinite(expected)])
        scale = finite.max() if finite.any() else 1.0
        same = (values == expected) | (np.isnan(values) & np.isnan(expected))
        with np.errstate(invalid="ignore"):
            error = np.where(same, 0.0, np.abs(values - expected) / scale)
        # plans are as exact as their solver (HiGHS: 1e-7), whose rounding differs between processors
        allowed = 1e-8 if name.startswith("agent/uav_route/") else 1e-9
        if not (error <= allowed).all():  # also if one is not a number
            wrong[name] = float(np.max(error))
    assert not wrong


@pytest.mark.matrix(
    keep=(
        "rig",
        "pose_reaching",
        "uav_route",
        "heel_strike",
    )
)
@pytest.mark.parametrize("name", record.MODELS)
def test_simulations_are_those_that_were_recorded(name):
    check(record.simulations(name))


@pytest.mark.every("task", fieldgym.TASKS)
def test_environments_are_those_that_were_recorded(task):
    check(record.episodes(task))


@pytest.mark.matrix(
    keep=(
        "heel_strike",
        "line_following",
        "line_following_pixels",
    )
)
@pytest.mark.parametrize("task", fieldgym.TASKS)
def test_agents_score_as_was_recorded(task):
    check(record.agents(task))


def test_nothing_recorded_is_left_out():
    names = {f"model/{name}" for name in record.MODELS}
    names |= {f"{kind}/{task}" for kind in ("environment", "agent") for task in fieldgym.TASKS}
    assert {"/".join(key.split("/")[:2]) for key in GOLDEN.files} == names
