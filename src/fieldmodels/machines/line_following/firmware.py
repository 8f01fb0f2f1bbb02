"""The Ranger Line Following firmware: threshold, band, centroid, lost flag, and its calibration."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fieldmodels.compiled import compiled
from fieldmodels.machines.line_following.parameters import Camera
from fieldmodels.model import ModelError

Image = NDArray[np.uint8]


def centroid(
    image: Image, first_row: int, last_row: int, threshold: float | tuple[float, ...]
) -> tuple[float, int]:
    """Mean column of the pixels below the threshold in a band of rows, and their number.

    Sections 3.3.2 and 3.4.2: a pixel of a colour image is tape if each component is below its threshold.

    Args:
        image: Grey, shape (rows, width), or colour, shape (rows, width, 3).
        first_row: First row of the band.
        last_row: Row after its last one.
        threshold: Level, or one for each component.

    Returns:
        Column, in pixels from the image's left edge (0 if there is no such pixel), and the number.
    """
    found: tuple[float, int]
    if image.ndim == 2:
        level = threshold[0] if isinstance(threshold, tuple) else threshold
        found = _grey_centroid(image, first_row, last_row, level)
    else:
        band: Image = np.any(image[first_row:last_row] >= np.asarray(threshold), axis=2).astype(np.uint8)
        found = _grey_centroid(band, 0, last_row - first_row, 1.0)
    return found


@compiled
def _grey_centroid(image: Image, first_row: int, last_row: int, threshold: float) -> tuple[float, int]:
    """As ``centroid``, of a grey image."""
    limit = np.uint8(min(max(np.ceil(threshold), 0.0), 255.0))
    count = 0
    total = 0
    for row in range(first_row, last_row):
        inside = 0
        for column in range(image.shape[1]):
            hit = image[row, column] < limit
            inside += hit
            total += column * hit
        count += inside
    return (total / count + 0.5 if count else 0.0), count


def line_position(image: Image, camera: Camera, threshold: float | tuple[float, ...]) -> tuple[float, bool]:
    """What the camera board sends: the line's sideways place at the look-ahead distance, or the lost flag.

    Image and threshold are those of ``centroid``.

    Returns:
        Place [m], left positive, and whether the line is found (else the place is 0).
    """
    column, count = centroid(image, camera.first_row, camera.last_row, threshold)
    if count < camera.least_pixels:
        return 0.0, False
    return (camera.width / 2.0 - column) * camera.metres_per_pixel, True


def calibrate(images: Sequence[Image], tape: Sequence[NDArray[np.bool_]], share: float = 0.01) -> float:
    """Choose the threshold from photos of the tape in several lights, by histograms (section 3.4.2).

    Args:
        images: Photos, uint8.
        tape: For each photo, which pixels are tape.
        share: Share of pixels that may be outliers on either side.

    Returns:
        The level in the middle between the brightest tape and the darkest floor of all photos.

    Raises:
        ModelError: If in these lights no level separates tape from floor.
    """
    brightest = max(
        float(np.quantile(image[mask], 1.0 - share)) for image, mask in zip(images, tape, strict=True)
    )
    darkest = min(float(np.quantile(image[~mask], share)) for image, mask in zip(images, tape, strict=True))
    if brightest >= darkest:
        raise ModelError(
            f"no threshold separates tape (up to {brightest:.0f}) from floor (down to {darkest:.0f}) in all "
            "of these photos: leave out the darkest light, or use a darker or wider tape"
        )
    return 0.5 * (brightest + darkest)
