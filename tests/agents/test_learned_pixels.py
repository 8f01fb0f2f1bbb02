"""Learning from images: what is exported acts as the learner does, and a killed run resumes exactly."""

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
from fieldagents.learned.pixels import SHRINK, ImageFeatures, is_image
from fieldagents.learned.run import Run, SpaceError
from fieldagents.learned.training import train
from fieldagents.learned.vector import NativeVecEnv
from fieldagents.policies.policy import OnnxAgent

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
    "normalise": {"observation": False, "reward": True},
    "validation": {"every": 3, "episodes": 2},
}


class Killed(BaseException):
    """Stands in for the end of the process."""


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    return train(TrainConfig(**TINY), progress=False, out=tmp_path_factory.mktemp("runs") / "run")


def test_onnx_acts_on_images_as_the_trained_policy_does(finished):
    """Raw bytes, rows first, give the learner's own most likely action."""
    native = gymnasium.make_vec(
        fieldgym.TASKS[TASK].env_id, num_envs=2, vectorization_mode="vector_entry_point", settings=COLOUR
    )
    run = Run(TrainConfig(**TINY), NativeVecEnv(native, seed=0))
    run.restore(load_checkpoint(sorted((finished / "checkpoints").glob("*.pt"))[-1]))
    rng = np.random.default_rng(0)
    noise = rng.integers(0, 256, (20, 120, 160, 3), dtype=np.uint8)
    images = np.concatenate([native.reset(seed=k)[0] for k in range(20)] + [noise])
    with torch.no_grad():  # large outputs, so that actions differ and some meet their limits
        run.policy.action_net.weight.mul_(100)
    loud = OnnxAgent(to_onnx(run.policy, run.normaliser, "test"))
    expected = run.model.predict(images, deterministic=True)[0]
    assert np.ptp(expected) > 0.1
    np.testing.assert_allclose(loud.act(images, {}), expected, atol=1e-4)
    run.environment.close()


def test_a_killed_run_on_images_resumes_bit_for_bit(finished, tmp_path, monkeypatch):
    saved = []

    def save_and_die(state, path):
        save_checkpoint(state, path)
        saved.append(path)
        if len(saved) == 2:
            raise Killed

    monkeypatch.setattr(recorder, "save_checkpoint", save_and_die)
    with pytest.raises(Killed):
        train(TrainConfig(**TINY), progress=False, out=tmp_path / "run")
    monkeypatch.setattr(recorder, "save_checkpoint", save_checkpoint)
    torch.manual_seed(99)
    train(TrainConfig(**TINY), progress=False, resume=tmp_path / "run")
    for name in ("policy.onnx", "curve.csv"):
        assert (tmp_path / "run" / name).read_bytes() == (finished / name).read_bytes()


def test_features_are_of_every_image_alone():
    space = gymnasium.spaces.Box(0, 255, (1, 120, 160), np.uint8)
    assert is_image(gymnasium.spaces.Box(0, 255, (120, 160, 1), np.uint8))
    assert not is_image(gymnasium.spaces.Box(-1, 1, (9,), np.float32))
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


def test_only_on_policy_algorithms_learn_from_images(tmp_path):
    changed = {"algorithm": "sac", "learner": {"buffer_size": 64, "learning_starts": 16, "batch_size": 16}}
    with pytest.raises(SpaceError, match="images are learned from by on-policy algorithms"):
        train(TrainConfig(**{**TINY, **changed}), progress=False, out=tmp_path / "run")
