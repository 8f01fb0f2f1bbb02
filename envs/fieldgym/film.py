"""Films of what environments draw, without further packages."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from fieldmodels.files import replacing

FILMS = (".gif", ".webp", ".mp4")
"""Endings of films; ``.mp4`` needs the program ffmpeg."""

Picture = NDArray[np.uint8]


class FilmError(ValueError):
    """A film that cannot be written."""


def ever_rarer(episode: int) -> bool:
    """Whether to film an episode: the cubes up to 1000, then every thousandth, as Gymnasium does."""
    return episode % 1000 == 0 if episode >= 1000 else round(episode ** (1 / 3)) ** 3 == episode


class RecordVideo(gym.Wrapper[Any, Any, Any, Any]):
    """Writes films of some episodes, as Gymnasium's wrapper of this name, which needs moviepy.

    Args:
        env: Made with ``render_mode="rgb_array"``.
        folder: Where the films go: ``<name_prefix>-episode-<number><ending>``.
        episode_trigger: Whether to film the episode of a number; by default 0, 1, 8, 27, ... 1000, 2000, ...
        name_prefix: Begin of the files' names.
        ending: One of ``FILMS``.

    Raises:
        FilmError: If the environment draws nothing, or there is no such film.
    """

    def __init__(
        self,
        env: gym.Env[Any, Any],
        folder: Path | str,
        episode_trigger: Callable[[int], bool] = ever_rarer,
        name_prefix: str = "film",
        ending: str = ".gif",
    ) -> None:
        super().__init__(env)
        if env.render_mode != "rgb_array":
            raise FilmError("a film needs pictures: gymnasium.make(..., render_mode='rgb_array')")
        check_ending(Path(f"film{ending}"))
        self._folder, self._trigger, self._prefix, self._ending = (
            Path(folder),
            episode_trigger,
            name_prefix,
            ending,
        )
        self._number, self._pictures = -1, list[Picture]()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode, and its film."""
        self._write()
        result = self.env.reset(seed=seed, options=options)
        self._number += 1
        self._take()
        return result

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Take a step, and a picture of it."""
        result = self.env.step(action)
        self._take()
        if result[2] or result[3]:
            self._write()
        return result

    def close(self) -> None:
        """Write what has been filmed, and close the environment."""
        self._write()
        self.env.close()

    def _take(self) -> None:
        if self._trigger(self._number):
            picture: Any = self.env.render()
            self._pictures.append(picture)

    def _write(self) -> None:
        if self._pictures:
            path = self._folder / f"{self._prefix}-episode-{self._number}{self._ending}"
            write_film(path, self._pictures, float(self.env.metadata["render_fps"]))
            self._pictures = []


def check_ending(path: Path) -> None:
    """Make sure that a film can be written.

    Raises:
        FilmError: If the ending is not that of a film, or its program is missing.
    """
    if path.suffix.lower() not in FILMS:
        raise FilmError(f"{path}: a film ends in {', '.join(FILMS[:-1])} or {FILMS[-1]}")
    if path.suffix.lower() == ".mp4" and shutil.which("ffmpeg") is None:
        raise FilmError(f"{path}: .mp4 needs the program ffmpeg, which is not installed; .webp needs nothing")


def write_film(
    path: Path, pictures: Iterable[Picture], rate: float, done: Callable[[int], None] = lambda _: None
) -> None:
    """Write a film; it appears whole or not at all.

    Args:
        path: The file; its ending, one of ``FILMS``, says which kind.
        pictures: Each of shape (height, width, 3), uint8; at least one.
        rate: Pictures a second.
        done: Called with the number of pictures taken.

    Raises:
        FilmError: See `check_ending`; or if ffmpeg fails.
    """
    check_ending(path)

    def taken() -> Iterator[Picture]:
        for number, picture in enumerate(pictures, 1):
            done(number)
            yield picture

    with replacing(path) as temporary:
        if path.suffix.lower() == ".mp4":
            _by_ffmpeg(temporary, taken(), rate)
        else:
            _by_pillow(temporary, taken(), rate)


def _by_pillow(path: Path, pictures: Iterator[Picture], rate: float) -> None:
    kind = path.suffix[1:].upper()
    images = (
        Image.fromarray(one).quantize(64) if kind == "GIF" else Image.fromarray(one) for one in pictures
    )
    first = next(images)
    first.save(path, format=kind, save_all=True, append_images=images, duration=round(1000 / rate), loop=0)


def _by_ffmpeg(path: Path, pictures: Iterator[Picture], rate: float) -> None:
    first = next(pictures)
    height, width, _ = first.shape
    raw = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", f"{rate:g}", "-i", "-"]
    command = ["ffmpeg", "-y", "-loglevel", "error", *raw, "-pix_fmt", "yuv420p", str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdin is not None
        assert process.stderr is not None
        try:
            process.stdin.write(first.tobytes())
            for picture in pictures:
                process.stdin.write(picture.tobytes())
            process.stdin.close()
        except BrokenPipeError:
            pass  # it says why on its standard error
        said = process.stderr.read().decode(errors="replace").strip()
    if process.returncode:
        raise FilmError(f"ffmpeg: {said}")
