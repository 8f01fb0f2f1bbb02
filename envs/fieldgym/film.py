"""Films of what environments draw: `.gif` and `.webp` without further packages, `.mp4` by ffmpeg."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from fieldmodels.extras import MissingExtraError, needed
from fieldmodels.files import replacing

FILMS = (".gif", ".webp", ".mp4")
"""Endings of films."""

Picture = NDArray[np.uint8]


class FilmError(ValueError):
    """A film that cannot be written."""


def check_ending(path: Path) -> None:
    """Make sure that a film can be written.

    Raises:
        FilmError: If the ending is not that of a film, or its program is missing.
    """
    if path.suffix.lower() not in FILMS:
        raise FilmError(f"{path}: a film ends in {', '.join(FILMS[:-1])} or {FILMS[-1]}")
    if path.suffix.lower() == ".mp4" and ffmpeg() is None:
        raise FilmError(
            f"{path}: .mp4 needs the program ffmpeg: pip install 'fieldgym[video]'; .webp needs nothing"
        )


def ffmpeg() -> str | None:
    """The program, of this machine or of the extra ``video``; None if there is neither."""
    if found := shutil.which("ffmpeg"):
        return found
    try:
        return str(needed("imageio_ffmpeg").get_ffmpeg_exe())
    except (MissingExtraError, RuntimeError):
        return None


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
    command = [str(ffmpeg()), "-y", "-loglevel", "error", *raw, "-pix_fmt", "yuv420p", str(path)]
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
