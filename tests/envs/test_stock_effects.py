"""Stock effects around the tasks: what acts is what plain NumPy says, and what a model around predicts.

An environment under an actuator's effect moves as the nominal one does under commands that NumPy has
computed; a sensor's effect moves nothing, and shows what NumPy makes of what the nominal one shows.
"""

import gymnasium as gym
import numpy as np
import pytest

import fieldgym
from fieldmodels.drivers.around import flown
from fieldmodels.machines.line_following.model import LineFollowing
from fieldmodels.machines.line_following.parameters import Noise
from fieldmodels.machines.line_following.recording import record_walk
from fieldmodels.machines.line_following.tracks import straight
from fieldmodels.machines.line_following.walks import Scene
from fieldmodels.model import ModelError


def lagged(commands, time_constant, step):
    """Mean over each step behind T dF/dt = u - F, at rest at the first command."""
    force, means = commands[0], []
    for u in commands:
        kept = np.exp(-step / time_constant)
        means.append(u + (force - u) * time_constant / step * (1.0 - kept))
        force = u + (force - u) * kept
    return np.array(means)


def play(env_id, actions, reality=None, seed=3, **settings):
    """Observations and infos of an episode's beginning under given actions."""
    env = gym.make(env_id, reality=reality, settings=settings or None).unwrapped
    steps = [env.reset(seed=seed)]
    for action in actions:
        observation, _, ended, cut, info = env.step(np.atleast_1d(action).astype(np.float64))
        steps.append((observation, info))
        if ended or cut:
            break
    return np.array([o for o, _ in steps], dtype=np.float64), [i for _, i in steps]


LINE = "fieldgym/LineFollowing-v0"
STRIDE = LineFollowing().gait.stride_time
TURNS = 0.7 * np.diff(np.random.default_rng(1).uniform(-1.0, 1.0, 31))
ENDLESS = {"lost_strides": 1000, "lost_offset": 100.0}


def walked(infos):
    return np.array([(i["privileged"]["offset"], i["privileged"]["heading"]) for i in infos])


@pytest.mark.parametrize(
    ("reality", "oracle"),
    [
        ({"steering_gain": {"gain": 0.6}}, lambda u: 0.6 * u),
        (
            {"steering_gain": {"gain": 0.8}, "steering_lag": {"time_constant": 0.9}},
            lambda u: lagged(0.8 * u, 0.9, STRIDE),
        ),
        (
            {"steering_dead_zone": {"width": 0.02}},
            lambda u: np.sign(u) * np.maximum(np.abs(u) - 0.02, 0.0),
        ),
        (
            {"steering_curve": {"low": -0.1, "high": 0.1, "value_1": 0.03, "value_2": -0.02, "value_3": 0.0}},
            lambda u: u + np.interp(u, [-0.1, 0.0, 0.1], [0.03, -0.02, 0.0]),
        ),
    ],
    ids=["gain", "gain and lag", "dead zone", "curve"],
)
def test_a_walk_turns_as_its_steering_gives(reality, oracle):
    seen, infos = play(LINE, TURNS, reality, **ENDLESS)
    same, nominal = play(LINE, oracle(0.15 * np.clip(TURNS, -1, 1)) / 0.15, **ENDLESS)
    assert len(infos) == len(TURNS) + 1
    np.testing.assert_allclose(walked(infos), walked(nominal), atol=1e-9)
    assert np.abs(walked(infos) - walked(play(LINE, TURNS, **ENDLESS)[1])).max() > 0.02
    np.testing.assert_allclose(seen[:, :4], same[:, :4], atol=1e-6)  # what the camera sends
    np.testing.assert_allclose(seen[1:, 4], np.clip(TURNS, -1, 1), atol=1e-6)  # what the robot has sent
    np.testing.assert_allclose([i["command"] for i in infos[1:]], 0.15 * np.clip(TURNS, -1, 1))


def test_a_bent_camera_shows_what_numpy_makes_of_the_line():
    reality = {"line_bend": {"curvature": 0.7}, "line_drift": {"rate": 0.002}}
    gentle = {"track": "straight", "bias": 0.0, "misalignment": 0.0, **ENDLESS}
    seen, infos = play(LINE, TURNS, reality, **gentle)
    plain, nominal = play(LINE, TURNS, **gentle)
    np.testing.assert_array_equal(walked(infos), walked(nominal))
    true = 0.3 * plain[:, 0]
    found = np.array([i.get("lost", 0.0) for i in nominal]) == 0.0
    expected = (true + 0.7 * true * np.abs(true) + 0.002 * STRIDE * np.arange(len(true))) / 0.3
    assert found.sum() > 10
    np.testing.assert_allclose(seen[found, 0], expected[found], atol=1e-5)
    np.testing.assert_array_equal(seen[1:, 1], seen[:-1, 0])  # memory holds what was shown
    assert np.abs(seen[found, 0] - plain[found, 0]).max() > 0.05


