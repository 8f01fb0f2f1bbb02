"""Spikes, stuck values, drop-outs and repeated rows: found, said with their rows, and counted nowhere."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from fieldagents.logs import Logs
from fieldmodels.diagnosis.problem import build
from fieldmodels.effects import actuator, friction, sensor
from fieldmodels.machine import Machine, number
from fieldmodels.model import Signal
from fieldmodels.recording import RecordingWarning
from fieldmodels.recording.files import load_recording
from fieldmodels.recording.lost import Sensor, lost_in
from fieldmodels.recording.resampling import evened
from fieldmodels.registry import get_model

RIG = get_model("rig")
STEP, COUNT = 0.02, 1000


class Motor(Machine):
    """A motor with a lag, and a load cell."""

    inputs = (Signal("voltage", "V"),)
    states = (Signal("speed", "rad/s"),)
    outputs = (Signal("speed", "rad/s", noise=0.02), Signal("force", "N", noise=0.02, optional=True))
    gain = number("rad/s/V", 1.0, 0.0, 1e3)
    time_constant = number("s", 0.1, 0.01, 10.0)
    effects = actuator("voltage") + friction("speed") + sensor("speed")

    def derivative(self, state, input, p):
        return (p.gain * input.voltage - state.speed) / p.time_constant

    def observe(self, state, p):
        return state.speed, 3.0 * state.speed


MOTOR = Motor()


def logged(seed=0, noise=0.02):
    """Columns of a motor that follows steps of 6 V."""
    rng = np.random.default_rng(seed)
    time = STEP * np.arange(COUNT)
    voltage = np.where((time > 1) & (np.floor(time) % 4 < 2), 6.0, -6.0) * (time > 1)
    speed = np.zeros(COUNT)
    for k in range(1, COUNT):
        speed[k] = speed[k - 1] + STEP * (voltage[k - 1] - speed[k - 1]) / 0.1
    return {
        "t": time,
        "voltage": voltage,
        "speed": speed + noise * rng.standard_normal(COUNT),
        "force": 3.0 * speed + noise * rng.standard_normal(COUNT),
    }


def written(path, columns):
    rows = np.column_stack([*columns.values()])
    np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="", fmt="%.5f")
    return path


def read(path, model=MOTOR):
    """A recording, and what was said of it."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        recording = load_recording(path, model)
    return recording, [str(w.message) for w in said if issubclass(w.category, RecordingWarning)]


def test_spikes_are_said_in_one_line_with_their_rows_and_counted_nowhere(tmp_path):
    columns = logged()
    columns["speed"][[10, 17, 31]] = 30.0
    columns["speed"][[501, 502]] = -12854.0  # two rows after a step
    recording, said = read(written(tmp_path / "log.csv", columns))
    assert len(said) == 1
    assert "column 'speed': spikes in rows 12, 19, 33 and 503 to 504 (5 rows)" in said[0]
    assert said[0].partition(": ")[2] in recording.notes
    assert np.abs(recording["speed"]).max() < 6.3
    clean, nothing = read(written(tmp_path / "log.csv", logged()))
    assert nothing == []
    problems = [build(MOTOR.scaled_to([r]), [r], 0.4) for r in (recording, clean)]
    [part] = problems[0].parts
    slots = part.slots[:, :, 0]
    rows = part.windows.starts[:, None] + np.arange(part.windows.samples)
    assert (slots[np.isin(rows, [10, 17, 31, 501, 502])] == -1).all()
    assert (slots >= 0).sum() == (problems[1].parts[0].slots[:, :, 0] >= 0).sum() - 5
    assert np.isnan(part.windows.measured(("speed", "force"))[:, :, 0]).sum() == 5


def test_what_stands_in_the_place_of_lost_samples_is_no_finer_than_the_sensor(tmp_path):
    columns = logged()
    columns["speed"] = 0.1 * np.round(columns["speed"] / 0.1)
    columns["speed"][300] = 99.0
    recording, said = read(written(tmp_path / "log.csv", columns))
    assert "row 302" in said[0]
    assert recording["speed"][300] in set(np.delete(recording["speed"], 300))


