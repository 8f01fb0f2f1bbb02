"""A command that explains nothing of the response is said before anything is judged."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import cont2discrete

from fieldmodels.diagnosis import diagnose
from fieldmodels.diagnosis.outcome import Diagnosis
from fieldmodels.diagnosis.pilot import identifiable
from fieldmodels.diagnosis.relation import CERTAIN, DOUBT, _answers
from fieldmodels.recording import Recording, RecordingError
from fieldmodels.registry import get_model

ROWS, STEP, NOISE = 1200, 0.01, 0.002
CHANCE = 16
"""A seed whose noise goes with the command at p < 0.05."""


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


@pytest.mark.matrix(keep=("noise alone-2",))
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("kind", ["noise alone", "another run"])
def test_no_relation_is_said_with_the_remedy(kind: str, seed: int):
    signals, rng = bench(seed), np.random.default_rng(seed)
    other = 0.01 * rng.standard_normal(ROWS) if kind == "noise alone" else bench(seed + 100)["position"]
    found = verdict({**signals, "position": other})
    assert found.verdict == "unrelated", found.summary()
    assert not found.causes
    assert "no relation between command and response: check that both columns" in found.summary()


def test_noise_that_goes_with_the_command_by_chance_is_not_consistent():
    """In one record of twenty it does; then nothing found is no proof of a relation either."""
    signals = bench(CHANCE)
    signals["position"] = 0.01 * np.random.default_rng(CHANCE).standard_normal(ROWS)
    log = Recording(np.arange(ROWS) * STEP, signals)
    assert _answers(log, get_model("rig"), DOUBT)
    assert not _answers(log, get_model("rig"), CERTAIN)
    assert verdict(signals).verdict == "unrelated"


@pytest.mark.parametrize("signal", ["force", "position"])
@pytest.mark.parametrize("size", [1e-300, 1e-30, 1e30, 1e297])
def test_what_no_sensor_can_measure_is_refused_before_the_work(signal: str, size: float):
    signals = bench(5)
    signals[signal] = size * signals[signal]
    with pytest.raises(RecordingError, match=r"have been measured|never changes"):
        identifiable(get_model("rig"), [Recording(np.arange(ROWS) * STEP, signals)], {})


def test_a_weak_response_is_a_relation():
    """Three times the noise."""
    signals = bench(3)
    signals["position"] = signals["position"] + 0.01 * np.random.default_rng(3).standard_normal(ROWS)
    assert verdict(signals).verdict == "consistent"


def test_a_command_that_never_changes_has_nothing_to_relate():
    signals = bench(4)
    assert verdict({**signals, "force": np.zeros(ROWS)}).verdict != "unrelated"
