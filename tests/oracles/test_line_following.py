"""The walking robot and its camera against an oracle in the plane that shares no code with them."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from numpy.typing import NDArray

import fieldgym  # noqa: F401
from exam.oracles.line_following import Line, Robot, simulate, walk
from fieldgym.info import part
from fieldmodels.machines.line_following.model import LineFollowing
from fieldmodels.recording import Recording, Windows

Array = NDArray[np.float64]
Effects = dict[str, dict[str, float]]

WALKED: dict[str, tuple[dict[str, float], ...]] = {
    "steering_bias": ({"turn": 0.0017}, {"turn": -0.0371}),
    "turn_gain": ({"factor": 0.973}, {"factor": 1.71}, {"factor": 0.31}),
    "actuator_delay": ({"strides": 0.137}, {"strides": 1.31}, {"strides": 2.0}),
    "foot_slip": (
        {"turn": 0.0173, "twist": 0.0071, "step": 0.0037},
        {"turn": 0.31, "twist": 0.53, "step": 0.171},
    ),
    "camera_yaw": ({"angle": 0.0037}, {"angle": -0.0713}),
    "camera_pitch": ({"angle": 0.0071}, {"angle": -0.131}, {"angle": 0.231}),
    "sensor_gain": ({"factor": 1.0173}, {"factor": 0.371}, {"factor": 2.31}),
    "sensor_quantisation": ({"step": 0.0137}, {"step": 0.171}),
    "actuator_saturation": ({"turn": 0.131}, {"turn": 0.0173}),
}
CASES = {"line_following": WALKED}
ALONE: list[Effects] = [{name: values} for name, cases in WALKED.items() for values in cases]
PAIRS: list[Effects] = [
    {a: WALKED[a][1], b: WALKED[b][1]}
    for a, b in (
        ("steering_bias", "turn_gain"),
        ("steering_bias", "actuator_saturation"),
        ("turn_gain", "actuator_saturation"),
        ("turn_gain", "foot_slip"),
        ("steering_bias", "foot_slip"),
        ("foot_slip", "actuator_saturation"),
        ("actuator_delay", "actuator_saturation"),
        ("actuator_delay", "foot_slip"),
        ("camera_yaw", "camera_pitch"),
        ("sensor_gain", "sensor_quantisation"),
        ("camera_yaw", "sensor_gain"),
    )
]
PAIRS.append({effect: cases[0] for effect, cases in WALKED.items()})  # and all of them at once
REALITIES = [{}, *ALONE, *PAIRS]
EXACT = 1e-12
"""On a straight and in the plane both are closed forms."""
PARABOLA = 1e-3
"""A prediction takes an arc for a parabola, k^3 x^4 / 8 = 0.8 mm off at 1.5 m on a radius of 9 m [m]."""
TOLD = np.array([1e-7, 1e-7, 1e-7])
"""The environment rounds actions and observations to 32 bits."""
EDGE = 1e-3
"""How far the centroid of a tape that the image's edge cuts may be off [m]."""
TABLE = np.array([2e-4, 1e-4, 1e-4])
"""Its tracks are chords of 5 cm: 0.035 mm off an arc of 9 m, and corners of the tangent of 1e-5 rad."""
BASE = {"stride": 0.713, "camera_height": 1.0371}


def name_of(effects: Effects) -> str:
    """Name of a test's case."""
    if len(effects) > 2:
        return "all"
    return "+".join(f"{e}:{','.join(f'{v:g}' for v in values.values())}" for e, values in effects.items())


def both(effects: Effects, bent: bool) -> tuple[Array, Array]:
    """What the model and the oracle predict of two windows, on a straight or along bends."""
    model, rng = LineFollowing(), np.random.default_rng(5)
    steering = rng.uniform(-0.149, 0.149, 60)
    curvature = np.repeat(rng.uniform(-0.11, 0.11, 12), 5) if bent else np.zeros(60)
    recording = Recording(1.2 * np.arange(60), {"steering": steering, "curvature": curvature})
    starts, lengths = np.array([0, 21]), np.array([8, 8])
    states = np.array([[0.071, -0.037], [-0.113, 0.091]])
    made = Windows(recording, starts, lengths, states, np.ones((2, 8, 3), dtype=np.bool_))
    ours = model.simulate(model.vector(BASE, effects)[None], made)[0]
    theirs = []
    for first, state in zip(starts, states, strict=True):
        before = {f"command_{m}": steering[first - m] for m in (1, 2, 3) if first >= m}
        given = np.column_stack([steering, curvature])[first : first + 9]
        start = {"offset": state[0], "heading": state[1], **before}
        theirs.append(simulate(BASE, effects, given, 1.2, start)[:8])
    return np.concatenate(ours), np.concatenate(theirs)


@pytest.mark.matrix(
    keep=(
        "False-turn_gain:1.71+foot_slip:0.31,0.53,0.171",
        "True-actuator_delay:0.137",
    )
)
@pytest.mark.parametrize("effects", REALITIES, ids=map(name_of, REALITIES))
@pytest.mark.parametrize("bent", [False, True])
def test_prediction(effects: Effects, bent: bool) -> None:
    """Effects change a prediction as their equations say."""
    ours, theirs = both(effects, bent)
    error, change = np.abs(ours - theirs).max(axis=0), np.abs(theirs - both({}, bent)[1]).max(axis=0)
    assert not effects or change.max() > 2e-3
    np.testing.assert_array_less(error, EXACT + np.array([PARABOLA if bent else 0.0, 0.0, 0.0]))


LINES = {
    "straight": ((100.0, 0.0),),
    "s": ((5.0, 0.0), *(((0.5 * math.pi * 9.0), s / 9.0) for s in (1, -1, 1))),
}


@pytest.mark.matrix(
    keep=(
        "straight-steering_bias:-0.0371",
        "s-foot_slip:0.31,0.53,0.171",
    )
)
@pytest.mark.parametrize("effects", REALITIES, ids=map(name_of, REALITIES))
@pytest.mark.parametrize("track", LINES)
def test_environment(effects: Effects, track: str) -> None:
    """The environment walks and sees in this reality as the oracle does on the line as it is."""
    quiet = dict.fromkeys(("sensor", "yaw", "lateral", "bias"), 0.0)
    settings: dict[str, Any] = {"track": track, "offset": 0.03, "misalignment": 0.02, "lost_offset": 9.0}
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
    robot, line = Robot(effects, *BASE.values()), Line(LINES[track])
    commands = 0.15 * np.array(actions, dtype=np.float64)[: len(seen) - 1, 0]
    theirs = walk(robot, line, *start, commands)
    # Where an edge cuts the tape, the five rows that are looked at do not stand for all forty of the band.
    cut = theirs[:, 0] != walk(replace(robot, columns=math.inf), line, *start, commands)[:, 0]
    error = np.abs(np.array(seen) - theirs)
    error[cut, 0] = np.maximum(error[cut, 0] - EDGE, 0.0)
    error = error.max(axis=0)
    np.testing.assert_array_less(error, TOLD if track == "straight" else 10.0 * TOLD + TABLE)
