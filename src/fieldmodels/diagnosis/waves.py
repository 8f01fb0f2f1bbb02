"""Waves that may be missing: hum over time, eccentric gears and wheels over the way, ripple over commands."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.result import WAVE
from fieldmodels.diagnosis.shapes import Curve, Place, Signals, wave
from fieldmodels.drivers.variables import SHARE, WAY
from fieldmodels.model import Model

CYCLES = 600.0  # of a wave over the whole range of its variable, at most
TRIED = 64  # waves at a time, which bounds memory
POINTS = 16  # of a cycle, where its table is given

Power = Callable[[Curve, int], FloatArray]


def strongest(place: Curve, power: Power) -> Curve | None:
    """The strongest wave at a place; None if its variable is too fast for any.

    Args:
        place: Where, over what; its values from zero to one in place of columns, see ``places``.
        power: What each of some waves, given as the columns of one curve, two a wave, explains.
    """
    # Faster waves are lost in the averages over a segment.
    x, span = place.values, float(place.knots[1] - place.knots[0])
    passed = float(np.median(np.abs(np.diff(x, axis=1)))) + 1e-9
    counts = np.arange(2.0, min(0.5 / passed, CYCLES), 0.5)
    if not len(counts):
        return None
    powers = []
    for some in np.array_split(counts, -(-len(counts) // TRIED)):
        powers.append(power(replace(place, values=_waves(x, some)), len(some)))
    count = float(counts[np.argmax(np.concatenate(powers))])
    points = np.linspace(0.0, 1.0, POINTS * int(np.ceil(count)) + 1)
    return replace(
        place,
        values=wave(x, count),
        knots=place.knots[0] + span * points,
        shapes=wave(points, count),
        formula=f"{WAVE} {span / count:.3g} {place.over_unit}",
        tried=len(counts),
    )


def _waves(x: FloatArray, counts: FloatArray) -> FloatArray:
    """Cosine and sine of evenly spaced numbers of cycles, by recurrence: sines would take twice as long."""
    turns = np.empty((*x.shape, len(counts)), dtype=np.complex128)
    turns[..., 0] = np.exp(2j * np.pi * counts[0] * x)
    turns[..., 1:] = np.exp(2j * np.pi * (counts[1] - counts[0]) * x)[..., None] if len(counts) > 1 else 0.0
    return np.multiply.accumulate(turns, axis=-1).view(np.float64)


def places(
    model: Model, signals: Signals, shown: Mapping[str, object], averaged: Callable[[str], FloatArray]
) -> Iterator[Curve]:
    """Where there may be waves, and over what: the variable from zero to one in place of columns.

    Args:
        model: The machine.
        signals: Variables, their units and values on the segments of every window.
        shown: Measured outputs.
        averaged: Any other variable of what a machine is told, on the segments.
    """
    outputs = {s.name: s.unit for s in model.outputs}
    inputs = {s.name for s in model.inputs} | {s.name for s in model.sums}

    def over_range(at: Place, target: str, unit: str, over: str, over_unit: str, x: FloatArray) -> Curve:
        ends = np.array([x.min(), x.max()])
        return Curve(at, target, over, over_unit, unit, (x - ends[0]) / np.ptp(ends), ends, np.eye(2))

    for target in shown:
        for over, (unit, values) in signals.items():
            if over == "time" or (over == target and not unit.endswith("/s")):
                yield over_range("sensor", target, outputs[target], over, unit, values)
    for push in model.pushes:
        one_way = sum(weight != 0.0 for weight in push.weights) == 1
        for over, (unit, values) in signals.items():
            if one_way and over in inputs:
                yield over_range("force", push.name, push.unit or "1", over, unit, values)
        if push.rate in signals and push.rate not in outputs and one_way:
            per, way = signals[push.rate][0], f"{WAY}{push.rate}"
            values = averaged(way)
            if np.ptp(values) > 0:
                share = "1" if per == push.unit else f"{push.unit} / ({per})"
                yield over_range("force", SHARE + push.name, share, way, per.removesuffix("/s"), values)
