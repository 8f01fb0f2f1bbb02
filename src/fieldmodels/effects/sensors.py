"""Stock effects between what a machine does and what a sensor measures of it, in the order in which they act.

y(t) = true(t - delay),   T dy/dt = true - y
measured = g y + b2 y |y| + E_s sin(2 pi y/p) + E_c cos(2 pi y/p) + bias + rate t + play
clipped;   quantised
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import allocation_free_inlined as inlined
from fieldmodels.compiled import compiled
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
    positive,
    signed,
    span,
)
from fieldmodels.elementary import hyperbolic_tangent
from fieldmodels.model import Effect, Parameter


class Row(NamedTuple):
    """Numbers of an output's stock effects; the defaults switch them off."""

    bias_bias: float = 0.0
    drift_rate: float = 0.0
    gain_gain: float = 1.0
    bend_curvature: float = 0.0
    eccentricity_sine: float = 0.0
    eccentricity_cosine: float = 0.0
    eccentricity_period: float = 1.0
    lag_time_constant: float = 0.0
    delay_delay: float = 0.0
    backlash_gap: float = 0.0
    clipping_limit: float = NO_LIMIT
    quantisation_step: float = 0.0


ROW = Layout(Row)
unpack = ROW.unpack

ITERATIONS = 20
"""Newton's steps by which a bent sensor is inverted."""


@inlined
def is_linear(r: Row) -> bool:
    """Whether a sensor shows a straight line of the true value."""
    return bool(r.bend_curvature == 0.0 and r.eccentricity_sine == 0.0 and r.eccentricity_cosine == 0.0)


@inlined
def is_straight(r: Row) -> bool:
    """Whether a sensor only has a gain, a bias and a drift."""
    return bool(
        is_linear(r) and r.backlash_gap == 0.0 and r.clipping_limit >= NO_LIMIT and r.quantisation_step == 0.0
    )


@inlined
def straight(true: float, time: float, r: Row) -> float:
    """As ``measured``, of a straight sensor."""
    return r.gain_gain * true + r.bias_bias + r.drift_rate * time


@inlined
def measured(true: float, time: float, play: float, r: Row) -> float:
    """What the sensor shows without noise.

    Args:
        true: What it senses, late if it is late.
        time: On the recording's clock [s].
        play: Displacement by backlash (see ``play``).
        r: The output's row.
    """
    value = r.gain_gain * true + r.bias_bias + r.drift_rate * time + play
    if not is_linear(r):
        phase = 2.0 * math.pi * true / r.eccentricity_period
        value += (
            r.bend_curvature * true * abs(true)
            + r.eccentricity_sine * math.sin(phase)
            + r.eccentricity_cosine * math.cos(phase)
        )
    if abs(value) > r.clipping_limit:
        value = math.copysign(r.clipping_limit, value)
    if r.quantisation_step > 0.0:
        value = r.quantisation_step * math.floor(value / r.quantisation_step + 0.5)
    return float(value)


@compiled
def measure(values: FloatArray, times: FloatArray, r: Row, curve: FloatArray) -> FloatArray:
    """What a sensor shows of true values.

    Args:
        values: Shape (batch, windows, samples).
        times: Shape (windows, samples) [s].
        r: The output's row.
        curve: Row of a curve of the true value, or empty.
    """
    out: FloatArray = np.empty_like(values)
    for p in range(values.shape[0]):
        for w in range(values.shape[1]):
            for k in range(values.shape[2]):
                true = values[p, w, k]
                if len(curve) > 0:
                    true += on_curve(true, curve)
                out[p, w, k] = measured(true, times[w, k], 0.0, r)
    return out


@inlined
def slope(true: float, r: Row) -> float:
    """How the measured value grows with the true one."""
    value = r.gain_gain
    if not is_linear(r):
        wave = 2.0 * math.pi / r.eccentricity_period
        value += 2.0 * r.bend_curvature * abs(true)
        value += wave * (
            r.eccentricity_sine * math.cos(wave * true) - r.eccentricity_cosine * math.sin(wave * true)
        )
    return float(value)


@inlined
def inverted(value: float, time: float, play: float, r: Row) -> float:
    """The true value behind a measured one; a clipped or quantised value is taken as it is."""
    linear = value - r.bias_bias - r.drift_rate * time - play
    true = linear / r.gain_gain
    if not is_linear(r):
        for _ in range(ITERATIONS):
            phase = 2.0 * math.pi * true / r.eccentricity_period
            bent = (
                r.bend_curvature * true * abs(true)
                + r.eccentricity_sine * math.sin(phase)
                + r.eccentricity_cosine * math.cos(phase)
            )
            steep = slope(true, r)
            if abs(steep) < 0.1 * abs(r.gain_gain):
                break  # a sensor that shows several values alike
            true -= (r.gain_gain * true + bent - linear) / steep
    return float(true)


@inlined
def play(force: float, scale: float, r: Row) -> float:
    """Displacement of a motor's sensor against the load: the force pushes one flank or the other."""
    return float(0.5 * r.backlash_gap * hyperbolic_tangent(force / scale)) if r.backlash_gap != 0.0 else 0.0


