"""A static map: the model for rows that each show a settled response to their command."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Self

import numpy as np

from fieldmodels.arrays import FloatArray, IntArray
from fieldmodels.effects import actuator, sensor
from fieldmodels.effects.stock import LARGE, NO_LIMIT
from fieldmodels.machine import Machine, number
from fieldmodels.model import Effect, Parameter, Signal
from fieldmodels.recording import Recording

ANY = "1"
DEAD_ZONE = Effect(
    "dead_zone",
    "Around one command nothing happens.",
    "actuator",
    (
        Parameter("width", ANY, 0.0, 0.0, LARGE, 0.01, starts=(0.05, 0.2)),
        Parameter("centre", ANY, 0.0, -LARGE, LARGE, 0.01, starts=(0.0,)),
    ),
    "u - c is 0 up to a width, and less by it beyond",
)
UPPER_LIMIT = Effect(
    "upper_limit",
    "The response saturates: it goes no higher than a certain value.",
    "actuator",
    (Parameter("limit", ANY, NO_LIMIT, -NO_LIMIT, NO_LIMIT, 0.01, starts=(1.0,)),),
    "y <= limit",
)
LOWER_LIMIT = Effect(
    "lower_limit",
    "The response saturates: it goes no lower than a certain value.",
    "actuator",
    (Parameter("limit", ANY, -NO_LIMIT, -NO_LIMIT, NO_LIMIT, 0.01, starts=(-1.0,)),),
    "y >= limit",
)
OWN = ("dead_zone", "upper_limit", "lower_limit", "curvature")
KNOTS = 9
"""Places of a curve, equally spaced; at the outermost two it is 0, since a line has gain and offset."""
CURVATURE = Effect(
    "curvature",
    "The response is a curve of the command, not a line.",
    "actuator",
    (
        Parameter("low", ANY, -1.0, -LARGE, LARGE, 0.1, refitted=False),
        Parameter("high", ANY, 1.0, -LARGE, LARGE, 0.1, refitted=False),
        *(
            Parameter(f"value_{k}", ANY, 0.0, -LARGE, LARGE, 0.01, starts=(0.1,), knot=True)
            for k in range(1, KNOTS - 1)
        ),
    ),
    "y + curve(u), which is 0 at both ends",
)
RANGE = (0.1, 0.3, 0.5, 0.7, 0.9)
"""Parts of the commands' and the responses' range at which a dead zone or a limit is sought."""


class Map(Machine):
    """A static map, in any units: a command in, the response to it in the same row out.

        response = gain command + offset

    It has no time constant: it suits rows that are so far apart that the machine settles between them.
    """

    inputs = (Signal("command", ""),)
    states = outputs = (Signal("response", "", noise=0.01),)
    gain = number(ANY, 1.0, -LARGE, LARGE)
    offset = number(ANY, 0.0, -LARGE, LARGE, scale=0.1)
    effects = (
        DEAD_ZONE,
        UPPER_LIMIT,
        LOWER_LIMIT,
        CURVATURE,
        *actuator("command", ("play",)),
        *sensor("response", ("drift", "quantisation")),
    )
    ahead = hold_said = True

    def step(self, state: Any, input: Any, p: Any, dt: Any) -> Any:  # noqa: ARG002 - by name
        """The response to a command, whatever was before."""
        u = input.command
        if p.dead_zone_width > 0.0:
            beyond = u - p.dead_zone_centre
            u = p.dead_zone_centre + math.copysign(max(abs(beyond) - p.dead_zone_width, 0.0), beyond)
        bent = (
            0.0, p.curvature_value_1, p.curvature_value_2, p.curvature_value_3, p.curvature_value_4,
            p.curvature_value_5, p.curvature_value_6, p.curvature_value_7, 0.0,
        )  # fmt: skip
        at = 8.0 * min(max((u - p.curvature_low) / (p.curvature_high - p.curvature_low), 0.0), 1.0)
        k = min(int(at), 7)
        y = p.gain * u + p.offset + bent[k] + (at - k) * (bent[k + 1] - bent[k])
        return min(max(y, p.lower_limit_limit), p.upper_limit_limit)

    def initial_states(self, recording: Recording, starts: IntArray) -> FloatArray:
        """The responses as they were measured: rows beside each other may have nothing in common."""
        return np.ascontiguousarray(recording["response"][starts], dtype=np.float64)[:, None]

    def scaled_to(self, recordings: Sequence[Recording]) -> Self:
        """Suit units, scales and starts to the data; see ``Model.scaled_to``."""
        result = super().scaled_to(recordings)
        command, response = (np.concatenate([r[n] for r in recordings]) for n in ("command", "response"))
        over, unit = (recordings[0].units.get(name) or ANY for name in ("command", "response"))
        (low, wide), (least, high) = (_range(command), _range(response))
        gain, offset = np.polyfit(command, response, 1) if wide > 0.0 else (0.0, float(np.mean(response)))
        result.inputs = (replace(self.inputs[0], unit=over),)
        result.states = result.outputs = (replace(result.outputs[0], unit=unit),)
        sizes = {"gain": (f"{unit}/{over}", gain, high / (wide or 1.0)), "offset": (unit, offset, high)}
        result.parameters = tuple(
            replace(
                p,
                unit=sizes[p.name][0],
                starts=(float(sizes[p.name][1]),),
                scale=0.1 * sizes[p.name][2] or 0.1,
            )
            for p in self.parameters
        )
        known = {"low": low, "high": low + (wide or 1.0)}
        sought = {
            "width": (over, wide, (0.05 * wide, 0.2 * wide)),
            "centre": (over, wide, tuple(low + part * wide for part in RANGE)),
            "limit": (unit, high, tuple(least + part * high for part in RANGE)),
        }

        def suited(p: Parameter) -> Parameter:
            if p.name in known:
                return replace(p, unit=over, nominal=known[p.name])
            where, size, starts = sought.get(p.name, (unit, high, (0.05 * high,)))
            return replace(p, unit=where, scale=0.05 * size or 0.1, starts=starts)

        result.effects = tuple(
            replace(e, parameters=tuple(map(suited, e.parameters))) if e.name in OWN else e
            for e in result.effects
        )
        return result


def _range(values: FloatArray) -> tuple[float, float]:
    """The least value, and how far the others go beyond it."""
    return float(values.min()), float(np.ptp(values))
