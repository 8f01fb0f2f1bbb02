"""Logs of flight controllers, LabVIEW, robots and buses are read to what was measured, by names and units."""

import re
import sqlite3
import sys
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from expected import Expected, errors, made, read
from formats import dataflash, ulog
from outsiders import unitree

from fieldmodels.recording import RecordingError
from fieldmodels.recording.sources import read_log
from fieldmodels.recording.tables import Series, SeriesTable
from fieldmodels.recording.units import canonical

LOGS = ("px4_yaw", "px4_rover", "ardupilot", "mavlink", "tdms", "wpilog", "can_trace", "sqlite")
REFUSED = ("matlab_dataset", "matlab_timeseries", "betaflight_raw")


def written(name: str, folder: Path) -> Expected:
    try:
        return made(name, folder)
    except ImportError as error:
        pytest.skip(f"{name} is written by a library that is missing: {error.name}")


@pytest.mark.parametrize("name", LOGS)
def test_a_log_is_read_as_it_was_measured(tmp_path, name):
    told = written(name, tmp_path)
    table, recording = read(told)
    for column in told.columns.values():
        own, _, unit = column.rpartition(":")
        assert own in table.numbers()
        assert canonical(table.units.get(own, "")) == canonical(unit), own
    assert set(recording.signals) >= set(told.run.signals)  # a gyro is a velocity beside them
    assert recording.step == pytest.approx(np.median(np.diff(told.run.time)), rel=1e-3)
    assert {name: error for name, error in errors(told, recording).items() if error > 0.05} == {}


def test_units_of_px4_are_those_of_its_messages_and_instances_have_numbers(tmp_path, capsys):
    pytest.importorskip("pyulog")
    rates, sticks = ("float roll;float yaw;", np.arange(9) / 10, [0.1, 0.2]), [0.5, 0.5]
    path = ulog(tmp_path / "log.ulg", {
        "vehicle_rates_setpoint": rates,
        "manual_control_setpoint": ("float roll;float yaw;", np.arange(9) / 10, sticks),
        "sensor_combined": ("float[3] gyro_rad;float[3] accelerometer_m_s2;", np.arange(9) / 10, [0.0] * 6),
    })  # fmt: skip
    whole = path.read_bytes().replace(b"\x00\x01\x00manual_control", b"\x01\x01\x00manual_control")
    path.write_bytes(whole.replace(b"\x01\x12\x35\x01", b"\x01\x12\x35\x09", 1))
    table = read_log(path)
    assert capsys.readouterr().out == ""  # of an unknown version the library prints a warning
    assert table.units["vehicle_rates_setpoint.roll"] == "rad/s"
    assert table.units["sensor_combined.gyro_rad[2]"] == "rad/s"
    assert table.units["sensor_combined.accelerometer_m_s2[0]"] == "m/s^2"
    assert "manual_control_setpoint[1].roll" not in table.units  # a stick, from -1 to 1
    assert table.clocks["manual_control_setpoint[1].roll"] == "manual_control_setpoint[1].timestamp"


def test_an_older_dataflash_log_states_no_units_and_a_cut_message_is_left_out(tmp_path):
    pytest.importorskip("pymavlink")
    rows = [("IMU", 1000 * k, k % 2, 10 + k) for k in range(6)]
    rows += [("RCIN", 1000 * k, 150 * k) for k in range(5)]
    formats = {
        "RCIN": (70, "Qc", "TimeUS,Tilt", "sd", "FB"),
        "IMU": (68, "QBf", "TimeUS,I,GyrX", "s#E", "F-0"),
    }
    path = dataflash(tmp_path / "log.bin", formats, rows)
    np.testing.assert_array_equal(read_log(path)["IMU[1].GyrX"], [11, 13, 15])
    path.write_bytes(path.read_bytes().replace(b"FMTU", b"USER")[:-1])
    table = read_log(path)
    np.testing.assert_allclose(table["RCIN.Tilt"], 1.5 * np.arange(4))
    assert (canonical(table.units["RCIN.TimeUS"]), table.units.get("RCIN.Tilt")) == ("us", None)


def test_telemetry_with_garbage_gives_the_rest_and_a_second_sender_is_told_apart(tmp_path):
    told = written("mavlink", tmp_path)
    path = tmp_path / "cut.tlog"
    whole = Path(told.source).read_bytes()
    path.write_bytes(whole[:9000] + b"\xfd\xfe\x00\x01" + whole[9000:-3])
    rolls, cut = read_log(told.source)["ATTITUDE.roll"], read_log(path)["ATTITUDE.roll"]
    assert len(rolls) - 3 < len(cut) < len(rolls)
    assert set(cut) <= set(rolls)
    table = read_log(told.source)
    assert set(table["HEARTBEAT.system_status"]) == {4}
    assert set(table["255.0/HEARTBEAT.type"]) == {6}


