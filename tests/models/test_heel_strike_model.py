"""Heel strike as a model for diagnosis: predictions are the truth's, to the last digits."""

import numpy as np
import pytest
from scipy import integrate

from fieldmodels.arrays import FloatArray
from fieldmodels.machines.heel_strike.model import LONG, HeelStrikeModel, with_derived
from fieldmodels.machines.heel_strike.parameters import SILENT, Leg, Noise
from fieldmodels.machines.heel_strike.recording import record_walk
from fieldmodels.model import ModelError
from fieldmodels.reality import Reality
from fieldmodels.recording import Recording, RecordingError, Windows
from fieldmodels.recording.files import load_recording, save_recording

MODEL = HeelStrikeModel()
OUTPUTS = tuple(output.name for output in MODEL.outputs)
EFFECTS = {
    "viscous_friction": {"rate": 0.1},
    "coulomb_friction": {"acceleration": 0.2},
    "quadratic_drag": {"coefficient": 0.2},
    "constant_force": {"acceleration": 0.2},
    "periodic_force": {"sine": 0.3, "cosine": 0.2, "frequency": 1.7},
    "gyro_bias": {"rate": 0.01},
    "gyro_drift": {"rate": 1e-3},
    "gyro_gain": {"gain": 1.05},
    "gyro_delay": {"delay": 0.0051},
    "parameter_step": {"rate": 0.02, "time": 3.3},
}


def walk(
    seed: int = 1, duration: float = 12.0, noise: Noise = SILENT, reality: Reality | None = None
) -> Recording:
    return record_walk(duration, np.random.default_rng(seed), noise, reality)


def errors(windows: Windows, vector: FloatArray) -> FloatArray:
    error = windows.measured(OUTPUTS) - MODEL.simulate(vector, windows)[0]
    return np.where(windows.observed, error, 0.0)


def residual(windows: Windows, vector: FloatArray) -> FloatArray:
    """Of what is simulated from the window's start."""
    return errors(windows, vector)[..., :LONG].reshape(len(windows), -1)


def best_states(windows: Windows, vector: FloatArray) -> Windows:
    """Gauss-Newton on every window's own state."""
    for _ in range(4):
        here = residual(windows, vector)
        columns = []
        for j in range(2):
            moved = windows.states.copy()
            moved[:, j] += 1e-6
            columns.append((here - residual(windows.with_states(moved), vector)) / 1e-6)
        jacobian = np.stack(columns, axis=-1)
        steps = [np.linalg.lstsq(j, r, rcond=None)[0] for j, r in zip(jacobian, here, strict=True)]
        windows = windows.with_states(windows.states + steps)
    return windows


@pytest.mark.every("horizon", MODEL.horizons)
@pytest.mark.every("effect", EFFECTS)
def test_prediction_in_the_true_reality_is_exact(effect, horizon):
    reality = Reality(effects={effect: EFFECTS[effect]})
    windows = MODEL.windows(walk(reality=reality), horizon)
    vector = reality.vector(MODEL)
    assert np.abs(residual(best_states(windows, vector), vector)).max() < 1e-11
    nominal = best_states(windows, MODEL.nominal)
    if horizon >= 1:
        assert np.abs(residual(nominal, MODEL.nominal)).max() > 1e-4


def test_closure_does_not_see_the_process_torque():
    windows = MODEL.windows(walk(2, 40, Noise(gyro=0, collision=0, floor=0, process=0.5)), 1.0)
    error = np.abs(windows.measured(OUTPUTS) - MODEL.simulate(MODEL.nominal, windows)[0])
    error = np.nanmax(np.where(windows.observed, error, np.nan), axis=(0, 1))
    assert error[0] > 0.05
    assert error[2] < 2e-4


@pytest.mark.every("effect", EFFECTS)
def test_a_long_turn_shows_what_turns_the_gyro_steadily(effect):
    """Six strides add a bias up; a gain and a delay do not show, nor does any force."""
    reality = Reality(effects={effect: EFFECTS[effect]})
    windows = MODEL.windows(walk(8, 40.0, Noise(gyro=0, collision=0, floor=0, process=0.15), reality), 1.0)
    true, nominal = (
        errors(windows, v)[..., LONG].sum(axis=1) for v in (reality.vector(MODEL), MODEL.nominal)
    )
    steady = effect in ("gyro_bias", "gyro_drift", "parameter_step")
    assert np.abs(true).max() < 3e-5
    assert (np.abs(nominal).max() > 0.03) == steady
    assert steady or np.abs(nominal).max() < 1e-3


def test_six_strides_close_as_well_as_one():
    """What the geometry errs at a strike enters the next closure with the opposite sign."""
    recording = walk(9, 400.0, Noise(process=0.15))
    windows = MODEL.windows(recording, 1.0)
    error = errors(windows, MODEL.nominal).sum(axis=1)
    one, six = error[:, 2] - error[:, 2].mean(), error[:, LONG]
    assert np.mean(one[1:] * one[:-1]) / np.mean(one**2) == pytest.approx(-0.5, abs=0.1)
    assert np.std(six) == pytest.approx(np.std(one), rel=0.15)


