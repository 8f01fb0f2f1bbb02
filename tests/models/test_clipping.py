"""A sensor that saturates is warned of, a machine at rest is not; a counter that wraps is unwrapped."""

import warnings

import numpy as np
import pytest

from fieldmodels.machine import Machine, number
from fieldmodels.model import Signal
from fieldmodels.recording import Recording, RecordingWarning
from fieldmodels.recording.bench import unwrapped
from fieldmodels.recording.checks import suspicions
from fieldmodels.recording.files import load_recording
from fieldmodels.registry import get_model

RIG, STEP = get_model("rig"), 0.01
TIME = STEP * np.arange(3000)


class Wheel(Machine):
    """A wheel whose speed alone is measured."""

    inputs = (Signal("voltage", "V"),)
    states = outputs = (Signal("speed", "rad/s", noise=0.1),)
    lag = number("s", 0.1, 0.01, 1.0)

    def derivative(self, state, input, p):
        """A first-order lag."""
        return (input.voltage - state.speed) / p.lag


def said(model=RIG, **signals) -> list[str]:
    found = suspicions(Recording(TIME, signals), model)
    return [one for one in found if "extreme values" in one]


def drives(speeds, seconds=3.0, ramp=0.3):
    """Speed of a robot that takes one speed after another and stands still in between, as trapezia."""
    speed = np.zeros(len(TIME))
    for k, wanted in enumerate(speeds):
        since = TIME - 2 * k * seconds - 1.0
        speed += wanted * np.clip(np.minimum(since, seconds - since) / ramp, 0.0, 1.0)
    return speed


def integral(speed):
    return np.cumsum(speed) * STEP


@pytest.mark.every("speeds", [(0.5, -0.5, 0.5, -0.5), (0.4, 0.3, 0.2, 0.5), (-0.2, 0.3, -0.4, 0.3)])
@pytest.mark.every("resolution", [0.0, 1e-4, 1e-3])
def test_a_robot_that_stands_still_is_not_saturated(speeds, resolution):
    speed = drives(speeds)
    place = integral(speed)
    if resolution:
        place = np.round(place / resolution) * resolution
    assert said(force=speed, position=place) == []
    assert said(force=speed, position=place, velocity=speed) == []


def test_a_wheel_at_rest_is_not_saturated_however_noisy_its_speed_is():
    speed = drives((5.0, 3.0, 4.0, 6.0))
    noisy = np.where(speed > 0, speed + 0.2 * np.random.default_rng(0).normal(size=len(speed)), 0.0)
    assert said(Wheel(), voltage=speed, speed=np.abs(noisy)) == []


def test_what_waits_for_its_command_is_not_saturated():
    late = np.clip(TIME - 5.0, 0.0, None)
    assert said(Wheel(), voltage=1.0 * (TIME > 5), speed=1.0 - np.exp(-late / 2.0)) == []


def test_an_encoder_that_turns_round_is_not_saturated():
    """In counts, slowly: at its turning points it stays for many rows, and leaves them count by count."""
    counts = np.round(200.0 * np.sin(0.5 * TIME) + 150.0 * np.sin(1.3 * TIME))
    assert said(force=np.cos(TIME), position=3e-4 * counts) == []
    slowly = np.round(400.0 * np.sin(0.3 * TIME))  # about a count a row
    assert said(force=np.cos(TIME), position=0.0029 * slowly) == []


def test_a_run_that_begins_at_rest_is_not_saturated_where_the_last_one_ended_elsewhere():
    speed = drives((0.4, 0.3, 0.2, 0.5))
    away = TIME > 17  # at rest, the robot was carried back to the start
    place = 0.1 + (integral(speed) - away * integral(speed)[int(17.5 / STEP)])
    recording = Recording(TIME, {"force": speed, "position": place}, episode=away.astype(np.int64))
    assert [one for one in suspicions(recording, RIG) if "extreme" in one] == []