def test_tdms_groups_begin_when_they_say_and_channels_of_times_are_clocks(tmp_path):
    nptdms, start = pytest.importorskip("nptdms"), datetime(2026, 11, 22, 10)
    wave = [
        {"wf_increment": 0.1, "wf_start_offset": 0.0, "wf_start_time": start + timedelta(seconds=s)}
        for s in (0, 3)
    ]
    with nptdms.TdmsWriter(tmp_path / "log.tdms") as file:
        file.write_segment([
            nptdms.ChannelObject("A", "u", np.zeros(5), wave[0]),
            nptdms.ChannelObject("B", "y", np.zeros(6), wave[1]),
            nptdms.ChannelObject("C", "Time", np.arange(7.0)),
            nptdms.ChannelObject("C", "w", np.arange(7.0)),
            nptdms.ChannelObject("C", "note", ["a", "b"]),
        ])  # fmt: skip
    table = read_log(tmp_path / "log.tdms")
    np.testing.assert_allclose(table["B.t"], 3 + 0.1 * np.arange(6))
    assert (table.clocks["A.u"], table.clocks["B.y"]) == ("A.t", "B.t")
    assert "C.note" not in table.header
    assert table.clocks["C.w"] == "C.Time"


def test_wpilib_records_are_those_of_the_specification(tmp_path):
    """The examples of https://github.com/wpilibsuite/allwpilib/blob/main/wpiutil/doc/datalog.adoc."""
    head = b"WPILOG" + bytes([0, 1, 3, 0, 0, 0]) + b"own"
    start = bytes.fromhex("20 00 1a 40420f 00 01000000 04000000") + b"test" + b"\5\0\0\0int64" + bytes(4)
    data = bytes.fromhex("20 01 08 40420f 03") + bytes(7)
    later = bytes.fromhex("30 01 08 40420f01 ff") + b"\xff" * 7
    (tmp_path / "log").write_bytes(head + start + data + later + data[:-1])
    table = read_log(tmp_path / "log")
    assert table.header == ("test.timestamp", "test")
    np.testing.assert_array_equal(table["test"], [3, -1])
    np.testing.assert_array_equal(table["test.timestamp"], [1_000_000, 1_000_000 + (1 << 24)])


def test_wpilib_arrays_integers_and_units_in_words(tmp_path):
    wpilib = pytest.importorskip("wpiutil.log")
    file = pytest.importorskip("wpiutil").DataLogWriter(str(tmp_path / "log.wpilog"), "")
    arrays, counts = (
        wpilib.DoubleArrayLogEntry(file, "q", "Radian", 1),
        wpilib.IntegerLogEntry(file, "n", "", 1),
    )
    rates = wpilib.FloatLogEntry(file, "turret/rate", "Rotation per Second", 1)
    for k in range(300):
        arrays.append([k, -k], 1 << k % 40)
        counts.append(k - 5, 1000 * k + 1)
        rates.append(0.5, 1000 * k + 1)
    file.flush()
    file.stop()
    path = tmp_path / "log.wpilog"
    path.write_bytes(path.read_bytes()[:-2])
    table = read_log(path)
    assert (table.units["q[1]"], table.units["turret/rate"], table.units.get("n")) == ("rad", "rev/s", None)
    np.testing.assert_array_equal(table["q[1]"], -np.arange(300))
    np.testing.assert_array_equal(table["q.timestamp"], 1 << np.arange(300) % 40)
    np.testing.assert_array_equal(table["n"], np.arange(300) - 5)
    assert len(table["turret/rate"]) == 299


def test_a_trace_takes_the_one_dbc_beside_it_and_asks_for_one_otherwise(tmp_path):
    can = pytest.importorskip("can")
    told = written("can_trace", tmp_path)
    trace, dbc = told.source.split("+")
    speeds = read_log(told.source)["Encoder.Speed"]
    np.testing.assert_array_equal(read_log(trace)["Encoder.Speed"], speeds)
    for ending in (".asc", ".blf", ".mf4"):
        with can.CanutilsLogReader(trace) as frames, can.Logger(tmp_path / f"trace{ending}") as copy:
            for frame in frames:
                copy(frame)
        found = read_log(f"{tmp_path / f'trace{ending}'}+{dbc}")
        np.testing.assert_array_equal(found["Encoder.Speed"], speeds)
        if ending != ".mf4":  # which has columns of its own
            with pytest.raises(
                RecordingError, match=rf"no such file lies beside it: give both as .*{ending}\+"
            ):
                read_log(tmp_path / f"trace{ending}")
    with pytest.raises(RecordingError, match="give it with its trace"):
        read_log(dbc)
    Path(dbc).with_name("other.dbc").write_text(Path(dbc).read_text().replace("BO_ 25", "BO_ 35"))
    with pytest.raises(RecordingError, match="2 such files"):
        read_log(trace)
    with pytest.raises(RecordingError, match="no message of it is in"):
        read_log(f"{trace}+{Path(dbc).with_name('other.dbc')}")


