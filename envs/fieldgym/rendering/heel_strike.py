"""The picture of the heel-strike task: the leg, its angle and the estimate's error, strike after strike."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fieldgym.rendering.canvas import Canvas, Color, Frame

BACKGROUND: Color = (250, 250, 247)
PANEL: Color = (255, 255, 255)
INK: Color = (38, 50, 64)
MUTED: Color = (122, 134, 148)
GRID: Color = (226, 230, 234)
TRUTH: Color = (38, 50, 64)
ESTIMATE: Color = (226, 98, 22)
RANGER: Color = (150, 170, 196)
SHADE: Color = (236, 239, 242)
GROUND: Color = (206, 198, 182)
REGIME: Color = (176, 112, 176)

# An error of 3 mm at the foot is half a degree: invisible unless enlarged.
MAGNIFICATION = 20.0
STRIDES_SHOWN = 40


@dataclass(frozen=True)
class Stride:
    """What one stride looked like, for drawing only.

    Attributes:
        time: Sample times since the stride began [s], shape (n,).
        angle: True leg angle [rad], shape (n,).
        estimate: Estimated leg angle [rad], shape (n,).
        error_mm: The estimator's error at the closing strike [mm].
        ranger_mm: The Ranger estimator's error there [mm].
        gains: Name, value, and lower and upper end of the range of every gain.
        regimes: Hidden noise source to whether its level is high.
    """

    time: NDArray[np.float64]
    angle: NDArray[np.float64]
    estimate: NDArray[np.float64]
    error_mm: float
    ranger_mm: float
    gains: tuple[tuple[str, float, float, float], ...]
    regimes: tuple[tuple[str, bool], ...]


def draw(strides: Sequence[Stride], number: int, total: int, step_length: float, sample: int = -1) -> Frame:
    """Draw the task.

    Args:
        strides: The latest strides, oldest first; may be empty (before the first step).
        number: Strides taken in this episode.
        total: Strides in an episode.
        step_length: Turns an angle error into a foot-height error [m].
        sample: Sample of the latest stride at which the leg is shown; -1 for its end, the strike.

    Returns:
        The frame, shape (540, 960, 3), uint8.
    """
    canvas = Canvas(BACKGROUND)
    canvas.text("Heel strike", (24, 26), INK, 18, bold=True)
    canvas.text(f"stride {number} of {total}", (396, 27), MUTED, 12, align="right")
    if strides:
        _mean_errors(canvas, strides)
    _leg(canvas, strides[-1] if strides else None, sample)
    _gains(canvas, strides[-1] if strides else None)
    _traces(canvas, strides[-3:], step_length, sample)
    _bars(canvas, strides[-STRIDES_SHOWN:])
    return canvas.frame()


def _mean_errors(canvas: Canvas, strides: Sequence[Stride]) -> None:
    own = np.mean([abs(s.error_mm) for s in strides])
    ranger = np.mean([abs(s.ranger_mm) for s in strides])
    canvas.text(f"mean error, last {len(strides)}", (432, 27), MUTED, 12)
    canvas.circle((580, 27), 5, ESTIMATE)
    canvas.text(f"this estimator {own:.2f} mm", (592, 27), INK, 12)
    canvas.circle((772, 27), 5, RANGER)
    canvas.text(f"Ranger {ranger:.2f} mm", (784, 27), INK, 12)


def _leg(canvas: Canvas, stride: Stride | None, sample: int) -> None:
    """The leg as a pendulum over the ground, its recent past, and the estimate with its error enlarged."""
    canvas.rectangle(16, 48, 392, 352, PANEL, 8)
    pivot, length, ground = (212.0, 84.0), 262.0, 352.0
    canvas.rectangle(16, ground, 392, 48, GROUND, 8)
    canvas.rectangle(16, ground, 392, 12, GROUND)
    canvas.line([(212, 76), (212, ground)], GRID, 1)

    def foot(angle: float, reach: float = length) -> tuple[float, float]:
        return pivot[0] + reach * math.sin(angle), pivot[1] + reach * math.cos(angle)

    angle, heading = 0.0, 1.0
    if stride is not None:
        now = sample if sample >= 0 else len(stride.angle) - 1
        angle = float(stride.angle[now])
        error = float(stride.estimate[now]) - angle
        shown = angle + float(np.clip(MAGNIFICATION * error, -0.6, 0.6))
        for k in np.linspace(0, now, 12).astype(int)[:-1]:
            canvas.bar(pivot, foot(float(stride.angle[k])), SHADE, 3)
        canvas.bar(pivot, foot(shown), ESTIMATE, 4)
        canvas.circle(foot(shown), 7, ESTIMATE)
        heading = math.copysign(1.0, float(stride.angle[len(stride.angle) // 2]))
    canvas.bar(pivot, foot(angle), TRUTH, 7)
    sole = [(-8.0, -5.0), (-8.0, 6.0), (22.0, 6.0), (8.0, -5.0)]
    cos, sin = math.cos(angle), math.sin(angle)
    x, y = foot(angle)
    canvas.polygon(
        [(x + heading * a * cos + b * sin, y - heading * a * sin + b * cos) for a, b in sole], TRUTH
    )
    canvas.circle(pivot, 13, TRUTH)
    canvas.circle(pivot, 5, PANEL)
    canvas.circle((34, 66), 5, TRUTH)
    canvas.text("truth", (46, 66), INK, 11)
    canvas.circle((34, 84), 5, ESTIMATE)
    canvas.text(f"estimate (error x{MAGNIFICATION:.0f})", (46, 84), INK, 11)


def _gains(canvas: Canvas, stride: Stride | None) -> None:
    """The chosen gains, on their logarithmic ranges."""
    canvas.rectangle(16, 412, 392, 112, PANEL, 8)
    if stride is None:
        canvas.text("no stride yet", (212, 468), MUTED, 12, align="center")
        return
    for row, (name, value, lower, upper) in enumerate(stride.gains):
        y = 434.0 + 34 * row
        canvas.text(name, (32, y), INK, 12)
        canvas.rectangle(160, y - 2, 160, 4, GRID, 2)
        place = math.log(value / lower) / math.log(upper / lower) if upper > lower else 0.5
        x = 160 + 160 * min(max(place, 0.0), 1.0)
        canvas.rectangle(160, y - 2, x - 160, 4, ESTIMATE, 2)
        canvas.circle((x, y), 7, ESTIMATE)
        canvas.text(f"{value:.3g}", (392, y), INK, 12, bold=True, align="right")


def _traces(canvas: Canvas, strides: Sequence[Stride], step_length: float, sample: int) -> None:
    """Angle and estimate's error along the latest strides."""
    left, width = 476.0, 452.0
    canvas.rectangle(424, 48, 520, 246, PANEL, 8)
    canvas.text("leg angle [rad]", (436, 64), MUTED, 11)
    canvas.text("error of the estimate at the foot [mm]", (436, 170), MUTED, 11)
    if not strides:
        return
    offsets = np.concatenate([[0.0], np.cumsum([s.time[-1] for s in strides])])
    total = float(offsets[-1])
    angle_limit = max(0.05, max(float(np.abs(s.angle).max()) for s in strides))
    errors = [(s.estimate - s.angle) * step_length * 1e3 for s in strides]
    error_limit = _round_up(max(0.1, max(float(np.abs(e).max()) for e in errors)))
    for middle, half, limit in ((116.0, 38.0, angle_limit), (226.0, 44.0, error_limit)):
        canvas.line([(left, middle), (left + width, middle)], GRID, 1)
        for sign in (-1, 1):
            canvas.text(f"{sign * limit:+.2g}", (left - 8, middle - sign * half), MUTED, 9, align="right")
    for i, (stride, error) in enumerate(zip(strides, errors, strict=True)):
        end = len(stride.time) if i < len(strides) - 1 or sample < 0 else sample + 1
        x = left + width * (offsets[i] + stride.time[:end]) / total
        canvas.line(list(zip(x, 116 - 38 * stride.angle[:end] / angle_limit, strict=True)), TRUTH, 2)
        canvas.line(list(zip(x, 226 - 44 * error[:end] / error_limit, strict=True)), ESTIMATE, 1.5)
        if end == len(stride.time):
            strike = left + width * offsets[i + 1] / total
            canvas.line([(strike, 74), (strike, 274)], GRID, 1)
            canvas.circle((strike, 116 - 38 * stride.angle[-1] / angle_limit), 4, TRUTH)
            canvas.circle((strike, 226 - 44 * error[-1] / error_limit), 4, ESTIMATE)
    canvas.text("heel strikes", (left + width, 284), MUTED, 9, align="right")


