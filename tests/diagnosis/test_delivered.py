"""What a diagnosis states is what its extension delivers: written, loaded and run before it is stated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fieldmodels.diagnosis import delivered, diagnose
from fieldmodels.diagnosis.outcome import Diagnosis
from fieldmodels.diagnosis.result import Estimate
from fieldmodels.drivers.named import extended_model
from fieldmodels.model import ModelError
from fieldmodels.recording import Recording
from fieldmodels.registry import get_model
from fieldmodels.yaml import save_yaml

STEP, SAMPLES, FINE, NOISE = 0.01, 2000, 10, 2e-5


def log(seed: int) -> Recording:
    """A mass on a spring by semi-implicit Euler steps; its position sensor errs by a dent around 2 cm."""
    rng = np.random.default_rng(seed)
    held = np.minimum(rng.integers(5, 40, 400).cumsum().searchsorted(np.arange(SAMPLES)), 399)
    force, x, v, h = rng.uniform(-20, 20, 400)[held], 0.0, 0.0, STEP / FINE
    true = np.empty(SAMPLES)
    for i in range(SAMPLES):
        true[i] = x
        for _ in range(FINE):
            v += h * (force[i] - 6.0 * v - 800.0 * x) / 2.0
            x += h * v
    shown = true + 8e-4 * np.exp(-(((true - 0.015) / 0.005) ** 2)) + NOISE * rng.standard_normal(SAMPLES)
    return Recording(np.arange(SAMPLES) * STEP, {"force": force, "position": shown}, source=str(seed))


TRAIN, TEST = log(1), log(2)


def found() -> Diagnosis:
    return diagnose(get_model("rig"), [TRAIN], [TEST])


def delivers(diagnosis: Diagnosis) -> float:
    """Error of the extended simulation over its main windows of the test record."""
    table = diagnosis.predict(TEST)
    return float(np.sqrt(np.mean((table.position - table.position_predicted) ** 2)))


def test_what_is_stated_is_what_the_file_delivers(tmp_path):
    one = found()
    gain = one.gain["position"]
    assert one.curve_effects
    assert not one.not_runnable
    assert gain.rmse_with_curves < 0.7 * gain.rmse_before
    assert gain.rmse_with_curves == pytest.approx(delivers(one), rel=1e-9)
    main = next(row for row in gain.horizons if row.horizon == one.horizon)
    assert main.rmse_after == gain.rmse_with_curves  # with curves at every horizon
    save_yaml(one.extended(), tmp_path / "extended.yaml")
    model, vector = extended_model(tmp_path / "extended.yaml")
    assert model.names == one.simulation.model.names
    np.testing.assert_array_equal(vector, one.simulation.vector)


@pytest.mark.parametrize("how", ["cannot run", "is worse", "does not settle"])
def test_a_curve_that_does_not_deliver_is_neither_written_nor_stated(how: str, monkeypatch):
    """It is said with the reason, and the extension without it is what is stated."""
    honest, load = delivered.runnable, delivered.loaded

    def runnable(model, curves, horizon):
        effects, left = honest(model, curves, horizon)
        if how == "cannot run":
            return {}, tuple(f"{c.direction} (there is no place for it)" for c in curves)
        return {name: {k: spoilt(k, e) for k, e in values.items()} for name, values in effects.items()}, left

    def spoilt(key: str, e: Estimate) -> Estimate:
        return replace(e, value=-3.0 * e.value) if key.startswith("value") and how == "is worse" else e

    def loaded(model, data):
        if how == "does not settle" and data["effects"]:
            raise ModelError("what a curve adds does not settle")
        return load(model, data)

    monkeypatch.setattr(delivered, "runnable", runnable)
    monkeypatch.setattr(delivered, "loaded", loaded)
    one = found()
    gain, extended = one.gain["position"], one.extended()
    reason = {"cannot run": "no place", "is worse": "no better", "does not settle": "does not settle"}[how]
    assert reason in " ".join(one.not_runnable)
    assert (extended["effects"], one.verdict) == ({}, "unknown")
    assert gain.rmse_with_curves == gain.rmse_after == pytest.approx(gain.rmse_before)
    assert gain.rmse_with_curves == pytest.approx(delivers(one), rel=1e-9)


COMPASS = (0.003, 0.003, 0.005)  # noise of x, y [m] and heading [rad]


def compass(seed: int, n: int) -> Recording:
    """A robot by Euler steps that turns on and on; soft iron makes its compass err twice a turn."""
    rng, step, fine = np.random.default_rng(seed), 0.05, 10
    held = np.minimum(rng.integers(10, 60, 300).cumsum().searchsorted(np.arange(n)), 299)
    speed, rate = rng.uniform(0.1, 0.9, 300)[held], rng.uniform(-0.8, 1.2, 300)[held]
    pose = np.zeros((n + 1, 3))
    for i in range(n):
        x, y, heading = pose[i]
        for _ in range(fine):
            x += step / fine * speed[i] * np.cos(heading)
            y += step / fine * speed[i] * np.sin(heading)
            heading += step / fine * rate[i]
        pose[i + 1] = x, y, heading
    shown = pose[:n] + rng.standard_normal((n, 3)) * COMPASS
    shown[:, 2] += 0.12 * np.sin(2.0 * pose[:n, 2] + 0.4)
    signals = dict(zip(("speed", "turn_rate", "x", "y", "heading"), (speed, rate, *shown.T), strict=True))
    return Recording(
        np.arange(n) * step, signals, source=str(seed), known={"wheel_radius": 0.03, "track": 0.15}
    )


def test_a_wave_is_delivered_with_its_period_and_goes_on_where_the_data_ended():
    """The test record goes where no training data were: a table ends there, a wave does not."""
    train, test = compass(1, 1000), compass(2, 2000)
    assert test["heading"].max() > train["heading"].max() + np.pi
    one = diagnose(get_model("pose_reaching"), [train], [test])
    [curve] = [c for c in one.curves if c.found]
    assert curve.period == pytest.approx(np.pi, rel=3e-3)
    for name, noise in zip(("x", "y", "heading"), COMPASS, strict=True):
        gain = one.gain[name]
        assert gain.rmse_with_curves < 1.1 * noise, name
        table = one.predict(test)
        error = np.sqrt(np.mean((table[name] - table[f"{name}_predicted"]) ** 2))
        assert error == pytest.approx(gain.rmse_with_curves, rel=1e-6)
    assert one.gain["heading"].rmse_before > 5.0 * COMPASS[2]