@pytest.mark.parametrize("name", REFUSED)
def test_a_refusal_names_a_remedy_and_what_follows_from_it_is_read(tmp_path, name):
    told = written(name, tmp_path)
    with pytest.raises(RecordingError) as caught:
        read_log(told.source)
    assert all(re.search(pattern, str(caught.value)) for pattern in told.refused), caught.value
    table, recording = read(replace(told, source=told.remedy))
    assert {column.rpartition(":")[0] for column in told.columns.values()} <= set(table.numbers())
    assert {name: error for name, error in errors(told, recording).items() if error > 0.05} == {}


def test_arrays_beside_an_object_of_matlab_are_read_and_the_object_is_noted(tmp_path):
    h5py = pytest.importorskip("h5py")
    told = written("matlab_dataset", tmp_path)
    with h5py.File(told.source, "r+") as file:
        file["torque"] = np.arange(9.0)
    table = read_log(told.source)
    assert table.header == ("torque",)
    assert table.notes == ("logsout is a Simulink.SimulationData.Dataset, an object, and is left out",)


def test_tables_of_sqlite_have_their_names_and_what_is_no_number_is_left_aside(tmp_path):
    with sqlite3.connect(tmp_path / "log?.db") as base:
        base.execute('create table "a b" (t real, x integer, note text, raw blob)')
        base.execute("create table other (t real, y real)")
        base.executemany(
            'insert into "a b" values (?, ?, ?, ?)', [(k / 10, k or None, "on", b"a") for k in range(5)]
        )
        base.executemany("insert into other values (?, ?)", [(k / 10, k) for k in range(9)])
    table = read_log(tmp_path / "log?.db")
    np.testing.assert_array_equal(table["a b.x"], [np.nan, 1, 2, 3, 4])
    assert (table.clocks["a b.x"], table.clocks["other.y"]) == ("a b.t", "other.t")
    assert "a b.raw" not in table.header


@pytest.mark.parametrize(
    ("name", "tool"), [("a.hoot", "owlet a.hoot"), ("b.PKL", "may run code"), ("c.xyz", "CSV or Parquet")]
)
def test_a_binary_that_none_reads_is_refused_with_the_tool_that_does(tmp_path, name, tool):
    (tmp_path / name).write_bytes(bytes(range(256)) * 9)
    with pytest.raises(RecordingError, match=tool):
        read_log(tmp_path / name)


def test_a_column_of_any_format_may_end_in_its_unit_and_a_joint_in_brackets_is_none(tmp_path):
    series = {name: Series.of(np.arange(3.0)) for name in ("/rig/position_mm", "/arm.q[lift]", "temp_in")}
    assert SeriesTable(tmp_path, series).units == {"/rig/position_mm": "mm"}


def test_numbered_runs_of_hdf5_are_episodes_in_their_order(tmp_path):
    """Of a run's states there may be one more than of its actions; what is shorter belongs to no row."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "log.h5", "w") as file:
        for k, rows in ((0, 5), (10, 7), (2, 6)):
            file[f"traj_{k}/obs"] = np.arange(rows + 1.0)
            file[f"traj_{k}/actions"] = np.full((rows, 2), float(k))
            file[f"traj_{k}/gains"] = np.ones(3)
    table = read_log(tmp_path / "log.h5")
    assert table.header == ("actions[1]", "actions[2]", "obs", "episode")
    assert table["obs"].tolist() == [*range(5), *range(6), *range(7)]
    assert table["actions[2]"].tolist() == [0.0] * 5 + [2.0] * 6 + [10.0] * 7
    assert table["episode"].tolist() == [1.0] * 5 + [2.0] * 6 + [3.0] * 7


def test_messages_of_a_bag_that_are_no_ros_are_refused_with_lines_that_make_a_table(tmp_path):
    told = unitree(tmp_path)
    bag = next(Path(told.source).glob("*.mcap"))
    (tmp_path / "log.mcap").write_bytes(bag.read_bytes().replace(b"ros2", b"json", 1))
    with pytest.raises(RecordingError, match=r"(?s)messages are not ROS 2's.*mcap.reader"):
        read_log(tmp_path / "log.mcap")