@pytest.mark.every(("value", "kind"), [(0.0, "drop-outs"), (-9999.0, "drop-outs"), (np.nan, "empty")])
@pytest.mark.every("first", [600, 650])  # where the motor turns round, and where it runs on
def test_a_sentinel_for_a_few_rows_is_a_drop_out(tmp_path, value, kind, first):
    columns = logged()
    columns["speed"][first : first + 12] = value
    path = written(tmp_path / "log.csv", columns)
    path.write_text(path.read_text().replace("nan", ""))
    recording, said = read(path)
    assert f"column 'speed': {kind} in rows {first + 2} to {first + 13} (12 rows)" in said[0]
    assert np.array_equal(np.flatnonzero(recording.lost["speed"]), np.arange(first, first + 12))


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_a_sensor_that_is_stuck_while_the_machine_moves(tmp_path, noise):
    columns = logged(noise=noise)
    time = columns["t"]
    for name in ("speed", "force"):
        columns[name] = np.sin(2.0 * time) + noise * np.random.default_rng(1).standard_normal(COUNT)
    columns["speed"][400:460] = columns["speed"][399]
    recording, said = read(written(tmp_path / "log.csv", columns))
    assert "column 'speed': stuck in rows 402 to 461 (60 rows)" in said[0]
    assert recording.lost["speed"].sum() == 60
    columns.pop("force")
    assert "stuck in rows 402 to 461" in read(written(tmp_path / "alone.csv", columns))[1][0]


def test_rows_that_a_logger_wrote_twice_are_read_once(tmp_path):
    columns = {name: np.insert(c, 520, c[500:520]) for name, c in logged().items()}
    recording, said = read(written(tmp_path / "log.csv", columns))
    assert [s.partition(": ")[2] for s in said] == [
        "repeats of earlier rows are left out: rows 522 to 541 (20 rows)"
    ]
    clean, _ = read(written(tmp_path / "clean.csv", logged()))
    assert np.array_equal(recording["speed"], clean["speed"])
    columns["t"][700:] -= 1.3 * STEP
    said = read(written(tmp_path / "back.csv", columns))[1]
    assert [s.rpartition("row")[2] for s in said if "the clock" in s] == [" 702"]  # the file's
    later = logged()
    for name in ("voltage", "speed", "force"):  # all but the clock
        later[name][[300, 301, 640]] = later[name][[299, 299, 639]]
    recording, said = read(written(tmp_path / "log.csv", later))
    assert "column 'speed': repeated in rows 302 to 303 and 642 (3 rows)" in said[0]
    assert "column 'force': repeated in rows 302 to 303 and 642 (3 rows)" in said[0]


def test_an_empty_command_is_held_and_one_without_a_time_refused(tmp_path):
    columns = logged()
    columns["voltage"][[0, 1, 700]] = np.nan
    path = written(tmp_path / "log.csv", columns)
    path.write_text(path.read_text().replace("nan", ""))
    recording, said = read(path)
    assert (
        "column 'voltage': empty in rows 2 to 3 and 702 (3 rows), where the command before is held" in said[0]
    )
    assert np.array_equal(recording["voltage"][[0, 700]], [0.0, recording["voltage"][699]])
    assert recording.lost == {}


def test_lost_samples_stay_lost_on_an_even_grid_and_among_several_rates(tmp_path):
    columns = logged()
    columns["speed"][301] = 500.0
    columns["t"] = columns["t"] + 0.3 * STEP * np.random.default_rng(0).random(COUNT)
    recording, said = read(written(tmp_path / "log.csv", columns))
    assert "time steps are uneven" in said[-1]
    at = np.flatnonzero(recording.lost["speed"])
    assert 1 <= len(at) <= 2
    assert np.abs(recording.time[at] - columns["t"][301]).max() < STEP
    again = evened(replace(recording, time=columns["t"][: len(recording)]), MOTOR)
    assert 1 <= again.lost["speed"].sum() <= 2
    slow = logged()
    slow["voltage"][1::2] = np.nan  # a column with a rate of its own
    slow["speed"][301] = 500.0
    path = written(tmp_path / "log.csv", slow)
    path.write_text(path.read_text().replace("nan", ""))
    recording, said = read(path)
    assert "spikes in row 303" in said[0]
    assert np.flatnonzero(recording.lost["speed"]).tolist() == [301]


