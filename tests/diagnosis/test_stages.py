"""Stages of one machine, diagnosed one after the other, make one diagnosis."""

from types import SimpleNamespace

import numpy as np
import pytest

from fieldmodels.diagnosis.stages import joined

NOMINAL = np.array([1.0, 2.0, 3.0])
MACHINE = SimpleNamespace(name="machine", nominal=NOMINAL)


def part(verdict, vector=NOMINAL):
    """A stage's diagnosis that found nothing but its verdict."""
    nothing = SimpleNamespace(
        traces={},
        residuals={},
        calibration={},
        correlations=(),
        ranking=(),
        base=np.array(vector),
        stretch=(),
    )
    return SimpleNamespace(
        verdict=verdict, vector=np.array(vector), causes=(), misfit=(), gain={}, curves=(), possible=(),
        seen=(), mistaken="", curve_effects={}, not_runnable=(), next_measurement=None, parameters={},
        undetermined=(), bounded=(), wandering={}, above_noise={}, not_testable={},
        trained_on=(), tested_on=(), windows=(1, 1), seconds=1.0, evidence=nothing, notes=(),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("verdicts", "whole"),
    [
        (("consistent", "consistent"), "consistent"),
        (("consistent", "named"), "named"),
        (("named", "ambiguous"), "ambiguous"),
        (("unknown", "consistent"), "unknown"),
        (("unknown", "named"), "named"),  # a name is not lost; what is unknown stands beside it
    ],
)
def test_the_whole_says_the_most_that_a_stage_says(verdicts, whole):
    assert joined(MACHINE, [part(verdict) for verdict in verdicts]).verdict == whole
    assert joined(MACHINE, [part(verdict) for verdict in reversed(verdicts)]).verdict == whole


def test_each_stage_keeps_what_it_has_moved():
    parts = [part("named", [1.0, 2.5, 3.0]), part("named", [0.5, 2.0, 3.0])]
    np.testing.assert_array_equal(joined(MACHINE, parts).vector, [0.5, 2.5, 3.0])