@pytest.mark.every("height", [0.5, 0.7, 0.9, 0.95])
@pytest.mark.every("noise", [0.0, 1e-3, 1e-2])
@pytest.mark.every("name", ["position", "velocity"])
def test_a_sensor_that_saturates_is_warned_of(height, noise, name):
    rng = np.random.default_rng(1)
    true = {"position": np.sin(2 * TIME), "velocity": 2 * np.cos(2 * TIME)}
    limit = height * np.abs(true[name]).max()
    shown = {key: values + noise * rng.normal(size=len(TIME)) for key, values in true.items()}
    shown[name] = np.clip(shown[name], -limit, limit)
    (one,) = said(force=np.cos(2 * TIME), **shown)
    assert f"column {name!r}" in one


def test_a_speed_that_its_sensor_cannot_show_is_warned_of():
    """A step to 10 rad/s, of which a tachometer shows up to 6, and the command stands still meanwhile."""
    speed = 10.0 * (1.0 - np.exp(-np.clip(TIME - 1.0, 0.0, None) / 0.5))
    (one,) = said(Wheel(), voltage=10.0 * (TIME > 1), speed=np.minimum(speed, 6.0))
    assert "'speed' stays at its extreme values for up to 2" in one  # from 1.46 s on


@pytest.mark.every("noise", [0.0, 1e-2])
@pytest.mark.every("resolution", [0.0, 1e-2])
def test_a_sensor_that_saturates_from_the_first_row_on_is_warned_of(noise, resolution):
    """A wheel that slows down from 10 rad/s, of which its tachometer shows up to 6; it is there but once."""
    pulled = 10.0 * np.exp(-TIME / 5.0) + np.sin(3 * TIME)
    shown = pulled + noise * np.random.default_rng(2).normal(size=len(TIME))
    shown = np.minimum(np.round(shown / resolution) * resolution if resolution else shown, 6.0)
    (one,) = said(Wheel(), voltage=pulled, speed=shown)
    assert "'speed' stays at its extreme values for up to 29" in one  # till 2.98 s
    woken = np.where(TIME < 3.0, 0.0, 2.0 + np.sin(TIME))
    assert said(force=pulled, position=woken) == []


@pytest.mark.every("height", [-4.5, -3.0, 2.0])
@pytest.mark.every("resolution", [1e-3, 1e-2, 2e-2])
def test_a_coarse_sensor_that_saturates_most_of_the_time_is_warned_of(height, resolution):
    speed = np.round(5.0 * np.sin(2 * TIME) / resolution) * resolution
    limit = np.round(height / resolution) * resolution
    (one,) = said(Wheel(), voltage=np.sin(2 * TIME), speed=np.minimum(speed, limit))
    assert "'speed'" in one
    assert said(Wheel(), voltage=np.sin(2 * TIME), speed=speed) == []


def test_a_wheel_that_also_turned_evenly_is_warned_of():
    """It came slowly to the speed that it held for ten seconds, and fast to the one that its sensor holds."""
    ramp = 0.5 - 0.5 * np.cos(0.5 * np.pi * np.minimum(TIME, 2.0))
    speed = ramp + 5.0 * np.sin(2 * np.maximum(TIME - 12.0, 0.0))
    (one,) = said(Wheel(), voltage=speed, speed=np.minimum(speed, 4.0))
    assert "for up to 93 rows" in one


def test_a_sensor_whose_frames_are_lost_is_not_saturated():
    """Each value is shown until the next one arrives, after 1 to 30 rows, the largest one, too."""
    rng = np.random.default_rng(4)
    shown = np.cumsum(rng.integers(1, 31, 300))
    rows = np.searchsorted(shown, np.arange(len(TIME)), side="right")
    held = np.concatenate([[0], shown])[rows]
    speed = 5.0 * np.sin(1.3 * TIME) + 2.0 * np.sin(3.1 * TIME)
    assert said(Wheel(), voltage=speed, speed=speed[np.minimum(held, len(TIME) - 1)]) == []