def test_an_angle_is_no_spike_where_it_jumps_by_a_turn(tmp_path):
    drive = get_model("differential_drive")
    time = 0.05 * np.arange(COUNT)
    true = np.pi + 0.05 * np.random.default_rng(3).standard_normal(COUNT)  # to and fro over the end of a turn
    still = {"left_command": np.sin(time), "right_command": np.cos(time), "x": time, "y": time**1.1}
    columns = {"t": time, **still, "heading": (true + np.pi) % (2 * np.pi) - np.pi}
    assert not any("lost" in s for s in read(written(tmp_path / "log.csv", columns), drive)[1])
    columns["heading"][500] = 1.0
    recording, said = read(written(tmp_path / "log.csv", columns), drive)
    assert "column 'heading': spikes in row 502" in said[0]
    assert abs(abs(recording["heading"][500]) - np.pi) < 0.3


def hammered(time):
    """A blow of a hammer on a force sensor: some samples, a quiet baseline."""
    return np.where(np.abs(time - 5.0) < 0.05, np.cos(np.pi * (time - 5.0) / 0.1) ** 2 * 800.0, 0.0)


QUIET = np.random.default_rng(2).standard_normal(COUNT)
TIME = STEP * np.arange(COUNT)
REAL = {
    "noise": (QUIET, True),
    "noise with heavy tails": (np.random.default_rng(2).laplace(size=COUNT), True),
    "an encoder that rests": (np.round(20 * np.maximum(np.sin(TIME), 0.0)), True),
    "an encoder that dithers at rest": (np.round(20 * np.maximum(np.sin(TIME), 0.0)) + (QUIET > 2.5), True),
    "a simulated rest": (np.where(np.sin(TIME) > 0, np.sin(9 * TIME), 0.0), True),
    "a blow of some samples": (hammered(TIME) + QUIET, True),
    "a blow of one sample": (np.where(np.arange(COUNT) == 500, 800.0, QUIET), False),
    "a current that rushes in": (20.0 * np.exp(-((TIME % 4.0) / 0.06)) + 0.05 * QUIET, True),
    "a sensor slower than the log": (np.repeat(np.sin(TIME[::20]), 20), True),
    "saturation": (np.clip(np.sin(TIME) + 1e-3 * QUIET, -0.8, 0.8), True),
    "a limit switch": ((np.sin(TIME) > 0.99).astype(float), True),
    "steps of a slow machine": (np.repeat(np.random.default_rng(0).standard_normal(50), 20), True),
}


@pytest.mark.every("what", REAL)
def test_what_may_be_real_is_kept(what):
    values, inert = REAL[what]
    assert lost_in({"y": Sensor(values, TIME, np.zeros(COUNT), inert)}, [], True) == {}


def test_a_response_to_a_pulse_is_kept_and_what_is_beyond_all_is_not():
    speed = np.random.default_rng(0).standard_normal(COUNT)
    speed[500] = 200.0
    pulse = (np.arange(COUNT) == 499).astype(float)
    sensors = {"y": Sensor(speed, TIME, np.zeros(COUNT), True)}
    assert lost_in(sensors, [pulse], True)["y"]["spikes"].tolist() == [500]
    speed[500] = 40.0
    assert lost_in(sensors, [pulse], True) == {}
    assert lost_in(sensors, [], True)["y"]["spikes"].tolist() == [500]


def test_no_command_is_ever_said_to_be_lost(tmp_path):
    columns = logged()
    columns["voltage"][[200, 400]] = 1e6
    columns["voltage"][600:620] = 0.0
    assert not any("lost" in s for s in read(written(tmp_path / "log.csv", columns))[1])


def test_uneven_steps_of_many_files_are_said_once(tmp_path):
    rng = np.random.default_rng(0)
    paths = []
    for k in range(5):
        columns = logged(seed=k)
        columns["t"] = columns["t"] + 0.3 * STEP * rng.random(COUNT)
        if k == 3:
            columns["speed"][300] = 99.0
        paths.append(str(written(tmp_path / f"run{k}.csv", columns)))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        recordings = Logs(MOTOR).read_all(paths)
    said = [str(w.message) for w in caught]
    assert len(recordings) == 5
    uneven = [s for s in said if "time steps are uneven" in s]
    assert len(uneven) == 1
    assert uneven[0].startswith(f"{paths[0]} and 4 more files: time steps are uneven")
    assert [s for s in said if "spikes in row 302" in s and s.startswith(f"{paths[3]}: ")]
