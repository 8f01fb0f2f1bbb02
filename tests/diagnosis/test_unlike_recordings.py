"""Recordings of one machine may be sampled otherwise, and may lack an optional output."""

from dataclasses import replace

import numpy as np
import pytest

from fieldmodels.diagnosis import diagnose
from fieldmodels.diagnosis.problem import build
from fieldmodels.registry import get_model
from fieldmodels.synthesis import synthesise

RIG = get_model("rig")
COULOMB = {"coulomb_friction": {"force": 0.3}}


def recorded(step, seed, hidden=None):
    rng = np.random.default_rng(seed)
    return synthesise(RIG, hidden, "mixed", duration=20.0, step=step, amplitude=6.0, rng=rng)


@pytest.mark.parametrize(("learned", "tested"), [(0.01, 0.05), (0.05, 0.01)])
def test_test_records_may_have_another_step(learned, tested):
    found = diagnose(RIG, [recorded(learned, 1, COULOMB)], [recorded(tested, 2, COULOMB)])
    assert [c.effect for c in found.causes] == ["coulomb_friction"]
    gain = found.gain["position"]
    assert gain.rmse_after == pytest.approx(2e-4, rel=0.25)  # the sensor's noise
    assert gain.rmse_before > 1e-3


@pytest.mark.parametrize(("learned", "tested"), [(0.01, 0.05), (0.05, 0.01), (0.01, 0.1)])
def test_both_are_compressed_to_the_same_averages(learned, tested):
    train, test = recorded(learned, 1), recorded(tested, 2)
    training = build(RIG, [train], 0.5, None, tested)
    testing = build(RIG, [test], 0.5, training)
    assert np.array_equal(training.outputs, testing.outputs)
    for problem in (training, testing):
        assert (problem.parts[0].counts > 0).all()
    # An average of a line over a share of the window lies at the same share of its way.
    for problem in (training, testing):
        window = problem.parts[0].windows
        way = np.arange(window.samples) / window.samples
        line = np.broadcast_to(way[None, None, :, None], (1, len(window), window.samples, 2))
        position = problem.parts[0].compressed(line)[0, 0][problem.outputs == 0]
        assert np.abs(np.diff(position) - 1 / len(position)).max() < 0.08


@pytest.mark.matrix(keep=("tested",))
@pytest.mark.parametrize("which", ["learned", "tested"])
def test_an_output_that_not_every_record_has_is_left_out_and_said(which):
    pair = {"learned": recorded(0.01, 1, COULOMB), "tested": recorded(0.01, 2, COULOMB)}
    signals = {name: values for name, values in pair[which].signals.items() if name != "velocity"}
    pair[which] = replace(pair[which], signals=signals)
    found = diagnose(RIG, [pair["learned"]], [pair["tested"]])
    assert [c.effect for c in found.causes] == ["coulomb_friction"]
    assert list(found.gain) == ["position"]
    assert any("velocity" in note for note in found.notes)
