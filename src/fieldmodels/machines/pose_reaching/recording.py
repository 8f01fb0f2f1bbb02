"""Drives as a robot would log them: commands, pose and wheel speeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.machines.pose_reaching.model import PoseReaching
from fieldmodels.machines.pose_reaching.parameters import Limits
from fieldmodels.machines.pose_reaching.unicycle import wheel_speeds
from fieldmodels.reality import Reality
from fieldmodels.recording import Recording
from fieldmodels.synthesis import synthesise

SHORTEST, LONGEST = 0.2, 1.2
"""How long a command is held [s]."""
TURNING, REST = 0.2, 0.1
"""Shares of commands that turn on the spot, and that stop."""


def random_commands(duration: float, step: float, limits: Limits, rng: np.random.Generator) -> FloatArray:
    """Speeds [m/s] and turn rates [rad/s] in random steps within a robot's limits, shape (n, 2).

    Each is held for 0.2 to 1.2 s; some turn on the spot or stop, for what shows at small speeds only.
    """
    result = np.zeros((max(2, round(duration / step)), 2))
    i = 0
    while i < len(result):
        count = max(1, round(rng.uniform(SHORTEST, LONGEST) / step))
        speed, rate = limits.max_speed * rng.uniform(), limits.max_rate * rng.uniform(-1.0, 1.0)
        kind = rng.uniform()
        if kind < TURNING + REST:
            speed = 0.0
        if kind < REST:
            rate = 0.0
        result[i : i + count] = speed, rate
        i += count
    return result


def record_drive(
    duration: float,
    rng: np.random.Generator,
    reality: Reality | Mapping[str, Any] | None = None,
    *,
    step: float = 0.05,
    episodes: int = 1,
    noise: float = 1.0,
    limits: Limits | None = None,
    model: PoseReaching | None = None,
    wheels: bool = True,
) -> Recording:
    """Record a robot that is driven by random commands on an open floor.

    Args:
        duration: Length of an episode [s]; each starts at rest at the origin.
        rng: Source of all randomness.
        reality: What differs from the nominal robot.
        step: Sampling interval [s].
        episodes: Number of episodes.
        noise: Factor on the sensors' noise.
        limits: Of the commands (default: the task's).
        model: The robot, which also says how it is commanded (default: nominal, by its motion).
        wheels: Whether the wheels' speeds are measured too.

    Returns:
        Signals of ``PoseReaching``; headings wrapped to (-pi, pi].

    Raises:
        ModelError: For an unknown reality.
    """
    model = model or PoseReaching()
    # Each episode's commands are drawn when it begins, after the noise of the one before.
    drawn = (
        _for_front(model, random_commands(duration, step, limits or Limits(), rng)) for _ in range(episodes)
    )
    return _joined(
        [synthesise(model, reality, given, step=step, rng=rng, noise=noise) for given in drawn],
        wheels,
    )


def record_commands(
    commands: FloatArray,
    rng: np.random.Generator,
    reality: Reality | Mapping[str, Any] | None = None,
    *,
    step: float = 0.05,
    episodes: int = 1,
    noise: float = 1.0,
    model: PoseReaching | None = None,
    wheels: bool = True,
) -> Recording:
    """Record a robot that is driven by given commands; arguments and result as of ``record_drive``.

    Args:
        commands: What the model is given, the same in every episode, shape (n, 2).
        rng: Source of the noise.
        reality: What differs from the nominal robot.
        step: Sampling interval [s].
        episodes: Number of episodes; each starts at rest at the origin.
        noise: Factor on the sensors' noise.
        model: The robot (default: nominal, commanded by its motion).
        wheels: Whether the wheels' speeds are measured too.
    """
    model = model or PoseReaching()
    return _joined(
        [synthesise(model, reality, commands, step=step, rng=rng, noise=noise) for _ in range(episodes)],
        wheels,
    )


def _joined(parts: Sequence[Recording], wheels: bool) -> Recording:
    """Episodes in one recording, headings wrapped."""
    names = [n for n in parts[0].signals if wheels or not n.endswith("_wheel")]
    signals = {name: np.concatenate([part[name] for part in parts]) for name in names}
    signals["heading"] = np.pi - np.mod(np.pi - signals["heading"], 2 * np.pi)
    return replace(
        parts[0],
        time=np.concatenate([part.time for part in parts]),
        signals=signals,
        units={name: parts[0].units[name] for name in names},
        episode=np.repeat(np.arange(len(parts)), [len(part) for part in parts]),
    )


def _for_front(model: PoseReaching, commands: FloatArray) -> FloatArray:
    """Speeds and turn rates as the commands that a robot takes, shape (n, 2)."""
    if not model.wheel_front:
        return commands
    given = [wheel_speeds(v, w, model.wheels.radius, model.wheels.track) for v, w in commands]
    return np.array(given)
