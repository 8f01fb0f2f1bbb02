"""A command that explains nothing of the response is said before anything is judged."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import cont2discrete

from fieldmodels.diagnosis import diagnose
from fieldmodels.diagnosis.outcome import Diagnosis
from fieldmodels.recording import Recording
from fieldmodels.registry import get_model

ROWS, STEP, NOISE = 1200, 0.01, 0.002


def bench(seed: int) -> dict[str, np.ndarray]:
    """A mass on a damped spring by its exact response: held levels of force."""
    rng = np.random.default_rng(seed)
    mass, damping, stiffness = 2.0, 3.0, 60.0
    system = np.array([[0.0, 1.0], [-stiffness / mass, -damping / mass]]), np.array([[0.0], [1 / mass]])
    a, b = cont2discrete((*system, np.eye(2), np.zeros((2, 1))), STEP)[:2]
    force, state = rng.uniform(-3.0, 3.0, ROWS // 20).repeat(20), np.zeros(2)
    position = np.empty(ROWS)
    for k, u in enumerate(force):
        position[k] = state[0]
        state = a @ state + b[:, 0] * u
    return {"force": force, "position": position + NOISE * rng.standard_normal(ROWS)}


def verdict(signals: dict[str, np.ndarray]) -> Diagnosis:
    return diagnose(get_model("rig"), [Recording(np.arange(ROWS) * STEP, signals)])


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("kind", ["noise alone", "another run"])
def test_no_relation_is_said_with_the_remedy(kind: str, seed: int):
    signals, rng = bench(seed), np.random.default_rng(seed)
    other = 0.01 * rng.standard_normal(ROWS) if kind == "noise alone" else bench(seed + 100)["position"]
    found = verdict({**signals, "position": other})
    assert found.verdict == "unrelated", found.summary()
    assert not found.causes
    assert "no relation between command and response: check that both columns" in found.summary()


def test_a_weak_response_is_a_relation():
    """Three times the noise."""
    signals = bench(3)
    signals["position"] = signals["position"] + 0.01 * np.random.default_rng(3).standard_normal(ROWS)
    assert verdict(signals).verdict == "consistent"


def test_a_command_that_never_changes_has_nothing_to_relate():
    signals = bench(4)
    assert verdict({**signals, "force": np.zeros(ROWS)}).verdict != "unrelated"
