"""An environment says how long its episodes can be, is filmed, and is steered by keys."""

import sys
from pathlib import Path

import cv2
import gymnasium as gym
import matplotlib
import numpy as np
import pygame
import pytest
from gymnasium.utils.play import play
from PIL import Image

from fieldgym import TASKS
from fieldgym.bench import as_env
from fieldgym.film import FilmError, check_ending, write_film
from fieldmodels.extras import MissingExtraError

matplotlib.use("Agg")  # importing Gymnasium's play asks for a window

LIMITS = {
    "heel_strike": {"strides": 7},
    "line_following": {"strides": 6},
    "line_following_pixels": {"strides": 5},
    "excitation": {"decisions": 4},
    "pose_reaching": {"timeout": 0.95},
    "uav_route": {"max_legs": 3},
}


@pytest.mark.every("task", TASKS)
def test_the_spec_names_the_step_that_ends_the_longest_episode(task):
    """Of ten episodes of an agent that does nothing, none is longer, and the longest is as long."""
    env = gym.make(TASKS[task].env_id, settings=LIMITS[task])
    assert "TimeLimit" not in str(env), "a second limit"
    most = env.spec.max_episode_steps
    assert most == env.unwrapped.spec.max_episode_steps
    lengths = []
    for seed in range(10):
        env.reset(seed=seed)
        over, steps = False, 0
        while not over:
            _, _, terminated, truncated, _ = env.step(np.zeros(env.action_space.shape, dtype=np.float32))
            over, steps = terminated or truncated, steps + 1
        lengths.append(steps)
    assert max(lengths) == most
    assert gym.spec(TASKS[task].env_id).max_episode_steps is None
    vector = gym.make_vec(
        TASKS[task].env_id, num_envs=2, vectorization_mode="vector_entry_point", settings=LIMITS[task]
    )
    assert vector.spec.max_episode_steps == most
    again = gym.make(env.spec)  # the same limit twice is one
    assert again.spec.max_episode_steps == most


def test_a_random_limit_counts_at_its_largest():
    env = gym.make("fieldgym/HeelStrike-v0", settings={"strides": {"choice": [3, 9, 5]}})
    assert env.spec.max_episode_steps == 9
    assert as_env("rig", settings={"duration": 0.5, "step": 0.01})._task.most_steps == 50


def test_films_of_episodes(tmp_path):
    env = gym.make("fieldgym/HeelStrike-v0", render_mode="rgb_array", settings={"strides": 4})
    env = gym.wrappers.RecordVideo(env, str(tmp_path), episode_trigger=lambda n: n != 1)
    for seed in range(3):
        env.reset(seed=seed)
        for _ in range(4 if seed < 2 else 2):  # the last one is left early
            env.step(env.action_space.sample())
    env.close()
    films = sorted(path.name for path in tmp_path.iterdir())
    assert films == ["rl-video-episode-0.mp4", "rl-video-episode-2.mp4"]
    first = cv2.VideoCapture(str(tmp_path / films[0]))
    assert first.get(cv2.CAP_PROP_FRAME_COUNT) == 5
    assert first.read()[1].shape == (540, 960, 3)


def test_wrappers_of_gymnasium_resize_and_grey_the_camera_s_images():
    env = gym.make("fieldgym/LineFollowingPixels-v1", settings={"colour": True})
    small = gym.wrappers.ResizeObservation(gym.wrappers.GrayscaleObservation(env), (60, 80))
    assert small.reset(seed=0)[0].shape == (60, 80)


@pytest.mark.every(
    ("task", "settings", "actions"),
    [
        ("line_following", {}, [[1.0], [0.0]]),
        ("line_following_pixels", {}, [[1.0], [0.0]]),
        ("pose_reaching", {}, [[-1.0, 1.0], [-1.0, 0.0]]),
        ("pose_reaching", {"drive": "omnidirectional"}, [[0.0, 1.0, 0.0], [0.0, 0.0, 0.0]]),
    ],
)
def test_a_person_steers_by_gymnasium_s_own_play(task, settings, actions, monkeypatch):
    """The key a turns left until it is let go; then the window is closed."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    env = gym.make(TASKS[task].env_id, settings=settings, render_mode="rgb_array")
    taken = []

    def after(_seen, _next, action, *_):
        taken.append(np.asarray(action).tolist())
        event = pygame.KEYUP if len(taken) == 1 else pygame.QUIT
        pygame.event.post(pygame.event.Event(event, key=ord("a")))

    pygame.init()
    pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=ord("a")))
    play(env, callback=after, fps=1000, seed=0)
    assert taken[:2] == actions
    for action in env.unwrapped.get_keys_to_action().values():
        assert env.action_space.contains(action)


def test_every_ending_gives_its_film(tmp_path):
    pictures = [np.full((20, 30, 3), shade, dtype=np.uint8) for shade in (0, 90, 250)]
    for ending in (".gif", ".webp"):
        write_film(tmp_path / f"film{ending}", pictures, 10.0)
        with Image.open(tmp_path / f"film{ending}") as film:
            assert film.n_frames == 3
            film.seek(2)
            assert np.asarray(film.convert("RGB")).mean() > 240


def test_mp4_goes_through_ffmpeg_if_there_is_one(tmp_path, monkeypatch):
    pictures = [np.full((20, 30, 3), shade, dtype=np.uint8) for shade in (0, 90, 250)]
    write_film(tmp_path / "film.mp4", pictures, 10.0)
    film = cv2.VideoCapture(str(tmp_path / "film.mp4"))
    assert film.get(cv2.CAP_PROP_FPS) == 10.0
    assert [film.read()[1].mean() for _ in pictures] == pytest.approx([0, 90, 250], abs=5)
    fake = tmp_path / "ffmpeg"
    fake.write_text("#!/bin/sh\necho no such codec >&2; exit 1\n")
    fake.chmod(0o755)
    with monkeypatch.context() as patched:
        patched.setenv("IMAGEIO_FFMPEG_EXE", str(fake))
        with pytest.raises(FilmError, match="ffmpeg has written nothing"):
            write_film(tmp_path / "other.mp4", pictures * 5, 10.0)
    assert not (tmp_path / "other.mp4").exists()
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(MissingExtraError, match=r"imageio_ffmpeg is not installed.*\[video\]"):
        write_film(tmp_path / "film.mp4", pictures, 10.0)


def test_mistakes(tmp_path):
    with pytest.raises(FilmError, match=r"ends in \.gif, \.webp or \.mp4"):
        check_ending(tmp_path / "film.avi")
    assert not [path for path in Path(tmp_path).iterdir() if path.stat().st_size]
