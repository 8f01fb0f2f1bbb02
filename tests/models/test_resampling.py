"""Logs whose rows do not come evenly: measured against a bench that is simulated twenty times finer."""

from __future__ import annotations

import numpy as np
import pytest

from fieldmodels.diagnosis import diagnose
from fieldmodels.recording import Recording, RecordingError, RecordingWarning
from fieldmodels.recording.files import load_recording, save_recording
from fieldmodels.recording.resampling import evened
from fieldmodels.registry import get_model
from fieldmodels.synthesis import excitation, synthesise

RIG = get_model("rig")
STEP, FINE = 0.01, 20
TICK = STEP / FINE
NOISE = {"position": 2e-4, "velocity": 5e-3}


def logged(kind, jitter, missing=0.0, seed=0, duration=30.0, reality=None):
    """A log and the truth in ticks: rows "taken" at uneven times, or even rows whose stamps "wander".

    Jitter is the half width of a uniform law, as a share of the step.
    """
    rng = np.random.default_rng(seed)
    n = round(duration / STEP)
    even = np.arange(n) * FINE
    rows = even + np.r_[0, np.round(rng.uniform(-jitter, jitter, n - 1) * FINE)].astype(int)
    taken = rows if kind == "taken" else even
    told = 5.0 * excitation("mixed", duration, STEP, rng)
    held = np.repeat(told, np.diff(np.append(taken, n * FINE)))
    reality = reality or {"coulomb_friction": {"force": 0.3}}
    truth = synthesise(RIG, reality, held, step=TICK, refine=1, rng=rng, noise=False)
    kept = np.r_[True, rng.uniform(size=n - 1) >= missing]
    signals = {
        name: (truth[name][taken] + NOISE.get(name, 0.0) * rng.standard_normal(n))[kept]
        for name in ("force", "position", "velocity")
    }
    return Recording((rows * TICK)[kept], signals), truth


CASES = [
    ("taken", 0.1, 0.0, "were interpolated"),
    ("taken", 0.3, 0.0, "were interpolated"),
    ("taken", 0.3, 0.02, "were interpolated"),
    ("wander", 0.1, 0.0, "rows are counted"),
    ("wander", 0.3, 0.0, "rows are counted"),
    ("wander", 0.3, 0.02, "rows are counted"),
]


@pytest.mark.every(("kind", "jitter", "missing", "note"), CASES)
def test_the_even_grid_shows_the_truth_with_no_more_noise_than_the_sensor_s(kind, jitter, missing, note):
    log, truth = logged(kind, jitter, missing, seed=3)
    result = evened(log, RIG)
    assert note in result.notes[-1]
    assert ("are missing and were filled" in result.notes[-1]) == (missing > 0)
    even = result
    assert even.step == pytest.approx(STEP, rel=1e-4)
    rows = np.minimum(np.round(even.time / TICK).astype(int), len(truth) - 1)
    for name, noise in NOISE.items():
        error = even[name] - truth[name][rows]
        assert np.std(error) == pytest.approx(noise, rel=0.06)
        # As if it were read at these times: what is wrong is white, as the sensor's noise is.
        assert abs(np.corrcoef(error[1:], error[:-1])[0, 1]) < 0.08


@pytest.mark.nightly
@pytest.mark.parametrize(("kind", "jitter", "missing"), [("taken", 0.3, 0.02), ("wander", 0.3, 0.02)])
def test_the_diagnosis_of_an_uneven_log_is_that_of_an_even_one(kind, jitter, missing):
    train, test = (evened(logged(kind, jitter, missing, seed)[0], RIG) for seed in (5, 6))
    found = diagnose(RIG, [train], [test])
    assert [cause.effect for cause in found.causes] == ["coulomb_friction"]
    assert found.causes[0].parameters["force"].value == pytest.approx(0.3, abs=0.02)
    assert found.parameters["mass"].value == pytest.approx(2.0, rel=0.02)
    assert found.unknown is None


