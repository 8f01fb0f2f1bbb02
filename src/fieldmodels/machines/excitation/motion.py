"""The arm's motion: one sinusoid that passes smoothly from command to command, within an acceleration.

A command is amplitude a [rad], frequency w [rad/s] and offset a0 [rad] of f = a0 + a sin(phi), phi' = w,
the source's f(t) = a0 + a sin(w t). Each decision lasts 0.4 s, in which all three pass from the previous
command to the next along the quintic 10 s^3 - 15 s^4 + 6 s^5: f, f' and f'' are continuous, and an
unchanging command gives eq (24) itself. The source says nothing of how commands join: with an angle that
jumps, or an acceleration without bound, an excitation would be judged by its seams.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import allocation_free_inlined, compiled, inlined
from fieldmodels.machines.excitation.vectors import copy_to
from fieldmodels.model import ModelError

AMPLITUDE, FREQUENCY, OFFSET = range(3)
CONSTANT = np.array([2.0 * math.pi / 9.0, math.pi / 2.0, math.pi / 4.0])
"""The source's constant excitation, eq (24); every run starts in it, at phase 0."""
DECISION = 0.4
"""Time between two commands [s] (section VII-A)."""
STEADY_SHARE = 0.9
"""Share of the acceleration that a steady sinusoid may use; an arm that used all of it could not change."""
CHECKED = 80
HALVINGS = 12


@inlined
def motion_at(
    a: float, w: float, a0: float, phase: float, da: float, dw: float, da0: float, time: float
) -> tuple[float, float, float]:
    """Angle, speed and acceleration at a time into a decision that changes (a, w, a0) by (da, dw, da0)."""
    s = time / DECISION
    blend = s * s * s * (10.0 + s * (6.0 * s - 15.0))
    blend1 = 30.0 * s * s * (1.0 - s) * (1.0 - s) / DECISION
    blend2 = 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / (DECISION * DECISION)
    integral = DECISION * s * s * s * s * (2.5 + s * (s - 3.0))
    amplitude = a + da * blend
    frequency = w + dw * blend
    angle = phase + w * time + dw * integral
    sine, cosine = math.sin(angle), math.cos(angle)
    f = a0 + da0 * blend + amplitude * sine
    f1 = (da0 + da * sine) * blend1 + amplitude * frequency * cosine
    f2 = (
        (da0 + da * sine) * blend2
        + (2.0 * da * frequency + amplitude * dw) * blend1 * cosine
        - amplitude * frequency * frequency * sine
    )
    return f, f1, f2


@allocation_free_inlined
def phase_after(phase: float, previous: FloatArray, following: FloatArray) -> float:
    """Phase at the end of a decision [rad], in [0, 2 pi)."""
    turn: float = DECISION * 0.5 * (previous[FREQUENCY] + following[FREQUENCY])
    return (phase + turn) % (2.0 * math.pi)


@allocation_free_inlined
def keeps_within(previous: FloatArray, phase: float, following: FloatArray, acceleration: float) -> bool:
    """Whether |f''| is within an acceleration [rad/s2] at each sample of a decision."""
    da = following[AMPLITUDE] - previous[AMPLITUDE]
    dw = following[FREQUENCY] - previous[FREQUENCY]
    da0 = following[OFFSET] - previous[OFFSET]
    for i in range(1, CHECKED + 1):
        _, _, f2 = motion_at(
            previous[AMPLITUDE], previous[FREQUENCY], previous[OFFSET], phase, da, dw, da0,
            i * (DECISION / CHECKED),
        )  # fmt: skip
        if abs(f2) > acceleration:
            return False
    return True


@allocation_free_inlined
def towards(
    previous: FloatArray, wanted: FloatArray, share: float, acceleration: float, out: FloatArray
) -> None:
    """Go a share of the way from one command to another, at an amplitude that can be kept up."""
    for k in range(3):
        out[k] = previous[k] + share * (wanted[k] - previous[k])
    square = out[FREQUENCY] * out[FREQUENCY]
    if out[AMPLITUDE] * square > STEADY_SHARE * acceleration:
        out[AMPLITUDE] = STEADY_SHARE * acceleration / square


@allocation_free_inlined
def attainable(
    previous: FloatArray, phase: float, wanted: FloatArray, acceleration: float, out: FloatArray
) -> None:
    """The command nearest to the wanted one, on the way to it, that the arm's acceleration allows.

    Args:
        previous: Command in force, shape (3,); its own acceleration is within the limit.
        phase: Phase at the beginning of the decision [rad].
        wanted: Command that the agent wants, shape (3,).
        acceleration: Largest |f''| [rad/s2], met at each 5 ms sample (between samples within 0.3 %).
        out: Receives the command, shape (3,).
    """
    towards(previous, wanted, 1.0, acceleration, out)
    if keeps_within(previous, phase, out, acceleration):
        return
    possible, impossible = 0.0, 1.0
    for _ in range(HALVINGS):
        share = 0.5 * (possible + impossible)
        towards(previous, wanted, share, acceleration, out)
        if keeps_within(previous, phase, out, acceleration):
            possible = share
        else:
            impossible = share
    if possible > 0.0:
        towards(previous, wanted, possible, acceleration, out)
    else:
        copy_to(out, previous)


