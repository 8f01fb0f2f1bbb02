"""Stock effects between a command and what the machine is driven by, in the order in which they act.

    a = g u + b;   a (1 + d/2) if a > 0, a (1 - d/2) if a < 0;   play;   dead zone;   saturation;   a jump
    T dF/dt = a - F, |dF/dt| <= r;   delay

Static effects act on the samples of a command; lag and rate limit are carried on exactly between them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fieldmodels.arrays import FloatArray, IntArray
from fieldmodels.compiled import allocation_free, compiled
from fieldmodels.compiled import allocation_free_inlined as inlined
from fieldmodels.effects.curves import on_curve
from fieldmodels.effects.stock import (
    LARGE,
    NO_LIMIT,
    Declare,
    Layout,
    Names,
    Sizes,
    Stock,
    choose,
    effect,
    late,
    signed,
)
from fieldmodels.model import Effect, Parameter


class Row(NamedTuple):
    """Numbers of an input's stock effects; the defaults switch them off."""

    gain_gain: float = 1.0
    bias_bias: float = 0.0
    asymmetry_difference: float = 0.0
    play_width: float = 0.0
    dead_zone_width: float = 0.0
    saturation_limit: float = NO_LIMIT
    parameter_step_time: float = 0.0
    parameter_step_factor: float = 1.0
    rate_limit_rate: float = NO_LIMIT
    lag_time_constant: float = 0.0
    delay_delay: float = 0.0


ROW = Layout(Row)
unpack = ROW.unpack
PHASES = 3
"""A rate limit holds, lets go, and holds the other way while a target goes along one line."""


@inlined
def is_static(r: Row) -> bool:
    """Whether an effect acts on the samples of the command."""
    return bool(
        r.gain_gain != 1.0
        or r.bias_bias != 0.0
        or r.asymmetry_difference != 0.0
        or r.play_width > 0.0
        or r.dead_zone_width > 0.0
        or r.saturation_limit < NO_LIMIT
        or r.parameter_step_factor != 1.0
    )


@inlined
def has_dynamics(r: Row) -> bool:
    """Whether the actuator follows its target with a lag or at a limited rate."""
    return bool(r.lag_time_constant > 0.0 or r.rate_limit_rate < NO_LIMIT)


@inlined
def asked(command: float, r: Row, curve: FloatArray) -> float:
    """What a command asks of the actuator, before play."""
    u = r.gain_gain * command + r.bias_bias
    if len(curve) > 0:
        u += on_curve(u, curve)
    if r.asymmetry_difference != 0.0:
        u *= 1.0 + 0.5 * r.asymmetry_difference if u > 0.0 else 1.0 - 0.5 * r.asymmetry_difference
    return float(u)


@inlined
def target(command: float, engaged: float, after: float, r: Row, curve: FloatArray) -> tuple[float, float]:
    """What the actuator aims at for a command, and what its play then transmits.

    Args:
        command: The command.
        engaged: What the play transmitted before.
        after: Share of the sampling interval after the moment of the jump.
        r: The input's row.
        curve: Row of a curve of the command, or empty.
    """
    u = asked(command, r, curve)
    if r.play_width > 0.0:
        engaged = min(max(engaged, u - 0.5 * r.play_width), u + 0.5 * r.play_width)
        u = engaged
    if r.dead_zone_width > 0.0:
        u = math.copysign(max(abs(u) - r.dead_zone_width, 0.0), u)
    if abs(u) > r.saturation_limit:
        u = math.copysign(r.saturation_limit, u)
    if r.parameter_step_factor != 1.0:
        u *= 1.0 + (r.parameter_step_factor - 1.0) * after
    return u, engaged


@inlined
def is_curved(curve: FloatArray) -> bool:
    """Whether a curve of the command is on."""
    for value in curve[2:]:  # noqa: SIM110 - compiled
        if value != 0.0:
            return True
    return False