def test_strides_that_become_shorter():
    reality = {"stride_step": {"time": 10.0 * STRIDE, "change": -0.3}}
    infos = play(LINE, np.zeros(20), reality, track="straight", yaw=0.0, lateral=0.0, bias=0.0)[1]
    nominal = play(LINE, np.zeros(20), None, track="straight", yaw=0.0, lateral=0.0, bias=0.0)[1]
    ways, own = (np.diff(walked(part)[:, 0]) for part in (infos, nominal))
    np.testing.assert_allclose(ways[:10], own[:10], atol=1e-9)
    np.testing.assert_allclose(ways[10:], own[10:] * (0.7 - 0.3) / 0.7, atol=1e-9)


WALKED = {
    "gain and lag": {"steering_gain": {"gain": 0.7}, "steering_lag": {"time_constant": 0.6}},
    "delay and play": {"steering_delay": {"delay": 0.5}, "steering_play": {"width": 0.01}},
    "bend": {"line_bend": {"curvature": 0.8}, "offset_bend": {"curvature": 0.5}},
    "curve": {
        "steering_curve": {"low": -0.1, "high": 0.1, "value_1": 0.02, "value_2": 0.0, "value_3": -0.03}
    },
    "bent camera": {
        "line_curve": {"low": -0.5, "high": 0.5, "value_1": -0.1, "value_2": 0.0, "value_3": 0.2}
    },
}


@pytest.mark.parametrize("name", WALKED)
def test_the_model_with_the_same_effects_predicts_a_recorded_walk(name):
    """Exactly, without noise; the nominal model errs by much."""
    plain = LineFollowing()
    quiet = Scene(straight(200.0), noise=Noise(0.0, 0.0, 0.0, 0.0))
    recording = record_walk(WALKED[name], 150, scene=quiet, noise=0.0, rng=np.random.default_rng(2))
    model, truth = flown(plain, WALKED[name])
    windows = plain.windows(recording, plain.horizons[1])
    measured = windows.measured(tuple(s.name for s in plain.outputs))
    error = np.nanmax(np.abs(model.simulate(truth.vector(model)[None], windows)[0] - measured))
    assert error < 1e-9
    assert np.nanmax(np.abs(plain.simulate(plain.nominal[None], windows)[0] - measured)) > 3e-3


def test_a_parameter_that_jumps_between_windows_is_predicted():
    plain, reality = LineFollowing(), {"stride_step": {"time": 60 * STRIDE, "change": -0.2}}
    quiet = Scene(straight(200.0), noise=Noise(0.0, 0.0, 0.0, 0.0))
    recording = record_walk(reality, 150, scene=quiet, noise=0.0, rng=np.random.default_rng(2))
    model, truth = flown(plain, reality)
    windows = plain.windows(recording, 3 * STRIDE)
    assert 60 in windows.starts
    predicted = model.simulate(truth.vector(model)[None], windows)[0]
    measured = windows.measured(tuple(s.name for s in plain.outputs))
    np.testing.assert_allclose(predicted[..., 1:], measured[..., 1:], atol=1e-9)
    nominal = plain.simulate(plain.nominal[None], windows)[0]
    assert np.abs(nominal - measured)[windows.starts >= 60].max() > 0.01


@pytest.mark.parametrize(
    ("env_id", "reality", "words"),
    [
        (LINE, {"offset_gain": {"gain": 1.1}}, "the commands steering; the sensors line"),
        (LINE, {"curvature_lag": {"time_constant": 1.0}}, "a robot steers"),
        ("fieldgym/LineFollowingPixels-v0", {"line_gain": {"gain": 1.1}}, "it observes images"),
        (LINE, {"steering_gian": {"gain": 1.1}}, "did you mean 'steering_gain'"),
        (LINE, {"steering_lag": {"time_constant": -1.0}}, "outside"),
    ],
)
def test_what_cannot_act_in_a_task_is_said(env_id, reality, words):
    with pytest.raises(ModelError, match=words):
        gym.make(env_id, reality=reality)


def test_what_the_tasks_declare_is_in_their_models():
    from fieldmodels.registry import get_model

    for task in fieldgym.TASKS.values():
        model = get_model(task.model)
        assert set(task.channels.commands) <= {s.name for s in model.inputs}
        assert set(task.channels.observed) <= {s.name for s in model.outputs}
