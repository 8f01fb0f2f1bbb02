"""What inputs do between samples goes with the extended simulation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fieldgym.bench import as_env
from fieldmodels.diagnosis import diagnose
from fieldmodels.diagnosis.report import write_results
from fieldmodels.drivers.named import apply_reality
from fieldmodels.machine import held_inputs
from fieldmodels.model import ModelError
from fieldmodels.registry import get_model
from fieldmodels.synthesis import synthesise


def test_a_recording_of_the_extended_simulation_is_its_free_run(tmp_path: Path):
    interpolated, drag = (
        held_inputs(get_model("rig"), "interpolated"),
        {"quadratic_drag": {"coefficient": 3.0}},
    )
    logs = [
        synthesise(
            interpolated,
            drag,
            "steps",
            duration=20.0,
            step=0.04,
            amplitude=8.0,
            rng=np.random.default_rng([5, k]),
        )
        for k in range(2)
    ]
    found = diagnose(interpolated, logs[:1], logs[1:])
    path = write_results(found, tmp_path, drawn={})["extended.yaml"]
    model, reality = apply_reality(get_model("rig"), path)
    assert (reality.hold, model.hold) == ("interpolated", "interpolated")
    again = synthesise(
        get_model("rig"),
        path,
        {"force": logs[1]["force"]},
        step=0.04,
        rng=np.random.default_rng(0),
        noise=False,
    )
    free = found.simulate(again)  # from its first state, at rest
    held = synthesise(
        get_model("rig"), reality.plain(), {"force": logs[1]["force"]},
        step=0.04, rng=np.random.default_rng(0), noise=False,
    )  # fmt: skip
    off, other = (np.abs(free["position"] - one["position"]).max() for one in (again, held))
    assert off < 0.01 * np.ptp(again["position"])
    assert other > 3.0 * off  # the same with held inputs is another machine
    env = as_env("rig", reality=path)
    env.reset(seed=1)
    assert np.isfinite(env.step(np.ones(1, np.float32))[0]).all()


def test_another_hold_is_refused(tmp_path: Path):
    path = tmp_path / "extended.yaml"
    path.write_text("model: rig\neffects: {}\nhold: linear\n")
    with pytest.raises(ModelError, match="'hold' must be 'held' or 'interpolated'"):
        apply_reality(get_model("rig"), path)