@allocation_free
def actuate(
    command: FloatArray,
    bounds: IntArray,
    step: float,
    interpolated: bool,
    r: Row,
    curve: FloatArray,
    out: FloatArray,
) -> None:
    """What the actuator aims at on each sample of a recording.

    Args:
        command: Commands, shape (n,).
        bounds: First sample and end of every episode, or of every piece that is needed, shape (pieces, 2).
        step: Sampling interval [s].
        interpolated: Whether the target goes along lines from sample to sample, instead of being held.
        r: The input's row.
        curve: Row of a curve of the command, or empty.
        out: Receives the target, shape (n,).
    """
    ahead = 0.5 if interpolated else 1.0  # so that what follows a jump has the right area
    for piece in range(len(bounds)):
        engaged = asked(command[bounds[piece, 0]], r, curve)
        for i in range(bounds[piece, 0], bounds[piece, 1]):
            after = min(max((i + ahead) - r.parameter_step_time / step, 0.0), 1.0)
            out[i], engaged = target(command[i], engaged, after, r, curve)


@inlined
def phase(force: float, aim: float, slope: float, r: Row) -> tuple[float, float]:
    """At what rate an actuator moves if its limit holds it, else 0; and how long this lasts [s].

    Args:
        force: What it gives.
        aim: Its target.
        slope: How fast the target moves [1/s].
        r: The input's row.
    """
    if r.rate_limit_rate >= NO_LIMIT:
        return 0.0, math.inf
    gap, reach = aim - force, r.rate_limit_rate * r.lag_time_constant
    sign = math.copysign(1.0, gap if gap != 0.0 else slope)
    closing = r.rate_limit_rate - sign * slope
    beyond = abs(gap) > reach * (1.0 + 1e-12)
    if beyond or (closing < 0.0 and abs(gap) >= reach * (1.0 - 1e-12)):
        return sign * r.rate_limit_rate, (abs(gap) - reach) / closing if closing > 0.0 else math.inf
    if abs(slope) <= r.rate_limit_rate:
        return 0.0, math.inf
    trailing = slope * r.lag_time_constant  # what the lag's gap grows to, beyond its reach
    left = math.log((trailing - gap) / (trailing - math.copysign(reach, slope)))
    return 0.0, r.lag_time_constant * left


@inlined
def follow_line(force: float, begin: float, end: float, h: float, r: Row) -> float:
    """The force a time ``h`` later, for a target that goes along a line: ramps and a lag, exactly."""
    slope, aim = (end - begin) / h, begin
    for _ in range(PHASES):
        rate, lasts = phase(force, aim, slope, r)
        cut = min(lasts, h)
        behind = slope * r.lag_time_constant
        if rate != 0.0 and lasts <= h:
            force = aim + slope * cut - rate * r.lag_time_constant
        elif rate != 0.0:
            force += rate * cut
        elif r.lag_time_constant > 0.0:
            decaying = (force - aim + behind) * math.exp(-cut / r.lag_time_constant)
            force = aim + slope * cut - behind + decaying
        else:
            force = aim + slope * cut
        aim += slope * cut
        h -= cut
        if h <= 0.0:
            break
    return float(force)


@inlined
def follow(force: float, aim: float, h: float, r: Row) -> float:
    """As ``follow_line``, for a held target."""
    return follow_line(force, aim, aim, h, r)


@allocation_free
def respond(
    aims: FloatArray, bounds: IntArray, step: float, interpolated: bool, r: Row, out: FloatArray
) -> None:
    """The actuator's force along every episode, from rest at its first command.

    Args:
        aims: What the actuator aims at, shape (n,).
        bounds: First sample and end of every episode, or of every piece that is needed, shape (pieces, 2).
        step: Sampling interval [s].
        interpolated: Whether the target goes along lines from sample to sample, instead of being held.
        r: The input's row.
        out: Receives the force at the sample times, shape (n,).
    """
    for piece in range(len(bounds)):
        begin = bounds[piece, 0]
        out[begin] = aims[begin]
        for i in range(begin + 1, bounds[piece, 1]):
            if interpolated:
                out[i] = follow_line(out[i - 1], aims[i - 1], aims[i], step, r)
            else:
                out[i] = follow(out[i - 1], aims[i - 1], step, r)