@inlined
def filtered(value: float, begin: float, end: float, h: float, time_constant: float) -> float:
    """A first-order lag's output a time ``h`` later, as its input goes along a line."""
    behind = (end - begin) / h * time_constant
    return float(end - behind + (value - begin + behind) * math.exp(-h / time_constant))


def _bias(n: Names, s: Sizes) -> Effect:
    return effect(
        "sensor_bias", "sensor", f"The {n.position} sensor shows a constant too much.",
        f"{n.position} shown = {n.position} + bias",
        signed("bias", n.position_unit, 0.05 * s.position),
    )  # fmt: skip


def _drift(n: Names, s: Sizes) -> Effect:
    return effect(
        "sensor_drift", "sensor", f"The {n.position} sensor drifts steadily.",
        f"{n.position} shown = {n.position} + rate t",
        signed("rate", f"{n.position_unit}/s", 0.1 * s.position / s.duration),
    )  # fmt: skip


def _gain(n: Names, _: Sizes) -> Effect:
    return effect(
        "sensor_gain", "sensor", f"The {n.position} sensor shows too much or too little in proportion.",
        f"{n.position} shown = gain {n.position}",
        Parameter("gain", "1", 1.0, 0.05, 20.0, 0.05, starts=(0.9, 1.1)),
    )  # fmt: skip


def _bend(n: Names, s: Sizes) -> Effect:
    return effect(
        "sensor_bend", "sensor", f"The {n.position} sensor bends: it shows large values out of proportion.",
        f"{n.position} shown = y + curvature y |y|",
        signed("curvature", f"1/({n.position_unit})", 0.1 / s.position),
    )  # fmt: skip


def _eccentricity(n: Names, s: Sizes) -> Effect:
    return effect(
        "sensor_eccentricity", "sensor",
        f"The {n.position} sensor errs by a wave along its range, as of a disc off its centre.",
        f"{n.position} shown = y + E_s sin(2 pi y/p) + E_c cos(2 pi y/p)",
        signed("sine", n.position_unit, 0.05 * s.position),
        signed("cosine", n.position_unit, 0.05 * s.position),
        span("period", n.position_unit, 4.0 * s.position, 1.0, 0.5, 0.25, 0.125, sizes=s),
    )  # fmt: skip


def _lag(n: Names, s: Sizes) -> Effect:
    return effect(
        "sensor_lag", "sensor", f"The {n.position} sensor follows with a first-order lag (filter).",
        f"T d(shown)/dt = {n.position} - shown",
        late("time_constant", s, 10.0),
    )  # fmt: skip


def _delay(n: Names, s: Sizes) -> Effect:
    return effect(
        "sensor_delay", "sensor", f"The {n.position} is shown late (filter, bus).",
        f"{n.position} shown (t) = {n.position}(t - T)",
        late("delay", s, 2.0),
    )  # fmt: skip


def _backlash(n: Names, s: Sizes) -> Effect:
    return effect(
        "backlash", "force",
        "Play between motor and load: the sensor sits on the motor, which rests on one flank or the "
        f"other as the {n.force} pushes.",
        "x shown = x + gap/2 sign(F), smoothed over 2 % of the largest command",
        positive("gap", n.position_unit, 0.05 * s.position),
    )  # fmt: skip


def _clipping(n: Names, s: Sizes) -> Effect:
    starts = tuple(s.position * k for k in (2.0, 1.5, 1.0))
    return effect(
        "sensor_clipping", "sensor", f"The {n.position} sensor shows nothing beyond a certain value.",
        "|shown| <= limit",
        Parameter(
            "limit", n.position_unit, NO_LIMIT, 1e-9, NO_LIMIT, 0.05 * s.position, starts=starts
        ),
    )  # fmt: skip


def _quantisation(n: Names, s: Sizes) -> Effect:
    return effect(
        "sensor_quantisation", "sensor", f"The {n.position} sensor shows multiples of a coarse step.",
        "shown = step round(shown / step)",
        Parameter(
            "step", n.position_unit, 0.0, 0.0, LARGE, 0.01 * s.position,
            starts=tuple(s.position * k for k in (0.01, 0.03, 0.1)), smooth=False,
        ),
    )  # fmt: skip


LIBRARY: dict[str, Declare] = {
    "bias": _bias,
    "drift": _drift,
    "gain": _gain,
    "bend": _bend,
    "eccentricity": _eccentricity,
    "lag": _lag,
    "delay": _delay,
    "backlash": _backlash,
    "clipping": _clipping,
    "quantisation": _quantisation,
}


def sensor(
    signal: str, only: Sequence[str] = (), without: Sequence[str] = (), prefix: str = "sensor_"
) -> tuple[Stock, ...]:
    """Stock effects of an output: all of them but backlash, or some kinds.

    Args:
        signal: Name of the output.
        only: The kinds that are wanted; by default all but backlash, which is of a motor's own sensor.
        without: Kinds that are not.
        prefix: Beginning of their names, to be chosen where a machine has several outputs.

    Raises:
        ModelError: For a kind that there is none of.
    """
    kinds = only or tuple(kind for kind in LIBRARY if kind != "backlash")
    return choose(LIBRARY, "sensor", signal, kinds, without, prefix)