def _bars(canvas: Canvas, strides: Sequence[Stride]) -> None:
    """The error at every strike, and below it the hidden noise levels at the time."""
    left, width, base, height = 476.0, 452.0, 462.0, 126.0
    canvas.rectangle(424, 306, 520, 218, PANEL, 8)
    canvas.text("|strike error| [mm], latest strides", (436, 322), MUTED, 11)
    if not strides:
        return
    errors = np.abs([[s.error_mm, s.ranger_mm] for s in strides])
    # A few huge errors shall not flatten the rest: the scale follows the ninth decile.
    limit = _round_up(max(0.1, 1.2 * float(np.quantile(errors, 0.9))))
    for level in (0.0, 0.5, 1.0):
        y = base - height * level
        canvas.line([(left, y), (left + width, y)], GRID, 1)
        canvas.text(f"{limit * level:.2g}", (left - 8, y), MUTED, 9, align="right")
    pitch = width / STRIDES_SHOWN
    for i, (own, ranger) in enumerate(errors):
        x = left + pitch * i
        tall = height * min(ranger / limit, 1.04)
        canvas.rectangle(x + 1, base - tall, pitch - 2, tall, RANGER)
        tall = height * min(own / limit, 1.04)
        canvas.rectangle(x + 3, base - tall, pitch - 6, tall, ESTIMATE)
    for row, (name, _) in enumerate(strides[-1].regimes):
        y = 476.0 + 14 * row
        canvas.text(name, (left - 8, y), MUTED, 9, align="right")
        for i, stride in enumerate(strides):
            color = REGIME if stride.regimes[row][1] else GRID
            canvas.rectangle(left + pitch * i + 1, y - 4, pitch - 2, 8, color, 2)
    canvas.text("hidden noise level high", (left + width, 322), REGIME, 10, align="right")


def _round_up(value: float) -> float:
    """The next of 1, 2, 5, 10, ... above a value, so that scales do not flicker."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(step * power for step in (1.0, 2.0, 5.0, 10.0) if value <= step * power * (1 + 1e-9))