def test_windows_run_from_strike_to_strike():
    recording = walk(3, 30, Noise())
    windows = MODEL.windows(recording, 1.0)
    ends = windows.starts + windows.lengths - 1
    assert np.all(recording["strike"][windows.starts] == 1)
    assert np.all(recording["strike"][ends] == 1)
    assert np.array_equal(ends[:-1], windows.starts[1:])
    assert windows.observed[:, :, 1].sum() == 2 * len(windows)
    half = MODEL.windows(recording, 0.5)
    assert np.all(half.lengths < 0.6 * windows.lengths.max())
    assert np.allclose(MODEL.windows(recording, 2.0).lengths, 2 * windows.lengths.mean(), rtol=0.05)


def test_a_batch_gives_the_rows_of_single_calls():
    windows = MODEL.windows(walk(4, 8, Noise()), 1.0)
    vectors = np.array([MODEL.vector({"length": length}) for length in (0.9, 1.0, 1.1)])
    batch = MODEL.simulate(vectors, windows)
    for vector, row in zip(vectors, batch, strict=True):
        assert np.array_equal(MODEL.simulate(vector, windows)[0], row, equal_nan=True)


def test_a_disturbance_acts_like_a_constant_force():
    windows = MODEL.windows(walk(5, 8), 1.0)
    pushed = windows.with_disturbance(np.full(len(windows.recording), 0.3))
    force = MODEL.vector(effects={"constant_force": {"acceleration": 0.3}})
    assert MODEL.simulate(MODEL.nominal, pushed)[0, :, :, 1] == pytest.approx(
        MODEL.simulate(force, windows)[0, :, :, 1], abs=1e-12, nan_ok=True
    )


def test_a_quantised_gyro_shows_multiples():
    gyro = walk(reality=Reality(effects={"gyro_quantisation": {"step": 0.02}}))["gyro"]
    assert np.abs(gyro / 0.02 - np.round(gyro / 0.02)).max() < 1e-9


def test_a_recording_survives_a_file(tmp_path):
    recording = walk(6, 5, Noise())
    for name in ("walk.csv", "walk.parquet"):
        save_recording(recording, tmp_path / name)
        again = load_recording(tmp_path / name, MODEL)
        for column in ("gyro", "strike", "strike_angle"):
            assert again[column] == pytest.approx(recording[column], rel=1e-9, abs=1e-12)


def test_bad_recordings_and_realities_are_refused():
    recording = walk(7, 5)
    blind = Recording(recording.time, {**recording.signals, "strike": np.zeros(len(recording))})
    with pytest.raises(RecordingError, match="fewer than two heel strikes"):
        MODEL.windows(blind, 1.0)
    with pytest.raises(ModelError, match="did you mean 'gyro_bias'"):
        walk(reality=Reality(effects={"gyro_bais": {"rate": 0.1}}))
    with pytest.raises(ModelError, match="the leg fell"):
        record_walk(
            5,
            np.random.default_rng(0),
            SILENT,
            Reality(effects={"coulomb_friction": {"acceleration": 2.0}}),
            Leg(),
        )


def test_readings_are_late_by_more_samples_than_a_walker_remembers():
    """At 1 kHz 19 ms are 19 samples: both averages of the push-off against SciPy's pendulum."""
    step, delay, around, share = 0.001, 0.019, 30, MODEL.leg.push_off
    time = step * np.arange(200)
    signals = {"gyro": np.zeros(200), "strike": np.zeros(200), "strike_angle": np.zeros(200)}
    recording = with_derived(Recording(time=time, signals=signals), MODEL.leg)
    one = np.array([0])
    observed = np.ones((1, 100, 4), dtype=bool)
    windows = Windows(recording, one, np.array([100]), np.array([[0.1, 1.2]]), observed)
    predicted = MODEL.simulate(MODEL.vector(effects={"gyro_delay": {"delay": delay}}), windows)[0, 0]

    def slope(_t, x):
        return [x[1], -MODEL.leg.gravity / MODEL.leg.length * np.sin(x[0])]

    sides = [
        integrate.solve_ivp(slope, (0, end), [0.1, 1.2], rtol=1e-12, atol=1e-12, dense_output=True).sol
        for end in (-0.1, 0.1)
    ]
    speed = [float(sides[int(t > 0)](t)[1]) for t in step * np.arange(1 - around, around + 1) - delay]
    before, after = np.mean(speed[:around]), np.mean(speed[around:])
    expected = after - ((1 - share) * before + share * MODEL.leg.speed)
    assert predicted[around, 3] == pytest.approx(expected, abs=1e-6)
