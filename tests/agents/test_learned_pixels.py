"""Learning from images: features, what is exported acts as the learner does, a killed run resumes exactly."""

import math

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

import gymnasium
import torch

import fieldgym
from fieldagents.learned import recorder
from fieldagents.learned.checkpoint import load_checkpoint, save_checkpoint
from fieldagents.learned.config import TrainConfig
from fieldagents.learned.export import to_onnx
from fieldagents.learned.pixels import SHRINK, DarkLine, ImageFeatures, is_image
from fieldagents.learned.run import Run, SpaceError
from fieldagents.learned.training import train
from fieldagents.policies.policy import OnnxAgent
from fieldgym.sb3 import NativeVecEnv
from fieldmodels.machines.line_following.parameters import Camera, Lighting
from fieldmodels.machines.line_following.renderer import Renderer, make_view
from fieldmodels.machines.line_following.tracks import straight

TASK = "line_following_pixels"
COLOUR = {"strides": 7, "track": "straight", "colour": True}
TINY = {
    "name": "tiny",
    "task": TASK,
    "seed": 1,
    "steps": 96,
    "num_envs": 2,
    "checkpoint_every": 1,
    "environment": {"settings": COLOUR},
    "algorithm": "ppo",
    "learner": {"n_steps": 16, "batch_size": 16, "n_epochs": 1},
    "network": {"hidden": [8]},
    "normalise": {"reward": True},
    "validation": {"every": 3, "episodes": 2},
}
LINE = "fieldagents.learned.pixels:DarkLine"
FEATURES = {**TINY, "features": LINE, "stack": 3}
BOTH = pytest.mark.parametrize("tiny", [TINY, FEATURES], ids=["image", "features"])


class Killed(BaseException):
    """Stands in for the end of the process."""


@BOTH
def test_onnx_acts_on_images_as_the_trained_policy_does(tiny, tmp_path):
    """Raw bytes, rows first, and what it remembers itself, give the learner's own most likely action."""
    finished = train(TrainConfig(**tiny), progress=False, out=tmp_path / "run")
    native = gymnasium.make_vec(
        fieldgym.TASKS[TASK].env_id, num_envs=2, vectorization_mode="vector_entry_point", settings=COLOUR
    )
    config = TrainConfig(**tiny)
    run = Run(config, NativeVecEnv(native, seed=0))
    run.restore(load_checkpoint(sorted((finished / "checkpoints").glob("*.pt"))[-1]))
    run.normaliser.training = False  # what is exported no longer changes
    observation, ended, actions = run.normaliser.reset(), np.ones(2, dtype=bool), []
    with torch.no_grad():  # large outputs around zero, so that actions differ and some meet their limits
        run.policy.action_net.weight.mul_(100 if config.features else 1000)
        given, _ = run.policy.obs_to_tensor(observation)
        run.policy.action_net.bias.sub_(run.policy._predict(given, deterministic=True).mean())
    loud = OnnxAgent(to_onnx(run.policy, run.normaliser, "test", config.stack, run.featured))
    for _ in range(40):
        expected = run.model.predict(observation, deterministic=True)[0]
        loud.begin_episodes(ended)
        np.testing.assert_allclose(loud.act(run.environment.latest, {}), expected, atol=1e-4)
        actions.append(expected)
        observation, _, ended, _ = run.normaliser.step(expected)
    assert np.ptp(actions) > 0.1
    run.environment.close()


@BOTH
def test_a_killed_run_on_images_resumes_bit_for_bit(tiny, tmp_path, monkeypatch):
    finished = train(TrainConfig(**tiny), progress=False, out=tmp_path / "whole")
    saved = []

    def save_and_die(state, path):
        save_checkpoint(state, path)
        saved.append(path)
        if len(saved) == 2:
            raise Killed

    monkeypatch.setattr(recorder, "save_checkpoint", save_and_die)
    with pytest.raises(Killed):
        train(TrainConfig(**tiny), progress=False, out=tmp_path / "run")
    monkeypatch.setattr(recorder, "save_checkpoint", save_checkpoint)
    torch.manual_seed(99)
    train(TrainConfig(**tiny), progress=False, resume=tmp_path / "run")
    for name in ("policy.onnx", "curve.csv"):
        assert (tmp_path / "run" / name).read_bytes() == (finished / name).read_bytes()


@pytest.mark.every(("light", "colour"), [(1.0, False), (0.3, False), (1.0, True)])
@pytest.mark.every(("offset", "heading"), [(0.0, 0.0), (0.12, -0.2), (-0.25, 0.1)])
def test_the_course_of_a_line_is_where_a_pinhole_camera_sees_it(offset, heading, light, colour):
    """Of a straight line, whose picture is straight, as plane geometry has it."""
    camera = Camera()
    view = make_view(camera, lighting=Lighting(light=light), colour=colour)
    image = Renderer(straight(), camera, view).image((5.0, offset, heading), 5.0, key=3)
    image = image.reshape(camera.rows, camera.width, -1)
    found = DarkLine(gymnasium.spaces.Box(0, 255, image.shape, np.uint8))
    features = found(torch.as_tensor(image)[None])[0].numpy()
    places = found.polynomials.numpy() @ features[:-3] * found.bands
    for band, place in enumerate(places):
        row = 4 * band + 1.5
        ahead = camera.distance(row)
        beside = -offset / math.cos(heading) - ahead * math.tan(heading)
        depth = ahead * math.cos(camera.pitch) + camera.height * math.sin(camera.pitch)
        assert abs(place - beside / depth * camera.focal / (camera.width / 2)) < 0.012  # a pixel's width
    assert (features[-3:] == 1.0).all()


