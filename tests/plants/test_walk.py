"""The walking robot and its camera against the exam's plant."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from numpy.typing import NDArray

import fieldgym  # noqa: F401
from exam.benches import get_bench
from exam.plants import walk
from fieldgym.info import part
from fieldmodels.machines.line_following.model import LineFollowing
from fieldmodels.recording import Recording, Windows

Array = NDArray[np.float64]
Effects = dict[str, dict[str, float]]

VALUES: Effects = {
    "steering_bias": {"turn": -0.0053},
    "turn_gain": {"factor": 1.71},
    "actuator_delay": {"strides": 1.31},
    "foot_slip": {"turn": 0.31, "twist": 0.53, "step": 0.171},
    "camera_yaw": {"angle": -0.0713},
    "camera_pitch": {"angle": -0.131},
    "sensor_gain": {"factor": 0.371},
    "sensor_quantisation": {"step": 0.0137},
    "actuator_saturation": {"turn": 0.0731},
}
REALITIES: list[Effects] = [{}, *({e: VALUES[e]} for e in get_bench("line_following").effects), VALUES]
EXACT = 1e-12
"""On a straight both are closed forms."""
TOLD = 1e-7
"""The environment rounds actions and observations to 32 bits."""
EDGE = 1e-3
"""How far the centroid of a tape that the image's edge cuts may be off [m]."""
BASE = {"stride": 0.713, "camera_height": 1.0371}


def walked(effects: Effects, start: tuple[float, float], commands: Array) -> Array:
    """Command, line, offset and heading at each stride by the plant, steered by the commands alone."""
    walker = walk.Walker(*BASE.values(), start=start, law=(0.0, 0.0, 0.0))
    walk.install(walker, effects)
    return walk.simulate(walker, commands, np.zeros((len(commands), 5)))


@pytest.mark.every("effects", REALITIES)
def test_prediction(effects: Effects) -> None:
    """Effects change a prediction as their equations say."""
    commands = np.array([-0.05, 0.14, -0.13, 0.11, -0.14, 0.02, 0.13, -0.05, -0.06, 0.0])
    rows = walked(effects, (0.071, -0.037), commands)
    recording = Recording(1.2 * np.arange(10), {"steering": rows[:, 0], "curvature": np.zeros(10)})
    starts, observed = np.array([0, 3]), np.ones((2, 7, 3), dtype=np.bool_)
    made = Windows(recording, starts, np.full(2, 7), rows[starts, 2:], observed)
    model = LineFollowing()
    ours, without = model.simulate(np.array([model.vector(BASE, on) for on in (effects, {})]), made)
    assert np.abs(ours - without).max() > 2e-3 or not effects
    assert (
        np.abs(rows[:, 1]).max() < 0.4
    )  # no edge of the image cuts the tape, which a prediction does not know
    for window, first in zip(ours, starts, strict=True):
        np.testing.assert_allclose(window, rows[first : first + 7, 1:], rtol=0, atol=EXACT)


@pytest.mark.every("effects", REALITIES)
def test_environment(effects: Effects) -> None:
    """The environment walks and sees in this reality as the plant does on a straight line."""
    quiet = dict.fromkeys(("sensor", "yaw", "lateral", "bias"), 0.0)
    settings: dict[str, Any] = {"track": "straight", "offset": 0.03, "misalignment": 0.02, "lost_offset": 9.0}
    reality = effects | {"parameters": BASE}
    env = gym.make("fieldgym/LineFollowing-v1", settings=settings | quiet, reality=reality)
    observation, info = env.reset(seed=2)
    told = part(info, "privileged")
    start = told["offset"], told["heading"]
    rng, actions = np.random.default_rng(4), []
    seen = [(0.3 * observation[0], *start)]
    for _ in range(12):
        towards = -0.35 * told["offset"] - 0.8 * told["heading"] + rng.uniform(-0.06, 0.06)
        actions.append(np.clip([towards / 0.15], -1.0, 1.0, dtype=np.float32))
        observation, *_, info = env.step(actions[-1])
        told = part(info, "privileged")
        if info["lost"]:  # what is shown is an earlier place
            break
        seen.append((0.3 * observation[0], told["offset"], told["heading"]))
    assert len(seen) > 2
    commands = np.append(0.15 * np.array(actions, dtype=np.float64)[: len(seen) - 1, 0], 0.0)
    error = np.abs(np.array(seen) - walked(effects, start, commands)[:, 1:])
    # Where an edge cuts the tape, the five rows that are looked at do not stand for all forty of the band.
    assert (error < [EDGE, TOLD, TOLD]).all()
    assert (error[:, 0] < TOLD).sum() > 0.7 * len(error)
