"""A small drawing surface: smooth shapes and text in logical pixels, and a window to show it in."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import matplotlib
import numpy as np
from numpy.typing import NDArray

from fieldmodels.extras import needed

os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")  # keeps standard output for results

pygame = needed("pygame")

Color = tuple[int, int, int]
Point = tuple[float, float]
Frame = NDArray[np.uint8]

WIDTH, HEIGHT = 960, 540
# Shapes are drawn twice as large and scaled down: pygame's thick lines are not anti-aliased.
_SCALE = 2


class Canvas:
    """A picture of ``WIDTH`` by ``HEIGHT`` logical pixels; y points down."""

    def __init__(self, background: Color) -> None:
        self._surface = pygame.Surface((WIDTH * _SCALE, HEIGHT * _SCALE))
        self._surface.fill(background)
        self._fonts: dict[tuple[int, bool], Any] = {}

    def rectangle(self, x: float, y: float, w: float, h: float, color: Color, radius: float = 0) -> None:
        """Fill a rectangle given by its top left corner and its size."""
        box = pygame.Rect(
            round(x * _SCALE), round(y * _SCALE), max(1, round(w * _SCALE)), max(1, round(h * _SCALE))
        )
        pygame.draw.rect(self._surface, color, box, border_radius=round(radius * _SCALE))

    def line(self, points: Sequence[Point], color: Color, width: float = 1.0) -> None:
        """Draw a polyline."""
        scaled = [(x * _SCALE, y * _SCALE) for x, y in points]
        if len(scaled) > 1:
            pygame.draw.lines(self._surface, color, False, scaled, max(1, round(width * _SCALE)))

    def bar(self, start: Point, end: Point, color: Color, width: float) -> None:
        """Draw a thick straight bar with round ends (pygame cuts thick lines off along an axis)."""
        dx, dy = end[0] - start[0], end[1] - start[1]
        length = math.hypot(dx, dy) or 1.0
        nx, ny = -dy / length * width / 2, dx / length * width / 2
        corners = [(start, 1), (end, 1), (end, -1), (start, -1)]
        self.polygon([(x + side * nx, y + side * ny) for (x, y), side in corners], color)
        for point in (start, end):
            self.circle(point, width / 2, color)

    def polygon(self, points: Sequence[Point], color: Color) -> None:
        """Fill a polygon."""
        pygame.draw.polygon(self._surface, color, [(x * _SCALE, y * _SCALE) for x, y in points])

    def circle(self, center: Point, radius: float, color: Color) -> None:
        """Fill a circle."""
        pygame.draw.circle(
            self._surface, color, (center[0] * _SCALE, center[1] * _SCALE), max(1.0, radius * _SCALE)
        )

    def text(
        self,
        text: str,
        position: Point,
        color: Color,
        size: int = 12,
        *,
        bold: bool = False,
        align: Literal["left", "center", "right"] = "left",
    ) -> None:
        """Write one line; ``position`` is the middle of its left end, its center or its right end."""
        image = self._font(size, bold).render(text, True, color)
        x, y = position[0] * _SCALE, position[1] * _SCALE - image.get_height() / 2
        x -= {"left": 0.0, "center": image.get_width() / 2, "right": image.get_width()}[align]
        self._surface.blit(image, (round(x), round(y)))

    def _font(self, size: int, bold: bool) -> Any:
        """DejaVu Sans as shipped with matplotlib, so that text looks the same on every machine.

        A canvas keeps its own fonts: one kept for longer is dead, and crashes Python, once another
        environment's ``close`` has called ``pygame.quit``.
        """
        if (size, bold) not in self._fonts:
            pygame.font.init()
            name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
            path = Path(matplotlib.get_data_path(), "fonts", "ttf", name)
            self._fonts[size, bold] = pygame.font.Font(str(path), size * _SCALE)
        return self._fonts[size, bold]

    def image(self, levels: NDArray[np.uint8], x: float, y: float, w: float, h: float) -> None:
        """Put an image, grey of shape (rows, columns) or colour (rows, columns, 3), into a rectangle."""
        colours = levels if levels.ndim == 3 else np.repeat(levels[:, :, None], 3, axis=2)
        picture = pygame.transform.scale(
            pygame.surfarray.make_surface(np.swapaxes(colours, 0, 1)), (round(w * _SCALE), round(h * _SCALE))
        )
        self._surface.blit(picture, (round(x * _SCALE), round(y * _SCALE)))

    def frame(self) -> Frame:
        """The picture as RGB, shape (HEIGHT, WIDTH, 3), uint8."""
        small = pygame.transform.smoothscale(self._surface, (WIDTH, HEIGHT))
        return np.ascontiguousarray(np.transpose(pygame.surfarray.array3d(small), (1, 0, 2)))


class Window:
    """A window on the screen for ``render_mode="human"``."""

    def __init__(self, title: str) -> None:
        pygame.display.init()
        self._screen = pygame.display.set_mode((WIDTH, HEIGHT))
        pygame.display.set_caption(title)
        self._clock = pygame.time.Clock()

    def show(self, frame: Frame, frames_per_second: float) -> None:
        """Show a frame, no faster than the given rate."""
        pygame.event.pump()
        self._screen.blit(pygame.surfarray.make_surface(np.transpose(frame, (1, 0, 2))), (0, 0))
        pygame.display.flip()
        self._clock.tick(frames_per_second)

    def close(self) -> None:
        """Close the window."""
        pygame.display.quit()