def test_where_no_line_is_seen_its_neighbours_stand_in():
    space = gymnasium.spaces.Box(0, 255, (120, 160, 1), np.uint8)
    image = torch.full((2, 120, 160, 1), 165, dtype=torch.uint8)
    image[0, :60, 40:46] = 35
    found = DarkLine(space)
    features = found(image)
    assert features[:, -3:].tolist() == [[1.0, 0.5, 0.0], [0.0, 0.0, 0.0]]
    assert (features[1] == 0.0).all()
    places = found.polynomials @ features[0, :-3] * found.bands
    assert torch.allclose(places, torch.tensor(1.0 - 43.0 / 80.0), atol=1e-3)
    assert torch.allclose(found(image[:1]), features[:1], atol=1e-6)  # each image by itself


def test_learned_features_are_of_every_image_alone():
    space = gymnasium.spaces.Box(0, 255, (1, 120, 160), np.uint8)
    torch.manual_seed(0)
    features = ImageFeatures(space, 5)
    batch = torch.rand(3, 1, 120, 160)
    together = features(batch)
    assert together.shape == (3, 5)
    assert torch.allclose(together[1], features(batch[1:2])[0], atol=1e-6)
    # only averages over small squares count
    swapped = batch.clone()
    swapped[:, :, :SHRINK, :SHRINK] = batch[:, :, :SHRINK, :SHRINK].flip(2, 3)
    assert torch.allclose(features(swapped), together, atol=1e-6)


def test_features_stand_beside_the_action_and_begin_anew_with_an_episode():
    native = gymnasium.make_vec(
        fieldgym.TASKS[TASK].env_id, num_envs=2, vectorization_mode="vector_entry_point", settings=COLOUR
    )
    run = Run(TrainConfig(**FEATURES), NativeVecEnv(native, seed=0))
    width = 4 + 3 + 1
    observation = run.normaliser.reset()
    assert observation.shape == (2, 3 * width)
    for step in range(1, 8):
        command = np.array([[0.1 * step], [3.0 * (-1) ** step]], dtype=np.float32)
        _, _, ended, infos = run.normaliser.step(command)
        last, before = run.normaliser.get_original_obs()[:, -width:], 3 * width - width - 1
        seen = DarkLine(native.single_observation_space)(torch.as_tensor(run.environment.latest))
        np.testing.assert_array_equal(last[:, :-1], seen.numpy())
        if step < 7:
            np.testing.assert_allclose(last[:, -1], [0.1 * step, (-1.0) ** step], rtol=1e-6)  # within limits
    assert ended.all()
    assert (last[:, -1] == 0.0).all()
    assert (run.normaliser.get_original_obs()[:, : before + 1] == 0.0).all()
    terminal = run.normaliser.unnormalize_obs(infos[0]["terminal_observation"])
    np.testing.assert_allclose([terminal[-1], terminal[before]], [0.7, 0.6], atol=1e-5)
    run.environment.close()


@pytest.mark.nightly
def test_a_student_follows_the_line_by_its_camera(tmp_path):
    """After seconds of imitation it beats the law (3.1), which is 34 mm from the oval."""
    from fieldagents.config import EnvironmentConfig
    from fieldagents.evaluation.episodes import run_episodes

    config = TrainConfig(
        name="student",
        task=TASK,
        steps=0,
        num_envs=32,
        stack=6,
        features=LINE,
        imitate={"teacher": "ceiling", "rounds": 8, "steps": 50, "batch_size": 128, "learning_rate": 3e-3},
        validation={"episodes": 4},
    )
    agent = OnnxAgent(train(config, progress=False, out=tmp_path / "run") / "policy.onnx")
    walks = run_episodes(agent, TASK, EnvironmentConfig(), range(9000, 9020))
    assert walks["mean_offset"].mean() < 0.028


def test_what_cannot_be_learned_from_is_refused(tmp_path):
    assert is_image(gymnasium.spaces.Box(0, 255, (120, 160, 1), np.uint8))
    assert not is_image(gymnasium.spaces.Box(-1, 1, (9,), np.float32))
    off_policy = {
        "algorithm": "sac",
        "learner": {"buffer_size": 64, "learning_starts": 16, "batch_size": 16},
    }
    recurrent = {**FEATURES, "algorithm": "recurrent_ppo", "policy": "MlpLstmPolicy"}
    for changed, message in (
        (off_policy, "images are learned from by on-policy algorithms"),
        ({"stack": 2}, "without a stack; others, and a stack, need features"),
        ({"features": {LINE: {"band": 7}}}, "bands of 7 rows do not divide"),
        (recurrent, "remembered by a stack of them, not by recurrence"),
    ):
        with pytest.raises(SpaceError, match=message):
            train(TrainConfig(**{**TINY, **changed}), progress=False, out=tmp_path / message[:9])
    with pytest.raises(ValueError, match="cannot be imported"):
        TrainConfig(**{**TINY, "features": "fieldagents.learned.pixels:Lines"})
    with pytest.raises(ValueError, match="unexpected keyword argument 'bands'"):
        TrainConfig(**{**TINY, "features": {LINE: {"bands": 7}}})
