"""A reversed sensor is said also where its zero is off: before any cause, with the remedy."""

from __future__ import annotations

from dataclasses import replace

import pytest

from exam.benches import get_bench
from exam.benches.base import Conditions
from exam.sizes import recordings
from fieldmodels.diagnosis import diagnose


@pytest.mark.matrix(keep=("rig-position-1.0-0.5",))
@pytest.mark.parametrize(
    ("machine", "signal", "sign", "offset"),
    [
        ("rig", "position", -1.0, 0.5),
        ("pendulum", "angle", -1.0, 0.3),
        ("rig", "position", 1.0, 0.5),
    ],
)
def test_a_reversed_sensor_is_said_whatever_its_zero(machine: str, signal: str, sign: float, offset: float):
    """It may be the command as well; an offset alone is a cause, and no mistake of a column."""
    bench = get_bench(machine)
    train, test = (
        replace(one, signals={n: v for n, v in one.signals.items() if n in ("force", "torque", signal)})
        for one in recordings(bench, (), Conditions(), 5)
    )
    shown = [
        replace(one, signals={**one.signals, signal: sign * one[signal] + offset * one[signal].std()})
        for one in (train, test)
    ]
    found = diagnose(bench.model, shown[:1], shown[1:])
    assert (f"the sign of {signal} seems to be reversed" in found.mistaken) == (sign < 0), found.summary()