PIECES = 16
"""Pieces of a sampling interval over which a force that changes is averaged."""


@inlined
def mean_over(force: float, aim: float, h: float, r: Row) -> tuple[float, float]:
    """Mean of what the actuator gives over a time ``h`` for a held target, and what it gives at its end."""
    if not has_dynamics(r):
        return aim, aim
    mean, piece = 0.0, h / PIECES
    for _ in range(PIECES):
        middle = follow(force, aim, 0.5 * piece, r)
        end = follow(middle, aim, 0.5 * piece, r)
        mean += (force + 4.0 * middle + end) / (6.0 * PIECES)
        force = end
    return mean, force


@compiled
def mean_given(command: FloatArray, bounds: IntArray, step: float, r: Row, curve: FloatArray) -> FloatArray:
    """Mean of what the actuator gives over the interval after each sample.

    Args:
        command: Commands, shape (n,).
        bounds: First sample and end of every episode, or of every piece that is needed, shape (pieces, 2).
        step: Sampling interval [s].
        r: The input's row.
        curve: Row of a curve of the command, or empty.
    """
    aims, mean, out = np.empty(len(command)), np.empty(len(command)), command.copy()
    actuate(command, bounds, step, False, r, curve, aims)
    shift = r.delay_delay / step
    whole = math.floor(shift)
    for piece in range(len(bounds)):
        first, end = bounds[piece]
        force = aims[first]
        for i in range(first, end):
            mean[i], force = mean_over(force, aims[i], step, r)
        for i in range(first, end):
            near, far = max(i - whole, first), max(i - whole - 1, first)
            out[i] = mean[near] + (shift - whole) * (mean[far] - mean[near])
    return out


@inlined
def lag_shape(z: float) -> tuple[float, float, float]:
    """Values of exp(-z s) at s = 0, 1/2, 1 for a Runge-Kutta step, with the moments that the curve has.

    Pointwise values would make the start of a step count for a sixth of it, however short the lag is. These
    give the integrals of 1, 1 - s and s^2 times the curve exactly, so that a force that decays within the
    step gives the right impulse, at the right time; for a long lag they tend to the pointwise values.
    """
    if z < 0.02:
        return 1.0, math.exp(-0.5 * z), math.exp(-z)
    kept = math.exp(-z)
    whole = -math.expm1(-z) / z
    early = (1.0 - whole) / z
    square = (2.0 * (whole - kept) / z - kept) / z
    middle = 6.0 * (whole - square - early)
    return 6.0 * early - 2.0 * middle, middle, 6.0 * square - middle


def _gain(names: Names, _: Sizes) -> Effect:
    return effect(
        "actuator_gain", "actuator", f"The actuator gives more or less {names.force} than commanded.",
        "F = g u",
        Parameter("gain", "1", 1.0, 0.05, 20.0, 0.05, starts=(0.8, 1.25)),
    )  # fmt: skip


def _bias(names: Names, s: Sizes) -> Effect:
    return effect(
        "actuator_bias", "actuator", f"The actuator gives a constant {names.force} beside what is commanded.",
        "F = u + b",
        signed("bias", names.force_unit, 0.1 * s.force),
    )  # fmt: skip


def _asymmetry(_: Names, __: Sizes) -> Effect:
    return effect(
        "actuator_asymmetry", "actuator", "The actuator is stronger in one direction than in the other.",
        "F = (1 + d/2) u for u > 0, (1 - d/2) u for u < 0",
        Parameter("difference", "1", 0.0, -1.8, 1.8, 0.05, starts=(0.1,)),
    )  # fmt: skip


