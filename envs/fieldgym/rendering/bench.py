"""A machine that follows a reference, as a picture."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fieldgym.rendering.canvas import HEIGHT, WIDTH, Canvas, Frame

PAPER, INK, GREY, RED = (250, 250, 248), (40, 40, 44), (170, 170, 170), (200, 60, 40)
MARGIN = 40.0


def draw(title: str, reference: NDArray[np.float64], tick: int, value: float, reach: float) -> Frame:
    """Draw the whole reference and where the output is now.

    Args:
        title: Name and unit of the output.
        reference: Shape (n,).
        tick: The present step.
        value: The output now.
        reach: Largest reference, half the picture's height.
    """
    canvas = Canvas(PAPER)
    across = (WIDTH - 2 * MARGIN) / max(len(reference) - 1, 1)
    half = HEIGHT / 2 - 2 * MARGIN

    def at(k: int, y: float) -> tuple[float, float]:
        shown = min(max(y / reach, -1.2), 1.2) if np.isfinite(y) else 1.2
        return MARGIN + k * across, HEIGHT / 2 - half * shown

    canvas.line([at(0, 0.0), at(len(reference) - 1, 0.0)], GREY)
    canvas.line([at(k, float(y)) for k, y in enumerate(reference)], INK, 1.5)
    canvas.line([at(tick, float(reference[min(tick, len(reference) - 1)])), at(tick, value)], RED, 2.0)
    canvas.circle(at(tick, value), 6.0, RED)
    canvas.text(title, (MARGIN, MARGIN), INK, 16, bold=True)
    return canvas.frame()