@allocation_free_inlined
def fill_motion(previous: FloatArray, phase: float, following: FloatArray, out: FloatArray) -> None:
    """Angle, speed and acceleration over a decision.

    Args:
        previous: Command in force, shape (3,).
        phase: Phase at the beginning [rad].
        following: Command at the end, attainable, shape (3,).
        out: Receives f [rad], f' [rad/s], f'' [rad/s2] at n + 1 equally spaced times from the beginning
            to the end of the decision, both included, shape (n + 1, 3).
    """
    da = following[AMPLITUDE] - previous[AMPLITUDE]
    dw = following[FREQUENCY] - previous[FREQUENCY]
    da0 = following[OFFSET] - previous[OFFSET]
    count = len(out) - 1
    for i in range(count + 1):
        out[i, 0], out[i, 1], out[i, 2] = motion_at(
            previous[AMPLITUDE], previous[FREQUENCY], previous[OFFSET], phase, da, dw, da0,
            i * (DECISION / count),
        )  # fmt: skip


@allocation_free_inlined
def lag_motion(commanded: FloatArray, step: float, time_constant: float, lagged: FloatArray) -> None:
    """First-order lag of f, f' and f'' alike, exact for commands that are linear over a step.

    Args:
        commanded: Commanded motion, shape (n, 3).
        step: Time between its rows [s].
        time_constant: Lag [s], positive.
        lagged: The arm's motion, shape (n, 3): its first row as it is at the beginning; receives the others.
    """
    ratio = time_constant / step
    kept = math.exp(-1.0 / ratio)
    late = 1.0 - (1.0 - kept) * ratio
    early = (1.0 - kept) * ratio - kept
    for i in range(1, len(commanded)):
        for k in range(3):
            lagged[i, k] = kept * lagged[i - 1, k] + early * commanded[i - 1, k] + late * commanded[i, k]


@compiled
def _schedule(
    commands: FloatArray,
    start: FloatArray,
    phase: float,
    acceleration: float,
    attained: FloatArray,
    out: FloatArray,
) -> None:
    previous = start
    per_decision = (len(out) - 1) // len(commands)
    for k in range(len(commands)):
        attainable(previous, phase, commands[k], acceleration, attained[k])
        part = out[k * per_decision : (k + 1) * per_decision + 1]
        fill_motion(previous, phase, attained[k], part)
        phase = phase_after(phase, previous, attained[k])
        previous = attained[k]


def arm_motion(
    commands: ArrayLike,
    acceleration: float,
    *,
    start: ArrayLike = CONSTANT,
    phase: float = 0.0,
    per_decision: int = 80,
) -> tuple[FloatArray, FloatArray]:
    """The arm's motion under a schedule of commands.

    Args:
        commands: Wanted amplitude [rad], frequency [rad/s] and offset [rad] of each decision, shape (n, 3).
        acceleration: Largest |f''| [rad/s2].
        start: Command in force before the first decision, shape (3,).
        phase: Phase at the beginning [rad].
        per_decision: Samples a decision of 0.4 s.

    Returns:
        Motion: f [rad], f' [rad/s], f'' [rad/s2] from the beginning to the end, shape
        (n * per_decision + 1, 3); and the commands that the acceleration allowed, shape (n, 3).

    Raises:
        ModelError: If a shape is wrong, a number not finite, an amplitude or frequency negative, or the
            start itself beyond the acceleration.
    """
    wanted = np.ascontiguousarray(commands, dtype=np.float64)
    first = np.array(start, dtype=np.float64)
    if wanted.ndim != 2 or wanted.shape[1] != 3 or len(wanted) == 0 or first.shape != (3,):
        raise ModelError(
            f"commands must have shape (n, 3) and a start (3,), not {wanted.shape}, {first.shape}"
        )
    if not (np.isfinite(wanted).all() and (wanted[:, :2] >= 0).all() and (first[:2] >= 0).all()):
        raise ModelError("commands must be finite, their amplitudes and frequencies not negative")
    if not first[AMPLITUDE] * first[FREQUENCY] ** 2 <= STEADY_SHARE * acceleration * (1 + 1e-9):
        raise ModelError(
            f"an arm of {acceleration} rad/s2 keeps up sinusoids of {STEADY_SHARE} of that, not {first}"
        )
    attained = np.empty_like(wanted)
    motion = np.empty((len(wanted) * per_decision + 1, 3))
    _schedule(wanted, first, phase, acceleration, attained, motion)
    return motion, attained
