"""Stock effects of time: a parameter of a machine that jumps, or that drifts."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fieldmodels.compiled import allocation_free_inlined as inlined
from fieldmodels.effects.stock import Declare, Layout, Names, Sizes, Stock, choose, effect
from fieldmodels.model import Effect, Parameter


class Row(NamedTuple):
    """Numbers of a base parameter's changes; the defaults switch them off."""

    step_time: float = 0.0
    step_change: float = 0.0
    drift_rate: float = 0.0


ROW = Layout(Row)
unpack = ROW.unpack


@inlined
def changed(value: float, time: float, h: float, r: Row) -> float:
    """A parameter's mean value from ``time`` on for ``h`` [s]."""
    if r.step_change != 0.0:
        value += r.step_change * min(max((time + h - r.step_time) / h, 0.0), 1.0)
    return float(value + r.drift_rate * (time + 0.5 * h))


def _step(n: Names, s: Sizes) -> Effect:
    return effect(
        "step", "change", f"The {n.force} jumps during the record.", f"{n.force} + change from time on",
        Parameter(
            "time", "s", 0.0, 0.0, 1e5, 0.02 * s.duration,
            starts=tuple(float(t) for t in np.linspace(0.1, 0.9, 17) * s.duration), smooth=False,
        ),
        Parameter("change", n.force_unit, 0.0, -1e12, 1e12, 0.05 * s.force, starts=(0.1 * s.force,)),
    )  # fmt: skip


def _drift(n: Names, s: Sizes) -> Effect:
    size = 0.2 * s.force / s.duration
    return effect(
        "drift", "change", f"The {n.force} changes steadily, as when something warms up or wears.",
        f"{n.force} + rate t",
        Parameter("rate", f"{n.force_unit}/s", 0.0, -1e12, 1e12, 0.25 * size, starts=(size,)),
    )  # fmt: skip


LIBRARY: dict[str, Declare] = {"step": _step, "drift": _drift}


def change(parameter: str) -> tuple[Stock, ...]:
    """A step and a drift of a base parameter: ``<parameter>_step`` and ``<parameter>_drift``.

    Args:
        parameter: Name of the base parameter.
    """
    return choose(LIBRARY, "change", parameter, (), (), f"{parameter}_")
