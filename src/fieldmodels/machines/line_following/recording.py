"""Measured walks along a line: what a robot's log and an overhead tracker would hold."""

from __future__ import annotations

from typing import Any

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.drivers.named import apply_reality, stepped
from fieldmodels.drivers.stepped import Channels
from fieldmodels.machines.line_following.model import LineFollowing
from fieldmodels.machines.line_following.parameters import Noise
from fieldmodels.machines.line_following.tracks import straight
from fieldmodels.machines.line_following.walks import CHANNELS, Scene, Walks
from fieldmodels.model import StrayedError
from fieldmodels.recording import Recording

LAW = (-0.3, 0.8, 0.2)
"""Weights a, b, c of eq (3.1) with which a recorded walk is steered."""
TRACKER = Channels(observed=("offset", "heading"))
"""What an overhead tracker measures."""
RECORDED = Channels(
    commands=CHANNELS.commands,
    observed=(*CHANNELS.observed, *TRACKER.observed),
    without="a robot steers; its line is as it is",
)
"""Where stock effects can act on a recording."""


def record_walk(
    reality: Any = None,
    strides: int = 1200,
    *,
    scene: Scene | None = None,
    excitation: float = 0.05,
    law: tuple[float, float, float] = LAW,
    tracked: bool = True,
    noise: float = 1.0,
    rng: np.random.Generator,
) -> Recording:
    """Let the robot follow a line by eq (3.1), with random turns added so that its log tells something.

    Args:
        reality: What the robot truly is: effects of the model, see ``read_reality``.
        strides: Number of strides.
        scene: What it walks on and sees with; by default a straight line that is long enough.
        excitation: Standard deviation of the added turns [rad].
        law: Weights a, b, c of eq (3.1).
        tracked: Whether an overhead tracker measures offset and heading.
        noise: Factor on the tracker's noise.
        rng: Source of noise and of the added turns.

    Raises:
        StrayedError: If the robot leaves its line.
    """
    model = LineFollowing(None if scene is None else scene.gait, None if scene is None else scene.camera)
    around, truth = apply_reality(model, reality, RECORDED)
    if scene is None:
        # a bias of the walk itself would be an effect that nobody has switched on
        scene = Scene(straight(strides * model.gait.stride + 10.0), noise=Noise(bias=0.0))
    gait = scene.gait
    own = truth.vector(around)[: len(model.names)]
    walks = Walks(1, scene, own, stepped(around, truth, CHANNELS, 1, gait.stride_time))
    walks.restart([0], [rng])
    tracker = stepped(around, truth, TRACKER, 1, gait.stride_time)
    a, b, c = law
    log: dict[str, list[float]] = {name: [] for name in ("steering", "arc", "line", "offset", "heading")}
    one = walks.walks[0]
    # differences of white noise: the added turns cancel, and the heading does not wander off
    added = excitation * np.diff(rng.standard_normal(strides + 1)) / np.sqrt(2.0)
    for stride in range(strides):
        steered = a * one["lines"][0, 1] + b * one["lines"][0, 0] + c * one["commands"][0]
        command = float(np.clip(steered + added[stride], -gait.limit, gait.limit))
        log["steering"].append(command)
        log["arc"].append(float(one["arc"]))
        log["line"].append(float(one["lines"][0, 0]))
        place = np.array([[one["offset"], one["misalignment"]]])
        if tracker is not None:
            place = tracker.shown(place)
            tracker.tick()
        for name, value in zip(TRACKER.observed, place[0], strict=True):
            log[name].append(float(value) + noise * _noise(model, name) * rng.standard_normal())
        walks.advance(np.array([command]))
        if one["lost"][0] or abs(one["offset"]) > 1.0:
            raise StrayedError(
                f"the robot left its line after {stride + 1} strides: record with a weaker effect, or with "
                "less excitation",
                stride * gait.stride_time,
            )
    signals: dict[str, FloatArray] = {name: np.array(values) for name, values in log.items()}
    signals["curvature"] = np.asarray(scene.track.curvature(signals.pop("arc")))
    if not tracked:
        del signals["offset"], signals["heading"]
    units = {signal.name: signal.unit for signal in (*model.inputs, *model.outputs)}
    return Recording(
        time=gait.stride_time * np.arange(strides, dtype=np.float64),
        signals=signals,
        units={name: units[name] for name in signals},
        source="simulation of line_following",
    )


def _noise(model: LineFollowing, name: str) -> float:
    return next(output.noise for output in model.outputs if output.name == name)
