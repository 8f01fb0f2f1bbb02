"""The UAV's model against an independent integration, and its windows."""

import numpy as np
import pytest

from fieldmodels.machines.uav_route.declaration import nominal_plant
from fieldmodels.machines.uav_route.model import UavRoute
from fieldmodels.machines.uav_route.recording import record_flight
from fieldmodels.model import ModelError
from fieldmodels.recording import Recording
from fieldmodels.registry import get_model

MODEL = UavRoute()
OUTPUTS = tuple(output.name for output in MODEL.outputs)
WATCHED = {
    "signature_scale": {"factor": 1.6},
    "nose_cone_width": {"factor": 1.3},
    "radar_range_scale": {"factor": 0.9},
    "radar_position": {"north": 30e3, "east": -20e3},
    "scan_interval": {"factor": 1.2},
}
REALITIES = [
    None,
    {"wind": {"north": 20.0, "east": -35.0}},
    {"turn_speed_loss": {"share": 0.2}},
    {"weaker_bank": {"factor": 0.7}},
    {"sensor_bias": {"north": 300.0, "east": -150.0}},
    {
        "wind": {"north": -12.0, "east": 9.0},
        "turn_speed_loss": {"share": 0.1},
        "weaker_bank": {"factor": 1.2},
        "sensor_bias": {"north": -90.0, "east": 40.0},
        "parameters": {"speed": 230.0},
    },
    WATCHED,
]


def record(reality=None, duration=2500.0, noise=0.0, seed=1):
    return record_flight(reality, duration, noise=noise, rng=np.random.default_rng(seed))


def truth(reality):
    effects = {key: value for key, value in (reality or {}).items() if key != "parameters"}
    return MODEL.vector((reality or {}).get("parameters"), effects)


def test_model_is_registered():
    assert isinstance(get_model("uav_route"), UavRoute)


@pytest.mark.every("reality", REALITIES)
def test_prediction_equals_the_recorders_own_integration(reality):
    """Complex positions in 50 ms pieces against the kernel's pieces of legs, each window from its start."""
    recording = record(reality)
    windows = MODEL.windows(recording, 300.0)
    vector = truth(reality)
    # the state is the measured course, which a crabbing aircraft with a bias holds too
    error = MODEL.simulate(vector, windows)[0] - windows.measured(OUTPUTS)
    assert len(windows) >= 8
    assert np.nanmax(np.abs(error[:, :, :2])) < 1e-3
    assert np.nanmax(np.abs(error[:, :, 2])) < 1e-6
    if reality and reality is not WATCHED:
        off = MODEL.simulate(MODEL.nominal, windows)[0] - windows.measured(OUTPUTS)
        assert np.nanmax(np.abs(off)) > 0.1


@pytest.mark.every("reality", REALITIES)
def test_detections_come_with_the_probabilities_that_are_predicted(reality):
    """Drawn by the recorder from tables as NumPy interpolates them: residuals have mean 0 and variance 1.

    Both are tested at three standard errors, fourteen tests in all: a right kernel fails one in 27 runs of
    other seeds.
    """
    recording = record_flight(reality, 2000.0, episodes=6, rng=np.random.default_rng(5))
    windows = MODEL.windows(recording, 120.0)
    measured = windows.measured(OUTPUTS)[:, :, 3]
    seen = np.isfinite(measured)
    p = MODEL.simulate(truth(reality), windows)[0, :, :, 3][seen]
    score = (measured[seen] - p) / np.sqrt(p * (1 - p))
    error = np.sqrt(np.mean(score**4) / len(p))
    assert len(p) > 1500
    assert abs(score.mean()) < 3 / np.sqrt(len(p))
    assert abs(np.mean(score**2) - 1) < 3 * error


@pytest.mark.every("effect", [name for name in WATCHED if name != "scan_interval"])
def test_detections_alone_tell_what_the_radar_sees(effect):
    """The likelihood of the right parameters exceeds the nominal one's by far, positions as they are."""
    recording = record_flight({effect: WATCHED[effect]}, 1000.0, episodes=6, rng=np.random.default_rng(6))
    windows = MODEL.windows(recording, 120.0)
    y = windows.measured(OUTPUTS)[:, :, 3]
    vectors = np.array([MODEL.vector(effects={effect: WATCHED[effect]}), MODEL.nominal])
    p = MODEL.simulate(vectors, windows)[:, :, :, 3]
    right, nominal = np.nansum(np.log(np.where(y == 1, p, 1 - p)) + 0 * y, axis=(1, 2))
    assert right > nominal + 10