def test_held_commands_keep_their_impulse():
    time = np.array([0.0, 0.012, 0.02, 0.031, 0.04, 0.05, 0.06, 0.07, 0.08, 0.09])
    force = np.array([1.0, -2.0, 4.0, 0.0, 3.0, 3.0, 3.0, 3.0, 3.0, 3.0])
    log = Recording(time, {"force": force, "position": np.zeros(10)})
    even = evened(log, RIG)
    # Of each grid step the mean of what was held, summed on a grid ten thousand times finer.
    fine = even.time[0] + even.step * (np.arange(10_000 * len(even)) + 0.5) / 10_000
    held = force[np.searchsorted(time, fine, side="right") - 1].reshape(len(even), -1).mean(axis=1)
    np.testing.assert_allclose(even["force"], held, atol=2e-3)


def test_repeated_rows_are_dropped_and_late_ones_sorted():
    log, _ = logged("taken", 0.0, duration=5.0)
    rows = np.r_[np.arange(100), 99, 99, np.arange(100, 200), 201, 200, np.arange(202, 500)]
    mixed = Recording(log.time[rows], {name: values[rows] for name, values in log.signals.items()})
    result = evened(mixed, RIG)
    assert "2 repeated rows dropped" in result.notes[-1]
    np.testing.assert_allclose(result.time, log.time, atol=1e-9)
    np.testing.assert_allclose(result["position"], log["position"], atol=1e-9)


def test_a_coarse_clock_is_replaced_by_counting_rows():
    log, _ = logged("taken", 0.0, duration=10.0)
    coarse = Recording(np.floor(log.time / 0.0156) * 0.0156, log.signals)  # the usual clock of a PC
    result = evened(coarse, RIG)
    assert "rows are counted" in result.notes[-1]
    assert result.step == pytest.approx(STEP, rel=2e-3)
    np.testing.assert_allclose(result["position"], log["position"], atol=1e-15)


def test_a_long_gap_starts_a_new_episode_and_a_short_one_is_filled():
    log, truth = logged("taken", 0.0, duration=10.0)
    keep = np.r_[np.arange(300), np.arange(303, 600), np.arange(640, 1000)]
    result = evened(Recording(log.time[keep], {k: v[keep] for k, v in log.signals.items()}), RIG)
    assert "1 long gap starts a new episode" in result.notes[-1]
    assert result.bounds.tolist() == [[0, 600], [600, 960]]
    filled = result["position"][300:303]
    np.testing.assert_allclose(filled, truth["position"][300 * FINE : 303 * FINE : FINE], atol=1e-3)


def test_too_much_is_refused():
    rng = np.random.default_rng(0)
    time = np.cumsum(rng.exponential(0.01, 1000))
    signals = {"force": rng.normal(size=1000), "position": rng.normal(size=1000)}
    with pytest.raises(RecordingError, match=r"the time step varies by \d+ % \(allowed: 60 %\)"):
        evened(Recording(time, signals), RIG)
    keep = np.sort(rng.choice(1000, 600, replace=False))
    with pytest.raises(RecordingError, match="of the rows are missing"):
        evened(Recording(0.01 * keep, {k: v[keep] for k, v in signals.items()}), RIG)


def test_an_uneven_file_is_read_with_a_warning_and_an_even_one_without(tmp_path, recwarn):
    log, _ = logged("taken", 0.2, duration=5.0)
    save_recording(log, tmp_path / "log.csv")
    with pytest.warns(
        RecordingWarning, match=r"log\.csv: time steps are uneven; put on an even step of 0\.01"
    ):
        even = load_recording(tmp_path / "log.csv", RIG)
    save_recording(even, tmp_path / "even.csv")
    recwarn.clear()
    again = load_recording(tmp_path / "even.csv", RIG)
    assert not recwarn.list
    np.testing.assert_array_equal(again["position"], even["position"])


def test_a_clock_that_leaps_by_years_takes_no_terabytes():
    rng = np.random.default_rng(3)
    time = np.arange(600) * 0.01 + 0.002 * rng.random(600)
    time[300:] += 1e9
    found = evened(Recording(time=time, signals={"a": rng.random(600)}), None)
    assert len(found) < 700
    assert found.step == pytest.approx(0.01, rel=1e-3)
