"""Recordings of the experiment in a hidden reality: what a vehicle would log while its arm shakes it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.drivers.around import Surrounded
from fieldmodels.drivers.followed import Followed
from fieldmodels.drivers.named import apply_reality
from fieldmodels.drivers.stepped import Channels
from fieldmodels.machines.excitation.model import ExcitationModel, joined_runs
from fieldmodels.machines.excitation.motion import DECISION, arm_motion
from fieldmodels.machines.excitation.parameters import DURATION, LIMITS, MODES, Limits
from fieldmodels.reality import Reality
from fieldmodels.recording import Recording
from fieldmodels.synthesis import Noise, synthesise

RECORDED = Channels(
    commands=("arm_angle",),
    observed=tuple(s.name for s in ExcitationModel.outputs),
    without="the arm turns about one axis a run",
)
"""Where stock effects can act on a recording."""


def shaking(
    duration: float, step: float, rng: np.random.Generator, limits: Limits | None = None
) -> FloatArray:
    """An arm's angle [rad] under random sinusoids, one each 0.4 s, from rest; shape (duration / step,)."""
    limits = limits or LIMITS["wide"]
    count = math.ceil(duration / DECISION)
    commands = np.column_stack(
        [
            rng.uniform(0.2 * limits.amplitude, limits.amplitude, count),
            rng.uniform(*limits.frequency, count),
            rng.uniform(*limits.offset, count),
        ]
    )
    start = (0.0, limits.frequency[0], rng.uniform(*limits.offset))
    per_decision = round(DECISION / step)
    motion, _ = arm_motion(commands, limits.acceleration, start=start, per_decision=per_decision)
    return np.asarray(motion[: round(duration / step), 0])


def record_experiment(
    rng: np.random.Generator,
    reality: Reality | Mapping[str, Any] | None = None,
    *,
    duration: float = DURATION,
    step: float = 0.01,
    repeats: int = 1,
    noise: Noise = True,
    limits: Limits | None = None,
    model: ExcitationModel | None = None,
) -> Recording:
    """Record runs of all three modes, each with random sinusoids of its own.

    Args:
        rng: Source of all randomness.
        reality: What differs from the nominal simulation.
        duration: Length of a run [s].
        step: Sampling interval [s]; 0.4 s must be a multiple.
        repeats: Times that each mode is run.
        noise: As of ``synthesise``.
        limits: What the arm may do (default: ``wide``).
        model: The nominal vehicle (default: ``soft``).

    Returns:
        One episode a run, with the columns of ``ExcitationModel``.
    """
    model = model or ExcitationModel()
    around, _ = apply_reality(model, reality)
    around = around.inner if isinstance(around, Followed) else around
    if isinstance(around, Surrounded):
        RECORDED.check(model.name, around.stock)
    runs = []
    for k in range(repeats * MODES):
        angle = shaking(duration, step, rng, limits)
        commands = {"arm_angle": angle, "arm_axis": np.full(len(angle), float(k % MODES + 1))}
        runs.append(synthesise(model, reality, commands, step=step, rng=rng, noise=noise))
    return joined_runs(runs, f"simulation of {model.name}")