def test_what_sticks_before_it_moves_is_not_saturated():
    """Held at 0.3 m while the force changes, till it breaks away."""
    since = np.clip(TIME - 1.0, 0.0, None)
    place = 0.3 + 0.2 * (since - 0.1 * (1.0 - np.exp(-since / 0.1)))
    assert said(force=np.sin(2 * TIME), position=place) == []
    pushed = np.clip(TIME - 1.0, 0.0, None)
    away = 0.3 + 0.2 * pushed + 0.05 * np.sin(3 * pushed)  # fast at once, but nothing has moved before
    assert said(force=1.0 * (TIME > 1.0), position=away) == []


def wrapping(model=RIG, name="position", **signals) -> list[str]:
    units = {s.name: s.unit for s in model.signals}
    found = suspicions(Recording(TIME, signals, units), model)
    return [one for one in found if "wraps" in one and f"column {name!r}" in one]


@pytest.mark.every("period", [0.5, 4096.0])
@pytest.mark.every("back", [False, True])
def test_a_counter_that_wraps_is_suspected_and_nothing_else(period, back):
    """Also where it goes to and fro; a jump of a sensor's zero and a plain motion are none."""
    true = period * (3.0 * np.sin(0.3 * TIME) if back else 0.2 * TIME)
    (one,) = wrapping(force=np.ones(len(TIME)), position=true % period)
    jumps = int(np.count_nonzero(np.diff(np.floor(true / period))))
    assert f"jumps {jumps} times by about {period:.4g} m" in one
    assert f"first {1 + np.flatnonzero(np.diff(np.floor(true / period)))[0]} rows" in one
    assert wrapping(force=np.ones(len(TIME)), position=true) == []
    small = period * (0.02 * np.sin(TIME) + (TIME > 10))
    assert wrapping(force=np.ones(len(TIME)), position=small) == []
    switched = np.sign(np.sin(3 * TIME)) + 0.01 * np.sin(TIME)
    assert wrapping(force=np.ones(len(TIME)), position=switched) == []


def test_a_heading_that_swings_about_its_end_wraps():
    true = np.pi + 0.3 * np.sin(TIME)
    shown = (true + np.pi) % (2 * np.pi) - np.pi
    (one,) = wrapping(get_model("pendulum"), "angle", torque=np.ones(len(TIME)), angle=shown)
    assert "by about 6.28" in one
    vehicle = get_model("pose_reaching")
    speeds = {"speed": np.ones(len(TIME)), "turn_rate": np.cos(TIME)}
    assert wrapping(vehicle, "heading", **speeds, heading=shown) == []  # which it takes within a turn


def test_a_counter_is_unwrapped_by_its_period(tmp_path):
    """0.001 m a count, 12 bits, backwards and forwards; each run goes on by itself, and gaps stay."""
    counts = np.round(9000.0 * np.sin(0.3 * TIME)).astype(int)
    run = (TIME > 12).astype(int)
    lines = ["t,episode,force,enc"] + [
        f"{t:.2f},{e},{np.sin(t):.4f},{c % 4096}" for t, e, c in zip(TIME, run, counts, strict=True)
    ]
    (tmp_path / "log.csv").write_text("\n".join(lines) + "\n")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read = load_recording(tmp_path / "log.csv", RIG, {"position": "-0.001*enc%4096+2:m"})
    for which in (0, 1):
        rows = run == which
        true = 2.0 - 1e-3 * counts[rows]
        whole = 4.096 * np.round((read["position"][rows][0] - true[0]) / 4.096)
        np.testing.assert_allclose(read["position"][rows], true + whole, atol=1e-9)
        assert read["position"][rows][0] == pytest.approx(2.0 - 1e-3 * (counts[rows][0] % 4096))
    with pytest.warns(RecordingWarning, match=r"'position=NAME%360:deg'"):
        load_recording(tmp_path / "log.csv", RIG, {"position": "0.001*enc:m"})
    shown = unwrapped(np.array([350.0, np.nan, 10.0, 20.0]), 360.0)
    np.testing.assert_array_equal(shown, [350.0, np.nan, 370.0, 380.0])