def test_looks_that_were_not_made_are_not_observed():
    recording = record(noise=1.0)
    windows = MODEL.windows(recording, 120.0)
    looked = (recording["scan_gap"] > 0).mean()
    assert windows.observed[:, :, 3].mean() == pytest.approx(looked, abs=0.01)
    np.testing.assert_array_equal(windows.observed[:, :, 3], windows.observed[:, :, 4])
    blind = record_flight(None, 600.0, scans=False, rng=np.random.default_rng(0))
    assert not MODEL.windows(blind, 120.0).observed[:, :, 3:].any()


def test_a_batch_equals_single_vectors_to_the_bit():
    windows = MODEL.windows(record(noise=1.0), 120.0)
    vectors = np.array([truth(reality) for reality in REALITIES])
    together = MODEL.simulate(vectors, windows)
    for one, vector in zip(together, vectors, strict=True):
        np.testing.assert_array_equal(one, MODEL.simulate(vector, windows)[0])


def test_bank_may_be_missing():
    recording = record_flight(None, 600.0, bank=False, rng=np.random.default_rng(0))
    assert "bank" not in recording
    windows = MODEL.windows(recording, 120.0)
    assert not windows.observed[:, :, 2].any()


def test_prediction_turns_with_the_map():
    """Turning waypoints, positions and wind by a right angle turns the prediction."""
    recording = record()
    turned = dict(recording.signals)
    for north, east in (("to_north", "to_east"), ("north", "east")):
        turned[north], turned[east] = -recording[east], recording[north]
    other = type(recording)(recording.time, turned, recording.units)
    calm, blown = (MODEL.vector(effects={"wind": wind}) for wind in (
        {"north": 15.0, "east": 6.0}, {"north": -6.0, "east": 15.0}
    ))  # fmt: skip
    one = MODEL.simulate(calm, MODEL.windows(recording, 300.0))[0]
    two = MODEL.simulate(blown, MODEL.windows(other, 300.0))[0]
    np.testing.assert_allclose(two[:, :, 0], -one[:, :, 1], atol=1e-6)
    np.testing.assert_allclose(two[:, :, 1], one[:, :, 0], atol=1e-6)
    np.testing.assert_allclose(two[:, :, 2], one[:, :, 2], atol=1e-9)


def test_plant_converts_to_kilometres():
    effects = {
        "wind": {"north": 10.0, "east": 0.0},
        "sensor_bias": {"north": 0.0, "east": 500.0},
        "nose_cone_width": {"factor": 1.1},
        "radar_position": {"north": -3000.0, "east": 0.0},
    }
    plant = MODEL.plant(MODEL.vector({"speed": 240.0, "radar_north": 7e4}, effects))
    assert plant["speed"] == pytest.approx(0.24)
    assert plant["radar_north"] == pytest.approx(70.0)
    assert plant["wind"].tolist() == pytest.approx((0.01, 0.0))
    assert plant["sensor_bias"].tolist() == pytest.approx((0.0, 0.5))
    assert plant["radar_position"].tolist() == pytest.approx((-3.0, 0.0))
    assert plant["nose_cone_width"]["factor"] == 1.1
    assert plant["weaker_bank"]["factor"] == 1.0
    assert MODEL.plant(MODEL.nominal) == nominal_plant(0.25)


def test_a_record_of_no_length_is_refused():
    with pytest.raises(ModelError, match="at least 10 samples"):
        record_flight(None, 5.0, rng=np.random.default_rng(0))
    with pytest.raises(ModelError, match="twice in a step of 6 s"):
        record_flight(None, 600.0, step=6.0, rng=np.random.default_rng(0))


def test_disturbance_is_a_speed_along_the_course():
    """Added to every sample it is what the recorder adds itself."""
    recording = record_flight(None, 2500.0, noise=0.0, added=lambda _place: 3.0, rng=np.random.default_rng(1))
    windows = MODEL.windows(recording, 300.0).with_disturbance(np.full(len(recording), 3.0))
    error = MODEL.simulate(MODEL.nominal, windows)[0] - windows.measured(OUTPUTS)
    assert np.nanmax(np.abs(error[:, :, :2])) < 1e-3


def test_a_window_that_begins_with_a_leg_does_not_know_the_bank_before():
    """Of windows of 20 samples the third begins with a leg; the mean bank there is that of the leg before."""
    model, n = UavRoute(), 80
    names = [s.name for s in model.outputs]
    to_east = np.where(np.arange(n) < 40, 0.0, 5e4)
    signals = {"to_north": np.full(n, 5e4), "to_east": to_east, "north": np.zeros(n), "east": np.zeros(n)}
    recording = Recording(time=2.0 * np.arange(n), signals={**signals, "bank": np.zeros(n)})
    windows = model.windows(recording, 38.0)
    seen = windows.observed[:, 0, names.index("bank")]
    begins = np.isin(windows.starts, [0, 40])
    assert begins.any()
    assert not begins.all()
    assert (seen == ~begins).all()
    assert windows.observed[:, 1, names.index("bank")].all()
