"""What a report shows of a misfit: correlations with their limits, gains at every horizon, the equation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fieldmodels.diagnosis import diagnose
from fieldmodels.diagnosis import problem as problems
from fieldmodels.diagnosis.candidates import Candidates
from fieldmodels.diagnosis.correlation import correlations
from fieldmodels.diagnosis.gain import by_horizon, predict
from fieldmodels.diagnosis.report import pictures, report_section, write_results
from fieldmodels.reality import read_reality
from fieldmodels.recording import Recording
from fieldmodels.registry import get_model
from fieldmodels.synthesis import synthesise

MODEL = get_model("rig")


def record(seed: int, reality: dict[str, dict[str, float]] | None = None, coloured: float = 0.0) -> Recording:
    return synthesise(
        MODEL, reality or {}, "mixed", duration=30.0, step=0.01, amplitude=8.0,
        rng=np.random.default_rng(seed), noise=True, coloured=coloured,
    )  # fmt: skip


def looked_at(train: Recording, test: Recording, seed: int = 0):
    model = MODEL.scaled_to([train, test])
    training = problems.build(model, [train], model.horizons[1])
    testing = problems.build(model, [test], model.horizons[1], training)
    candidates = Candidates(
        training, model.vector(), frozenset(), training.blocks % 4, np.diag(1 / training.output_scale)
    )
    vector = candidates.base().fit.parameters
    prediction = predict(testing, vector)
    shown = correlations(testing, vector, prediction, prediction, np.random.default_rng(seed))
    return {(c.signal, c.other): c for c in shown}, testing, vector


def test_limits_hold_for_white_noise_and_not_for_a_lag() -> None:
    """Nothing hidden: 5 % of p-values lie below 5 %; of 32, more than 6 come by chance in 1 of 1000 runs."""
    clean = [looked_at(record(7100 + k), record(7200 + k))[0] for k in range(8)]
    values = np.array([c.p_before for shown in clean for c in shown.values()])
    assert len(values) == 32
    assert np.sum(values < 0.05) <= 6
    late = {"actuator_lag": {"time_constant": 0.02}}
    shown, _, _ = looked_at(record(7301, late), record(7302, late))
    assert shown["velocity", "velocity"].p_before < 0.01
    cross = shown["velocity", "force"]
    assert cross.p_before < 0.05
    # The force that a lagging actuator still gives is that of a moment ago.
    assert 0 <= cross.lags[np.argmax(np.abs(cross.before))] < 0.1


def test_coloured_noise_correlates_with_itself_but_not_with_the_input() -> None:
    shown = [looked_at(record(7400 + k, coloured=0.7), record(7500 + k, coloured=0.7))[0] for k in range(5)]
    own = [c.p_before for s in shown for c in s.values() if c.signal == c.other == "position"]
    inputs = [c.p_before for s in shown for c in s.values() if c.other == "force"]
    assert np.mean(np.array(own) < 0.05) > 0.5
    assert np.sum(np.array(inputs) < 0.05) <= 3  # of 10 at 5 %: more in 1 of 1000 runs


def test_every_horizon_is_measured_on_test_windows_only() -> None:
    recording = record(7601)
    model = MODEL.scaled_to([recording])
    whole = problems.build(model, [recording], model.horizons[1])
    kept = whole.blocks % 4 == 3
    testing = whole.select(kept)
    rows = by_horizon(testing, model.vector(), (testing, model.vector()), np.random.default_rng(0))[
        "position"
    ]
    # No window of the longest lies wholly inside test windows; with a test record of its own one would.
    assert [row.horizon for row in rows] == list(model.horizons[:2])
    spoilt = recording["position"].copy()
    inside = np.zeros(len(recording), dtype=bool)
    for start, length in zip(testing.parts[0].windows.starts, testing.parts[0].windows.lengths, strict=True):
        inside[start : start + length] = True
    spoilt[~inside] += 1.0  # what was used for fitting must not matter
    other = replace(recording, signals={**recording.signals, "position": spoilt})
    again = problems.build(model, [other], model.horizons[1]).select(kept)
    repeated = by_horizon(again, model.vector(), (again, model.vector()), np.random.default_rng(0))[
        "position"
    ]
    for before, after in zip(rows, repeated, strict=True):
        # A window's start is smoothed over its neighbours, which here are spoilt.
        assert after.rmse_before == pytest.approx(before.rmse_before, rel=0.05)
        assert after.windows == before.windows


@pytest.mark.nightly
def test_the_page_and_the_extended_model_show_it(tmp_path) -> None:
    hidden = {"coulomb_friction": {"force": 0.8}}
    diagnosis = diagnose(MODEL, [record(7701, hidden)], [record(7702, hidden)])
    assert [c.effect for c in diagnosis.causes] == ["coulomb_friction"]
    drawn = pictures(diagnosis)
    section = report_section(diagnosis, drawn, "")
    assert "Correlations of the errors" in section
    assert "-F_c sign(v)" in section
    gain = diagnosis.to_json()["gain"]["position"]["horizons"]
    assert [row["horizon_s"] for row in gain] == list(MODEL.horizons)
    assert all(row["percent"] > 20 and row["ci95"][0] > 0 for row in gain)
    written = write_results(diagnosis, tmp_path, drawn)
    text = written["extended.yaml"].read_text()
    assert "symbols: -F_c sign(v)" in text
    values = read_reality(written["extended.yaml"], MODEL).effects
    assert values["coulomb_friction"]["force"] == pytest.approx(0.8, rel=0.1)
