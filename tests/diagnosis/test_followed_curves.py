"""Curves over what remembers run in recordings as an outsider computes them."""

from __future__ import annotations

import numpy as np
import pytest

from fieldgym.bench import as_env
from fieldmodels.contract import ModelWarning
from fieldmodels.model import ModelError
from fieldmodels.registry import get_model
from fieldmodels.synthesis import synthesise

MEMORY = "force_over_memory of position over 0.2 s"
TABLE = {"at_1": -0.3, "at_2": 0.0, "at_3": 0.3, "value_1": 15.0, "value_2": 0.0, "value_3": -30.0}


def test_a_force_of_what_remembers_the_position_is_that_of_a_plain_euler_integration():
    rig, step, fine = get_model("rig"), 0.01, 8
    force = 8.0 * np.sign(np.sin(np.arange(600) * 0.05))
    log = synthesise(rig, {MEMORY: TABLE}, {"force": force}, rng=np.random.default_rng(0), noise=False)
    m, c, k = rig.nominal[:3]
    x = v = memory = 0.0
    truth = np.empty(600)
    for n in range(600 * fine):
        if n % fine == 0:
            truth[n // fine] = x
        memory += (1.0 - np.exp(-step / fine / 0.2)) * (x - memory)
        push = np.interp(memory - x, [-0.3, 0.0, 0.3], [15.0, 0.0, -30.0])
        for _ in range(20):
            a = (force[n // fine] + push - c * v - k * x) / m
            x, v = x + step / fine / 20 * v, v + step / fine / 20 * a
    plain = synthesise(rig, {}, {"force": force}, rng=np.random.default_rng(0), noise=False)["position"]
    effect = np.abs(truth - plain).max()
    assert effect > 0.02
    assert np.abs(log["position"] - truth).max() < 0.02 * effect


def test_what_is_stepped_says_that_it_leaves_such_a_curve_out():
    with pytest.warns(ModelWarning, match="is stepped without force_over_memory of position over 0.2 s"):
        env = as_env("rig", reality={MEMORY: TABLE})
    env.reset(seed=1)
    assert np.isfinite(env.step(np.ones(1, np.float32))[0]).all()


def test_a_curve_without_places_says_what_it_takes():
    with pytest.raises(ModelError, match=r"at_1, at_2, \.\.\. that rise"):
        synthesise(get_model("rig"), {MEMORY: {"value_1": 1.0}}, "steps", rng=np.random.default_rng(0))
