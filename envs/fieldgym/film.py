"""Films of what environments draw: `.gif` and `.webp` without further packages, `.mp4` by ffmpeg."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from fieldmodels.extras import needed
from fieldmodels.files import replacing

FILMS = (".gif", ".webp", ".mp4")
"""Endings of films."""

Picture = NDArray[np.uint8]


class FilmError(ValueError):
    """A film that cannot be written."""


def check_ending(path: Path) -> None:
    """Make sure that a film can be written.

    Raises:
        FilmError: If the ending is not that of a film.
        MissingExtraError: If its package is missing.
    """
    if path.suffix.lower() not in FILMS:
        raise FilmError(f"{path}: a film ends in {', '.join(FILMS[:-1])} or {FILMS[-1]}")
    if path.suffix.lower() == ".mp4":
        needed("imageio_ffmpeg")


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
    film = needed("imageio_ffmpeg").write_frames(path, first.shape[1::-1], fps=rate, macro_block_size=2)
    try:
        film.send(None)
        for picture in chain([first], pictures):
            film.send(np.ascontiguousarray(picture))
    except OSError:
        pass  # it says why on standard error
    finally:
        film.close()
    if not path.stat().st_size:
        raise FilmError("ffmpeg has written nothing; what it says is above")
