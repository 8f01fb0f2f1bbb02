"""An environment says how long its episodes can be, and is filmed without further packages."""

from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from PIL import Image

import fieldgym
from fieldgym import TASKS, RecordVideo
from fieldgym.bench import as_env
from fieldgym.film import FilmError, ever_rarer, write_film

LIMITS = {
    "heel_strike": {"strides": 7},
    "line_following": {"strides": 6},
    "line_following_pixels": {"strides": 5},
    "excitation": {"decisions": 4},
    "pose_reaching": {"timeout": 0.95},
    "uav_route": {"max_legs": 3},
}


@pytest.mark.parametrize("task", TASKS)
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
    env = RecordVideo(env, tmp_path, episode_trigger=lambda n: n != 1)
    for seed in range(3):
        env.reset(seed=seed)
        for _ in range(4 if seed < 2 else 2):  # the last one is left early
            env.step(env.action_space.sample())
    env.close()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["film-episode-0.gif", "film-episode-2.gif"]
    with Image.open(tmp_path / "film-episode-0.gif") as film:
        assert film.n_frames > 1
        assert film.size == (960, 540)


def test_every_ending_gives_its_film(tmp_path):
    pictures = [np.full((20, 30, 3), shade, dtype=np.uint8) for shade in (0, 90, 250)]
    for ending in (".gif", ".webp"):
        write_film(tmp_path / f"film{ending}", pictures, 10.0)
        with Image.open(tmp_path / f"film{ending}") as film:
            assert film.n_frames == 3
            film.seek(2)
            assert np.asarray(film.convert("RGB")).mean() > 240


def test_mp4_goes_through_ffmpeg_if_there_is_one(tmp_path, monkeypatch):
    """A script in its place says what it was given: the real one is not everywhere."""
    picture = np.zeros((2, 3, 3), dtype=np.uint8)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(FilmError, match=r"film.mp4: .mp4 needs the program ffmpeg.*\.webp needs nothing"):
        write_film(tmp_path / "film.mp4", [picture], 10.0)
    fake = tmp_path / "ffmpeg"
    fake.write_text('#!/bin/sh\nfor last; do :; done\n/bin/cat > "$last"; echo "$@" > "${0%/*}/said"\n')
    fake.chmod(0o755)
    write_film(tmp_path / "film.mp4", [picture, picture + 7], 10.0)
    assert (tmp_path / "film.mp4").read_bytes() == bytes(18) + bytes([7] * 18)
    assert "-s 3x2 -r 10" in (tmp_path / "said").read_text()
    fake.write_text("#!/bin/sh\necho no such codec >&2; exit 1\n")
    with pytest.raises(FilmError, match="ffmpeg: no such codec"):
        write_film(tmp_path / "other.mp4", [picture] * 5, 10.0)
    assert not (tmp_path / "other.mp4").exists()


def test_mistakes(tmp_path):
    with pytest.raises(FilmError, match="render_mode='rgb_array'"):
        RecordVideo(gym.make("fieldgym/HeelStrike-v0"), tmp_path)
    with pytest.raises(FilmError, match=r"ends in \.gif, \.webp or \.mp4"):
        RecordVideo(gym.make("fieldgym/HeelStrike-v0", render_mode="rgb_array"), tmp_path, ending=".avi")
    assert [n for n in range(30) if ever_rarer(n)] == [0, 1, 8, 27]
    assert ever_rarer(2000)
    assert not ever_rarer(1728)
    assert fieldgym.RecordVideo is RecordVideo
    assert not [path for path in Path(tmp_path).iterdir() if path.stat().st_size]