def _play(names: Names, s: Sizes) -> Effect:
    starts = tuple(s.high_forces[0] * k for k in (0.05, 0.2))
    return effect(
        "actuator_play", "actuator",
        "The command acts through play: when it turns back, nothing follows until the play is crossed.",
        "F stays while |u - F| < width/2, else follows u at width/2",
        Parameter("width", names.force_unit, 0.0, 0.0, LARGE, 0.02 * s.high_forces[0], starts=starts),
    )  # fmt: skip


def _dead_zone(names: Names, s: Sizes) -> Effect:
    starts = tuple(s.high_forces[0] * k for k in (0.02, 0.1, 0.3))
    return effect(
        "actuator_dead_zone", "actuator", "Small commands have no effect.",
        "F = 0 for |u| < width, else u - width sign(u)",
        Parameter("width", names.force_unit, 0.0, 0.0, LARGE, 0.02 * s.high_forces[0], starts=starts),
    )  # fmt: skip


def _saturation(names: Names, s: Sizes) -> Effect:
    return effect(
        "actuator_saturation", "actuator", f"The actuator cannot give more than a certain {names.force}.",
        "|F| <= limit",
        Parameter(
            "limit", names.force_unit, NO_LIMIT, 1e-9, NO_LIMIT, 0.05 * s.high_forces[0],
            starts=s.high_forces,
        ),
    )  # fmt: skip


def _rate_limit(names: Names, s: Sizes) -> Effect:
    return effect(
        "actuator_rate_limit", "actuator", f"The {names.force} cannot change faster than at a certain rate.",
        "|dF/dt| <= rate",
        Parameter(
            "rate", f"{names.force_unit}/s", NO_LIMIT, 1e-9, NO_LIMIT, 0.05 * s.rate,
            starts=tuple(s.rate / k for k in (0.5, 1.5, 4.0, 10.0, 25.0)),
        ),
    )  # fmt: skip


def _lag(names: Names, s: Sizes) -> Effect:
    return effect(
        "actuator_lag", "actuator",
        f"The {names.force} follows the command with a first-order lag (motor winding, valve).",
        "T dF/dt = u - F",
        late("time_constant", s, 10.0),
    )  # fmt: skip


def _delay(_: Names, s: Sizes) -> Effect:
    return effect(
        "actuator_delay", "actuator", "The command acts late (bus, computing time).", "F(t) = u(t - T)",
        late("delay", s, 2.0),
    )  # fmt: skip


def _step(_: Names, s: Sizes) -> Effect:
    return effect(
        "parameter_step", "change",
        "The actuator's strength jumps during the record (a voltage drops, a coupling slips).",
        "F = factor u from time on",
        Parameter(
            "time", "s", 0.0, 0.0, 1e5, 0.02 * s.duration,
            starts=tuple(float(t) for t in np.linspace(0.1, 0.9, 17) * s.duration), smooth=False,
        ),
        Parameter("factor", "1", 1.0, 0.05, 20.0, 0.05, starts=(0.9,)),
    )  # fmt: skip


LIBRARY: dict[str, Declare] = {
    "gain": _gain,
    "bias": _bias,
    "asymmetry": _asymmetry,
    "play": _play,
    "lag": _lag,
    "rate_limit": _rate_limit,
    "delay": _delay,
    "saturation": _saturation,
    "dead_zone": _dead_zone,
    "parameter_step": _step,
}


def actuator(
    signal: str, only: Sequence[str] = (), without: Sequence[str] = (), prefix: str = "actuator_"
) -> tuple[Stock, ...]:
    """Stock effects of an input: all of them, or some kinds.

    Args:
        signal: Name of the input.
        only: The kinds that are wanted; by default all.
        without: Kinds that are not.
        prefix: Beginning of their names, to be chosen where a machine has several inputs.

    Raises:
        ModelError: For a kind that there is none of.
    """
    return choose(LIBRARY, "actuator", signal, only, without, prefix)
