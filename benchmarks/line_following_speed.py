"""Speed of line following: strides of every plant and frames of the camera, as ratios within one run.

python benchmarks/line_following_speed.py
"""

from __future__ import annotations

import time
from collections.abc import Callable

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from steppers import scalar

import fieldgym  # noqa: F401 - registers the environments
from fieldmodels.machines.line_following.body import Body
from fieldmodels.machines.line_following.firmware import line_position
from fieldmodels.machines.line_following.parameters import Camera
from fieldmodels.machines.line_following.renderer import Renderer, make_view
from fieldmodels.machines.line_following.tracks import oval
from fieldmodels.machines.line_following.walks import Scene, Walks

BATCH = 1024
SECONDS = 2.0


def rate(step: Callable[[], object], per_call: int) -> float:
    """Steps a second of processor time; the first call (which may compile) is not timed."""
    step()
    calls, start = 0, time.process_time()
    while time.process_time() - start < SECONDS:
        step()
        calls += 1
    return calls * per_call / (time.process_time() - start)


def show(title: str, rates: dict[str, float]) -> None:
    """Print a table; ratios are to its last row."""
    base = list(rates.values())[-1]
    print(f"{title:52s}{'a second':>14s}{'ratio':>10s}")
    for name, value in rates.items():
        print(f"{name:52s}{value:14,.0f}{value / base:10.1f}")


def strides() -> None:
    """Strides a second with geometry, images, rigid bodies."""
    forever = {"strides": 100_000, "lost_offset": 1e9, "lost_strides": 100_000}
    walks = Walks(BATCH, Scene(oval()))
    walks.restart(range(BATCH), [np.random.default_rng(i) for i in range(BATCH)])
    commands, actions = np.zeros(BATCH), np.zeros((BATCH, 1), np.float32)
    native = gym.make_vec("fieldgym/LineFollowing-v1", num_envs=BATCH, settings=forever)
    pixels = gym.make_vec("fieldgym/LineFollowingPixels-v1", num_envs=16, settings=forever)
    single = scalar("fieldgym/LineFollowing-v1", settings=forever)
    body = Body()
    for env in (native, pixels):
        env.reset(seed=0)
    show(
        "strides",
        {
            f"kinematic walk with its sensor, {BATCH} walks": rate(lambda: walks.advance(commands), BATCH),
            f"native vector environment, {BATCH} copies": rate(lambda: native.step(actions), BATCH),
            "native vector environment on images, 16 copies": rate(lambda: pixels.step(actions[:16]), 16),
            "single environment": rate(lambda: single(0), 1),
            "rigid bodies (pymunk) alone": rate(lambda: body.stride(0.0), 1),
        },
    )


def plain_frame(
    camera: Camera, x: float, y: float, heading: float, track: NDArray[np.float64]
) -> NDArray[np.uint8]:
    """The same view with plain NumPy: each pixel's place on the floor, its distance from the line."""
    row, column = np.mgrid[0 : camera.rows, 0 : camera.width] + 0.5
    slope = (row - camera.rows / 2) / camera.focal
    depth = camera.height / (np.sin(camera.pitch) + slope * np.cos(camera.pitch))
    ahead = depth * (np.cos(camera.pitch) - slope * np.sin(camera.pitch))
    beside = (camera.width / 2 - column) / camera.focal * depth
    places = np.stack(
        [
            x + ahead * np.cos(heading) - beside * np.sin(heading),
            y + ahead * np.sin(heading) + beside * np.cos(heading),
        ],
        axis=-1,
    )
    near = track[np.hypot(track[:, 0] - x, track[:, 1] - y) < 4.0]
    away = np.hypot(*np.moveaxis(places[:, :, None, :] - near, -1, 0)).min(axis=2)
    return np.where(away < 0.0254, 35, 165).astype(np.uint8)


def frames() -> None:
    """Rendered frames with centroid a second."""
    camera, track = Camera(), oval()
    renderer, image = Renderer(track, camera, make_view(camera)), np.empty((120, 160), dtype=np.uint8)

    def compiled() -> None:
        renderer.image((2.0, 0.1, 0.05), 2.0, 1, image)
        line_position(image, camera, 90.0)

    def plain() -> None:
        line_position(plain_frame(camera, 2.0, 0.1, 0.05, track.points), camera, 90.0)

    show(
        "frames with centroid", {"compiled, with light and noise": rate(compiled, 1), "NumPy": rate(plain, 1)}
    )


def main() -> None:
    """Print both tables."""
    strides()
    print()
    frames()


if __name__ == "__main__":
    main()
